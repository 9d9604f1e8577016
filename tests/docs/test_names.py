"""The page of names lists what the code takes, and wrong names are answered with it."""

import re
from pathlib import Path

import pytest

import pepper_kin as pk
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.twin.sensors import CAMERAS

PAGE = (Path(__file__).parents[2] / "docs" / "names.md").read_text("utf-8")
PEPPER = pk.load_pepper(base="planar", hands="mimic")


def rows(title):
    """Return the names in code of each row's first and second cell, in the table after a line."""
    table = PAGE.partition(title)[2].strip().partition("\n\n")[0].splitlines()[2:]
    return [[re.findall(r"`([^`]+)`", cell) for cell in re.split(r" ?\| ?", row)[1:3]] for row in table]


def test_groups_are_those_of_the_robot():
    known = {names[0]: cell for names, cell in rows("## Pepper's groups")}
    assert sorted(known) == sorted(PEPPER.group_names)
    assert known.pop("whole_body") == []  # all but the base, in words
    for group, cell in known.items():
        members = [one for one in cell if "=" not in one]
        assert PEPPER.resolve_joints(members) == PEPPER.joint_group(group)
    assert set(PEPPER.joint_group("whole_body")) == {*PEPPER.joint_names} - {*PEPPER.joint_group("base")}


def test_other_names_are_those_of_the_code():
    taken = {names[0]: cell for names, cell in rows("```\n\n| argument") if names}
    assert tuple(taken["posture(name)"]) == PEPPER.posture_names
    assert tuple(taken["Camera(pepper, name)"]) == CAMERAS
    assert set(taken["camera="]) == {
        name for name in PEPPER.frame_names if re.fullmatch("Camera[A-Z][a-z]+_frame", name)
    }
    assert set(taken["pk.motion.gesture(pepper, name)"]) < set(pk.motion.gesture_names())
    assert {pk.ik.HandPosition(hand, (0, 0, 1)).frame for hand in ("left", "right")} == set(taken["hand"][2:])


@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda: PEPPER.resolve_joints(["arm_left"]), (*PEPPER.joint_names, *PEPPER.group_names)),
        (lambda: pk.ik.HandPosition("LArm", (0, 0, 1)), ("left", "right")),
        (lambda: PEPPER.posture("stand"), PEPPER.posture_names),
        (
            lambda: pk.collision.loads_of(PEPPER, payload={"hand": 0.1}),
            ("left", "right", *PEPPER.frame_names),
        ),
    ],
)
def test_a_wrong_name_is_answered_with_all_right_ones(call, names):
    with pytest.raises(UnknownNameError) as caught:
        call()
    assert caught.value.available == names
    assert all(name in str(caught.value) for name in names)
