"""Figures of the page on validation are those of a run."""

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "validation.md"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]\d+)?")
ROUNDING = 1e-8
"""Below this a figure is rounding, which depends on processor and libraries."""
MORE = 30.0
"""So many times more or less rounding there may be."""


def parts(monkeypatch, tmp_path):
    """Return what the page says that the check commands find, and what they find now."""
    spec = importlib.util.spec_from_file_location("make_validation", ROOT / "docs" / "make_validation.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    monkeypatch.setattr(script, "FOLDER", tmp_path)
    (tmp_path / "pictures").mkdir()
    page = PAGE.read_text("utf-8")
    return page[page.index(script.HEAD[:40]) :], script.checks()


def differences(page, run):
    """Return the figures that differ by more than their last digit, or by much of rounding, in words."""
    rules = re.compile(r"[-=─━]{4,}|^Python .*$", re.MULTILINE)
    lines, again = (rules.sub("", text).splitlines() for text in (page, run))
    assert len(lines) == len(again)
    found = []
    for one, other in zip(lines, again, strict=True):
        was, now = NUMBER.findall(one), NUMBER.findall(other)
        if len(was) != len(now):
            found.append(f"{one!r} is now {other!r}")
        for a, b in zip(was, now, strict=False):
            x, y = abs(float(a)), abs(float(b))
            mantissa, _, power = a.partition("e")
            digit = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
            rounding = max(x, y) < ROUNDING and x < MORE * y + 1e-16 and y < MORE * x + 1e-16
            if not rounding and abs(float(a) - float(b)) > max(2.0 * digit, 0.05 * x):
                found.append(f"{a} is now {b} in {one!r}")
    return found


@pytest.mark.thorough
def test_the_page_tells_what_a_run_gives(monkeypatch, tmp_path):
    """All but the robot's part: fits to its log differ by a few per cent from processor to processor."""
    assert differences(*parts(monkeypatch, tmp_path)) == []


def test_a_wrong_figure_is_noticed():
    assert differences("error 2.00 mm, 1.0e-14", "error 2.01 mm, 9.0e-15") == []
    assert differences("error 2.00 mm", "error 2.30 mm") == ["2.00 is now 2.30 in 'error 2.00 mm'"]
    assert differences("torque 2.0e-14", "torque 1.8e-17") == ["2.0e-14 is now 1.8e-17 in 'torque 2.0e-14'"]
