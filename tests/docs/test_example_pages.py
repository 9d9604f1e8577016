"""Every example has its place and its picture in the documentation, and the page says nothing of others."""

import ast
import re
from pathlib import Path

import pytest
from PIL import Image

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SECTIONS = re.split(r"^## ", (ROOT / "docs" / "examples.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[
    1:
]
LINK = re.compile(r"!\[([^\]]+)\]\((pictures/[^)]+)\)")
MOST_BYTES = 150_000


def test_examples_are_numbered_without_a_gap():
    assert [path.name[:3] for path in EXAMPLES] == [f"{k:02d}_" for k in range(1, len(EXAMPLES) + 1)]
    assert len(EXAMPLES) >= 15


def test_the_page_has_the_examples_in_their_order():
    listed = [re.findall(r"^`examples/(.+)`$", section, re.MULTILINE) for section in SECTIONS]
    assert listed == [[path.name] for path in EXAMPLES]


@pytest.mark.parametrize("number", range(len(EXAMPLES)), ids=lambda k: EXAMPLES[k].stem)
def test_an_example_has_its_words_and_its_picture(number):
    script, section = EXAMPLES[number], SECTIONS[number]
    tree = ast.parse(script.read_text(encoding="utf-8"))
    assert (ast.get_docstring(tree) or "").splitlines()[0] in section
    assert section.startswith(f"{script.stem[:2]} ")
    ((words, picture),) = LINK.findall(section)
    assert len(words.split()) > 3  # for those who cannot see it
    path = ROOT / "docs" / picture
    assert path.name == f"example_{script.stem[:2]}.png"
    assert path.stat().st_size <= MOST_BYTES
    with Image.open(path) as image:
        image.verify()
        assert 600 <= image.size[0] <= 1000


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_ends_with_a_check_of_its_own(script):
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 100
    last = ast.parse(text).body[-1]
    assert any(isinstance(node, ast.Assert) for node in ast.walk(last))


def test_every_picture_that_a_page_shows_is_there():
    shown = {
        (page.name, target)
        for page in PAGES
        for target in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
        if not (page.parent / target).is_file()
    }
    assert shown == set()


def test_no_picture_lies_about_unused():
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    unused = [
        path.name for path in (ROOT / "docs" / "pictures").iterdir() if f"pictures/{path.name}" not in text
    ]
    assert unused == []


def test_the_script_draws_every_example(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import make_pictures

    assert {f"example_{path.stem[:2]}" for path in EXAMPLES} <= set(make_pictures.DRAWERS)
