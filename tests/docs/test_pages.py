"""Links and names of files lead somewhere."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
FILE = re.compile(
    r"\b((?:benchmarks|docs|examples|planners|pepper_kin|tests|urdf)/[\w./-]+\.(?:py|md|csv|json|toml|ipynb))\b"
)
TO_BE_WRITTEN = {  # by who follows CONTRIBUTING
    "pepper_kin/ik/tasks/frame_distance.py",
    "pepper_kin/robots.py",
    "pepper_kin/twin/sensors/inclinometer.py",
    "planners/rrt.py",
}


def anchors(page):
    """Return the anchors of a page's headings, as the site and code hosts make them."""
    titles = re.findall(r"^#+ (.+)$", page.read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower()) for title in titles}


@pytest.mark.parametrize("page", PAGES[:2], ids=lambda page: page.name)
def test_links_of_pages_outside_the_site(page):
    """Those of the site are checked when it is built."""
    for target, anchor in re.findall(r"\]\((?!http)([^)#]+)(?:#([^)]+))?\)", page.read_text("utf-8")):
        assert (page.parent / target).exists(), target
        assert not anchor or anchor in anchors(page.parent / target), (target, anchor)


def test_files_that_pages_name_are_there():
    named = {name for page in PAGES for name in FILE.findall(page.read_text("utf-8"))}
    assert len(named) > 40
    there = lambda name: (ROOT / name).exists() or (ROOT / "docs" / name).exists()  # noqa: E731
    assert {name for name in named - TO_BE_WRITTEN if not there(name)} == set()


def test_every_page_is_in_the_contents():
    contents = (ROOT / "mkdocs.yml").read_text("utf-8")
    pages = {page.relative_to(ROOT / "docs").as_posix() for page in PAGES[2:]}
    assert {page for page in pages if f" {page}\n" not in contents} == set()


@pytest.mark.parametrize(
    "page", sorted((ROOT / "docs" / "benchmarks").glob("*.md")), ids=lambda page: page.stem
)
def test_benchmarks_begin_with_a_table_and_end_with_trials(page):
    text, _, appendix = page.read_text("utf-8").partition("\n## Appendix: trials and misses\n")
    front = text.partition("\n|")[0]
    assert len(re.sub(r"^#.*$", "", front, flags=re.MULTILINE).split()) <= 30
    assert not re.search(r"\btrials?\b|\bmissed targets, and why\b", text, re.IGNORECASE)
    assert "\n## " not in appendix
