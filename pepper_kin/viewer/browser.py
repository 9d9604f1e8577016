"""Pictures of pages by headless Chromium, through its command line alone."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from urllib.parse import urlencode

from pepper_kin.exceptions import InfeasibleError, InvalidValueError, MissingDependencyError
from pepper_kin.file_access import atomic_file
from pepper_kin.viewer.camera import CameraView, Viewpoint, view_options

CHROMIUM_VARIABLE = "PEPPER_KIN_CHROMIUM"
"""Environment variable that names the browser's program, before any that is found by name."""

PROGRAM_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")

# Software rendering on the processor: the same picture on every machine, with or without a graphics card.
CHROMIUM_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
)
# Virtual time: the page draws as soon as it is loaded, so a short while is enough on any machine.
_PAGE_MILLISECONDS = 1000


def find_chromium() -> str | None:
    """Return the path of a Chromium or Chrome program, or None.

    The variable PEPPER_KIN_CHROMIUM comes first, then the usual names on the search path.

    Raises:
        InvalidValueError: PEPPER_KIN_CHROMIUM is set to something that is not a program.
    """
    named = os.environ.get(CHROMIUM_VARIABLE)
    if named:
        found = shutil.which(named)
        if found is None:
            raise InvalidValueError(CHROMIUM_VARIABLE, repr(named), "the path of a Chromium program")
        return found
    return next((found for found in map(shutil.which, PROGRAM_NAMES) if found), None)


def screenshot(
    html_path: str | Path,
    png_path: str | Path,
    size: tuple[int, int] = (1280, 800),
    at_time: float | None = None,
    *,
    view: CameraView | Viewpoint = "three-quarter",
    panel: bool = False,
    timeout: float = 120.0,
) -> Path:
    """Save a picture of a motion page.

    Args:
        html_path: A page as written by `save_motion_page`.
        png_path: The picture to write; it appears when it is whole.
        size: Width and height [pixel].
        at_time: Time of the motion to show [s]; None shows its start.
        view: "three-quarter", "front", "side" or "top", or a `Viewpoint`.
        panel: Whether title, controls and plots are in the picture.
        timeout: Longest wait for the browser [s].

    Returns:
        The path of the picture.

    Raises:
        MissingDependencyError: No Chromium is installed.
        InvalidValueError: The page does not exist, or the size is not two positive whole numbers.
        UnknownNameError: There is no such view.
        InfeasibleError: The browser gave no picture.
        FileFormatError: The picture cannot be written.
    """
    page = Path(html_path).resolve()
    if not page.is_file():
        raise InvalidValueError("html_path", html_path, "an existing page")
    if len(size) != 2 or not all(isinstance(length, int) and 0 < length <= 8192 for length in size):
        raise InvalidValueError("size", size, "width and height in pixels, each in 1 ... 8192")
    shown = view_options(view)
    if at_time is not None and not math.isfinite(at_time):
        raise InvalidValueError("at_time", at_time, "a finite time [s]")
    chromium = find_chromium()
    if chromium is None:
        raise MissingDependencyError("chromium", "apt-get install chromium", "a picture of a page")
    options = shown | {"panel": str(int(panel))} | ({} if at_time is None else {"t": repr(float(at_time))})
    with tempfile.TemporaryDirectory() as profile:
        picture = Path(profile) / "picture.png"
        command = [
            chromium,
            *CHROMIUM_FLAGS,
            f"--user-data-dir={profile}",
            f"--window-size={size[0]},{size[1]}",
            f"--virtual-time-budget={_PAGE_MILLISECONDS}",
            f"--screenshot={picture}",
            f"{page.as_uri()}#{urlencode(options)}",
        ]
        _run(command, timeout)
        if not picture.is_file():
            raise InfeasibleError("picture", "the browser wrote nothing", "open the page by hand to see why")
        return atomic_file.write_bytes(png_path, picture.read_bytes())


def _run(command: list[str], timeout: float) -> None:
    """Run the browser and turn its failures into errors with advice."""
    try:
        done = subprocess.run(command, capture_output=True, timeout=timeout, check=False)
    except subprocess.TimeoutExpired as error:
        raise InfeasibleError(
            "picture", f"the browser took longer than {timeout:g} s", "pass a larger timeout"
        ) from error
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
        raise InfeasibleError(
            "picture",
            f"the browser ended with code {done.returncode}: {last[0]}",
            "open the page by hand to see why",
        )
