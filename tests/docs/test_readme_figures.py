"""What the README's table says was measured stands in the benchmarks, which scripts print."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
FIGURE = re.compile(r"\d+(?:\.\d+)?")


def test_measured_figures_stand_in_the_benchmarks():
    section = (ROOT / "README.md").read_text("utf-8").partition("## Measured\n")[2]
    rows = re.findall(r"^\| (?!median)[^|]*\|(.*)$", section, re.MULTILINE)
    pages = [page.read_text("utf-8") for page in sorted((ROOT / "docs" / "benchmarks").glob("*.md"))]
    listed = set(FIGURE.findall("\n".join(pages)))
    figures = [figure for row in rows for figure in FIGURE.findall(row)]
    assert len(figures) >= 6
    assert set(figures) <= listed
