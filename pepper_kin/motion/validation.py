"""Validation of paths: states so dense that nothing fits between them, and the first invalid one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, BriefRepr, PiecewiseCubic, read_only
from pepper_kin.collision import Scene
from pepper_kin.collision.curve_examination import cut, reach_along
from pepper_kin.collision.loads import inverse_dynamics_with
from pepper_kin.core.collision.curve_check import SHORTEST, count_intervals
from pepper_kin.exceptions import InvalidValueError, beside_limits
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.model.requirements import ROBOT, Balance, TorqueScale
from pepper_kin.motion.checks import Checks, checks_for
from pepper_kin.motion.goals import fault_of
from pepper_kin.motion.plan_result import PlanStatus
from pepper_kin.motion.problem import checked_margin
from pepper_kin.motion.static_limits import ROOM_ALONG, static_limits
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.balance import balance_margin, support_polygon
from pepper_kin.trajectory.path import CubicPath, PlannedPath, planned_curve
from pepper_kin.trajectory.samples import State, refuse_other_joints

AnyPath: TypeAlias = "ArrayLike | PiecewiseCubic | PlannedPath | Trajectory"
MOST_STATES = 4_000_000
"""Maximum number of states of one path, for an hour or 2 km: half a gigabyte for Pepper, and minutes."""
INSTANTS = 0.001
"""Maximum time between states of a trajectory; states are closer if the body moves far [s]."""
TOLERANCE = 1e-7
"""Violation attributed to rounding, relative to the width of the limits."""
_BLOCK = 2048


@dataclass(frozen=True, eq=False)
class DenseStates:
    """States along a motion.

    Attributes:
        positions: Joint positions [rad or m], shape (N, n).
        places: Position of each state along the motion, increasing, shape (N,): index of the waypoint plus
            fraction of the next edge, the curve's parameter, or the time [s].
    """

    positions: Array
    places: Array


def checked_path(pepper: PepperModel, path: Any) -> Array | CubicPath | Trajectory:
    """Return a path of any kind as waypoints, shape (k, n) with k >= 1, a curve or a trajectory.

    Args:
        pepper: The robot.
        path: Waypoints [rad or m], shape (k, n); a piecewise cubic curve, such as `Plan.curve`; a plan; or a
            trajectory.

    Raises:
        InvalidValueError: for a wrong shape, NaN, or a trajectory of other joints.
        InfeasibleError: for a plan that failed, with its reason.
    """
    if isinstance(path, Trajectory):
        refuse_other_joints(pepper, path.joint_names)
        return path
    if isinstance(path, PlannedPath):
        path = planned_curve(path)
    if isinstance(path, PiecewiseCubic):
        curve = path if isinstance(path, CubicPath) else CubicPath(path.breaks, path.coefficients)
        if curve.coefficients.shape[2] != pepper.n:
            raise InvalidValueError("path", f"{curve.coefficients.shape[2]} joints", f"{pepper.n} joints")
        return curve
    points = np.atleast_2d(as_joint_vectors(pepper, path, "waypoints"))
    if points.ndim != 2 or not len(points):
        raise InvalidValueError("waypoints", f"shape {points.shape}", f"shape (k, {pepper.n}), k >= 1")
    return points


def polyline(points: Array) -> CubicPath:
    """Return the straight edges between waypoints, shape (k, n), k >= 2, as a curve over their indices."""
    coefficients = np.zeros((len(points) - 1, 4, points.shape[1]))
    coefficients[:, 0], coefficients[:, 1] = points[:-1], np.diff(points, axis=0)
    return CubicPath(np.arange(len(points)).astype(np.float64), coefficients)


def dense_states(
    pepper: PepperModel, scene: Scene | None, path: Array | CubicPath | Trajectory, step: float = SHORTEST
) -> DenseStates:
    """Return states, including both ends, between which no point of the body moves more than a step [m].

    Args:
        pepper: The robot.
        scene: The world, with attached objects; None for the robot alone.
        path: Waypoints [rad or m], shape (k, n); a curve or a trajectory.
        step: Maximum motion of a body point between states [m].

    Raises:
        InvalidValueError: for a path of more than `MOST_STATES` states.
    """
    if isinstance(path, Trajectory):
        return _of_trajectory(pepper, scene, path, step)
    if not isinstance(path, CubicPath):
        if len(path) == 1:
            return DenseStates(path, np.zeros(1))
        path = polyline(path)
    reach = reach_along(pepper, scene, path)
    counts = np.empty(len(path.coefficients), np.int64)
    count = count_intervals(path.breaks, path.coefficients, reach, step, counts)
    _refuse_many(pepper, count, _way(path), reach, step)
    parts = cut(path.breaks, path.coefficients, reach, step)
    last = len(path.breaks) - 2
    segment = np.append(parts.segment, last)
    local = np.append(parts.begin, path.breaks[-1] - path.breaks[-2])
    return DenseStates(path.at(segment, local), path.breaks[segment] + local)


def _way(curve: CubicPath) -> Array:
    """Return the joints' motion from end to end of the curve's pieces, summed up [rad or m], shape (n,)."""
    h, (_, first, second, third) = np.diff(curve.breaks)[:, None], curve.coefficients.swapaxes(0, 1)
    return np.asarray(np.abs((first + (second + third * h) * h) * h).sum(axis=0))


def _refuse_many(pepper: PepperModel, count: float, way: Array, reach: Array, step: float) -> None:
    """Refuse a path of too many states.

    Args:
        pepper: The robot.
        count: Number of states.
        way: Total motion of each joint [rad or m], shape (n,).
        reach: Bounds on how far each joint moves a point of the body, shape (n,).
        step: Motion of a body point between two states [m].

    Raises:
        InvalidValueError: for too many states, naming the joint that moves the body farthest, and its motion.
    """
    if not 0 <= count <= MOST_STATES:
        j = int(np.argmax(way * np.where(way > 0, reach, 0.0)))
        got = f"one along which {pepper.joint_names[j]} goes {way[j]:.6g} {pepper.joint_units[j]}"
        allowed = f"at most {MOST_STATES:,} states {1000 * step:g} mm apart: give it in parts"
        raise InvalidValueError("path", got, allowed)


def _of_trajectory(pepper: PepperModel, scene: Scene | None, path: Trajectory, step: float) -> DenseStates:
    if path.duration / INSTANTS > MOST_STATES:
        allowed = f"at most {MOST_STATES * INSTANTS:g} s; cut it into parts with between()"
        raise InvalidValueError("duration", f"{path.duration:.6g} s", allowed)
    count = max(1, math.ceil(path.duration / INSTANTS))
    times = np.linspace(0.0, path.duration, count + 1)
    positions = path(times).position
    reach = reach_along(pepper, scene, polyline(positions))
    steps = np.abs(np.diff(positions, axis=0))
    share = np.ceil(steps @ reach / step)
    _refuse_many(pepper, float(share.sum()), steps.sum(axis=0), reach, step)
    parts = np.maximum(1, share).astype(np.int64)
    if parts.max() > 1:
        width = np.repeat(np.diff(times) / parts, parts)
        inner = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        times = np.append(np.repeat(times[:-1], parts) + inner * width, path.duration)
        positions = path(times).position
    return DenseStates(positions, times)


class ValidationStatus(ResultStatus):
    """Limit that the first invalid state violates; `advice` says what to try."""

    VALID = "valid", "Time a path with retime(), or make it shorter with simplify_path()."
    JOINT_LIMIT = "joint_limit", "Keep the path within the joint limits, or check the order of the joints."
    COLLISION = "collision", "Plan between the states before and after it with plan()."
    STATIC_TORQUE_LIMIT = "static_torque_limit", "Lead the path through postures that the joints can hold."
    TIPS_OVER = (
        "tips_over",
        "Keep the center of mass nearer to the middle of the wheels' triangle, or use retime(balance=).",
    )
    VELOCITY_LIMIT = "velocity_limit", "Time its path again with retime()."
    ACCELERATION_LIMIT = "acceleration_limit", "Time its path again with retime()."
    TORQUE_LIMIT = "torque_limit", "Time its path again with retime()."


@dataclass(frozen=True, eq=False)
class Validation(BriefRepr):
    """Result of `validate`.

    Attributes:
        status: Limit that the first invalid state violates.
        message: The fault in a sentence, with names and numbers.
        place: Position of the first invalid state: for waypoints the index of the previous one plus the
            fraction of the edge (2.25: a quarter of the way from number 2 to number 3), the curve's
            parameter, or the time [s]; None if all states are valid.
        q: First invalid state [rad or m], shape (n,), read-only; None if all states are valid.
        contacts: Names of the pairs in contact in that state.
        joint: Name of the joint at fault, or None.
        states_checked: Number of states checked.
    """

    status: ValidationStatus
    message: str
    place: float | None = None
    q: Array | None = None
    contacts: tuple[tuple[str, str], ...] = ()
    joint: str | None = None
    states_checked: int = 0

    @property
    def success(self) -> bool:
        """Whether the whole path is valid."""
        return self.status is ValidationStatus.VALID

    @property
    def advice(self) -> str:
        """Advice on what to try, as a sentence."""
        return self.status.advice

    def report(self) -> str:
        """Return in plain words whether the path is valid, or where it is not, and what to try."""
        return f"{self.message} {self.advice}"


def validate(
    pepper: PepperModel,
    path: AnyPath,
    scene: Scene | None = None,
    *,
    margin: float = 0.0,
    balance: Balance = "robot",
    torque_scale: TorqueScale = "robot",
    payload: Mapping[str, float] | None = None,
) -> Validation:
    """Check a given path, curve or trajectory: joint limits, collisions, torque, balance.

    States are so dense that no point of the body moves more than half a millimeter from one to the next.  For
    paths and curves, the joints must be able to hold each state against gravity, as for curves of `plan`; for
    a trajectory, velocity, acceleration, torque and the zero-moment point must be within their limits in
    motion.

    Args:
        pepper: The robot.
        path: Waypoints [rad or m], shape (k, n), joined by straight edges; a piecewise cubic curve; a plan;
            or a trajectory.
        scene: The world around the robot, with attached objects; None for the robot alone.
        margin: Distance to be kept to the scene [m].
        balance: Distance to be kept from the edges of the wheels' triangle [m]: by the center of mass for
            paths and curves, with a reserve of 2 mm; by the zero-moment point for trajectories.  "robot" for
            the robot's requirement, but 0 for trajectories, as in `Trajectory.check`; None to leave balance
            out.
        torque_scale: Fraction of the effort limits for holding torques; trajectories may use the full limits.
        payload: Point masses held at "left", "right" or a frame by name [kg].

    Returns:
        The validation: valid, or the first invalid state and the limit that it violates.

    Raises:
        InvalidValueError: for a wrong shape, NaN, a trajectory of other joints, a margin below zero, an
            invalid distance or mass, balance of a robot without wheels, or a path of more than four million
            states.
        UnknownNameError: for a frame of the payload that the robot lacks.
        InfeasibleError: for a plan that failed, with its reason.
    """
    margin = checked_margin(margin)
    followed = checked_path(pepper, path)
    if isinstance(followed, Trajectory) and balance == ROBOT and pepper.requirements.balance is not None:
        balance = 0.0
    checks = checks_for(pepper, scene, static_limits(pepper, balance, payload, scene, torque_scale))
    dense = dense_states(pepper, scene, followed)
    look = _Look(checks, dense, margin)
    found = look.limits(dense.positions, pepper.lower_limits, pepper.upper_limits, "position", "rad", "m")
    end = len(dense.places) if found is None else found[0]
    found = (look.motion(followed, end) if isinstance(followed, Trajectory) else look.heavy(end)) or found
    found = look.touching(end if found is None else found[0]) or found
    if found is None:
        return Validation(
            ValidationStatus.VALID,
            f"Valid: {len(dense.places)} states, half a millimeter apart at most.",
            states_checked=len(dense.places),
        )
    at, status, what, joint = found
    q, place = dense.positions[at], float(dense.places[at])
    contacts = checks.exact.contacts(q) if status is ValidationStatus.COLLISION else ()
    where = f"{place:.6g} s" if isinstance(followed, Trajectory) else f"{place:.6g} of {dense.places[-1]:.6g}"
    message = f"Invalid from {where} on: {what}"
    return Validation(status, message, place, read_only(q.copy()), contacts, joint, at + 1)


Finding = tuple[int, ValidationStatus, str, "str | None"]
"""Index of the first invalid state, violated limit, sentence, and name of the joint at fault or None."""


class _Look:
    """Checks of states in order; each method returns the first invalid one, or None."""

    def __init__(self, checks: Checks, dense: DenseStates, margin: float) -> None:
        self.checks, self.dense, self.margin = checks, dense, margin
        self.pepper = checks.pepper

    def limits(
        self, values: Array, lower: Array, upper: Array, quantity: str, turning: str, sliding: str
    ) -> Finding | None:
        """Compare values of the states, shape (m, n), with limits, shape (n,) each."""
        slack = TOLERANCE * np.where(np.isfinite(upper - lower), upper - lower, 1.0)
        outside = (values < lower - slack) | (values > upper + slack)
        rows = outside.any(axis=1)
        if not rows.any():
            return None
        at = int(np.argmax(rows))
        joint = int(np.argmax(outside[at]))
        name = self.pepper.joint_names[joint]
        unit = turning if self.pepper.joint_units[joint] == "rad" else sliding
        value, *limits = beside_limits(values[at, joint], lower[joint], upper[joint], outside=True, digits=6)
        what = f"the {quantity} of {name} is {value} {unit}, outside [{', '.join(limits)}] {unit}."
        return at, _STATUS_OF[quantity], what, name

    def motion(self, trajectory: Trajectory, end: int) -> Finding | None:
        """Check velocity, acceleration, torque and balance of the first `end` states."""
        found: Finding | None = None
        if not end:
            return found
        pepper, state = self.pepper, trajectory(self.dense.places[:end])
        torque = inverse_dynamics_with(pepper, self.checks.statics.carrying, *state)
        for quantity, values, most, units in (
            ("velocity", state.velocity, pepper.velocity_limits, ("rad/s", "m/s")),
            ("acceleration", state.acceleration, pepper.acceleration_limits, ("rad/s^2", "m/s^2")),
            ("torque", torque, pepper.effort_limits, ("N m", "N")),
        ):
            here = self.limits(values, -most, most, quantity, *units)
            found = here if here is not None and (found is None or here[0] < found[0]) else found
        tipping = self._tipping(state)
        return tipping if tipping is not None and (found is None or tipping[0] < found[0]) else found

    def _tipping(self, state: State) -> Finding | None:
        """Find the first state in motion whose zero-moment point violates the balance margin."""
        statics, polygon = self.checks.statics, support_polygon(self.pepper)
        if statics.balance is None or polygon is None:
            return None
        inside = balance_margin(self.pepper, polygon, *state, statics.carrying)
        tips = inside < statics.balance - TOLERANCE
        if not tips.any():
            return None
        at = int(np.argmax(tips))
        what = (
            f"the zero-moment point{statics.carried} is {1000 * inside[at]:.1f} mm inside the edge of the "
            f"wheels' triangle, less than balance, {1000 * statics.balance:.1f} mm."
        )
        return at, ValidationStatus.TIPS_OVER, what, None

    def heavy(self, end: int) -> Finding | None:
        """Find the first of `end` states that cannot be held still, because of torque or balance."""
        statics, q = self.checks.statics, self.dense.positions[:end]
        holds = statics.hold(q, ROOM_ALONG) if end else np.ones(0, bool)
        if holds.all():
            return None
        at = int(np.argmin(holds))
        sentence = statics.violation(q[at], "state", ROOM_ALONG) or "the joints can hardly hold it."
        sentence = sentence[:1].lower() + sentence[1:]
        joint = statics.weakest(q[at])
        if joint is None and statics.tips(q[at], ROOM_ALONG):
            return at, ValidationStatus.TIPS_OVER, sentence, None
        joint_name = self.pepper.joint_names[statics.most_loaded(q[at])]
        return at, ValidationStatus.STATIC_TORQUE_LIMIT, sentence, joint_name

    def touching(self, end: int) -> Finding | None:
        """Find the first of `end` states that violates the margin to the scene or touches itself."""
        q = self.dense.positions
        if not end:
            return None
        free_of = self.checks.along(q[0], np.flatnonzero(np.ptp(q, axis=0) > 0.0), (self.margin, 0.0))
        for begin in range(0, end, _BLOCK):
            block = np.ascontiguousarray(q[begin : min(begin + _BLOCK, end)])
            free = free_of(block)
            if not free.all():
                return self._near(begin + int(np.argmin(free)))
        return None

    def _near(self, at: int) -> Finding:
        """Return the finding of a state in contact, or nearer than the margin."""
        checker, q, status = self.checks.exact, self.dense.positions[at], ValidationStatus.COLLISION
        fault = fault_of(checker, q, "state", self.checks.statics)
        if fault is not None and fault[0] is PlanStatus.GOAL_IN_COLLISION:
            return at, status, fault[1][:1].lower() + fault[1][1:], None
        pair = checker.closest_pair(q)
        if pair is None:
            return at, status, "the state is nearer than the margin.", None
        near = f"{' and '.join(pair.names)} are {1000 * pair.distance:.1f} mm apart"
        return at, status, f"{near}, less than the margin of {1000 * self.margin:.1f} mm.", None


_STATUS_OF = {
    "position": ValidationStatus.JOINT_LIMIT,
    "velocity": ValidationStatus.VELOCITY_LIMIT,
    "acceleration": ValidationStatus.ACCELERATION_LIMIT,
    "torque": ValidationStatus.TORQUE_LIMIT,
}
