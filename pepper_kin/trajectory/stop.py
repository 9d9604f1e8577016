"""Stops: from an instant of a motion to rest, within its limits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import comb
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin import collision
from pepper_kin.arrays import Array, BriefRepr, read_only
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.core.splines import (
    derivatives_on_segments,
    evaluate_at_times,
    evaluate_on_segments,
    quintic_hermite,
)
from pepper_kin.core.timing.excess import BLAMED, FEWEST, MOMENT, ROUNDING, TORQUE, find_excess
from pepper_kin.core.timing.grid import coefficient_states
from pepper_kin.core.timing.steering import join_phases
from pepper_kin.core.timing.stopping import StopLimits, StopPath, cut_path, stop_polynomials, stop_profile
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import as_real, shown
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.trajectory.examined_states import extremes_of
from pepper_kin.trajectory.limits import (
    JerkLike,
    LimitedQuantities,
    Limits,
    MotionLimits,
    jerk_limits,
    motion_limits,
    quantities_of,
)
from pepper_kin.trajectory.samples import (
    EXAMINED_EVERY,
    TIME_TOLERANCE,
    known,
    refuse_other_joints,
    sample_times,
)

if TYPE_CHECKING:
    from pepper_kin.collision import Clearance, Scene
    from pepper_kin.trajectory.trajectory import Trajectory

_STEP = 0.005  # maximum length of an interval [s]
_AHEAD = 0.12  # part of the motion that is examined first [s]: about half of stops at full limits fit
_SHARES = (1.0, 0.8, 0.6, 0.4, 0.25)  # fractions of acceleration limits for braking joints, tried in turn
_LONGER, _TRIALS = 1.3, 8  # factor between durations of a jerk-limited slow-down, number of trials
_NODES = 0.002  # time between nodes of a slow-down with jerk limits [s]
_NEWTON_STEPS = 4
JUMP_TOLERANCE = 1e-6  # largest difference at a knot that is no jump [rad or m, per s, per s^2]
_AT_REST = 1e-9  # speed up to which the robot is at rest [rad/s or m/s]


@dataclass(frozen=True)
class Stop(BriefRepr):
    """A stop, which begins with position and velocity of the motion that it ends.

    Attributes:
        trajectory: The motion from the instant of the stop, its time 0, to rest.
        how: "path", along the motion's path; "end", the whole remaining motion, if no slow-down along it
            keeps jerk limits; or "joints".
        exceeded: Names of the limits that the stop exceeds: "position", "velocity", "acceleration", "jerk"
            (also if accelerations jump, at its end to rest), "torque", "balance".  Empty for "path".
        clearance: Minimum distances to obstacles and of the robot to itself, over every millisecond [m], at
            most 0 in contact; None without a scene.
    """

    trajectory: Trajectory
    how: str
    exceeded: tuple[str, ...] = ()
    clearance: Clearance | None = None

    @property
    def duration(self) -> float:
        """Duration until rest [s]."""
        return self.trajectory.duration

    @property
    def end(self) -> Array:
        """Position at rest [rad or m], shape (n,)."""
        return self.trajectory.end


def stop(
    pepper: PepperModel,
    trajectory: Trajectory,
    at: float,
    *,
    how: str = "path",
    scene: Scene | None = None,
    torque: bool = True,
    torque_scale: TorqueScale = 1.0,
    balance: Balance = None,
    jerk: JerkLike | None = None,
    payload: Mapping[str, float] | None = None,
) -> Stop:
    """Return the fastest stop from an instant of a motion; see `Trajectory.stop`."""
    refuse_other_joints(pepper, trajectory.joint_names)
    if how not in ("path", "joints"):
        raise UnknownNameError("way to stop", how, ("path", "joints"))
    at = checked_instant(trajectory, at)
    allowed = motion_limits(
        pepper, torque=torque, torque_scale=torque_scale, balance=balance, payload=payload, scene=scene
    )
    limits = limits_of(pepper, allowed)
    if jerk is not None:
        limits = replace(limits, jerk=jerk_limits(pepper, jerk))
    found = stop_within(pepper, trajectory, at, limits, how)
    if scene is None:
        return found
    return replace(found, clearance=least_clearance(pepper, found.trajectory, scene, at))


def stop_within(
    pepper: PepperModel, trajectory: Trajectory, at: float, limits: Limits, how: str = "path"
) -> Stop:
    """Return the fastest stop from an instant [s] within limits, without its clearance; see `stop`."""
    state = trajectory(at)
    inside = limits.jerk is not None and 0.0 < at < trajectory.duration
    if np.abs(state.velocity).max() <= _AT_REST and not (
        inside and np.abs(state.acceleration).max() > _AT_REST
    ):
        found = Stop(_resting(trajectory, at), how)
    elif how == "joints":
        found = _of_joints(pepper, trajectory, at, limits)
    else:
        found = Stop(_along_path(trajectory, at, limits, pepper), how)
        if limits.jerk is not None:
            found = _with_jerk(pepper, trajectory, at, limits, found.duration)
    return found


def checked_instant(trajectory: Trajectory, at: float) -> float:
    """Return an instant of a motion [s]; refuse a time outside it."""
    at = as_real(at)
    if not -TIME_TOLERANCE <= at <= trajectory.duration + TIME_TOLERANCE:
        raise InvalidValueError("at", f"{shown(at)} s", f"a time within [0, {trajectory.duration:.9g}] s")
    return min(max(at, 0.0), trajectory.duration)


@kept_for_robot(most=32)
def limits_of(pepper: PepperModel, allowed: MotionLimits) -> Limits:
    """Return a robot's limits, including the wheels of its base; cached."""
    return allowed.of(pepper, pepper.acceleration_limits, drives=True)


