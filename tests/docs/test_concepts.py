"""The pages of concepts agree with the code."""

import dataclasses
import re
from pathlib import Path

import pytest

import pepper_kin as pk
from pepper_kin.twin.world import World

DOCS = Path(__file__).parents[2] / "docs"
MOST_WORDS = 700
PACKAGES = [
    pk,
    *(getattr(pk, package) for package in ("ik", "kinematics", "dynamics", "collision", "motion", "twin")),
]
PACKAGES += [pk.planners, pk.servo]
VALUES = {"pepper": pk.PepperModel, "scene": pk.Scene, "trajectory": pk.Trajectory, "World": World}
VALUES |= {"plan": pk.motion.Plan, "Servo": pk.servo.Servo}


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
    page = (DOCS / "glossary.md").read_text("utf-8")
    rows = re.findall(r"^\| (?!term|---)[^|]+\|([^\n]+)\|$", page, re.MULTILINE)
    codes = [code for row in rows for code in re.findall(r"`([A-Za-z_.]+)[(`]", row)]
    assert len(rows) >= 40
    assert [code for code in codes if not _there(code.removeprefix("pk.").split("."))] == []


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
