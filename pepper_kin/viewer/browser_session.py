"""Images of a page from a headless Chromium, controlled through a pair of pipes."""

from __future__ import annotations

import base64
import contextlib
import json
import math
import os
import select
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.parse import urlencode

from pepper_kin.exceptions import InfeasibleError, InvalidValueError, MissingDependencyError
from pepper_kin.file_access import atomic_file
from pepper_kin.viewer.browser import CHROMIUM_FLAGS, find_chromium
from pepper_kin.viewer.camera import CameraView, Viewpoint, view_options

_ADVICE = "open the page by hand to see why"
# Rendered and read in one call, with no frame of the browser in between: same time, same pixels.
_CAPTURE = """(() => {
  pepperKin.pause();
  pepperKin.seek(%r);
  const viewer = pepperKin.viewer;
  viewer.scene.updateMatrixWorld(true);
  viewer.render();
  return viewer.renderer.domElement.toDataURL("image/png");
})()"""


class BrowserSession:
    """A browser with one open page, for the time of a `with` block.

        with BrowserSession("motion.html", (640, 480)) as session:
            png = session.picture(0.5)

    It is controlled by the Chrome DevTools Protocol over two pipes: no port is opened.

    Args:
        html_path: Page that `save_motion_page` has written.
        size: Width and height of the images [pixel].
        view: View: "three-quarter", "front", "side" or "top", or a `Viewpoint`.
        panel: Whether title, controls and plots are visible.
        timeout: Timeout of each answer of the browser [s].

    Raises:
        MissingDependencyError: No Chromium is installed.
        InfeasibleError: The browser does not start, does not answer, or the page fails.
    """

    def __init__(
        self,
        html_path: str | Path,
        size: tuple[int, int],
        *,
        view: CameraView | Viewpoint = "three-quarter",
        panel: bool = False,
        timeout: float = 60.0,
    ) -> None:
        options = {"panel": str(int(panel))} | view_options(view)
        self._address = f"{Path(html_path).resolve().as_uri()}#{urlencode(options)}"
        self._size, self._timeout = size, timeout
        self._count, self._received, self._session = 0, b"", ""

    def __enter__(self) -> BrowserSession:
        chromium = find_chromium()
        if chromium is None:
            raise MissingDependencyError("chromium", "apt-get install chromium", "a picture of a page")
        try:
            with _uninterrupted():
                self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
                self._start(chromium)
            self._open()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def picture(self, at_time: float) -> bytes:
        """Return the page's image at a time of its motion [s], as PNG."""
        found = self._evaluate(_CAPTURE % float(at_time))
        return base64.b64decode(str(found).partition(",")[2])

    def whole_picture(self, at_time: float) -> bytes:
        """Return an image of the whole page, with its panels, at a time of its motion [s], as PNG."""
        self.picture(at_time)
        return base64.b64decode(self._ask("Page.captureScreenshot")["data"])

    def span(self) -> tuple[float, float]:
        """Return the times of the motion's first and last frame [s]."""
        start, duration = self._evaluate("pepperKin.seek(-1e9), [pepperKin.time, pepperKin.duration]")
        return float(start), float(start) + float(duration)

    def close(self) -> None:
        """Stop the browser."""
        if not hasattr(self, "_browser"):
            return  # the browser was not started
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._browser.pid, signal.SIGKILL)  # helper processes, too, which write files
        self._browser.wait()
        for pipe in (self._browser.stdin, self._browser.stdout):
            if pipe is not None:
                pipe.close()
        self._profile.cleanup()
        deadline = time.monotonic() + 10.0
        while os.path.exists(self._profile.name) and time.monotonic() < deadline:
            time.sleep(0.02)  # a helper process may have been writing when it was killed
            shutil.rmtree(self._profile.name, ignore_errors=True)

    def _start(self, chromium: str) -> None:
        """Start the browser, which reads commands from its file descriptor 3 and writes answers to 4."""
        # The shell only moves the two pipes from descriptors 0 and 1 to 3 and 4.
        moved = 'exec "$@" 3<&0 4>&1 </dev/null >/dev/null'
        flags = (*CHROMIUM_FLAGS, "--remote-debugging-pipe", f"--user-data-dir={self._profile.name}")
        self._browser = subprocess.Popen(
            ["sh", "-c", moved, "sh", chromium, *flags, f"--window-size={self._size[0]},{self._size[1]}"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            env={**os.environ, "TMPDIR": self._profile.name},  # its leftovers are deleted with the profile
            start_new_session=True,  # Ctrl-C goes to this process alone, which stops the browser
        )
        pipes = (self._browser.stdin, self._browser.stdout)
        self._to_browser, self._from_browser = (pipe.fileno() for pipe in pipes if pipe is not None)

    def _open(self) -> None:
        """Open the page in a new tab, and wait until it is ready."""
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        width, height = self._size
        self._ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        self._ask("Page.navigate", url=self._address)
        deadline = time.monotonic() + self._timeout
        while not self._evaluate("document.readyState === 'complete' && typeof pepperKin === 'object'"):
            if time.monotonic() > deadline:
                raise InfeasibleError("picture", f"the page was not ready in {self._timeout:g} s", _ADVICE)
            time.sleep(0.02)

    def _evaluate(self, expression: str) -> Any:
        answer = self._ask("Runtime.evaluate", expression=expression, returnByValue=True)
        if "exceptionDetails" in answer:
            description = answer["exceptionDetails"].get("exception", {}).get("description", "no message")
            raise InfeasibleError("picture", f"the page failed: {description.splitlines()[0]}", _ADVICE)
        return answer["result"].get("value")

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command and wait for its answer; discard other messages."""
        self._count += 1
        command = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            command["sessionId"] = self._session
        try:
            os.write(self._to_browser, json.dumps(command).encode() + b"\0")
        except BrokenPipeError as error:
            raise self._ended() from error
        deadline = time.monotonic() + self._timeout
        while True:
            message = json.loads(self._next_message(deadline))
            if message.get("id") != self._count:
                continue
            if "error" in message:
                raise InfeasibleError(
                    "picture", f"the browser refused: {message['error']['message']}", _ADVICE
                )
            answer: dict[str, Any] = message["result"]
            return answer

    def _ended(self) -> InfeasibleError:
        code = self._browser.wait(self._timeout)
        return InfeasibleError("picture", f"the browser ended with code {code}", _ADVICE)

    def _next_message(self, deadline: float) -> bytes:
        """Return the browser's next message; raise if none comes before the deadline."""
        parts = [self._received]
        while b"\0" not in parts[-1]:
            left = deadline - time.monotonic()
            if left <= 0 or not select.select([self._from_browser], [], [], left)[0]:
                raise InfeasibleError(
                    "picture", f"the browser did not answer in {self._timeout:g} s", "pass a larger timeout"
                )
            part = os.read(self._from_browser, 1 << 20)
            if not part:
                raise self._ended()
            parts.append(part)
        message, _, self._received = b"".join(parts).partition(b"\0")
        return message


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
    """Save an image of a motion page.

    Args:
        html_path: Page that `save_motion_page` has written.
        png_path: Image file to write; it appears when it is complete.
        size: Width and height [pixel].
        at_time: Time of the motion to show [s]; None shows its start.
        view: View: "three-quarter", "front", "side" or "top", or a `Viewpoint`.
        panel: Whether title, controls and plots are in the image.
        timeout: Timeout of each answer of the browser [s].

    Returns:
        The path of the image.

    Raises:
        MissingDependencyError: No Chromium is installed.
        InvalidValueError: The page does not exist, or the size is not two positive whole numbers.
        UnknownNameError: for an unknown view.
        InfeasibleError: The browser rendered no image.
        FileFormatError: The image cannot be written.
    """
    if not Path(html_path).is_file():
        raise InvalidValueError("html_path", html_path, "an existing page")
    if len(size) != 2 or not all(isinstance(length, int) and 0 < length <= 8192 for length in size):
        raise InvalidValueError("size", size, "width and height in pixels, each in 1 ... 8192")
    if at_time is not None and not math.isfinite(at_time):
        raise InvalidValueError("at_time", at_time, "a finite time [s]")
    with BrowserSession(html_path, size, view=view, panel=panel, timeout=timeout) as session:
        time = session.span()[0] if at_time is None else at_time
        picture = session.whole_picture(time) if panel else session.picture(time)
    return atomic_file.write_bytes(png_path, picture)


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Block Ctrl-C until a started process is recorded and can be stopped."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
