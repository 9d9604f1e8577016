"""Conversion of JointTrajectory messages to checked trajectories, with ros2_control's interpolation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.splines import quintic_hermite
from pepper_kin.exceptions import PepperKinError, beside_limits, shortened
from pepper_kin.file_access.reading import repeated
from pepper_kin.files.motion_points import MotionPoints
from pepper_kin.ros.message_parts import duration_message
from pepper_kin.ros_messages import message_type
from pepper_kin.trajectory import Trajectory

STANDING = 1e-3
"""Velocity of the last point up to which it counts as at rest [rad/s]."""

LIMIT_SLACK = 1e-4
"""Tolerance of position limits, for rounding [rad]."""

MOST_POINTS = 100_000
"""Maximum number of points of a message."""


class ErrorCode(IntEnum):
    """Result codes of control_msgs/action/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class TrajectoryRefusedError(PepperKinError):
    """A trajectory was refused.

    Attributes:
        code: Result code of the action.
        reason: Reason with names and numbers.
    """

    def __init__(self, code: ErrorCode, reason: str) -> None:
        self.code, self.reason = code, reason
        super().__init__(reason)


class StartState(NamedTuple):
    """Commanded state at the start of a trajectory, arrays of shape (n,) in the order of its joints.

    Attributes:
        position: Positions [rad or m].
        velocity: Velocities [rad/s or m/s].
        lower: Lower limits of position [rad or m].
        upper: Upper limits of position [rad or m].
    """

    position: Array
    velocity: Array
    lower: Array
    upper: Array