def like(trajectory: Trajectory, breaks: Array, coefficients: Array) -> Trajectory:
    """Return a motion with new breaks and coefficients and the joints of another motion."""
    return type(trajectory)(trajectory.joint_names, breaks, coefficients, trajectory.joint_units)


def _resting(trajectory: Trajectory, at: float) -> Trajectory:
    """Return a motion of one millisecond at rest, for a robot that does not move."""
    return like(trajectory, np.array([0.0, EXAMINED_EVERY]), trajectory(at).position[None, None])


def _along_path(trajectory: Trajectory, at: float, limits: Limits, pepper: PepperModel) -> Trajectory:
    """Return the stop along the path.

    Raises:
        InfeasibleError: if the motion ends before it can stop, or passes a posture that the robot could not
            hold.
    """
    breaks, coefficients = trajectory.breaks, trajectory.coefficients
    if coefficients.shape[1] < 3:
        coefficients = np.pad(coefficients, ((0, 0), (0, 3 - coefficients.shape[1]), (0, 0)))
    _, order, n = coefficients.shape
    ahead, left = _AHEAD, trajectory.duration - at
    while True:
        inside = np.searchsorted(breaks, [at, at + ahead])
        size = int(inside[1] - inside[0]) + math.ceil(min(ahead, left) / _STEP) + 2
        path = StopPath(
            np.empty(size, np.int64), np.empty(size), np.empty(size), np.empty((size, order, n)),
            np.empty(size + 1),
        )  # fmt: skip
        count = cut_path(breaks, coefficients, at, _STEP, path)
        effects, low, high = _effects(pepper, limits, coefficients, path, count)
        bounds = StopLimits(limits.acceleration, effects, low, high)
        used = stop_profile(count, _basis(order), path, bounds)
        if used or count < size:
            break
        ahead *= 2
    rest = effects[0, : 3 * (used or count)]
    if np.any((rest < low) | (rest > high)):
        reason = "along it the robot passes a posture that it could not hold at rest"
        raise InfeasibleError("stop along the path", reason, "let the motion go on, or how='joints'")
    if not used:
        if not _ends_at_rest(trajectory):
            reason = f"{left:.4g} s of the motion are left, and it ends in motion"
            raise InfeasibleError(
                "stop along the path", reason, "a motion that ends at rest, or how='joints'"
            )
        used = count
    times, motion = np.empty(used + 1), np.empty((used, 2 * order - 1, n))
    stop_polynomials(used, path, times, motion)
    if times[-1] > left > TIME_TOLERANCE and _ends_at_rest(trajectory):
        return trajectory.between(at, trajectory.duration)
    return like(trajectory, times, motion)


