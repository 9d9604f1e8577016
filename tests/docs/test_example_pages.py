"""Every example has its place and its picture in the documentation, and the page says nothing of others."""

import ast
import re
import sys
from pathlib import Path

import pytest
from examined_motions import run_examined
from PIL import Image

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
SECTIONS = re.split(r"^## ", (ROOT / "docs" / "examples.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[
    1:
]
LINK = re.compile(r"!\[([^\]]+)\]\((pictures/[^)]+)\)")
MOST_BYTES = 150_000
MAKES_MOTIONS = re.compile(r"retime\(|gesture\(|follow\(|optimize\(|smooth=True|from_keyframes|sequence\(")


def test_examples_have_numbers_words_pictures_and_a_check_of_their_own():
    listed = [re.findall(r"^`examples/(.+)`$", section, re.MULTILINE) for section in SECTIONS]
    assert listed == [[path.name] for path in EXAMPLES]
    for number, (script, section) in enumerate(zip(EXAMPLES, SECTIONS, strict=True), 1):
        assert script.name.startswith(f"{number:02d}_")
        assert section.startswith(f"{number:02d} ")
        text = script.read_text(encoding="utf-8")
        tree = ast.parse(text)
        assert (ast.get_docstring(tree) or "").splitlines()[0] in section
        assert any(isinstance(node, ast.Assert) for node in ast.walk(tree.body[-1])), script
        ((words, picture),) = LINK.findall(section)
        assert len(words.split()) > 3  # for those who cannot see it
        path = ROOT / "docs" / picture
        assert path.name == f"example_{number:02d}.png"
        assert path.stat().st_size <= MOST_BYTES
        with Image.open(path) as image:
            image.verify()
            assert 600 <= image.size[0] <= 1000


@pytest.mark.thorough
@pytest.mark.parametrize(
    "script",
    [path for path in EXAMPLES if MAKES_MOTIONS.search(path.read_text())],
    ids=lambda path: path.stem,
)
def test_motions_of_an_example_are_green_and_the_twin_follows(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(
        sys, "argv", [str(script), "--quick"] if "--quick" in script.read_text() else [str(script)]
    )
    assert run_examined(script.read_text(encoding="utf-8"), str(script), {"__name__": "example"}) == []


def test_pictures_that_pages_show_are_those_that_are_there():
    texts = [(page, page.read_text(encoding="utf-8")) for page in PAGES]
    shown = [
        page.parent / name for page, text in texts for name in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)
    ]
    assert [path for path in shown if not path.is_file()] == []
    pictures = (ROOT / "docs" / "pictures").iterdir()
    assert [p.name for p in pictures if not any(f"pictures/{p.name}" in text for _, text in texts)] == []


def test_the_script_draws_every_example(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import make_pictures

    assert {f"example_{path.stem[:2]}" for path in EXAMPLES} <= set(make_pictures.DRAWERS)
