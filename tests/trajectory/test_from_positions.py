"""Trajectories through recorded positions and keyframes, beside SciPy, with their warnings."""

import warnings

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, OvershootWarning, UnknownNameError

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
TIMES = np.array([10.0, 10.4, 10.9, 11.7, 12.0])


def gentle(joint, times=TIMES):
    """Return positions of one joint that rise, shape (T, n)."""
    q = np.tile(STAND, (len(times), 1))
    q[:, PEPPER.joint_index(joint)] = np.linspace(0.0, 0.3, len(times))
    return q


def test_it_is_scipys_clamped_spline_that_begins_at_zero():
    positions = np.random.default_rng(1).uniform(-0.1, 0.1, (5, 15)) + STAND
    with pytest.warns(OvershootWarning):
        found = pk.Trajectory.from_positions(PEPPER, TIMES, positions, overshoot=1e-3)
    spline = CubicSpline(TIMES, positions, bc_type="clamped")
    t = np.linspace(0.0, 2.0, 301)
    assert found.joint_names == PEPPER.joint_names
    assert found.duration == pytest.approx(2.0)
    for derivative, values in enumerate(found(t)):
        np.testing.assert_allclose(values, spline(t + 10.0, derivative), atol=1e-9)


def test_ends_in_motion_are_scipys_and_join_a_stroke_in_two_parts():
    positions = np.tile(STAND, (5, 1))
    positions[:, [3, 4]] = np.random.default_rng(1).uniform(-0.1, 0.1, (5, 2))
    velocity = {"start_velocity": [0.2, -0.1], "end_velocity": [0.0, 0.3]}
    head = positions[:, 3:5]
    found = pk.Trajectory.from_positions(PEPPER, TIMES, head, joints="head", overshoot=1.0, **velocity)
    spline = CubicSpline(TIMES, head, bc_type=((1, [0.2, -0.1]), (1, [0.0, 0.3])))
    t = np.linspace(0.0, 2.0, 301)
    for derivative, values in enumerate(found(t)):
        np.testing.assert_allclose(values[:, 3:5], spline(t + 10.0, derivative), atol=1e-9)
        others = np.delete(values, [3, 4], axis=1)
        np.testing.assert_array_equal(others, np.broadcast_to(others[0], others.shape))
    through = [0.3, 0.0]
    here, via, there = [0.0, 0.0], [0.2, 0.0], [0.4, 0.0]
    first = pk.Trajectory.from_positions(PEPPER, [0, 1], [here, via], end_velocity=through, joints="head")
    second = pk.Trajectory.from_positions(PEPPER, [0, 1], [via, there], start_velocity=through, joints="head")
    both = first.then(second)
    assert both.check(PEPPER, collisions=False).velocity_continuity.success
    assert both(1.0).velocity[3] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"end_velocity": [0.1]}, "end_velocity"),
        ({"start_velocity": [np.nan, 0.0]}, "start_velocity"),
        ({"end_velocity": [0.1, 0.0], "interpolation": "monotone"}, "None with interpolation='monotone'"),
    ],
)
def test_ends_in_motion_that_cannot_be_are_refused(option, words):
    with pytest.raises(InvalidValueError, match=words):
        pk.Trajectory.from_positions(PEPPER, [0, 1], [[0, 0], [0.2, 0]], joints="head", **option)


def test_columns_may_be_some_joints_and_groups():
    rows = np.linspace([0.0, 0.1, 1.0, -0.1, -1.2, -0.5, 0.0], [0.2, 0.0, 0.9, -0.2, -1.0, -0.6, 0.1], 5)
    found = pk.Trajectory.from_positions(PEPPER, TIMES, rows, joints=["head", "left_arm"], overshoot=1)
    np.testing.assert_allclose(found(TIMES - 10.0).position[:, 3:10], rows, atol=1e-12)
    np.testing.assert_array_equal(found(1.1).position[10:], STAND[10:])
    crouch = PEPPER.posture("Crouch")
    low = pk.Trajectory.from_positions(PEPPER, TIMES, rows[:, :1], joints="HeadYaw", rest=crouch)
    np.testing.assert_array_equal(np.delete(low(0.3).position, 3), np.delete(crouch, 3))


def test_without_a_robot_the_columns_have_names():
    found = pk.Trajectory.from_positions(
        None, [0, 1, 2], [[0.0, 1.0], [0.1, 1.1], [0.2, 1.2]], joints=["a", "b"]
    )
    assert found.joint_names == ("a", "b")
    assert found.joint_units == ("rad", "rad")
    with pytest.raises(InvalidValueError, match="joints: got None"):
        pk.Trajectory.from_positions(None, [0, 1], [[0.0], [1.0]])


def test_a_step_overshoots_and_is_reported_with_joint_time_and_amount():
    q = np.tile(STAND, (6, 1))
    q[:, 3] = [0.0, 0.0, 0.05, 1.0, 1.0, 1.0]
    times = np.arange(6.0)
    with pytest.warns(OvershootWarning) as caught:
        found = pk.Trajectory.from_positions(PEPPER, times, q)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    dense = found(np.linspace(0, 5, 50001)).position[:, 3]
    over = max(dense.max() - 1.0, -dense.min())
    at = np.linspace(0, 5, 50001)[np.argmax(np.maximum(dense - 1.0, -dense))]
    words = str(caught[0].message)
    assert f"HeadYaw is at {dense[np.argmax(np.maximum(dense - 1.0, -dense))]:.4g} rad" in words
    assert f"{over:.3g} rad outside the range of its samples" in words
    assert f"at {at:.3f} s" in words
    assert "interpolation='monotone'" in words
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pk.Trajectory.from_positions(PEPPER, times, q, overshoot=over * 1.01)
        calm = pk.Trajectory.from_positions(PEPPER, times, q, interpolation="monotone")
    inside = calm(np.linspace(0, 5, 5001)).position[:, 3]
    assert inside.min() >= 0.0
    assert inside.max() <= 1.0
    np.testing.assert_array_equal(calm(times).position, q)
    np.testing.assert_array_equal(calm([0.0, 5.0]).velocity, np.zeros((2, 15)))