def _ends_at_rest(trajectory: Trajectory) -> bool:
    return float(np.abs(trajectory(trajectory.duration).velocity).max()) <= _AT_REST


@lru_cache(maxsize=64)
def _basis(order: int) -> Array:
    """Return Bernstein coefficients of the powers up to order - 2 on [0, 1], shape (order - 1, order - 1)."""
    m = order - 2
    return np.array(
        [[comb(i, p) / comb(m, p) if p <= i else 0.0 for p in range(m + 1)] for i in range(m + 1)]
    )


def _effects(
    pepper: PepperModel, limits: Limits, coefficients: Array, path: StopPath, count: int
) -> tuple[Array, Array, Array]:
    """Return torques and edge moments on the intervals, and their lower and upper limits."""
    quantities = quantities_of(pepper, limits)
    torques, edges = quantities.torque_limit, quantities.edges
    low = np.concatenate([-torques, np.zeros(edges)])
    high = np.concatenate([torques, np.full(edges, np.inf)])
    if not low.size:
        return np.empty((3, 3 * count, 0)), low, high
    n = coefficients.shape[2]
    at, states = np.empty((3, 3 * count, n)), np.empty((3, 9 * count, n))
    local = path.local[:count, None] + path.step[:count, None] * np.array([0.0, 0.5, 1.0])
    evaluate_on_segments(coefficients, np.repeat(path.segment[:count], 3), local.ravel(), at)
    coefficient_states(at, states)
    return quantities.forces(*states).reshape(3, 3 * count, low.size), low, high


def _of_joints(pepper: PepperModel, trajectory: Trajectory, at: float, limits: Limits) -> Stop:
    """Return the stop in which each joint brakes by itself.

    All joints use the same fraction of their acceleration limits: the largest fraction tried that keeps all
    other limits, or the largest of all if none does.
    """
    state, tried = trajectory(at), []
    for share in _SHARES:
        phases = np.array(
            [
                _braking(*motion)
                for motion in zip(
                    state.velocity,
                    state.acceleration,
                    share * limits.acceleration,
                    np.full(pepper.n, np.inf) if limits.jerk is None else limits.jerk,
                    strict=True,
                )
            ]
        )
        motion = joined_phases(trajectory, state.position, phases)
        tried.append(Stop(motion, "joints", _exceeded(pepper, motion, limits)))
        if not tried[-1].exceeded:
            return tried[-1]
    return tried[0]


def _braking(v: float, a: float, most: float, jerk: float) -> list[tuple[float, float, float, float]]:
    """Return the fastest motion of a joint to v = a = 0, in three phases.

    With jerk j, the acceleration changes to b, opposed to v + a |a| / 2 j, is held, and returns to zero,
    where
        b^2 = j |v| + a^2 / 2,  b <= a_max
    (signs for v > 0).  Without a jerk limit the joint brakes with a_max until rest.

    Returns:
        Duration [s], and velocity, acceleration and jerk at the start of each phase.
    """
    if not math.isfinite(jerk):
        return [(abs(v) / most, v, -math.copysign(most, v), 0.0), (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)]
    sign = -math.copysign(1.0, v + a * abs(a) / (2 * jerk))
    v, a, most = -sign * v, -sign * a, max(most, abs(a))
    peak = min(math.sqrt(max(jerk * v + a * a / 2, 0.0)), most)
    first, last = max(a + peak, 0.0) / jerk, peak / jerk
    reached = v + a * first - jerk * first * first / 2
    keep = max(reached - peak * last / 2, 0.0) / peak if peak > 0.0 else 0.0
    return [
        (first, -sign * v, -sign * a, sign * jerk),
        (keep, -sign * reached, sign * peak, 0.0),
        (last, -sign * (reached - peak * keep), sign * peak, -sign * jerk),
    ]


