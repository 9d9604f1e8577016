"""Limit violations of a motion, by joint and time, and their repair."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.loads import inverse_dynamics_with
from pepper_kin.dynamics.load import carried_words
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, beside_limits
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_positive
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.trajectory.balance import balance_margin, support_polygon, wheel_limits
from pepper_kin.trajectory.examined_states import extremes_of
from pepper_kin.trajectory.limits import MotionLimits, motion_limits, refuse_motionless, share_of
from pepper_kin.trajectory.samples import (
    EXAMINED_EVERY,
    Samples,
    State,
    examination_step,
    refuse_other_joints,
    sample_times,
    unit_of,
)
from pepper_kin.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

JUMP = 1e-6  # largest difference at a knot that is no jump [rad, m, rad/s or m/s]
_RELATIVE = 1e-7  # violation attributed to rounding, relative to the width of the limits
_INSIDE = np.linspace(0.0, 1.0, 10)[1:-1]  # fractions of short pieces at which states are examined
_DERIVATIVES = ("position", "velocity")
_FINER = 4  # samples of the time scaling per piece of the rounded curve
_WINDOW = 0.05  # time over which a slow-down fades in and out [s]
_ROUNDS = 240
_JUMP = 1e-4  # smallest difference of positions at a knot that is replaced by a smooth motion [rad or m]
_SHARE = 0.98  # fraction of each limit that is used; the rest covers what is between samples
_BALANCE = 0.001  # additional distance from the triangle's edge, for the same reason [m]
_BASIS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
_GAUSS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class LimitViolation:
    """A time interval in which one joint is outside one limit, or a jump.

    Attributes:
        joint: Name of the joint.
        quantity: "position", "velocity", "acceleration", "position jump" or "velocity jump".
        start: Start of the interval [s].
        end: End of the interval [s]; for a jump equal to the start.
        time: Time of the worst value [s].
        value: Worst value; for a jump its height.
        limit: Limit that is exceeded; 0 for a jump.
        unit: Unit of value and limit.
    """

    joint: str
    quantity: str
    start: float
    end: float
    time: float
    value: float
    limit: float
    unit: str

    def sentence(self) -> str:
        """Return in words what was exceeded, when and by how much."""
        if self.quantity.endswith("jump"):
            return f"{self.joint}: {self.quantity} of {self.value:.4g} {self.unit} at {self.time:.3f} s"
        value, limit = beside_limits(self.value, self.limit, outside=True)
        return (
            f"{self.joint}: {self.quantity} {value} {self.unit} at {self.time:.3f} s, "
            f"limit {limit} (outside from {self.start:.3f} to {self.end:.3f} s)"
        )


def find_limit_violations(pepper: PepperModel, trajectory: Trajectory) -> tuple[LimitViolation, ...]:
    """Return all violations of position, velocity and acceleration limits, and all jumps, in order of time.

    The motion is examined every millisecond, on both sides of every knot, at the extremes of each quantity,
    and at more points on pieces shorter than 2 ms.

    Args:
        pepper: The robot.
        trajectory: The motion; its joints must be the robot's.

    Raises:
        InvalidValueError: if the joints are not the robot's, in its order.
    """
    refuse_other_joints(pepper, trajectory.joint_names)
    time, state = _states(trajectory, _between(trajectory))
    v, a = pepper.velocity_limits, pepper.acceleration_limits
    found = [
        *_outside(pepper, "position", time, state.position, pepper.lower_limits, pepper.upper_limits),
        *_outside(pepper, "velocity", time, state.velocity, -v, v),
        *_outside(pepper, "acceleration", time, state.acceleration, -a, a),
        *_jumps(pepper, trajectory),
    ]
    return tuple(sorted(found, key=lambda violation: (violation.start, violation.joint, violation.quantity)))


def _between(trajectory: Trajectory) -> Array:
    """Return times to examine in addition to every millisecond: of extremes, and on short pieces."""
    start, width = trajectory.knots[:-1], np.diff(trajectory.knots)
    short = width < 2 * EXAMINED_EVERY
    times = [(start[short, None] + width[short, None] * _INSIDE).ravel()]
    for order in range(3):
        found = extremes_of(trajectory.knots, trajectory.coefficients, order)
        times += [found.high_time, found.low_time]
    return np.unique(np.concatenate(times))


def _states(trajectory: Trajectory, besides: Array) -> tuple[Array, State]:
    """Return sorted times, shape (T,), and states, shape (T, n), each knot once for each side."""
    step = np.diff(trajectory.knots)
    segments = np.arange(step.size)
    regular = np.union1d(sample_times(trajectory.duration, examination_step(trajectory.duration)), besides)
    inside = regular[~np.isin(regular, trajectory.knots)]
    parts = [
        trajectory(inside),
        trajectory.at_segments(segments, 0 * step),
        trajectory.at_segments(segments, step),
    ]
    time = np.concatenate([inside, trajectory.knots[:-1], trajectory.knots[1:]])
    # At a knot the end of the earlier piece precedes the start of the later piece.
    side = np.concatenate([np.zeros(inside.size), np.ones(segments.size), -np.ones(segments.size)])
    order = np.lexsort((side, time))
    return time[order], State(*(np.concatenate(part)[order] for part in zip(*parts, strict=True)))


def _outside(
    pepper: PepperModel, quantity: str, time: Array, value: Array, lower: Array, upper: Array
) -> list[LimitViolation]:
    """Return the time intervals in which joints are outside the limits of a quantity.

    Args:
        pepper: The robot.
        quantity: "position", "velocity" or "acceleration".
        time: Sorted times [s], shape (T,).
        value: Values of the quantity, in its unit, shape (T, n).
        lower: Lower limits, in the same unit, shape (n,).
        upper: Upper limits, in the same unit, shape (n,).
    """
    found = []
    with np.errstate(invalid="ignore"):
        slack = np.where(np.isfinite(upper - lower), _RELATIVE * (upper - lower), 0.0)
    over = np.maximum(value - upper, lower - value)
    for j, name in enumerate(pepper.joint_names):
        outside = np.concatenate([[False], over[:, j] > slack[j], [False]])
        edges = np.flatnonzero(np.diff(outside.astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            at = begin + int(np.argmax(over[begin:end, j]))
            worst = float(value[at, j])
            limit = float(upper[j] if worst > upper[j] else lower[j])
            unit = unit_of(quantity, pepper.joint_units[j])
            times = (float(time[begin]), float(time[end - 1]), float(time[at]))
            found.append(LimitViolation(name, quantity, *times, worst, limit, unit))
    return found


def _jumps(pepper: PepperModel, trajectory: Trajectory) -> list[LimitViolation]:
    step, segments = np.diff(trajectory.knots), np.arange(trajectory.knots.size - 1)
    before = trajectory.at_segments(segments[:-1], step[:-1])
    after = trajectory.at_segments(segments[1:], 0.0 * step[1:])
    found = []
    for order, quantity in enumerate(_DERIVATIVES):
        heights = after[order] - before[order]
        for knot, j in np.argwhere(np.abs(heights) > JUMP):
            time = float(trajectory.knots[knot + 1])
            unit = unit_of(quantity, pepper.joint_units[j])
            height = float(heights[knot, j])
            joint = pepper.joint_names[j]
            found.append(LimitViolation(joint, f"{quantity} jump", time, time, time, height, 0.0, unit))
    return found


def enforce_limits(
    pepper: PepperModel,
    trajectory: Trajectory,
    *,
    rounding: float = 0.02,
    scene: Scene | None = None,
    payload: Mapping[str, float] | None = None,
    balance: Balance = "robot",
    torque_scale: TorqueScale = "robot",
) -> Trajectory:
    """Return the motion smoothed, and slowed down only where the robot cannot follow it.

    Positions are moved into the joint limits and become the control points of a uniform cubic B-spline,
        q(s) = sum_i B_i(s) P_i,  P_i = clip(q_given(i h)),
    which stays within the convex hull of its control points, begins and ends at rest, and replaces corners
    and jumps by smooth motions.  The time scaling ds/dt = sigma(s) <= 1 is smooth, and as near to 1 as
        |q' sigma| <= v,  |q'' sigma^2 + q' sigma sigma'| <= a,  |torque| <= tau
    and the zero-moment point within the wheels' triangle allow, and on a planar base the speeds and
    accelerations of its wheels and its own speed.  Unlike `retime` it is not the fastest:
    pauses and slow passages stay as they were, and accelerations are continuous.

    Args:
        pepper: The robot, which gives the limits.
        trajectory: Any motion of its joints, with jumps, corners and limit violations if need be.
        rounding: Time h between control points [s]; a smooth motion deviates by h^2 |a| / 6.
        scene: The scene whose attached objects count with their mass; None for none.  Collisions are not
            checked.
        payload: Point masses held at "left", "right" or a frame by name [kg], besides attached objects.
        balance: Distance that the zero-moment point keeps from the edges of the wheels' triangle [m]; "robot"
            for the robot's requirement, None to leave balance out.
        torque_scale: Fraction of the effort limits to use, in (0, 1]; "robot" for the robot's requirement.

    Returns:
        The motion, of degree 5, 2 h longer than the given one where nothing is slowed down.

    Raises:
        InvalidValueError: if the joints are not the robot's, or for a rounding not in (0, duration].
        UnknownNameError: for a frame that the robot lacks.
        InfeasibleError: if the robot could not even stand still in a position on the way, or if a joint moves
            whose velocity or acceleration limit is zero.
    """
    kept = motion_limits(pepper, balance=balance, torque_scale=torque_scale, payload=payload, scene=scene)
    return rounded_and_slowed(pepper, trajectory, rounding, kept).trajectory


class Slowed(NamedTuple):
    """A motion within the limits, and its time scaling.

    Attributes:
        trajectory: The motion.
        curve: The rounded motion at full speed.
        time: Times on the curve, evenly spaced [s], shape (T,).
        speed: Rate sigma at each time, 0 to 1, shape (T,).
    """

    trajectory: Trajectory
    curve: Trajectory
    time: Array
    speed: Array


def rounded_and_slowed(
    pepper: PepperModel,
    trajectory: Trajectory,
    rounding: float,
    kept: MotionLimits,
) -> Slowed:
    """Return the motion of `enforce_limits` within given limits, with its time scaling."""
    refuse_other_joints(pepper, trajectory.joint_names)
    h = check_positive("rounding", rounding, "s")
    if h > trajectory.duration:
        raise InvalidValueError("rounding", f"{h} s", f"at most the duration, {trajectory.duration:.6g} s")
    changes = np.diff(trajectory.coefficients[:, :1], axis=0, append=trajectory.coefficients[-1:, :1])
    steps = np.concatenate([trajectory.coefficients, changes], axis=1)  # a jump moves the joint, too
    refuse_motionless(pepper, steps, pepper.acceleration_limits, "safe motion")
    curve = _rounded(pepper, trajectory, h)
    s = np.linspace(0.0, curve.duration, _FINER * (curve.breaks.size - 1) + 1)
    speed = _speed(pepper, s, curve(s), kept)
    return Slowed(_run(curve, s, speed), curve, s, speed(s))


def _rounded(pepper: PepperModel, trajectory: Trajectory, h: float) -> Trajectory:
    """Return the B-spline whose control points are sampled positions, with threefold end points."""
    points = _control_points(pepper, trajectory, h)
    points = np.concatenate([points[:1], points[:1], points, points[-1:], points[-1:]])
    four = np.stack([points[i : points.shape[0] - 3 + i] for i in range(4)], axis=1)
    coefficients = np.einsum("pk,ikn->ipn", _BASIS / h ** np.arange(4)[:, None], four)
    still = np.ptp(points, axis=0) == 0  # exactly, for limits of zero
    coefficients[:, 0, still], coefficients[:, 1:, still] = points[0, still], 0.0
    breaks = h * np.arange(coefficients.shape[0] + 1)
    return Trajectory(trajectory.joint_names, breaks, coefficients, trajectory.joint_units)


def _control_points(pepper: PepperModel, trajectory: Trajectory, h: float) -> Array:
    """Return positions about every h [s], with a smooth motion inserted at each jump, shape (k, n)."""
    step, segments = np.diff(trajectory.knots), np.arange(trajectory.knots.size - 1)
    before = trajectory.at_segments(segments, step).position
    after = trajectory.at_segments(segments, 0.0 * step).position
    jumps = np.flatnonzero(np.abs(after[1:] - before[:-1]).max(axis=1) > _JUMP) + 1
    parts: list[Array] = []
    for first, last in zip([0, *jumps], [*jumps, segments.size], strict=True):
        begin, end = trajectory.knots[first], trajectory.knots[last]
        # At the end itself the later piece gives the value, so the earlier piece's end is used instead.
        inside = np.linspace(begin, end, max(2, round((end - begin) / h) + 1))[:-1]
        smooth = np.clip(
            np.vstack([trajectory(inside).position, before[last - 1]]),
            pepper.lower_limits,
            pepper.upper_limits,
        )
        if parts:
            parts.append(_swing(pepper, parts[-1][-1], smooth[0], h))
        parts.append(smooth)
    return np.concatenate(parts)


def _swing(pepper: PepperModel, start: Array, end: Array, h: float) -> Array:
    """Return points strictly between two positions on the fastest quintic from rest to rest.

    Args:
        pepper: The robot.
        start: First position [rad or m], shape (n,).
        end: Last position [rad or m], shape (n,).
        h: Approximate time between points [s].

    Returns:
        Positions [rad or m], shape (k, n).
    """
    distance = np.abs(end - start)
    # With q = d (10 u^3 - 15 u^4 + 6 u^5), u = t / T: |v| <= 1.875 d / T and |a| <= 5.774 d / T^2.
    time = max(
        float(np.max(share_of(1.875 * distance, pepper.velocity_limits))),
        float(np.sqrt(np.max(share_of(5.774 * distance, pepper.acceleration_limits)))),
    )
    u = np.linspace(0.0, 1.0, max(2, int(np.ceil(time / h))) + 1)[1:-1, None]
    return start + (end - start) * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def _speed(pepper: PepperModel, s: Array, path: State, kept: MotionLimits) -> Any:
    """Return the rate along the curve as a spline, lowered until no limit is exceeded.

    Args:
        pepper: The robot.
        s: Times on the curve, evenly spaced [s], shape (T,).
        path: States of the curve at each time, shape (T, n) each.
        kept: Limits that the motion may use.
    """
    from scipy.interpolate import CubicSpline
    from scipy.ndimage import minimum_filter1d

    half = max(2, round(_WINDOW / (s[1] - s[0])))
    kernel = np.hanning(2 * half + 3)[1:-1]
    kernel /= kernel.sum()
    _refuse_unholdable(pepper, path.position, kept)
    ceiling = _ceiling(pepper, path)
    for _ in range(_ROUNDS):
        # The minimum within the window, averaged over the window, is nowhere above the ceiling.
        lowest = minimum_filter1d(ceiling, 2 * half + 1, mode="nearest")
        sigma = np.convolve(np.pad(lowest, half, mode="edge"), kernel, mode="valid")
        speed = CubicSpline(s, sigma)
        need = _use(pepper, _state(path, sigma, speed(s, 1)), kept)
        if not np.any(need > 1.0):
            return speed
        # At most to 1 / 1.25 at once: the slowing down itself may cause the excess.
        lower = sigma / np.clip(np.sqrt(need) * 1.005, 1.0, 1.25)
        ceiling = np.where(need > 1.0, np.minimum(ceiling, lower), ceiling)
    raise InfeasibleError(
        "safe motion",
        f"after {_ROUNDS} rounds of slowing down a limit is still exceeded at {s[np.argmax(need)]:.3f} s",
        "start from a motion with smaller joint torques, its zero-moment point nearer to the wheels' middle",
    )


def _ceiling(pepper: PepperModel, path: State) -> Array:
    """Return the maximum constant rate up to 1 that velocity and acceleration allow at each point, (T,)."""
    velocity = share_of(np.abs(path.velocity), pepper.velocity_limits).max(axis=1)
    bend = share_of(np.abs(path.acceleration), pepper.acceleration_limits).max(axis=1)
    for speed, acceleration in _of_wheels(pepper, path):
        velocity, bend = np.maximum(velocity, speed), np.maximum(bend, acceleration)
    with np.errstate(divide="ignore"):
        return np.minimum(1.0, np.minimum(_SHARE / velocity, np.sqrt(_SHARE / bend)))


def _of_wheels(pepper: PepperModel, state: State) -> list[tuple[Array, Array]]:
    """Return the fractions of their limits that speeds and accelerations of the base use, shape (T,) each.

    The list is empty for a robot without a planar base.
    """
    wheels = wheel_limits(pepper)
    if wheels is None:
        return []
    speeds = wheels.shares(state.position, state.velocity).max(axis=1)
    accelerations = np.abs(wheels.accelerations(*state)).max(axis=1) / wheels.acceleration
    return [(speeds, accelerations)]


def _state(path: State, sigma: Array, slope: Array) -> State:
    """Return the states of a curve under another time scaling.

    Args:
        path: States of the curve over its own time s, shape (T, n) each.
        sigma: Rate ds/dt at each state, shape (T,).
        slope: Derivative d sigma / ds at each state [1/s], shape (T,).
    """
    along, bend = sigma[:, None], (sigma * slope)[:, None]
    return State(path.position, path.velocity * along, path.acceleration * along**2 + path.velocity * bend)


def _use(pepper: PepperModel, state: State, kept: MotionLimits) -> Array:
    """Return the largest fraction of any limit used at each point; above 1 if exceeded, shape (T,)."""
    torque = inverse_dynamics_with(pepper, kept.loads, *state)
    shares = [
        share_of(np.abs(state.velocity), pepper.velocity_limits).max(axis=1) / _SHARE,
        share_of(np.abs(state.acceleration), pepper.acceleration_limits).max(axis=1) / _SHARE,
        share_of(np.abs(torque), pepper.effort_limits).max(axis=1) / _torque_share(kept),
    ]
    for speed, acceleration in _of_wheels(pepper, state):
        shares += [speed / _SHARE, acceleration / _SHARE]
    polygon = support_polygon(pepper)
    if polygon is not None and kept.balance is not None:
        inside = balance_margin(pepper, polygon, *state, kept.loads)
        shares.append(np.where(inside < kept.balance + _BALANCE, 1.5, 0.0))
    return np.max(shares, axis=0)


def _torque_share(kept: MotionLimits) -> float:
    return _SHARE * (1.0 if kept.torque is None else kept.torque)


def _refuse_unholdable(pepper: PepperModel, position: Array, kept: MotionLimits) -> None:
    """Raise if gravity overloads a joint or tips the robot over at positions [rad or m], shape (T, n)."""
    still, loads, carrying = np.zeros_like(position), kept.loads, carried_words(kept.loads)
    torque = np.abs(inverse_dynamics_with(pepper, loads, position, still, still))
    share = share_of(torque, pepper.effort_limits)
    if share.max() > _torque_share(kept):
        joint = pepper.joint_names[int(np.argmax(share.max(axis=0)))]
        reason = (
            f"{joint} needs {share.max():.0%} of its effort limit to hold a position on the way{carrying}"
        )
        raise InfeasibleError(
            "safe motion", reason, "choose positions with less load on that joint, or a greater torque_scale"
        )
    polygon = support_polygon(pepper)
    if polygon is not None and kept.balance is not None:
        margin = float(balance_margin(pepper, polygon, position, still, still, loads).min())
        if margin < kept.balance + _BALANCE:
            reason = f"at rest the robot{carrying} would stand {1000 * margin:.1f} mm from tipping over"
            advice = "keep the center of mass nearer to the middle of the wheels' triangle, or reduce balance"
            raise InfeasibleError("safe motion", reason, advice)


def _run(curve: Trajectory, s: Array, speed: Any) -> Trajectory:
    """Return the quintic through the curve's states under its time scaling at s [s], shape (T,)."""
    nodes, weights = _GAUSS
    half = np.diff(s)[:, None] / 2
    inside = s[:-1, None] + half * (nodes + 1.0)
    step = (half * weights / speed(inside)).sum(axis=1)
    state = _state(curve(s), speed(s), speed(s, 1))
    time = np.concatenate([[0.0], np.cumsum(step)])
    return Samples(curve.joint_names, time, *state, joint_units=curve.joint_units).to_trajectory()