def test_leaving_the_limits_is_reported():
    top = float(PEPPER.upper_limits[3])
    q = np.tile(STAND, (4, 1))
    q[:, 3] = [0.0, top + 0.1, top - 0.1, 0.0]
    with pytest.warns(OvershootWarning, match=r"HeadYaw is at .* rad outside its limits"):
        pk.Trajectory.from_positions(PEPPER, [0, 1, 2, 3], q, interpolation="monotone")


def test_gentle_recordings_do_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pk.Trajectory.from_positions(PEPPER, TIMES, gentle("HeadYaw"))
        pk.Trajectory.from_positions(
            PEPPER, [3.0, 4.0], gentle("HeadYaw", [3.0, 4.0]), interpolation="monotone"
        )


def test_misuse_is_named():
    for arguments, words in [
        (([0.0], [[0.1]]), "times: got 1, expected two or more times that increase"),
        (([0.0, 2.0, 2.0], [[0.1]] * 3), "times: got 2 s, then 2 s"),
        (([0.0, np.nan], [[0.1]] * 2), "times: got nan"),
        (([0.0, 1.0], [[0.1]] * 3), r"positions: got shape \(3, 1\), expected shape \(2, 1\)"),
        (([0.0, 1.0], [[0.1], [np.inf]]), "positions: got inf"),
    ]:
        with pytest.raises(InvalidValueError, match=words):
            pk.Trajectory.from_positions(PEPPER, *arguments, joints="HeadYaw")


def test_other_misuse_is_named():
    with pytest.raises(UnknownNameError, match="Tail"):
        pk.Trajectory.from_positions(PEPPER, [0, 1], [[0], [1]], joints="Tail")
    with pytest.raises(InvalidValueError, match="interpolation: got 'linear'"):
        pk.Trajectory.from_positions(PEPPER, [0, 1], [[0], [1]], joints="HeadYaw", interpolation="linear")


def test_key_frames_are_passed_and_never_left():
    frames = {
        0.5: {"RShoulderPitch": -0.5, "head": (0.2, -0.1)},
        1.0: "Crouch",
        1.5: {"RShoulderPitch": 0.3},
        2.0: STAND,
    }
    found = pk.Trajectory.from_keyframes(PEPPER, frames)
    crouch, pitch = PEPPER.posture("Crouch"), PEPPER.joint_index("RShoulderPitch")
    np.testing.assert_allclose(found(0.0).position, STAND, atol=1e-12)
    np.testing.assert_allclose(found(0.5).position[[3, 4, pitch]], (0.2, -0.1, -0.5), atol=1e-12)
    np.testing.assert_allclose(found(1.0).position, crouch, atol=1e-12)
    assert found(1.5).position[pitch] == pytest.approx(0.3)
    np.testing.assert_allclose(found(2.0).position, STAND, atol=1e-12)
    # Joints that the first frame does not name are on their way to the second; those of the third likewise.
    knee = found(np.linspace(0.0, 1.0, 101)).position[:, 0]
    assert np.all(np.diff(knee) * np.sign(crouch[0] - STAND[0]) >= -1e-12)
    for first, last in ((0.0, 0.5), (0.5, 1.0), (1.0, 1.5), (1.5, 2.0)):
        between = found(np.linspace(first, last, 201)).position[:, pitch]
        assert between.min() >= min(between[0], between[-1]) - 1e-12
        assert between.max() <= max(between[0], between[-1]) + 1e-12
    np.testing.assert_allclose(found([0.0, 2.0]).velocity, 0.0, atol=1e-12)
    velocity = [found.at_segments(k, s).velocity for k, s in ((0, np.diff(found.breaks)[0]), (1, 0.0))]
    np.testing.assert_allclose(velocity[0], velocity[1], atol=1e-9)


def test_key_frames_may_be_pairs_and_begin_elsewhere():
    pairs = [(1.0, {"HeadYaw": 0.5}), (2.0, {"HeadYaw": 0.0})]
    found = pk.Trajectory.from_keyframes(PEPPER, pairs, start="Crouch")
    assert found.duration == 2.0
    np.testing.assert_allclose(np.delete(found(1.3).position, 3), np.delete(PEPPER.posture("Crouch"), 3))
    assert found.check(PEPPER, collisions=False).success


def test_wrong_key_frames_are_named():
    for frames, error, words in [
        ({}, InvalidValueError, "times of keyframes"),
        ({0.0: "Stand"}, InvalidValueError, "times of keyframes"),
        ([(2.0, "Stand"), (1.0, "Crouch")], InvalidValueError, "times of keyframes"),
        (["Stand", "Crouch"], InvalidValueError, "keyframes: got"),
        ({1.0: "Sit"}, UnknownNameError, "unknown posture 'Sit'"),
        ({1.0: {"Tail": 0.1}}, UnknownNameError, "unknown joint or group 'Tail'"),
        ({1.0: {}}, InvalidValueError, "keyframe at 1 s: got no joint"),
        ({1.0: {"HeadYaw": np.nan}}, InvalidValueError, "keyframe at 1 s: position of HeadYaw: got nan"),
        ({1.0: {"HeadYaw": 3.0}}, LimitError, "keyframe at 1 s: HeadYaw = 3 rad is outside"),
    ]:
        with pytest.raises(error, match=words):
            pk.Trajectory.from_keyframes(PEPPER, frames)