def joined_phases(trajectory: Trajectory, position: Array, phases: Array) -> Trajectory:
    """Return the motion of phases as `_braking` returns them, shape (n, 3, 4), from positions, shape (n,)."""
    n = position.size
    breaks, pieces = np.empty(3 * n + 1), np.empty((3 * n, 4, n))
    count = join_phases(position, phases, breaks, pieces)
    arrays = {"breaks": read_only(breaks[: count + 1]), "coefficients": read_only(pieces[:count])}
    return known(type(trajectory), trajectory.joint_names, trajectory.joint_units, **arrays)


def _exceeded(pepper: PepperModel, motion: Trajectory, limits: Limits) -> tuple[str, ...]:
    """Return names of limits a motion exceeds: polynomials at extremes, torque and balance every 1 ms."""
    found = []
    for order, (name, low, high) in enumerate(
        (
            ("position", pepper.lower_limits, pepper.upper_limits),
            ("velocity", -limits.velocity, limits.velocity),
            ("acceleration", -limits.acceleration, limits.acceleration),
            ("jerk", None if limits.jerk is None else -limits.jerk, limits.jerk),
        )
    ):
        if low is not None and high is not None and not _within(motion, order, low, high):
            found.append(name)
    if limits.jerk is not None and "jerk" not in found and _jumps(motion):
        found.append("jerk")
    return (*found, *exceeded_effects(pepper, motion, limits))


def exceeded_effects(pepper: PepperModel, motion: Trajectory, limits: Limits) -> tuple[str, ...]:
    """Return which of torque and balance a motion exceeds, examined on both sides of knots and every 1 ms."""
    quantities = quantities_of(pepper, limits)
    over = [_excess(quantities, state).max(axis=0) > 0.0 for state in _examined(quantities, motion)]
    return _names(quantities, np.flatnonzero(np.any(over, axis=0)))


def first_exceeded(pepper: PepperModel, motion: Trajectory, limits: Limits) -> tuple[tuple[str, ...], Array]:
    """Return the limits that a motion exceeds, up to the first excess, and accelerations to keep them.

    A joint's contribution is the amount by which the exceeded torque or edge moment, at its worst state,
    would be smaller without the joint's acceleration.

    Returns:
        Names as `exceeded_effects` returns them; and for each joint whose contribution is at least half of
        the largest, the absolute acceleration with which the limit would just be kept if all these joints
        were reduced by the same factor, at least 0.4; inf for other joints, shape (n,) [rad/s^2 or m/s^2].
    """
    quantities, n = quantities_of(pepper, limits), pepper.n
    kernel = quantities.effect_kernel
    if kernel is not None and quantities.torque_limit.size + quantities.edges:
        used, times = np.empty(n), sample_times(motion.duration, EXAMINED_EVERY)
        found = find_excess.native(kernel, motion.breaks, motion.coefficients, times, used)
        return ("torque",) * bool(found & TORQUE) + ("balance",) * bool(found & MOMENT), used
    for state in _examined(quantities, motion):
        excess = _excess(quantities, state)
        over = np.flatnonzero(excess.max(axis=0) > 0.0)
        if over.size:
            worst, each = excess[:, over].argmax(axis=0), np.arange(over.size)
            without = state[:, worst].repeat(n, axis=1)
            without[2].reshape(-1, n, n)[:, np.arange(n), np.arange(n)] = 0.0
            left = _excess(quantities, without)[:, over].reshape(-1, n, over.size)
            gain = excess[worst, over][:, None] - left[each, :, each]
            blamed = gain > BLAMED * np.maximum(gain.max(axis=1, keepdims=True), ROUNDING)
            enough = 1.0 - excess[worst, over] / np.maximum((gain * blamed).sum(axis=1), ROUNDING)
            kept = np.clip(enough, FEWEST, 1.0)[:, None] * np.abs(state[2, worst])
            return _names(quantities, over), np.where(blamed, kept, np.inf).min(axis=0)
    return (), np.full(n, np.inf)


