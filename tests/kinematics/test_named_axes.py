"""Axes of palms and sensors: by the chain of the URDF's own XML, and by what lies on which side."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
BENT = PEPPER.joint_vector({"left_arm": (0.4, 0.3, -1.0, -0.8, 0.5), "head": (0.3, -0.2), "HipRoll": 0.1})
LETTERS = {"x": 0, "y": 1, "z": 2}


def by_the_urdf(robot, q, frame):
    """Return orientation and origin of a link by the XML's origins and axes of the joints below it."""
    above = {joint.find("child").get("link"): joint for joint in ET.fromstring(robot.urdf).findall("joint")}
    rotation, origin = np.eye(3), np.zeros(3)
    while frame in above:
        joint = above[frame]
        place = joint.find("origin")
        numbers = {key: np.fromstring(place.get(key, "0 0 0"), sep=" ") for key in ("xyz", "rpy")}
        turn = Rotation.from_euler("xyz", numbers["rpy"])  # lower case: fixed axes
        if joint.get("name") in robot.joint_names:
            axis = np.fromstring(joint.find("axis").get("xyz"), sep=" ")
            turn = turn * Rotation.from_rotvec(axis * q[robot.joint_index(joint.get("name"))])
        rotation, origin = turn.as_matrix() @ rotation, turn.as_matrix() @ origin + numbers["xyz"]
        frame = joint.find("parent").get("link")
    return rotation, origin


@pytest.mark.parametrize("q", [STAND, BENT], ids=["Stand", "bent"])
def test_origins_and_directions_are_the_urdfs(q):
    axes = pk.kinematics.named_axes(PEPPER, q)
    assert len(axes) == 16
    for name, axis in axes.items():
        rotation, origin = by_the_urdf(PEPPER, q, axis.frame)
        column = rotation[:, LETTERS[axis.axis[1]]] * (1 if axis.axis[0] == "+" else -1)
        np.testing.assert_allclose(axis.direction, column, atol=1e-12)
        np.testing.assert_allclose(axis.origin, origin, atol=1e-12)
        np.testing.assert_allclose(rotation @ axis.in_frame, axis.direction, atol=1e-12)
        assert axis.name == name
        assert not axis.direction.flags.writeable


@pytest.mark.parametrize("side", ["left", "right"])
def test_hands(side):
    """The back of the hand is behind the palm, closing fingers come out of it, the thumb is on its side."""
    robot = pk.load_pepper(hands="mimic")
    letter = side[0].upper()
    opened, closed = (robot.joint_vector({f"{letter}Hand": opening}) for opening in (0.98, 0.02))
    axes = pk.kinematics.named_axes(robot, opened)
    palm, fingers, thumb = (axes[f"{side} {part}"] for part in ("palm", "fingers", "thumb"))
    back = by_the_urdf(robot, opened, f"{letter}HandTouchBack_frame")[1]
    assert (back - palm.origin) @ palm.direction < -0.05

    def tip(q, finger):
        return pk.kinematics.frame_pose(robot, q, f"{letter}{finger}_link")[:3, 3]

    wrist = pk.kinematics.frame_pose(robot, opened, f"{letter.lower()}_wrist")[:3, 3]
    for finger in ("Finger13", "Finger23", "Finger33", "Finger43"):
        assert (tip(opened, finger) - wrist) @ fingers.direction > 0.09
        assert (tip(closed, finger) - tip(opened, finger)) @ palm.direction > 0.01
    assert (tip(opened, "Thumb1") - tip(opened, "Finger41")) @ thumb.direction > 0.05
    handed = np.cross(palm.direction, fingers.direction) @ thumb.direction
    assert handed == pytest.approx({"left": 1.0, "right": -1.0}[side])


def test_sensors_look_where_their_names_say():
    flat = PEPPER.joint_vector(np.clip(np.zeros(15), PEPPER.lower_limits, PEPPER.upper_limits))
    axes = pk.kinematics.named_axes(PEPPER, flat)
    for name in ("top camera", "depth camera", "front laser"):
        np.testing.assert_allclose(axes[name].direction, (1, 0, 0), atol=1e-6)
    down = axes["bottom camera"].direction
    assert np.degrees(np.arcsin(-down[2])) == pytest.approx(40.0, abs=0.01)
    assert axes["front sonar"].direction[0] > 0.9
    assert axes["back sonar"].direction[0] < -0.9
    assert axes["left laser"].direction[1] > 0.9
    assert axes["right laser"].direction[1] < -0.9
    assert axes["shovel laser"].direction[2] < -0.3
    assert axes["tablet"].direction[2] == pytest.approx(0.5, abs=1e-5)
    optical = by_the_urdf(PEPPER, flat, "CameraTop_optical_frame")[0]
    np.testing.assert_allclose(optical, np.transpose([(0, -1, 0), (0, 0, -1), (1, 0, 0)]), atol=1e-9)


def test_the_page_has_the_table_and_the_drawing_has_the_numbers():
    docs = Path(__file__).parents[2] / "docs"
    page, drawing = (
        (docs / "description.md").read_text("utf-8"),
        (docs / "pictures" / "axes.svg").read_text("utf-8"),
    )
    for number, axis in enumerate(pk.kinematics.named_axes(PEPPER).values(), start=1):
        assert f"| {number} | {axis.name} | `{axis.frame}` | {axis.axis} | {axis.meaning} |" in page
        assert f">{number}</text>" in drawing


def test_a_palm_is_laid_down_by_its_axis():
    palm = pk.kinematics.named_axes(PEPPER)["left palm"]
    result = pk.ik.solve(PEPPER, [pk.ik.AxisAlignment(palm.frame, (0, 0, -1), axis=palm.in_frame)])
    assert result.success, result.report()
    assert pk.kinematics.named_axes(PEPPER, result.q)["left palm"].direction[2] < -0.9999


def test_another_robot_has_the_axes_whose_frames_it_has():
    one = (
        '<robot name="r"><link name="a"/><joint name="j" type="revolute"><parent link="a"/><child link="b"/>'
    )
    two = '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint><link name="b"/></robot>'
    assert pk.kinematics.named_axes(pk.load_robot(one + two)) == {}
    with pytest.raises(InvalidValueError, match=r"q: got shape \(3,\)"):
        pk.kinematics.named_axes(PEPPER, (0, 0, 0))
