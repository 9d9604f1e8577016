"""Points of a trajectory for files and robots, and the curve that readers interpolate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.files.sampled_motion import through_points
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.samples import State, sample_times
from pepper_kin.trajectory.trajectory import Trajectory

Nanoseconds = NDArray[np.int64]

NANOSECONDS = 1_000_000_000
_LEAST_STEP = 3e-5  # minimum duration of a segment [s]: rounding to nanoseconds costs accelerations digits
_MERGED = 1e-5  # minimum time between knots [s]: closer ones are merged
_MOST_POINTS = 100_000
_JUMP = 1e-6  # minimum jump of acceleration, relative to its limit
_OVER = 5e-6  # relative excess of a limit above which a segment is halved; slowing corrects the rest
_REST = 1e-6  # speed below which the last velocity is written as zero [rad/s or m/s]
_INSIDE = np.array([0.0, 0.25, 0.5, 0.75, 1.0])


class MotionPoints(NamedTuple):
    """A motion at discrete times.

    Between two points the motion is of degree 5 if accelerations are known, else of degree 3, as the
    JointTrajectoryController of ros2_control and NAOqi's Bezier curves with handles of a third of the time
    between two keys interpolate.

    Attributes:
        joint_names: Names of the joints, in the order of the columns.
        joint_units: "rad" or "m" for each joint.
        stamps: Times, increasing from 0 [ns], shape (T,).
        position: Positions [rad or m], shape (T, n).
        velocity: Velocities [rad/s or m/s], shape (T, n).
        acceleration: Accelerations [rad/s^2 or m/s^2], shape (T, n), or None.
    """

    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    stamps: Nanoseconds
    position: Array
    velocity: Array
    acceleration: Array | None

    @property
    def time(self) -> Array:
        """Times [s], shape (T,)."""
        return self.stamps / NANOSECONDS

    def curve(self) -> Trajectory:
        """Return the motion that readers interpolate between the points.

        Raises:
            InvalidValueError: for points so near in time that the polynomials overflow.
        """
        return through_points(
            self.joint_names, self.joint_units, self.time, self.position, self.velocity, self.acceleration
        )


def points_at(
    trajectory: Trajectory, time: Array, *, quintic: bool, from_rest: bool, stretch: float = 1.0
) -> MotionPoints:
    """Return the points of a trajectory at given times.

    Args:
        trajectory: The trajectory.
        time: Times, increasing from 0 to the trajectory's duration [s], shape (T,).
        quintic: Whether the points have accelerations.
        from_rest: Whether the first velocity is written as zero, which some readers assume.
        stretch: Factor on all times, by which the motion is slowed.

    Raises:
        InvalidValueError: for times that are equal to a nanosecond.
    """
    stamps = np.round(time * (stretch * NANOSECONDS)).astype(np.int64)
    if np.any(np.diff(stamps) <= 0):
        raise InvalidValueError(
            "dt", f"{np.diff(time).min():.3g} s", "at least 1e-9 s, as files count whole nanoseconds"
        )
    state = trajectory(np.minimum(stamps / (stretch * NANOSECONDS), trajectory.duration))
    velocity = state.velocity / stretch
    # A controller of ros2_control refuses motions whose last velocity is not exactly zero.
    velocity[-1] = np.where(np.abs(velocity[-1]) < _REST, 0.0, velocity[-1])
    if from_rest:
        velocity[0] = 0.0
    bend = state.acceleration / stretch**2 if quintic else None
    return MotionPoints(
        trajectory.joint_names, trajectory.joint_units, stamps, state.position, velocity, bend
    )


def points_every(trajectory: Trajectory, dt: float, bezier: bool = False) -> MotionPoints:
    """Return the points of a trajectory at 0, dt, 2 dt, ... and at its duration.

    Args:
        trajectory: The trajectory.
        dt: Time between points, at least 1 ns [s].
        bezier: Whether NAOqi interpolates: the points have no accelerations and begin at rest.

    Raises:
        InvalidValueError: for a dt that is too small or not above zero.
    """
    time = sample_times(trajectory.duration, dt)
    return points_at(trajectory, time, quintic=not bezier, from_rest=bezier)


def slowing_needed(pepper: PepperModel, curve: Trajectory) -> Array:
    """Return the factor on time that is needed to keep velocity and acceleration limits at some states.

    Five states of each segment are used, which include the maximum accelerations of cubics: a factor above 1
    fails `check`, but a lower one may fail, too.

    Returns:
        Factor for each segment, shape (m,).
    """
    state = _inside(curve)
    with np.errstate(invalid="ignore", divide="ignore"):
        slow = np.sqrt(np.abs(state.acceleration) / pepper.acceleration_limits)
        use = np.maximum(slow, np.abs(state.velocity) / pepper.velocity_limits)
    return np.asarray(np.nan_to_num(use, posinf=np.inf).max(axis=(1, 2)))  # 0 / 0 where a joint is fixed


def points_near(
    pepper: PepperModel, trajectory: Trajectory, step: float, tolerance: float, bezier: bool = False
) -> tuple[Array, bool]:
    """Return times of points whose interpolated curve is near a trajectory, also at jumps of acceleration.

    A polynomial across a jump cannot keep an acceleration limit that is used on both sides, so points lie at
    the jumps, with cubics between them. A motion without jumps gets quintics between its own knots. Segments
    are halved if their acceleration deviates by more than the tolerance, or exceeds its limit.

    Args:
        pepper: The robot.
        trajectory: The trajectory.
        step: Maximum time between points [s].
        tolerance: Maximum error of accelerations, relative to their limits.
        bezier: Whether NAOqi interpolates.

    Returns:
        Times [s], shape (T,), and whether the points need accelerations.
    """
    jumps = _jumps(pepper, trajectory)
    quintic = not (jumps.size or bezier)
    inner = trajectory.breaks[1:-1] if quintic else jumps  # motions with jerk limits are quintics already
    time = np.concatenate([[0.0], inner, [trajectory.duration]])
    time = time[np.concatenate([[True], np.diff(time) > _MERGED])]
    time[-1] = trajectory.duration
    parts = np.maximum(np.ceil(np.diff(time) / step - 1e-9), 1).astype(int)
    time = np.interp(
        np.arange(parts.sum() + 1), np.concatenate([[0], np.cumsum(parts)]), time
    )  # each interval divided into equal parts
    scale = _acceleration_scale(pepper)
    while time.size < _MOST_POINTS:
        curve = points_at(trajectory, time, quintic=quintic, from_rest=bezier).curve()
        width = np.diff(time)
        # States of the trajectory slightly inside the segments, since accelerations may jump at their ends.
        inside = time[:-1, None] + width[:, None] * np.clip(_INSIDE, 1e-3, 1 - 1e-3)
        error = np.abs(_inside(curve).acceleration - trajectory(inside).acceleration) / scale
        over = slowing_needed(pepper, curve) > 1.0 + _OVER
        wrong = (over | (error.max(axis=(1, 2)) > tolerance)) & (width >= 2 * _LEAST_STEP)
        if not wrong.any():
            break
        time = np.sort(np.concatenate([time, (time[:-1] + width / 2)[wrong]]))
    return time, quintic


def _jumps(pepper: PepperModel, trajectory: Trajectory) -> Array:
    """Return the times at which accelerations jump [s]."""
    width = np.diff(trajectory.breaks)
    every = np.arange(width.size)
    before = trajectory.at_segments(every[:-1], width[:-1]).acceleration
    after = trajectory.at_segments(every[1:], 0 * width[1:]).acceleration
    size = np.abs(after - before) / _acceleration_scale(pepper)
    return trajectory.breaks[1:-1][size.max(axis=1, initial=0.0) > _JUMP]


def _acceleration_scale(pepper: PepperModel) -> Array:
    """Return the acceleration limits, 1 for joints without any [rad/s^2 or m/s^2], shape (n,)."""
    limits = pepper.acceleration_limits
    return np.where(np.isfinite(limits), limits, 1.0)


def _inside(curve: Trajectory) -> State:
    """Return five states of each segment, shape (m, 5, n)."""
    width = np.diff(curve.breaks)
    shape = (width.size, _INSIDE.size)
    return curve.at_segments(np.broadcast_to(np.arange(width.size)[:, None], shape), width[:, None] * _INSIDE)