def _examined(quantities: LimitedQuantities, motion: Trajectory) -> Iterator[Array]:
    """Yield states on both sides of knots, then of every 1 ms, shape (3, T, n); nothing without limits."""
    if quantities.torque_limit.size + quantities.edges:
        breaks, pieces = motion.breaks, motion.coefficients
        steps = np.diff(breaks)
        ends = np.append(0.0 * steps, steps)
        yield derivatives_on_segments(pieces, np.tile(np.arange(steps.size), 2), ends, 3)
        times = sample_times(motion.duration, EXAMINED_EVERY)
        states = np.empty((3, times.size, motion.n))
        evaluate_at_times(breaks, pieces, times, states)
        yield states


def _excess(quantities: LimitedQuantities, state: Array) -> Array:
    """Return by how much torques and edge moments of states, shape (3, T, n), exceed limits, (T, k + e)."""
    forces, torques = quantities.forces(*state), quantities.torque_limit.size
    limits = np.append(quantities.torque_limit * (1 + ROUNDING), np.zeros(quantities.edges))
    forces[:, :torques] = np.abs(forces[:, :torques])
    forces[:, torques:] *= -1.0
    return forces - limits


def _names(quantities: LimitedQuantities, over: NDArray[np.intp]) -> tuple[str, ...]:
    """Return the names, "torque" or "balance", of columns of `_excess`."""
    torque = over < quantities.torque_limit.size
    return ("torque",) * bool(torque.any()) + ("balance",) * (not torque.all())


def _within(motion: Trajectory, order: int, low: Array, high: Array) -> bool:
    slack = ROUNDING * np.maximum(1.0, np.minimum(np.abs(high), 1e6))
    found = extremes_of(motion.breaks, motion.coefficients, order)
    return bool(np.all(found.high <= high + slack) and np.all(found.low >= low - slack))


def _with_jerk(
    pepper: PepperModel, trajectory: Trajectory, at: float, limits: Limits, shortest: float
) -> Stop:
    """Return a stop along the path that keeps jerk limits too.

    The path is q(l) with the length l = integral of |dq/dt|; q' and q" stay continuous where accelerations
    jump along the path.  The speed is

        dl/dt = v (1 - 3 r^2 + 2 r^3) + a T (r - 2 r^2 + r^3),   r = t / T,

    which begins with the motion's speed v and its derivative a and ends with zero speed and acceleration, for
    the smallest T tried that keeps all limits; between nodes 2 ms apart the motion is a quintic.  Jerk limits
    are not convex in this parametrization, so there may be no such T: then the remaining motion itself is the
    stop, with the limits that it exceeds.
    """
    left = trajectory.between(at, trajectory.duration)
    clock = _Length(left)
    start = trajectory(at)
    v = float(np.linalg.norm(start.velocity))
    a = float(start.velocity @ start.acceleration) / v if v > 0.0 else 0.0
    duration = 1.2 * shortest
    for _ in range(_TRIALS if v > 0.0 else 0):
        if a < 0.0:
            duration = min(duration, -3.0 * v / a)  # a longer slow-down would reverse
        r = np.linspace(0.0, 1.0, math.ceil(duration / _NODES) + 1)
        way = duration * (v * (r - r**3 + r**4 / 2) + a * duration * (r**2 / 2 - 2 * r**3 / 3 + r**4 / 4))
        if way[-1] >= clock.length[-1]:
            break
        rate = v * (1 - 3 * r**2 + 2 * r**3) + a * duration * (r - 2 * r**2 + r**3)
        change = v * (6 * r**2 - 6 * r) / duration + a * (1 - 4 * r + 3 * r**2)
        path = left(clock.times_of(way))
        size = np.linalg.norm(path.velocity, axis=1, keepdims=True)
        if size.min() <= _AT_REST:
            break
        along = path.velocity / size
        bend = path.acceleration - along * (along * path.acceleration).sum(axis=1, keepdims=True)
        velocity, acceleration = (
            rate[:, None] * along,
            change[:, None] * along + (rate[:, None] / size) ** 2 * bend,
        )
        nodes = duration * r
        pieces = quintic_hermite(np.diff(nodes), path.position, velocity, acceleration)
        motion = like(trajectory, nodes, pieces)
        if not _exceeded(pepper, motion, limits):
            return Stop(motion, "path")
        duration *= _LONGER
    return Stop(left, "end", _exceeded(pepper, left, limits))