def seconds(stamp: Any) -> float:
    """Convert a Time or Duration message to seconds."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def check_joints(names: Sequence[str], allowed: Sequence[str], controller: str) -> None:
    """Check that joints belong to a controller and occur once.

    Raises:
        TrajectoryRefusedError: with the code INVALID_JOINTS and their names.
    """
    known = set(allowed)
    unknown = [name for name in names if name not in known]
    twice = repeated(names)
    if names and not unknown and not twice:
        return
    what = "it has no joint names"
    if unknown:
        what = f"it has no joint {', '.join(shortened(repr(name)) for name in unknown[:5])}"
    elif twice:
        what = f"{twice[0]!r} occurs twice"
    raise TrajectoryRefusedError(
        ErrorCode.INVALID_JOINTS, f"{controller}: {what}; its joints are {', '.join(allowed)}"
    )


def refuse_other_parts(goal: Any) -> None:
    """Refuse a goal of control_msgs/action/FollowJointTrajectory with parts besides joints.

    Raises:
        TrajectoryRefusedError: with the name of the part.
    """
    parts = {
        "multi_dof_trajectory": goal.multi_dof_trajectory.points,
        "component_path_tolerance": goal.component_path_tolerance,
        "component_goal_tolerance": goal.component_goal_tolerance,
    }
    for name, part in parts.items():
        if len(part):
            raise _invalid(f"it has a {name}; only joints are followed")


def trajectory_of(message: Any, start: StartState) -> Trajectory:
    """Return the trajectory of a message, from the joints' present commands.

    The interpolation equals ros2_control's JointTrajectoryController: degree 5 between two points that
    both have velocities and accelerations, degree 3 if both have velocities, otherwise a line.  The
    trajectory starts at time 0 with the present command; a first point at time 0 is skipped if other points
    follow.

    Args:
        message: `trajectory_msgs/msg/JointTrajectory` with checked joints.
        start: Commanded state of its joints, in their order.

    Raises:
        TrajectoryRefusedError: with the code INVALID_GOAL, the point, the joint and the reason.
    """
    names = tuple(str(name) for name in message.joint_names)
    points = list(message.points)
    if not points:
        raise _invalid("it has no points")
    if len(points) > MOST_POINTS:
        raise _invalid(f"it has {len(points)} points, at most {MOST_POINTS} are allowed")
    times = np.array([seconds(point.time_from_start) for point in points])
    if times[0] < 0 or np.any(np.diff(times) <= 0):
        late = int(np.argmax(np.diff(times, prepend=-1e-12) <= 0))
        raise _invalid(f"point {late} at {times[late]:g} s does not come after the one before")
    position = _table(points, "positions", names, required=True)
    velocity = _table(points, "velocities", names)
    acceleration = _table(points, "accelerations", names)
    assert position is not None
    if any(len(point.effort) for point in points):
        raise _invalid("its points have efforts; positions are controlled")
    _check_limits(names, position, start)
    if velocity is not None and np.abs(velocity[-1]).max() > STANDING:
        k = int(np.argmax(np.abs(velocity[-1])))
        raise _invalid(f"the velocity of {names[k]} at the last point is {velocity[-1, k]:g} rad/s, not 0")
    return _segments(names, times, (position, velocity, acceleration), start)


def _segments(
    names: tuple[str, ...],
    times: Array,
    points: tuple[Array, Array | None, Array | None],
    start: StartState,
) -> Trajectory:
    """Return the polynomials through points at times [s], shape (T,)."""
    position, velocity, acceleration = points
    first = np.zeros(len(names)) if acceleration is None or times[0] > 0.0 else acceleration[0]
    if times[0] == 0.0 and len(times) > 1:  # a desired position for now: the commanded one is used
        times, position = times[1:], position[1:]
        velocity = None if velocity is None else velocity[1:]
        acceleration = None if acceleration is None else acceleration[1:]
    elif times[0] == 0.0:  # a single point at time 0: as soon as the limits allow
        times = np.array([1e-3])
    step = np.diff(times, prepend=0.0)
    place = np.vstack([start.position, position])
    m, n = len(times), len(names)
    coefficients = np.zeros((m, 6, n))
    if velocity is not None and acceleration is not None:
        slope = np.vstack([start.velocity, velocity])
        bend = np.vstack([first, acceleration])
        coefficients = quintic_hermite(step, place, slope, bend)
    elif velocity is not None:
        slope, h = np.vstack([start.velocity, velocity]), step[:, None]
        mean = np.diff(place, axis=0) / h
        coefficients[:, 0], coefficients[:, 1] = place[:-1], slope[:-1]
        coefficients[:, 2] = (3 * mean - 2 * slope[:-1] - slope[1:]) / h
        coefficients[:, 3] = (slope[:-1] + slope[1:] - 2 * mean) / h**2
    else:
        coefficients[:, 0], coefficients[:, 1] = place[:-1], np.diff(place, axis=0) / step[:, None]
    if not np.isfinite(coefficients).all():
        raise _invalid("its points are so near in time that no finite speeds lie between them")
    return Trajectory(names, np.concatenate([[0.0], times]), coefficients)


def _table(points: list[Any], field: str, names: tuple[str, ...], required: bool = False) -> Array | None:
    """Return a field of all points, shape (T, n), or None if it is empty in all points."""
    rows = [getattr(point, field) for point in points]
    lengths = {len(row) for row in rows}
    if lengths == {0} and not required:
        return None
    wrong = next((i for i, row in enumerate(rows) if len(row) != len(names)), None)
    if wrong is not None:
        raise _invalid(f"point {wrong} has {len(rows[wrong])} {field} for {len(names)} joints")
    table = np.array(rows, dtype=float)
    if not np.isfinite(table).all():
        i, k = (int(x) for x in np.argwhere(~np.isfinite(table))[0])
        raise _invalid(f"point {i}: {field} of {names[k]} is {table[i, k]}")
    return table


def _check_limits(names: tuple[str, ...], position: Array, start: StartState) -> None:
    """Raise for positions [rad or m], shape (T, n), outside the limits."""
    outside = (position < start.lower - LIMIT_SLACK) | (position > start.upper + LIMIT_SLACK)
    if outside.any():
        i, k = (int(x) for x in np.argwhere(outside)[0])
        value, *limits = beside_limits(position[i, k], start.lower[k], start.upper[k], outside=True, digits=6)
        reason = f"{names[k]} at {value} is outside of its limits {' ... '.join(limits)} rad"
        raise _invalid(f"point {i}: {reason}")


def _invalid(reason: str) -> TrajectoryRefusedError:
    return TrajectoryRefusedError(ErrorCode.INVALID_GOAL, reason)


class JointTolerance(NamedTuple):
    """Tolerances of joint errors; infinity for none.

    Attributes:
        position: Largest position errors [rad or m], shape (n,).
        velocity: Largest velocity errors [rad/s or m/s], shape (n,).
    """

    position: Array
    velocity: Array

    def violated(self, names: Sequence[str], error: Array, rate: Array) -> str:
        """Return which joint violates its tolerance and by how much; "" if none does.

        Args:
            names: Names of the joints.
            error: Position errors [rad or m], shape (n,).
            rate: Velocity errors [rad/s or m/s], shape (n,).
        """
        for quantity, value, most, unit in (
            ("position", error, self.position, "rad"),
            ("velocity", rate, self.velocity, "rad/s"),
        ):
            over = np.abs(value) - most
            k = int(np.argmax(over))
            if over[k] > 0.0:
                return (
                    f"{quantity} error of {names[k]} is {abs(float(value[k])):.4f} {unit}, "
                    f"its tolerance {float(most[k]):g} {unit}"
                )
        return ""


def tolerance_of(messages: Sequence[Any], names: Sequence[str], default: float) -> JointTolerance:
    """Return the tolerances of a goal: 0 means the default, a negative value no tolerance.

    Args:
        messages: `control_msgs/msg/JointTolerance`.
        names: Names of the joints.
        default: Default tolerance of positions [rad or m]; velocities have none.

    Raises:
        TrajectoryRefusedError: with the code INVALID_GOAL, for other joints, or NaN.
    """
    position, velocity = np.full(len(names), default), np.full(len(names), math.inf)
    for message in messages:
        if message.name not in names:
            known = ", ".join(names)
            raise _invalid(f"tolerance of {shortened(repr(message.name))}; the trajectory has {known}")
        k = list(names).index(message.name)
        for limits, value in ((position, message.position), (velocity, message.velocity)):
            if math.isnan(value):
                raise _invalid(f"a tolerance of {message.name} is nan")
            if value != 0.0:
                limits[k] = value if value > 0.0 else math.inf
    return JointTolerance(position, velocity)


def message_of(points: MotionPoints, joints: Sequence[str] | None = None) -> Any:
    """Return a motion's points as trajectory_msgs/msg/JointTrajectory.

    Args:
        points: Certified points, from `pepper_kin.files.ros_points`.
        joints: Names of the joints in the message; None for all.
    """
    names = points.joint_names if joints is None else tuple(joints)
    rows = [points.joint_names.index(name) for name in names]
    kind = message_type("trajectory_msgs/msg/JointTrajectoryPoint")
    velocity = points.velocity[:, rows].copy()
    velocity[-1] = 0.0 if np.abs(velocity[-1]).max() < STANDING else velocity[-1]
    none = np.empty((len(velocity), 0))
    acceleration = none if points.acceleration is None else points.acceleration[:, rows]
    made = [
        kind(positions=p, velocities=v, accelerations=a, time_from_start=duration_message(t))
        for t, p, v, a in zip(
            points.time.tolist(), points.position[:, rows], velocity, acceleration, strict=True
        )
    ]
    return message_type("trajectory_msgs/msg/JointTrajectory")(joint_names=list(names), points=made)
