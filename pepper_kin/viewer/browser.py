"""Chromium: its program, and the flags for rendering without a screen."""

from __future__ import annotations

import os
import shutil

from pepper_kin.exceptions import InvalidValueError

CHROMIUM_VARIABLE = "PEPPER_KIN_CHROMIUM"
"""Environment variable with the browser's program, which precedes the programs found by name."""

PROGRAM_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")

# Software rendering on the processor: the same image on every machine, with or without a graphics card.
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


def find_chromium() -> str | None:
    """Return the path of a Chromium or Chrome program, or None.

    The variable PEPPER_KIN_CHROMIUM comes first, then the usual names on the search path.

    Raises:
        InvalidValueError: PEPPER_KIN_CHROMIUM is not the path of a program.
    """
    named = os.environ.get(CHROMIUM_VARIABLE)
    if named:
        found = shutil.which(named)
        if found is None:
            raise InvalidValueError(CHROMIUM_VARIABLE, repr(named), "the path of a Chromium program")
        return found
    return next((found for found in map(shutil.which, PROGRAM_NAMES) if found), None)
