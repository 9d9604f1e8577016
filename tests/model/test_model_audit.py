"""One planted fault of each kind must be found and named; sound robots have none."""

import json
import re

import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, ModelError
from pepper_kin.model import audit, compare
from pepper_kin.model.semantics import parse_srdf

HANDS = ("locked", "mimic", "independent")


def pepper_text(hands="mimic"):
    return pk.load_pepper(hands=hands).urdf


def edited(old, new, hands="mimic", count=1):
    text = pepper_text(hands)
    assert old in text, old
    return text.replace(old, new, count)


def in_element(tag, name, old, new, hands="mimic"):
    """Edit inside the element of that tag and name."""
    text = pepper_text(hands)
    start = text.index(f'<{tag} name="{name}"')
    end = text.index(f"</{tag}>", start)
    assert old in text[start:end], (old, text[start:end])
    return text[:start] + text[start:end].replace(old, new, 1) + text[end:]


@pytest.mark.parametrize("base", ["fixed", "planar"])
@pytest.mark.parametrize("hands", HANDS)
def test_pepper_has_no_fault(base, hands):
    pepper = pk.load_pepper(base=base, hands=hands)
    result = audit(pepper)
    assert result.success, result.report()
    assert result.total_mass == pytest.approx(28.68118, abs=1e-9)
    assert result.reachable == result.frames == len(pepper.link_names)
    assert (
        result.fingers
        == {"locked": (28, 0, 0, 0), "mimic": (0, 28, 0, 0), "independent": (0, 0, 28, 0)}[hands]
    )
    assert result.meshes > 60
    # Bodies whose motors sit inside a neighbor: known, noted, and no others.
    assert {note.where.removeprefix("link ") for note in result.notes if note.kind == "inertia"} == {
        "Neck", "LElbow", "RElbow", "LForeArm", "RForeArm",
    }  # fmt: skip
    assert [note.where for note in result.notes if note.kind != "inertia"] == ["joint HeadPitch"]


def test_a_pitch_of_the_head_that_no_robot_reached_is_a_note():
    """25.5 degrees are 0.44506 rad, 36.5 are 0.63705."""
    noted = pk.model.audit(pk.load_pepper()).notes[-1]
    assert (noted.kind, noted.where) == ("limits", "joint HeadPitch")
    assert "its upper limit is 0.637045 rad, but no robot was seen beyond 0.445059" in noted.message
    documented = pk.load_pepper(head_limits="documented")
    assert {note.kind for note in pk.model.audit(documented).notes} == {"inertia"}
    nao = pepper_text().replace('"KneePitch"', '"LKneePitch"')
    assert {note.kind for note in audit(nao).notes} == {"inertia"}, "NAO has joints of the same names"
    nothing = without("limit", "HeadPitch")
    assert {note.kind for note in audit(nothing).notes} == {"inertia"}


def without(tag, joint):
    text = pepper_text()
    start = text.index(f'<joint name="{joint}"')
    end = text.index("</joint>", start)
    return text[:start] + re.sub(rf"<{tag}[^>]*/>", "", text[start:end]) + text[end:]


def heavy_finger():
    """The published 5 g finger whose mass would have to lie 14 cm from its center."""
    text = pepper_text()
    start = text.index('<link name="LFinger12_link"')
    end = text.index("</inertial>", start)
    inertia = '<inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>'
    return f'{text[:start]}<link name="LFinger12_link"><inertial><mass value="0.005"/>{inertia}{text[end:]}'


def head(old, new):
    return in_element("link", "Head", old, new)


def yaw(old, new):
    return in_element("joint", "HeadYaw", old, new)


def finger(new):
    return in_element("joint", "LFinger12", 'mimic joint="LHand"', f'mimic joint="{new}"')


LINK, JOINT, FINGER, TENSOR = "link Head", "joint HeadYaw", "joint LFinger12", 'ixx="0.00597209"'
NO_WRIST = edited('<child link="l_wrist"/>', '<child link="no_wrist"/>')
DOCTYPE = '<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/hostname">]><robot name="&a;"/>'
PLANTED = [
    ("mass", LINK, "its mass is negative: -1 kg", head('mass value="1.51893"', 'mass value="-1"')),
    ("mass", LINK, "its <inertial> states no mass", head('<mass value="1.51893"/>', "")),
    ("inertia", LINK, "not positive definite", head(TENSOR, 'ixx="-0.00597209"')),
    ("inertia", LINK, "break the triangle inequality", head(TENSOR, 'ixx="0.0597209"')),
    ("inertia", "link LFinger12_link", "radius of gyration 0.1732 m, but no point", heavy_finger()),
    ("limits", JOINT, "missing: lower, upper, velocity, effort", without("limit", "HeadYaw")),
    ("limits", JOINT, "its lower limit 3 is above its upper limit 2.08567",
     yaw('lower="-2.08567"', 'lower="3"')),
    ("limits", JOINT, "its effort limit is 0", yaw('effort="5.428"', 'effort="0"')),
    ("limits", JOINT, "its velocity limit is 0", yaw('velocity="7.33998"', 'velocity="0"')),
    ("mimic", "the fingers", "they follow their hand, but not these: LFinger12",
     without("mimic", "LFinger12")),
    ("mimic", "the fingers", "1 of 28 are missing: RThumb2",
     edited('joint name="RThumb2"', 'joint name="RThumbX"')),
    ("mimic", FINGER, "it follows an unknown joint 'LPaw'", finger("LPaw")),
    ("mimic", FINGER, "it follows itself: LFinger12 -> LFinger12", finger("LFinger12")),
    ("mimic", FINGER, "it follows the other side's RHand", finger("RHand")),
    ("structure", "the robot", "do not hang on the root: l_wrist", NO_WRIST),
    ("structure", "joint LWristYaw", "it names an unknown link 'no_wrist'", NO_WRIST),
    ("structure", LINK, "two links have this name", edited('<link name="Neck">', '<link name="Head">')),
    ("structure", "link RShoulder", "it has 2 parents: HeadPitch, RShoulderPitch",
     edited('<child link="Head"/>', '<child link="RShoulder"/>')),
    ("structure", "joint HeadPitch", "type 'ball' is none of",
     in_element("joint", "HeadPitch", 'type="revolute"', 'type="ball"')),
    ("number", "origin of joint HeadYaw", "xyz='-0.038 zero 0.3089' is not 3 finite numbers",
     yaw('xyz="-0.038 0 0.3089"', 'xyz="-0.038 zero 0.3089"')),
    ("number", LINK, "value='nan' is not a finite number", head('value="1.51893"', 'value="nan"')),
    ("mesh", "visual head_shell of link Head", "'package://pepper_kin/urdf/meshes/lost.stl' is not there",
     edited("meshes/head_shell.stl", "meshes/lost.stl")),
    ("geometry", "collision Head_capsule_0_start of link Head", "sphere: radius='-1' is not above zero",
     in_element("collision", "Head_capsule_0_start", 'radius="0.11314"', 'radius="-1"')),
    ("xml", "the file", "not well-formed (invalid token)", "<robot name='x'><link name=</robot>"),
    ("xml", "the file", "the root element is <sdf>, expected <robot>", "<sdf version='1.9'/>"),
    ("xml", "the file", "entities are not allowed", DOCTYPE),
]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "where", "message", "text"), PLANTED, ids=[f"{p[0]}-{p[2][:28]}" for p in PLANTED]
)
def test_planted_fault_is_found_and_named(kind, where, message, text):
    result = audit(text)
    assert not result.success
    found = [fault for fault in result.of_kind(kind) if fault.where == where and message in fault.message]
    assert found, result.report()
    assert str(found[0]) in result.report()


