"""Trajectory messages: interpolation against SciPy, and what is refused."""

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicHermiteSpline
from short_messages import trajectory

from pepper_kin.files.motion_points import points_every
from pepper_kin.ros.joint_trajectory import (
    ErrorCode,
    StartState,
    TrajectoryRefusedError,
    check_joints,
    message_of,
    tolerance_of,
    trajectory_of,
)
from pepper_kin.ros_messages import message_type

START = StartState(np.array([0.1, -0.2]), np.array([0.3, 0.0]), np.full(2, -2.0), np.full(2, 2.0))
NAMES = ("HeadYaw", "HeadPitch")
TIMES = np.array([0.0, 0.5, 1.25])
PLACES = np.array([[0.1, -0.2], [0.4, 0.1], [0.0, 0.3]])
SLOPES = np.array([[0.3, 0.0], [0.2, 0.5], [0.0, 0.0]])
BENDS = np.array([[0.0, 0.0], [-1.0, 2.0], [0.5, -0.5]])


def made(count):
    tables = (PLACES, SLOPES, BENDS)[:count]
    points = [(TIMES[i], *(table[i] for table in tables)) for i in (1, 2)]
    return trajectory_of(trajectory(NAMES, *points), START)


def test_positions_alone_are_joined_by_lines():
    t = np.linspace(0.0, 1.25, 101)
    found = made(1)(t).position
    expected = np.column_stack([np.interp(t, TIMES, PLACES[:, k]) for k in range(2)])
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_velocities_make_cubics():
    t = np.linspace(0.0, 1.25, 101)
    spline = CubicHermiteSpline(TIMES, PLACES, SLOPES)
    np.testing.assert_allclose(made(2)(t).position, spline(t), atol=1e-12)
    np.testing.assert_allclose(made(2)(t[:-1]).velocity, spline(t[:-1], 1), atol=1e-10)


def test_accelerations_make_quintics():
    t = np.linspace(0.0, 1.25, 101)
    spline = BPoly.from_derivatives(TIMES, np.stack([PLACES, SLOPES, BENDS], axis=1))
    np.testing.assert_allclose(made(3)(t).position, spline(t), atol=1e-10)


def test_the_acceleration_of_a_first_point_at_time_zero_is_taken():
    """As ros2_control does; it was zero, which changed motions that set out with an acceleration."""
    bends = BENDS + np.array([[1.0, -2.0], [0.0, 0.0], [0.0, 0.0]])
    points = [(TIMES[i], PLACES[i], SLOPES[i], bends[i]) for i in range(3)]
    t = np.linspace(0.0, 1.25, 101)
    spline = BPoly.from_derivatives(TIMES, np.stack([PLACES, SLOPES, bends], axis=1))
    np.testing.assert_allclose(
        trajectory_of(trajectory(NAMES, *points), START)(t).position, spline(t), atol=1e-10
    )


def test_a_planned_trajectory_survives_the_message(pepper):
    import pepper_kin as pk

    goal = pepper.joint_vector({"HeadYaw": 0.8, "LElbowRoll": -1.0})
    planned = pk.retime(pepper, np.stack([pepper.neutral(), goal]))
    message = message_of(points_every(planned, 0.05), ("HeadYaw", "LElbowRoll"))
    rows = [pepper.joint_index(name) for name in message.joint_names]
    start = StartState(planned.start[rows], np.zeros(2), pepper.lower_limits[rows], pepper.upper_limits[rows])
    t = np.linspace(0.0, planned.duration, 500)
    found = trajectory_of(message, start)(t).position
    assert np.abs(found - planned(t).position[:, rows]).max() < 2e-3


def test_refused_points():
    for points, words in [
        ([], "no points"),
        ([(0.5, [0.0, 0.0]), (0.5, [0.1, 0.1])], "point 1 at 0.5 s does not come after"),
        ([(-0.5, [0.0, 0.0])], "point 0 at -0.5 s"),
        ([(0.5, [0.0])], "point 0 has 1 positions for 2 joints"),
        ([(0.5, [0.0, 0.0], [0.0])], "point 0 has 1 velocities for 2 joints"),
        ([(0.5, [float("nan"), 0.0])], "positions of HeadYaw is nan"),
        ([(0.5, [0.0, 3.0])], "HeadPitch at 3 is outside of its limits -2 ... 2"),
        ([(0.5, [0.0, 0.0], [0.0, 0.4])], "velocity of HeadPitch at the last point is 0.4"),
        ([(0.5, [0.0, 0.0], [], [], [1.0, 1.0])], "efforts"),
        ([(1e-9, [1.0, 1.0], [0.0, 0.0]), (1e300, [0.0, 0.0], [0.0, 0.0])][:0], "no points"),
    ]:
        with pytest.raises(TrajectoryRefusedError, match=words.replace("(", r"\(")) as caught:
            trajectory_of(trajectory(NAMES, *points), START)
        assert caught.value.code is ErrorCode.INVALID_GOAL


def test_refused_joints():
    for names, words in [
        ((), "no joint names"),
        (("Tail",), "no joint 'Tail'"),
        (("HeadYaw", "HeadYaw"), "occurs twice"),
    ]:
        with pytest.raises(TrajectoryRefusedError, match=words) as caught:
            check_joints(names, NAMES, "Head_controller")
        assert caught.value.code is ErrorCode.INVALID_JOINTS


def test_tolerances():
    kind = message_type("control_msgs/msg/JointTolerance")
    found = tolerance_of([kind(name="HeadYaw", position=-1.0, velocity=0.5)], NAMES, 0.1)
    assert found.position.tolist() == [np.inf, 0.1]
    assert found.velocity.tolist() == [0.5, np.inf]
    assert found.violated(NAMES, np.array([9.0, 0.09]), np.array([0.4, 9.0])) == ""
    assert "position error of HeadPitch is 0.1100" in found.violated(NAMES, np.array([0, 0.11]), np.zeros(2))
    assert "velocity error of HeadYaw" in found.violated(NAMES, np.zeros(2), np.array([-0.6, 0]))
    with pytest.raises(TrajectoryRefusedError, match="tolerance of 'Tail'"):
        tolerance_of([kind(name="Tail")], NAMES, 0.1)
