"""A hand along lines and arcs."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError
from pepper_kin.motion import Arc, CartesianStatus, Line, cartesian_path

HAND = "LArm_effector"


@pytest.fixture(scope="module")
def start(pepper):
    """A posture that touches nothing, the left hand before the body."""
    tasks = [pk.ik.HandPosition("left", (0.25, 0.2, 0.85))]
    result = pk.ik.solve(pepper, tasks, joints="left_arm", scene=pk.Scene())
    assert result.success
    return result.q


def hand_of(pepper, q):
    return pk.kinematics.frame_pose(pepper, q, HAND)[..., :3, 3]


def test_a_line_is_straight_and_whole(pepper, start):
    found = cartesian_path(pepper, start, "left", Line((0.05, 0.03, 0.08), relative=True))
    assert found.success, found.report()
    assert found.fraction == 1.0
    begin, end = hand_of(pepper, start), hand_of(pepper, start) + np.array([0.05, 0.03, 0.08])
    hands = hand_of(pepper, found.path)
    along = (hands - begin) @ (end - begin) / np.linalg.norm(end - begin)
    off = hands - begin - along[:, None] * (end - begin) / np.linalg.norm(end - begin)
    assert np.linalg.norm(off, axis=1).max() < 1e-3
    np.testing.assert_allclose(along, found.distances, atol=1e-3)
    np.testing.assert_allclose(hands[-1], end, atol=1e-3)
    assert np.diff(found.distances).max() <= 0.005 + 1e-12
    assert (found.path >= pepper.lower_limits).all()
    assert (found.path <= pepper.upper_limits).all()
    assert not pk.collision.in_collision(pepper, found.path).any()
    assert np.abs(np.diff(found.path, axis=0)).max() < 0.1, (
        "small steps of the hand are small steps of the joints"
    )


def test_between_stops_the_hand_stays_by_the_line(pepper, start):
    found = cartesian_path(pepper, start, "left", Line((0.0, 0.05, 0.08), relative=True))
    middle = (found.path[1:] + found.path[:-1]) / 2
    stops = hand_of(pepper, found.path)
    assert np.linalg.norm(hand_of(pepper, middle) - (stops[1:] + stops[:-1]) / 2, axis=1).max() < 2e-4


def test_an_arc_keeps_its_distance_from_the_axis(pepper, start):
    center, axis = hand_of(pepper, start) + np.array([0.0, 0.0, 0.05]), np.array([1.0, 0.0, 0.0])
    found = cartesian_path(pepper, start, "left", Arc(center, axis, 2 * np.pi))
    assert found.success, found.report()
    off = hand_of(pepper, found.path) - center
    np.testing.assert_allclose(np.hypot(off[:, 1], off[:, 2]), 0.05, atol=1e-3)
    np.testing.assert_allclose(off[:, 0], 0.0, atol=1e-3)
    assert found.distances[-1] == pytest.approx(2 * np.pi * 0.05)
    np.testing.assert_allclose(hand_of(pepper, found.path[-1]), hand_of(pepper, start), atol=1e-3)
    turned = np.cross(off[0], off[len(off) // 8])
    assert turned @ axis > 0, "counter-clockwise"


def test_curves_follow_one_another(pepper, start):
    there = Line((0.0, 0.0, 0.06), relative=True)
    found = cartesian_path(pepper, start, "left", [there, Line(hand_of(pepper, start))])
    assert found.success
    assert found.distances[-1] == pytest.approx(0.12)
    np.testing.assert_allclose(hand_of(pepper, found.path[-1]), hand_of(pepper, start), atol=1e-3)
    assert hand_of(pepper, found.path)[:, 2].max() == pytest.approx(
        hand_of(pepper, start)[2] + 0.06, abs=1e-3
    )


def test_a_direction_is_approached_and_its_error_reported(pepper, start):
    direction_task = np.array([1.0, 0.0, 0.3])
    line = Line((0.03, 0.0, 0.06), relative=True)
    with_direction = cartesian_path(pepper, start, "left", line, direction=direction_task)
    without = cartesian_path(pepper, start, "left", line)

    def errors(path):
        x = pk.kinematics.frame_pose(pepper, path, HAND)[:, :3, 0]
        return np.arccos(np.clip(x @ direction_task / np.linalg.norm(direction_task), -1, 1))

    assert with_direction.success
    assert with_direction.direction_error == pytest.approx(errors(with_direction.path).max(), abs=1e-6)
    assert errors(with_direction.path)[-1] < errors(without.path)[-1] - 0.02
    assert np.isnan(without.direction_error)


def test_out_of_reach_goes_as_far_as_it_can(pepper, start):
    found = cartesian_path(pepper, start, "left", Line((0.0, 0.6, 0.6), relative=True), joints="left_arm")
    assert found.status in (CartesianStatus.OUT_OF_REACH, CartesianStatus.BLOCKED_BY_LIMITS)
    assert 0.05 < found.fraction < 1.0
    assert found.fraction == pytest.approx(found.distances[-1] / np.hypot(0.6, 0.6))
    assert "left hand stops after" in found.message
    assert found.advice in found.report()
    moved = np.ptp(found.path, axis=0) > 0
    assert {n for n, m in zip(pepper.joint_names, moved, strict=True) if m} <= set(
        pepper.joint_group("left_arm")
    )


def test_stops_before_the_wall_and_names_it(pepper, start):
    y = hand_of(pepper, start)[1]
    scene = pk.Scene().add_box("wall", size=(1.0, 0.02, 2.0), position=(0.3, y + 0.15, 0.9))
    line = Line((0.0, 0.3, 0.0), relative=True)
    found = cartesian_path(pepper, start, "left", line, scene, margin=0.01)
    assert found.status is CartesianStatus.IN_COLLISION
    assert "wall" in found.message
    assert not pk.collision.CollisionChecker(pepper, scene, margin=0.01 - 1e-6).in_collision(found.path).any()
    assert 0.0 < found.fraction < 0.5


def test_a_start_in_a_box_is_reported(pepper, start):
    scene = pk.Scene().add_sphere("ball", 0.05, hand_of(pepper, start))
    found = cartesian_path(pepper, start, "left", Line((0.0, 0.0, 0.05), relative=True), scene)
    assert found.status is CartesianStatus.START_INVALID
    assert "ball" in found.message
    assert found.fraction == 0.0
    assert len(found.path) == 1


def test_misuse_is_named(pepper, start):
    for error, change, word in [
        (InvalidValueError, {"curves": []}, "curves"),
        (InvalidValueError, {"curves": [(0, 0, 0)]}, "curves"),
        (InvalidValueError, {"step": 0.0}, "step"),
        (InvalidValueError, {"step": float("nan")}, "step"),
        (InvalidValueError, {"tolerance": -1.0}, "tolerance"),
        (InvalidValueError, {"margin": -0.1}, "margin"),
        (InvalidValueError, {"direction": (0.0, 0.0, 0.0)}, "direction"),
        (UnknownNameError, {"hand": "middle"}, "left"),
        (UnknownNameError, {"joints": "tail"}, "tail"),
        (LimitError, {"start": np.full(15, 9.0)}, "start"),
        (InvalidValueError, {"start": np.zeros((2, 15))}, "start"),
    ]:
        arguments = {"start": start, "hand": "left", "curves": Line((0.0, 0.0, 0.05), relative=True)} | change
        positional = (arguments.pop("start"), arguments.pop("hand"), arguments.pop("curves"))
        with pytest.raises(error, match=word):
            cartesian_path(pepper, *positional, **arguments)


def test_curves_refuse_what_is_none():
    with pytest.raises(InvalidValueError, match="to"):
        Line((0.0, float("nan"), 0.0))
    with pytest.raises(InvalidValueError, match="axis"):
        Arc((0, 0, 0), (0, 0, 0), 1.0)
    with pytest.raises(InvalidValueError, match="angle"):
        Arc((0, 0, 0), (0, 0, 1), float("inf"))
