"""The pages of concepts agree with the code, and words with the glossary."""

import ast
import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import pepper_kin as pk
from pepper_kin import datasets, learning
from pepper_kin.twin.world import World

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MOST_WORDS = 700
PACKAGES = [
    pk,
    *(getattr(pk, package) for package in ("ik", "kinematics", "dynamics", "collision", "motion", "twin")),
]
PACKAGES += [pk.planners, pk.servo, datasets, learning]
VALUES = {"pepper": pk.PepperModel, "scene": pk.Scene, "trajectory": pk.Trajectory, "World": World}
VALUES |= {"plan": pk.motion.Plan, "Servo": pk.servo.Servo, "viewer": pk.Viewer}


def test_every_status_stands_on_the_page_with_its_advice(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    import make_statuses

    (shown,) = make_statuses.SECTION.findall(make_statuses.PAGE.read_text("utf-8"))
    assert shown == make_statuses.tables(), "run `python docs/make_statuses.py`"
    assert shown.count("## ") >= 8


@pytest.mark.parametrize("page", sorted((DOCS / "concepts").glob("*.md")), ids=lambda page: page.stem)
def test_a_concept_is_read_in_a_few_minutes(page):
    assert len(page.read_text("utf-8").split()) < MOST_WORDS


def test_what_the_glossary_names_is_there():
    codes = [code for _, meaning, _ in glossary() for code in re.findall(r"`([A-Za-z_.]+)[(`]", meaning)]
    assert len(glossary()) >= 50
    names = [code.removeprefix("pk.").removeprefix("pepper_kin.").split(".") for code in codes]
    assert [name for name in names if not _there(name)] == []


@pytest.mark.thorough
def test_the_same_thing_is_called_the_same_everywhere():
    refused = {word: term for term, _, words in glossary() for word in words.split(", ") if word}
    assert len(refused) > 30
    words = (rf"(?P<w{k}>{word}s?)" for k, word in enumerate(refused))
    pattern = re.compile(rf"(?<![\w.=-])(?:{'|'.join(words)})(?![\w(:=])")
    assert pattern.search("two way-points, a COM")  # and neither names nor calls:
    assert not pattern.search(
        "shortcut(); waypoints: Of the path; pepper_kin.datasets; of com; dataset_job; a CoM"
    )
    found = [
        f"{place}: {match[0]} is called {list(refused.values())[int(match.lastgroup[1:])]}"
        for place, text in prose()
        for match in pattern.finditer(text)
    ]
    assert found == []


def glossary() -> list[tuple[str, str, str]]:
    """Return term, meaning, and words that are not used for it."""
    page = (DOCS / "glossary.md").read_text("utf-8")
    rows = re.findall(r"^\| (?!term |---)(.+?) \| (.+) \| (.*?) ?\|$", page, re.MULTILINE)
    assert [row[0].lower() for row in rows] == sorted(row[0].lower() for row in rows)
    return rows


def prose() -> Iterator[tuple[str, str]]:
    """Yield pages and docstrings without code, commands and lists of names."""
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")):
        if path.name != "glossary.md" and path.parent.name != "api":
            text = re.sub(r"^ *```.*?^ *```$", "", path.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
            yield path.relative_to(ROOT).as_posix(), re.sub(r"`[^`]*`|\]\([^)]*\)", "", text)
    for folder in ("pepper_kin", "planners", "urdf"):
        for path in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                    code = r"`[^`]*`|pepper-kin .*|pip install .*" + "|^    .*" * isinstance(node, ast.Module)
                    text = re.sub(code, "", ast.get_docstring(node) or "", flags=re.MULTILINE)
                    yield f"{path.relative_to(ROOT).as_posix()}:{getattr(node, 'lineno', 1)}", text


def _there(names):
    first, *rest = names
    if first in VALUES and rest and _has(VALUES[first], rest):
        return True
    return any(_has(package, names) for package in PACKAGES)


def _has(place, names):
    for name in names:
        fields = (
            {field.name for field in dataclasses.fields(place)} if dataclasses.is_dataclass(place) else ()
        )
        if name in fields:
            return True
        if not hasattr(place, name):
            return False
        place = getattr(place, name)
    return True
