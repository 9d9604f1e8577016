"""Pictures by a browser, and what is said when there is no browser."""

import sys

import numpy as np
import pytest
from PIL import Image

from pepper_kin.exceptions import (
    InfeasibleError,
    InvalidValueError,
    MissingDependencyError,
    UnknownNameError,
)
from pepper_kin.viewer import find_chromium, save_motion_page, screenshot


@pytest.fixture
def page(machine, tmp_path):
    return save_motion_page(
        machine.drawables, machine.links, machine.times, machine.poses, tmp_path / "motion.html", title="x"
    )


def red_center(path):
    """Middle of the red pixels, as column and row."""
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)
    rows, columns = np.nonzero((pixels[..., 0] > 2 * pixels[..., 1]) & (pixels[..., 0] > 60))
    return columns.mean(), rows.mean()


@pytest.mark.thorough
@pytest.mark.browser
def test_pictures_show_the_chosen_time_and_repeat_to_the_pixel(chromium_path, page, tmp_path):
    early = screenshot(page, tmp_path / "early.png", (320, 240), 0.0, view="front")
    late = screenshot(page, tmp_path / "late.png", (320, 240), 2.0, view="front")
    again = screenshot(page, tmp_path / "again.png", (320, 240), 0.0, view="front")
    assert Image.open(early).size == (320, 240)
    whole = screenshot(page, tmp_path / "whole.png", (640, 480), 0.0, view="front", panel=True)
    assert Image.open(whole).size == (640, 480)
    panel = np.asarray(Image.open(whole).convert("RGB"))[-90:]  # the slider and the button are blue
    assert ((panel[..., 2].astype(int) - panel[..., 0]) > 150).any()
    np.testing.assert_array_equal(np.asarray(Image.open(early)), np.asarray(Image.open(again)))
    # Seen from the front, the robot's left (+y) is on the right; the cube slides from -y to +y.
    assert red_center(early)[0] < 140
    assert red_center(late)[0] > 180
    assert abs(red_center(early)[1] - red_center(late)[1]) < 3


def test_without_a_chromium_the_message_says_how_to_get_one(page, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("PEPPER_KIN_CHROMIUM", raising=False)
    assert find_chromium() is None
    with pytest.raises(MissingDependencyError, match=r"needs 'chromium'.*apt-get install chromium"):
        screenshot(page, tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()


def test_the_environment_names_the_browser(monkeypatch):
    monkeypatch.setenv("PEPPER_KIN_CHROMIUM", sys.executable)
    assert find_chromium() == sys.executable
    monkeypatch.setenv("PEPPER_KIN_CHROMIUM", "/no/such/browser")
    with pytest.raises(InvalidValueError, match="PEPPER_KIN_CHROMIUM: got '/no/such/browser'"):
        find_chromium()


@pytest.mark.parametrize(
    ("script", "timeout", "message"),
    [
        ("exit 3", 60.0, "ended with code 3"),
        ("exit 0", 60.0, "ended with code 0"),
        ("exec sleep 30", 1.0, "did not answer in 1 s"),
    ],
)
def test_a_browser_that_fails_leaves_no_picture(page, tmp_path, monkeypatch, script, timeout, message):
    program = tmp_path / "browser"
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PEPPER_KIN_CHROMIUM", str(program))
    with pytest.raises(InfeasibleError, match=f"no picture: the browser .*{message}"):
        screenshot(page, tmp_path / "a.png", timeout=timeout)
    assert sorted(item.name for item in tmp_path.iterdir()) == ["browser", "motion.html"]


def test_bad_arguments_are_refused_by_name(page, tmp_path):
    for changes, error, message in [
        ({"html_path": "nowhere.html"}, InvalidValueError, "html_path: got nowhere.html"),
        ({"size": (0, 100)}, InvalidValueError, r"size: got \(0, 100\)"),
        ({"at_time": float("nan")}, InvalidValueError, "at_time: got nan"),
        ({"view": "below"}, UnknownNameError, "unknown camera view 'below'; available: three-quarter, front"),
    ]:
        with pytest.raises(error, match=message):
            screenshot(**({"html_path": page, "png_path": tmp_path / "a.png"} | changes))
