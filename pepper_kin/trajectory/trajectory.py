"""A trajectory: joint positions as piecewise polynomials of time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.core.splines import clamp, evaluate_at_times
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite, as_numbers, check_positive
from pepper_kin.trajectory import editing
from pepper_kin.trajectory.active_limits import ActiveLimits, active_limits
from pepper_kin.trajectory.certificate import Certificate
from pepper_kin.trajectory.check import check
from pepper_kin.trajectory.interpolation import from_positions
from pepper_kin.trajectory.key_curve import Frame, from_keyframes
from pepper_kin.trajectory.plot import plot
from pepper_kin.trajectory.samples import (
    TIME_TOLERANCE,
    Samples,
    State,
    checked_derivatives,
    known,
    names_and_units,
    sample_times,
)
from pepper_kin.trajectory.splice import Splice, replaced
from pepper_kin.trajectory.stop import Stop, stop

if TYPE_CHECKING:
    from pathlib import Path

    from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False)
class Trajectory(FrozenArrays):
    """Joint positions as piecewise polynomials of time; exact, frozen, read-only.

    On piece i, where breaks[i] <= t <= breaks[i + 1],
        q(t) = sum_p coefficients[i, p] (t - breaks[i])^p.
    At a break the later piece gives the values, at the end the last.

    Two trajectories are equal (==) when their names, durations, and positions, velocities and accelerations
    at all times agree to 1e-9; see `is_close`.

    Attributes:
        joint_names: Names of the joints, in the order of every joint vector.
        breaks: Ends of the pieces [s], shape (m + 1,), increasing from 0.
        coefficients: Coefficients, constant term first, shape (m, k, n) [rad/s^p or m/s^p].
        joint_units: "rad" or "m" for each joint; all "rad" if omitted.
    """

    joint_names: tuple[str, ...]
    breaks: Array
    coefficients: Array
    joint_units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: naming the field, for a wrong shape, NaN, breaks that do not increase from 0
                (a duration of zero among them), or names that are not unique.
        """
        names, units = names_and_units(self.joint_names, self.joint_units)
        breaks = read_only(as_finite(self.breaks, "breaks", (None,)))
        if breaks.size < 2 or breaks[0] != 0.0 or np.any(np.diff(breaks) <= 0):
            raise InvalidValueError(
                "breaks", np.array2string(breaks, threshold=6), "two or more times that increase from 0"
            )
        shape = (breaks.size - 1, None, len(names))
        coefficients = read_only(np.ascontiguousarray(as_finite(self.coefficients, "coefficients", shape)))
        if coefficients.shape[1] == 0:
            raise InvalidValueError("coefficients", f"shape {coefficients.shape}", "at least a constant term")
        for name, value in (
            ("joint_names", names),
            ("joint_units", units),
            ("breaks", breaks),
            ("coefficients", coefficients),
        ):
            object.__setattr__(self, name, value)

    @classmethod
    def from_positions(
        cls,
        pepper: PepperModel | None,
        times: ArrayLike,
        positions: ArrayLike,
        *,
        joints: str | Sequence[str] | None = None,
        rest: ArrayLike | None = None,
        interpolation: str = "cubic",
        overshoot: float = 0.01,
        start_velocity: ArrayLike | None = None,
        end_velocity: ArrayLike | None = None,
    ) -> Trajectory:
        """Return the trajectory through positions at given times, such as a recording's.

        The trajectory passes every position at its time, and is at rest at both ends unless velocities are
        given.  Limits are not enforced: `check` it, or time it again with `retime(pepper, positions)`.

        Args:
            pepper: The robot, whose joints and limits are used: the trajectory has all of its joints; None
                for a trajectory of `joints` alone, all in radians.
            times: Increasing times [s], shape (T,), two or more; the first becomes time 0.
            positions: Joint positions [rad or m], shape (T, k), a column for each of `joints`.
            joints: Names of joints and groups that the columns are for, see `PepperModel.resolve_joints`; all
                joints of the robot if omitted.  Without a robot, the names of the columns.
            rest: Positions of the robot's other joints [rad or m], shape (n,); Stand, or neutral, if omitted.
            interpolation: "cubic": the cubic spline, whose acceleration is continuous; "monotone": cubic
                pieces that never leave the two positions at their ends, whose acceleration jumps
                (Fritsch and Butland 1984; `scipy.interpolate.PchipInterpolator`).
            overshoot: Excess over the range of a joint's samples, or over its limits, without a warning [rad
                or m].
            start_velocity: Initial velocity of the columns [rad/s or m/s], shape (k,); None for rest, which
                "monotone" requires.
            end_velocity: Final velocity of the columns [rad/s or m/s], shape (k,), such as the initial
                velocity of a trajectory joined by `then`; None for rest, which "monotone" requires.

        Raises:
            InvalidValueError: naming the argument, for a wrong shape, NaN, or times that do not increase; for
                a start or end velocity with "monotone".
            UnknownNameError: for a joint or group that the robot lacks, or another interpolation.

        Warns:
            OvershootWarning: naming the worst joints, where the trajectory leaves the range of a joint's
                samples, or its limits, by more than `overshoot`.
        """
        return from_positions(
            cls,
            pepper,
            times,
            positions,
            joints=joints,
            rest=rest,
            interpolation=interpolation,
            overshoot=overshoot,
            end_velocities=(start_velocity, end_velocity),
        )

    @classmethod
    def from_keyframes(
        cls,
        pepper: PepperModel,
        keyframes: Mapping[float, Frame] | Iterable[tuple[float, Frame]],
        *,
        start: str | ArrayLike | None = None,
    ) -> Trajectory:
        """Return the motion through keyframes: postures at given times, of all joints or some.

            wave = Trajectory.from_keyframes(
                pepper, {0.0: "Stand", 1.0: {"RShoulderPitch": -0.9, "RElbowRoll": 1.2}, 2.5: "Stand"}
            )

        A joint moves between consecutive frames that name it; it stays between their two positions, and stops
        where it reverses (a `Timeline` with automatic handles).  Speeds follow from the times alone: `check`
        it; `enforce_limits` slows it down where necessary, and `retime(pepper, postures)` finds the times
        itself.

        Args:
            pepper: The robot.
            keyframes: Time [s] -> frame, or pairs (time, frame), with times that increase from 0 or later.  A
                frame is a posture's name, a mapping from names of joints and groups to positions, or all n
                positions [rad or m], see `PepperModel.joint_vector`.
            start: Initial positions of joints that no frame at time 0 names: a posture's name or positions
                [rad or m], shape (n,); Stand, or neutral, if omitted.

        Raises:
            InvalidValueError: for times that do not increase, or an invalid frame.
            UnknownNameError: for a posture, joint or group that the robot lacks.
            LimitError: for a position outside the limits, naming frame and joint.
        """
        return from_keyframes(cls, pepper, keyframes, start)

    def __repr__(self) -> str:
        return f"Trajectory({self.n} joints, {self.duration:.4g} s, {self.breaks.size - 1} pieces)"

    def __call__(self, t: ArrayLike) -> State:
        """Return position, velocity and acceleration at given times.

        Args:
            t: Times within [0, duration] [s], shape (...).

        Returns:
            Arrays of shape (..., n).

        Raises:
            InvalidValueError: for a time that is NaN or more than 1e-9 s outside.
        """
        state = self._derivatives(t, 3)
        return State(state[0], state[1], state[2])

    def at_segments(self, segment: ArrayLike, local_time: ArrayLike) -> State:
        """Return the state at local times of given pieces, which distinguishes the two sides of a break.

        Args:
            segment: Indices of pieces, shape (...).
            local_time: Time since the start of the piece [s], shape (...).

        Returns:
            Arrays of shape (..., n).

        Raises:
            InvalidValueError: for a piece that does not exist, a time that is not a finite number, or shapes
                that do not broadcast.
        """
        state = checked_derivatives(self.coefficients, segment, local_time, 3)
        return State(state[0], state[1], state[2])

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.breaks[-1])

    @property
    def knots(self) -> Array:
        """Times where pieces meet, both ends included [s], shape (m + 1,)."""
        return self.breaks

    @property
    def start(self) -> Array:
        """First position [rad or m], shape (n,)."""
        return self.coefficients[0, 0]

    @property
    def end(self) -> Array:
        """Last position [rad or m], shape (n,)."""
        return self(self.duration).position

    def sample(self, dt: float) -> Samples:
        """Return the trajectory at 0, dt, 2 dt, ... and exactly at its duration.

        Args:
            dt: Time between samples [s]; the last interval may be shorter.

        Returns:
            The samples.

        Raises:
            InvalidValueError: for a dt that is not above zero, or below a ten-millionth of the duration.
        """
        time = sample_times(self.duration, dt)
        return known(Samples, self.joint_names, self.joint_units, time=time, **self(time)._asdict())

    def is_close(self, other: Trajectory, tolerance: float = 1e-9) -> bool:
        """Return whether two trajectories are equal to a tolerance, however they are cut into pieces.

        Args:
            other: The other trajectory.
            tolerance: Maximum difference of duration [s] and of position, velocity and acceleration [SI
                units], each compared at as many points of every piece as the polynomials need.

        Returns:
            Whether they are equal; False if names or units differ.
        """
        if (self.joint_names, self.joint_units) != (other.joint_names, other.joint_units):
            return False
        if abs(self.duration - other.duration) > tolerance:
            return False
        knots = np.union1d(self.breaks, other.breaks)
        knots = knots[knots <= min(self.duration, other.duration)]
        # Inside the pieces, where neither trajectory is at one of its jumps of acceleration.
        points = max(self.coefficients.shape[1], other.coefficients.shape[1])
        inside = (np.arange(points) + 0.5) / points
        step = np.diff(knots)
        real = step > TIME_TOLERANCE  # shorter steps are one knot that was rounded in two ways
        time = (knots[:-1, None] + step[:, None] * inside)[real].ravel()
        return all(
            np.allclose(mine, theirs, rtol=0.0, atol=tolerance)
            for mine, theirs in zip(self(time), other(time), strict=True)
        )

    def __eq__(self, other: object) -> bool:
        return self.is_close(other) if isinstance(other, Trajectory) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def jerk(self, t: ArrayLike) -> Array:
        """Return d3q/dt3 at given times [rad/s^3 or m/s^3], shape (..., n); at a break the later piece's.

        Raises:
            InvalidValueError: for a time that is NaN or more than 1e-9 s outside.
        """
        return self._derivatives(t, 4)[3]

    def jerk_at_segments(self, segment: ArrayLike, local_time: ArrayLike) -> Array:
        """Return d3q/dt3 at local times [s] of given pieces [rad/s^3 or m/s^3], shape (..., n).

        Raises:
            InvalidValueError: for a piece that does not exist, a time that is not a finite number, or shapes
                that do not broadcast.
        """
        return np.asarray(checked_derivatives(self.coefficients, segment, local_time, 4)[3])

    def scaled(self, factor: float) -> Trajectory:
        """Return the trajectory that takes `factor` times as long along the same path, q(t / factor).

        Raises:
            InvalidValueError: for a factor that is not above zero.
        """
        return editing.scaled(self, factor)

    def with_duration(self, duration: float) -> Trajectory:
        """Return the trajectory that takes `duration` [s] along the same path.

        Raises:
            InvalidValueError: for a duration that is not above zero.
        """
        return self.scaled(check_positive("duration", duration, "s") / self.duration)

    def reversed(self) -> Trajectory:
        """Return the reversed trajectory, q(T - t)."""
        return editing.backward(self)

    def between(self, start: float, end: float) -> Trajectory:
        """Return the part from one time to another [s], which then begins at zero.

        Raises:
            InvalidValueError: for times outside [0, duration], or an end that is not after the start.
        """
        return editing.between(self, start, end)

    def then(self, other: Trajectory) -> Trajectory:
        """Return this trajectory with another one after it.

        Raises:
            InvalidValueError: if joints differ, or position or velocity differ by more than 1e-6 where they
                meet.
        """
        return editing.joined(self, other)

    def blend(self, other: Trajectory, overlap: float) -> Trajectory:
        """Return this trajectory with another one that begins `overlap` [s] before this one ends.

        During the overlap both motions are added, q(t) = q_1(t) + q_2(t - T_1 + overlap) - q_via, so that the
        robot passes near the waypoint instead of stopping there.  The sum may exceed limits that each motion
        keeps, and leaves the paths of both: check it, and slow it down if necessary.

        Raises:
            InvalidValueError: if joints differ, the two do not meet, or one is shorter than the overlap.
        """
        return editing.blended(self, other, overlap)

    def stop(self, pepper: PepperModel, at: float, how: str = "path", **options: Any) -> Stop:
        """Return the fastest stop from an instant on, which begins at position and velocity of this motion.

        "path": along the path of this motion, within acceleration limits at every instant, and within torque
        and balance limits at the nodes of intervals of at most 5 ms, with a reserve in between.  If this
        motion keeps its limits and the robot could rest anywhere on the path, such a stop always exists, and
        no other is shorter along the path: on every interval it has the minimum d2s/dt2 that
            |q'' x + q' d2s/dt2| <= a  and  |torque| <= tau,  x = (ds/dt)^2,
        allow (`pepper_kin.core.timing.stopping`).  With `jerk`, smooth slow-downs are tried (not the
        fastest); if none keeps all limits, the remaining motion is the stop, and `Stop.how` says so: this is
        frequent if the motion itself is at its jerk limits.

        "joints": every joint brakes by itself, with the same fraction of its acceleration limit, and with its
        jerk limit if `jerk` is given.  The robot leaves the path.  Positions, torque and balance are
        examined, and `Stop.exceeded` names the exceeded limits if no fraction tried keeps all of them.

        Args:
            pepper: The robot, which gives the limits.
            at: Time of the instant [s].
            how: "path" or "joints".
            **options: `scene`, for which the clearance is measured, with obstacles that move from time 0 of
                this motion on, and whose attached objects count with their mass; `torque`, False to leave it
                out; `torque_scale`, `balance` [m], `jerk` and `payload` as in `retime`, but by default full
                torque and no balance, so that a stop is as short as possible.

        Raises:
            InvalidValueError: for joints that are not the robot's, a time outside the motion, an option out
                of range.
            UnknownNameError: for another way to stop.
            InfeasibleError: for "path", if the motion ends before it can stop, or passes a posture that the
                robot could not hold.
        """
        return stop(pepper, self, at, how=how, **options)

    def replaced(
        self, pepper: PepperModel, at: float, goal: ArrayLike | Trajectory, **options: Any
    ) -> Splice:
        """Return this motion until an instant, then the motion to a new goal, if possible without a stop.

        The new motion goes straight to rest, each joint with a fraction of its acceleration limit, or more to
        turn within its range; or it joins another motion, now or during a `stop`.  Joints arrive together
        (`pepper_kin.core.timing.steering`; with `jerk`, `pepper_kin.trajectory.splice`); without `jerk`,
        accelerations may jump.  Limits of position, velocity, acceleration and jerk hold at every instant;
        torque and balance are examined every millisecond and on both sides of every knot.  The new motion is
        proven to touch nothing; a stop is examined for contact every millisecond.  If no fraction tried
        suffices, or only one so small that stopping first is faster, the motion stops first, and `Splice.how`
        says so.

        Args:
            pepper: The robot, which gives the limits.
            at: Time of the instant [s].
            goal: Joint positions [rad or m], shape (n,); or a trajectory that keeps limits and touches
                nothing, preferably one that begins where `stop` ends.
            **options: `scene`, which no body may touch; `torque`, False to leave it out; `torque_scale`,
                `balance` [m] and `jerk` as in `retime`: with `jerk`, accelerations are continuous too, except
                at the start of a stop of a motion without jerk limits.

        Raises:
            InvalidValueError: for joints that are not the robot's or have no limits, a time outside the
                motion, a wrong shape, NaN, or a goal at which the robot rests already.
            LimitError: for a goal outside the position limits.
            InfeasibleError: if no motion tried keeps all limits, naming the limits that the straight one
                exceeds.
        """
        return replaced(pepper, self, at, goal, **options)

    def active_limits(self, pepper: PepperModel, t: ArrayLike | None = None, **limits: Any) -> ActiveLimits:
        """Return the limit used most at times t [s], (T,); see `pepper_kin.trajectory.active_limits`."""
        return active_limits(pepper, self, t, **limits)

    def check(self, pepper: PepperModel, scene: Any = None, **limits: Any) -> Certificate:
        """Check limits, continuity, balance and clearance; see `pepper_kin.trajectory.check`."""
        return check(pepper, self, scene=scene, **limits)

    def plot(self, pepper: PepperModel, path: str | Path | None = None, **options: Any) -> Any:
        """Draw the trajectory against its limits, and the phase plane; see `pepper_kin.trajectory.plot`."""
        return plot(pepper, self, path, **options)

    def _derivatives(self, t: ArrayLike, count: int) -> Array:
        """Return the value and first derivatives at times [s], shape (count, ..., n)."""
        time, n = self._within(t), self.coefficients.shape[2]
        state, flat = np.empty((count, *time.shape, n)), time.reshape(-1)
        evaluate_at_times(self.breaks, self.coefficients, flat, state.reshape(count, flat.size, n))
        return state

    def _within(self, t: ArrayLike) -> Array:
        """Return a copy of times [s], shape (...), clamped to [0, duration].

        Raises:
            InvalidValueError: for a time that is NaN or more than 1e-9 s outside.
        """
        floats = isinstance(t, float) or getattr(t, "dtype", None) == np.float64
        time = np.array(t if floats else as_numbers(t, "t"), order="C")
        if not clamp.native(time.reshape(-1), self.duration, TIME_TOLERANCE):
            within = (time >= -TIME_TOLERANCE) & (time <= self.duration + TIME_TOLERANCE)
            allowed = f"times within [0, {self.duration:.9g}] s"
            raise InvalidValueError("t", f"{time[~within].flat[0]} s", allowed)
        return time


def known_trajectory(
    names: tuple[str, ...], units: tuple[str, ...], breaks: Array, coefficients: Array
) -> Trajectory:
    """Return the trajectory of arrays that are known to be valid, without checks.

    For code that has just computed breaks [s], shape (m + 1,), and coefficients, constant term first, shape
    (m, k, n); both are copied and made read-only.
    """
    arrays = {"breaks": read_only(breaks), "coefficients": read_only(coefficients)}
    return known(Trajectory, names, units, **arrays)


def checked_trajectory(value: Trajectory) -> Trajectory:
    """Return the argument if it is a trajectory; refuse other types, such as a plan, which has no times."""
    if not isinstance(value, Trajectory):
        allowed = "a Trajectory: of a plan that of retime(), of other results their `trajectory`"
        raise InvalidValueError("trajectory", f"a {type(value).__name__}", allowed)
    return value