class _Length:
    """Length of a motion's path, l(t) = integral of |dq/dt|, by Simpson's rule between its knots.

    Attributes:
        times: Times, including the knots [s], shape (T,).
        length: Path length l at each time, shape (T,).
    """

    def __init__(self, motion: Trajectory) -> None:
        step = max(min(_NODES, motion.duration / 64), TIME_TOLERANCE)
        every = np.unique(np.concatenate([sample_times(motion.duration, step), motion.breaks]))
        self._motion, self.times = motion, every[np.append(True, np.diff(every) > TIME_TOLERANCE)]
        at = self._speed(self.times)
        self.length = np.append(
            0.0, np.cumsum(self._added(self.times[:-1], np.diff(self.times), at[:-1], at[1:]))
        )

    def _speed(self, times: Array) -> Array:
        speed: Array = np.linalg.norm(self._motion(times).velocity, axis=1)
        return speed

    def _added(self, start: Array, step: Array, first: Array, last: Array) -> Array:
        """Return path lengths of steps [s] from times [s], given the speeds at both ends, shape (T,) each."""
        return step / 6 * (first + 4 * self._speed(start + step / 2) + last)

    def times_of(self, lengths: Array) -> Array:
        """Return the times [s] at which path lengths, shape (T,), are reached, by Newton's method."""
        low = np.clip(np.searchsorted(self.length, lengths, side="right") - 1, 0, self.times.size - 2)
        start, found = self.times[low], np.interp(lengths, self.length, self.times)
        first = self._speed(start)
        for _ in range(_NEWTON_STEPS):
            speed = self._speed(found)
            over = self.length[low] + self._added(start, found - start, first, speed) - lengths
            found = np.clip(found - over / np.maximum(speed, _AT_REST), start, self.times[low + 1])
        return found


def _jumps(motion: Trajectory) -> bool:
    """Return whether accelerations jump at a knot, or from the end to rest."""
    pieces, steps = motion.coefficients, np.diff(motion.breaks)
    each = np.arange(steps.size)
    before = derivatives_on_segments(pieces, each, steps, 3)[2]
    after = np.zeros_like(before)
    after[:-1] = derivatives_on_segments(pieces, each[1:], 0.0 * steps[1:], 3)[2]
    return bool(np.abs(after - before).max(initial=0.0) > JUMP_TOLERANCE)


def least_clearance(pepper: PepperModel, motion: Trajectory, scene: Scene, begin: float) -> Clearance:
    """Return the minimum distances of bodies over every millisecond, at most 0 in contact.

    `begin` is the time of the scene at which the motion begins [s].
    """
    times = sample_times(motion.duration, EXAMINED_EVERY)
    states: NDArray[np.float64] = motion(times).position
    return collision.clearance_along(pepper, states, checked_world(scene), begin + times)