def test_every_fault_of_a_broken_file_is_reported_at_once():
    text = in_element("link", "Head", 'value="1.51893"', 'value="-1"')
    text = text.replace('<child link="l_wrist"/>', '<child link="no_wrist"/>', 1)
    text = text.replace("meshes/neck_column.stl", "meshes/lost.stl", 1)
    text = text.replace('lower="-1.03847"', 'lower="many"', 1)
    kinds = {fault.kind for fault in audit(text).faults}
    assert {"mass", "structure", "mesh", "number", "limits"} <= kinds


@pytest.mark.parametrize(
    "text", ["<robot/>", "<robot name='empty'></robot>", "<", "<robot><joint/><link/></robot>"]
)
def test_nothing_crashes_it(text):
    result = audit(text)
    assert not result.success
    assert "faults" in result.report()


def test_entities_are_not_expanded_anywhere():
    bomb = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>'
    with pytest.raises(ModelError, match="SRDF: document type declarations and entities are not allowed"):
        parse_srdf(bomb, pk.load_pepper().document)
    with pytest.raises(ModelError, match="URDF: document type declarations and entities are not allowed"):
        pk.load_robot(bomb)
    assert compare(bomb, bomb).faults[0].kind == "xml"


def test_unreadable_path_is_named(tmp_path):
    with pytest.raises(FileFormatError, match=r"lost\.urdf: cannot be read"):
        audit(tmp_path / "lost.urdf")


def test_path_and_text_and_robot_give_the_same(tmp_path):
    path = tmp_path / "pepper.urdf"
    path.write_text(pepper_text(), encoding="utf-8")
    robot = pk.load_pepper(hands="mimic")
    assert (
        audit(path).to_dict() == audit(path.read_text(encoding="utf-8")).to_dict() == audit(robot).to_dict()
    )
    assert json.loads(json.dumps(audit(path).to_dict()))["success"] is True


def test_comparison_names_each_difference_with_its_size():
    first = pk.load_pepper(hands="mimic")
    second = in_element("joint", "HeadYaw", 'upper="2.08567"', 'upper="2.1"')
    second = second.replace('xyz="-0.038 0 0.3089"', 'xyz="-0.038 0 0.3100"', 1)
    second = second.replace('<mass value="1.51893"/>', '<mass value="1.6"/>', 1)
    second = second.replace('multiplier="0.872665"', 'multiplier="0.8"', 1)
    second = second.replace('rpy="0 -0.157079 0"', 'rpy="0 -0.057079 0"', 1)
    second = second.replace('<link name="LSpeaker_frame"/>', "", 1)
    result = compare(first, second)
    found = {(d.name, d.quantity): d for d in result.differences}
    assert found["HeadYaw", "upper limit"].size == pytest.approx(0.01433)
    assert found["HeadYaw", "position"].size == pytest.approx(0.0011)
    assert found["Head", "mass"].size == pytest.approx(0.08107)
    assert found["LFinger11", "multiplier"].size == pytest.approx(0.072665)
    assert found["LElbowYaw", "orientation (rpy)"].size == pytest.approx(0.1)
    assert found["LSpeaker_frame", "presence"].second == "no"
    assert len(result.differences) == 6
    assert not result.equal
    report = result.report()
    assert "joint HeadYaw" in report
    assert "0.0811 kg" in report
    assert json.loads(json.dumps(result.to_dict()))["equal"] is False


def test_comparison_of_equal_robots_is_empty():
    robot = pk.load_pepper()
    assert compare(robot, robot.urdf).equal
    assert "no difference" in compare(robot, robot).report()


def test_tolerance_of_the_comparison():
    other = edited('lower="-2.08567"', 'lower="-2.0857"')
    assert len(compare(pepper_text(), other).differences) == 1
    assert compare(pepper_text(), other, tolerance=1e-3).equal
