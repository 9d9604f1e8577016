"""Fixtures that several rooms share: the system's Chromium."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from pepper_kin.viewer import find_chromium
from pepper_kin.viewer.browser import CHROMIUM_FLAGS


@pytest.fixture(scope="session")
def chromium_path() -> str:
    """Path of a Chromium; without one the test is skipped on a bare machine and fails where CI=true."""
    path = find_chromium()
    if path is not None:
        return path
    message = "no Chromium found: browser tests need one (apt-get install chromium)"
    if os.environ.get("CI") == "true":
        pytest.fail(message)
    pytest.skip(message)


@pytest.fixture(scope="session")
def browser(chromium_path: str) -> Iterator[object]:
    """A headless Chromium, driven by playwright."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = [flag for flag in CHROMIUM_FLAGS if flag != "--headless"]
        chromium = playwright.chromium.launch(executable_path=chromium_path, args=arguments)
        yield chromium
        chromium.close()
