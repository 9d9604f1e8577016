"""Bounds on a motion between the states that are examined: extremes, rates, minimum clearance.

Extremes are exact for the whole piecewise polynomial, not only for samples: the maximum Bernstein coefficient
of a piece bounds it, and pieces are halved until none exceeds the maximum value found by more than rounding
(`pepper_kin.core.certificates.polynomials`).

If a quantity x(t) with |x''| <= b is known at both ends of a gap of length h, it deviates from the line
between the ends by at most b h^2 / 8.  The bounds b are proven from the tree of joints.  Let x_k >= |d^k x /
dt^k| be a bound on the norm of a vector's derivative on a piece of the motion.  Bounds of sums are sums of
the bounds; bounds of products (dot, cross, matrix times vector) follow the Leibniz rule,

    (x y)_k = sum_i C(k, i) x_i y_{k-i}.

From the floor outward, with u a unit vector fixed in a link, e and q the axis and position of its joint,
omega its angular velocity, p the joint's origin and c the center of mass (du/dt = omega x u):

    omega = omega_parent + e dq/dt,   p = p_parent + (an offset fixed in the parent) + (e q if prismatic),
    F = m (d2c/dt2 - g),   N = d(I omega)/dt;

inward, forces and moments about the joints' origins are summed, and tau = e . N, or e . F for a prismatic
joint.  Only norms of vectors enter, so that the bounds are several times too large; over a millisecond they
still amount to a small fraction of a limit.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import comb
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin import collision
from pepper_kin.arrays import Array
from pepper_kin.core.certificates.polynomials import derivative_bounds, evaluate, extremes
from pepper_kin.core.certificates.rate_bounds import (
    FORCE,
    LINK,
    MOMENT,
    ORIGIN,
    UNIT,
    WRENCH,
    Chain,
    bound_rates,
)
from pepper_kin.dynamics.load import Loads
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.trajectory.samples import TIME_TOLERANCE, State, examination_step, sample_times

if TYPE_CHECKING:
    from pepper_kin.collision import LeastClearance, Scene
    from pepper_kin.collision.checked_shapes import PairsTo
    from pepper_kin.trajectory.trajectory import Trajectory

CUT = 20
"""Maximum length of a piece, in steps of the examination; longer pieces are cut at a state."""

_ORDER = 4  # highest order of the derivatives of positions
RELATIVE_TOLERANCE = 1e-9  # violation attributed to rounding, relative to the limit
ALLOWANCE = 1e-3
"""Fraction of a torque or speed limit by which the bound between states may exceed the limit."""
_CLOSER = (2, 4, 8, 16)  # parts of a gap between states whose bound does not suffice, tried in turn
STATES = 32
"""Number of intervals between the states of one time interval whose clearance is examined."""
PARTS = 4
"""Number of parts into which a time interval is cut if its bound does not suffice."""
FINEST = 1e-6
"""Uncertainty below which no time interval is cut further [m]: coal's distances have as large an error."""
MOST_STRETCHES = 2000
"""Maximum number of time intervals examined: long motions a few micrometers from contact would need more."""


class Extremes(NamedTuple):
    """Maximum and minimum values of the columns of a piecewise polynomial, shape (n,) each.

    Attributes:
        high: Maximum values.
        high_time: Times of the maxima [s].
        low: Minimum values.
        low_time: Times of the minima [s].
    """

    high: Array
    high_time: Array
    low: Array
    low_time: Array


def extremes_of(breaks: Array, coefficients: Array, order: int = 0) -> Extremes:
    """Return the extremes of a derivative of a piecewise polynomial, to 1e-13 of the largest bound.

    Args:
        breaks: Ends of the pieces [s], shape (m + 1,).
        coefficients: Coefficients, constant term first, shape (m, k, n).
        order: Order of the derivative, 0 or more.
    """
    found = np.empty((coefficients.shape[2], 2, 2))
    extremes(np.ascontiguousarray(breaks), np.ascontiguousarray(coefficients), order, found)
    (high, high_time), (less, low_time) = np.moveaxis(found, 0, -1)
    return Extremes(high, high_time, -less, low_time)


class Parts(NamedTuple):
    """A trajectory cut into short pieces.

    Attributes:
        breaks: Ends of the short pieces [s], shape (m + 1,).
        segment: Index of the trajectory's piece that contains each short piece, shape (m,).
        offset: Time from the start of that piece to the start of the short piece [s], shape (m,).
        rates: Bounds on |d^k q / dt^k| on each short piece, k = 0 ... 4 [rad/s^k or m/s^k], shape (5, m, n).
    """

    breaks: Array
    segment: NDArray[np.intp]
    offset: Array
    rates: Array


def cut(trajectory: Trajectory, longest: float) -> Parts:
    """Cut a trajectory into short pieces, with bounds on its derivatives.

    Args:
        trajectory: The trajectory.
        longest: Length above which pieces are cut, at multiples of it [s].
    """
    knots = trajectory.breaks
    cuts = longest * np.arange(1, int(trajectory.duration / longest) + 1)
    segment = np.clip(np.searchsorted(knots, cuts, side="right") - 1, 0, knots.size - 2)
    inside = (cuts - knots[segment] > TIME_TOLERANCE) & (knots[segment + 1] - cuts > TIME_TOLERANCE)
    inside &= np.diff(knots)[segment] > longest
    breaks = np.sort(np.concatenate([knots, cuts[inside]]))
    segment = np.clip(np.searchsorted(knots, breaks[:-1], side="right") - 1, 0, knots.size - 2)
    offset, width = breaks[:-1] - knots[segment], np.diff(breaks)
    rates = np.empty((_ORDER + 1, segment.size, trajectory.n))
    derivative_bounds(trajectory.coefficients, segment, np.stack([offset, width], axis=1), rates)
    return Parts(breaks, segment, offset, rates)


class RateBounds:
    """Bounds on second derivatives along the pieces of a motion; arrays have the shape (m, ...).

    Args:
        pepper: The robot.
        rates: Bounds on |d^k q / dt^k|, k = 0 ... 4, shape (5, m, n).
        loads: Carried loads.
    """

    def __init__(self, pepper: PepperModel, rates: Array, loads: Loads = ()) -> None:
        self._pepper, self._model = pepper, pepper.inner_model
        chain = _chain(pepper, tuple(loads))
        self._gain = np.abs(np.asarray(pepper.full_map))
        full = rates @ self._gain.T
        # The constant offset of a mimic joint's position counts if the joint is prismatic.
        full[0] += np.abs(pepper.to_full(np.zeros(pepper.n)))
        self._full = np.ascontiguousarray(np.moveaxis(full, 0, -1))
        m, joints = full.shape[1], chain.parents.size
        self._links, self._wrenches = np.empty((m, joints, LINK)), np.empty((m, joints, WRENCH))
        self._torques = np.zeros((m, full.shape[2]))
        bound_rates(chain, self._full, self._links, self._wrenches, self._torques)

    def torque(self) -> Array:
        """Return bounds on d2 tau / dt2 [N m/s^2 or N/s^2], shape (m, n)."""
        return np.asarray(self._torques @ self._gain)

    def floor(self) -> tuple[Array, Array]:
        """Return bounds on the second derivatives of the floor's force and of its moment about the base.

        Returns:
            Bounds of the force [N/s^2] and of the moment in base axes [N m/s^2], shape (m,) each.
        """
        base = self._base()
        carried, unit = self._wrenches[:, base], self._links[:, base, UNIT:]
        x, y, z = (carried[:, MOMENT + k] for k in range(3))
        return carried[:, FORCE + 2], unit[:, 0] * z + 2 * unit[:, 1] * y + unit[:, 2] * x

    def frame_speed(self, frame: str) -> Array:
        """Return bounds on the second derivative of a frame's velocity [m/s^3], shape (m,)."""
        place = self._model.frames[self._pepper.frame_id(frame)]
        link = self._links[:, place.parentJoint]
        length = np.linalg.norm(place.placement.translation)
        return np.asarray(link[:, ORIGIN + 3] + length * link[:, UNIT + 3])

    def twist(self, order: int) -> tuple[Array, Array]:
        """Return bounds on a derivative of the base's linear (in its own axes) and angular velocity.

        Args:
            order: Order of the derivative: 2, or 3 for the second derivative of accelerations.

        Returns:
            Linear [m/s^(order + 1)] and angular bounds [rad/s^(order + 1)], shape (m,) each.
        """
        place = [self._model.joints[self._model.getJointId(joint)].idx_v for joint in BASE_JOINTS]
        speed = np.hypot(self._full[:, place[0], 1:], self._full[:, place[1], 1:])
        unit = self._links[:, self._base(), UNIT:]
        linear = sum(comb(order, k) * unit[:, k] * speed[:, order - k] for k in range(order + 1))
        return np.asarray(linear), self._full[:, place[2], order + 1]

    def _base(self) -> int:
        """Return Pinocchio's id of the joint that carries the base, 0 if the base does not move."""
        if set(BASE_JOINTS) <= set(self._pepper.joint_names):
            return int(self._model.getJointId(BASE_JOINTS[-1]))
        return 0


@kept_for_robot(most=8)
def _chain(pepper: PepperModel, loads: Loads) -> Chain:
    """Return the joints and masses of a robot with loads."""
    model = pepper.inner_model
    bodies = enumerate(model.inertias)
    masses = [(i, body.mass, body.lever, body.inertia) for i, body in bodies if body.mass > 0]
    for load in loads:
        place = model.frames[pepper.frame_id(load.frame)]
        lever = place.placement.translation + place.placement.rotation @ np.array(load.center)
        masses.append((place.parentJoint, load.mass, lever, load.tensor))  # only the norm of the lever counts
    sizes = [(mass, np.linalg.norm(lever), np.linalg.norm(inertia, 2)) for _, mass, lever, inertia in masses]
    return Chain(
        parents=np.array(model.parents, dtype=np.int64),
        places=np.array([0, *(joint.idx_v for joint in model.joints[1:])], dtype=np.int64),
        slides=np.array([False, *map(_slides, model.joints[1:])]),
        lengths=np.array([np.linalg.norm(place.translation) for place in model.jointPlacements]),
        armature=np.array(model.armature, dtype=float),
        carriers=np.array([carrier for carrier, *_ in masses], dtype=np.int64),
        masses=np.array(sizes, dtype=float).reshape(-1, 3),
        gravity=float(np.linalg.norm(model.gravity.linear)),
    )


def _slides(joint: object) -> bool:
    """Whether a joint of Pinocchio's is prismatic; all others are revolute."""
    return "P" in str(joint.shortname()).removeprefix("JointModel")[:1]  # type: ignore[attr-defined]


class Examined(NamedTuple):
    """States of a motion that are examined, and bounds on the motion between them.

    Attributes:
        step: Time between regular states [s].
        time: Times of the states [s], shape (T,).
        state: Positions, velocities and accelerations, shape (T, n) each.
        part: Index of the piece to which each state belongs, shape (T,).
        gap: Longest time between successive states of each piece [s], shape (m,).
        bounds: Bounds on second derivatives on the pieces.
        rates: Bounds on |dq/dt| on the pieces [rad/s or m/s], shape (m, n).
        breaks: Ends of the pieces [s], shape (m + 1,).
        trajectory: The motion.
        parts: The motion cut into the pieces.
    """

    step: float
    time: Array
    state: State
    part: NDArray[np.intp]
    gap: Array
    bounds: RateBounds
    rates: Array
    breaks: Array
    trajectory: Trajectory
    parts: Parts

    def closer(self, pieces: NDArray[np.intp], count: int) -> Examined:
        """Return states in selected pieces only, with gaps divided by `count`."""
        width = np.diff(self.breaks)[pieces]
        states = count * np.ceil(width / self.gap[pieces] - TIME_TOLERANCE).astype(int) + 1
        index = np.arange(states.sum()) - np.repeat(np.cumsum(states) - states, states)
        local = index * np.repeat(width / (states - 1), states)
        part = np.repeat(pieces, states)
        state = derivatives(self.trajectory, self.parts.segment[part], self.parts.offset[part] + local, 3)
        time = self.breaks[part] + local
        return self._replace(time=time, state=State(*state), part=part, gap=self.gap / count)

    def at_most(self, size: Array, second: Array) -> Array:
        """Return bounds on a quantity on the pieces, shape (m, w).

        Args:
            size: Absolute values of the quantity at the states, shape (T, w).
            second: Bounds on the second derivative of the quantity on the pieces, shape (m, w).
        """
        highest = np.zeros_like(second)
        np.maximum.at(highest, self.part, size)
        return np.asarray(highest + second * (self.gap**2 / 8)[:, None])

    def between(self, size_of: Callable[[State], Array], size: Array, second: Array, limit: Array) -> Array:
        """Return bounds on how much a quantity exceeds its maximum at the states between them, shape (w,).

        Args:
            size_of: Function that returns absolute values of the quantity, shape (T, w).
            size: Absolute values at the states, shape (T, w).
            second: Bounds on the second derivative of the quantity on the pieces, shape (m, w).
            limit: Limits of the quantity, shape (w,).
        """
        value = size.max(axis=0)
        bound = self.proven(
            self.at_most(size, second),
            lambda closer: closer.at_most(size_of(closer.state), second),
            np.where(value <= limit * (1 + RELATIVE_TOLERANCE), limit * (1 + ALLOWANCE), np.inf),
        )
        return np.maximum(bound - value, 0.0)

    def proven(self, bound: Array, bound_of: Callable[[Examined], Array], most: Array) -> Array:
        """Return bounds over the motion, shape (w,), refined by closer states where they exceed `most`.

        Args:
            bound: Bounds on the pieces, shape (m, w); replaced in place by better bounds.
            bound_of: Function that returns bounds from other states; bounds of pieces without a state are not
                used.
            most: Values up to which a bound needs no refinement, shape (w,).
        """
        for count in _CLOSER:
            pieces = np.flatnonzero((bound > most).any(axis=1))
            if not pieces.size:
                break
            bound[pieces] = np.minimum(bound[pieces], bound_of(self.closer(pieces, count))[pieces])
        return np.asarray(bound.max(axis=0))


def examined_states(pepper: PepperModel, trajectory: Trajectory, loads: Loads) -> Examined:
    """Return the states at every millisecond and on both sides of every knot, with bounds between."""
    step = examination_step(trajectory.duration)
    parts = cut(trajectory, CUT * step)
    regular, width = sample_times(trajectory.duration, step), np.diff(parts.breaks)
    inside = np.clip(np.searchsorted(parts.breaks, regular, side="right") - 1, 0, width.size - 1)
    every = np.arange(width.size)
    part = np.concatenate([inside, every, every])
    local = np.concatenate([regular - parts.breaks[inside], 0 * width, width])
    time = np.concatenate([regular, parts.breaks[:-1], parts.breaks[1:]])
    state = derivatives(trajectory, parts.segment[part], parts.offset[part] + local, 3)
    bounds = RateBounds(pepper, parts.rates, loads)
    return Examined(
        step, time, State(*state), part, np.minimum(width, step), bounds, parts.rates[1], parts.breaks,
        trajectory, parts,
    )  # fmt: skip


def derivatives(trajectory: Trajectory, segment: NDArray[np.intp], local: Array, count: int) -> list[Array]:
    """Return the value and first derivatives of the polynomials, `count` arrays of shape (T, n)."""
    state = np.empty((count, segment.size, trajectory.n))
    evaluate(trajectory.coefficients, segment, local, state)
    return list(state)


class ProvenClearance(NamedTuple):
    """Minimum clearance along a motion.

    Attributes:
        nearest: Minimum distance that was measured, and its pair.
        time: Time of that distance from the start of the motion [s].
        bound: Lower bound on all distances, also between the states [m].
        forbidden: The first time at which a table of joint ranges forbids the posture [s]; None for never.
    """

    nearest: LeastClearance
    time: float
    bound: float
    forbidden: float | None


class Pieces(NamedTuple):
    """Pieces of a motion.

    Attributes:
        breaks: Ends of the pieces [s], shape (m + 1,).
        rates: Bounds on |dq/dt| on each piece [rad/s or m/s], shape (m, n).
    """

    breaks: Array
    rates: Array


def proven_clearance(
    pepper: PepperModel,
    motion: Trajectory,
    times: Array,
    pieces: Pieces,
    scene: Scene,
    start_time: float,
    to: PairsTo,
    least: float = 0.0,
) -> ProvenClearance:
    """Return the minimum distance along a motion, and a lower bound for the whole motion.

    A distance that shrinks at most with speed v is, between two states a time h apart, at most v h / 2 below
    the smaller of its two values.  If that does not prove that the required distance is kept, the motion is
    cut into shorter and shorter time intervals with their own speeds, until it does, until something is
    nearer, or until v h / 2 is less than `FINEST`.

    Args:
        pepper: The robot.
        motion: The motion.
        times: Regular times of the motion [s], shape (T,).
        pieces: Pieces of the motion with bounds on speeds.
        scene: The world around the robot.
        start_time: Time of the scene at which the motion begins [s].
        to: Pairs that count: "self" or "obstacles".
        least: Required minimum distance [m].
    """
    found = collision.least_clearance(pepper, motion(times).position, scene, start_time + times, to=to)
    at = float(times[found.index])
    forbidden = None if found.forbidden is None else float(times[found.forbidden])
    step = float(np.diff(times).max(initial=0.0))
    bound = found.distance - 0.5 * step * collision.approach_speed(pepper, pieces.rates, scene)
    if bound > least or found.distance <= least:
        return ProvenClearance(found, at, min(bound, found.distance), forbidden)
    ends = np.unique(np.append(np.arange(0.0, motion.duration, STATES * step), motion.duration))
    waiting = list(pairwise(ends.tolist()))[::-1]
    bound, looked = np.inf, 0
    while waiting:
        start, end = waiting.pop()
        local = np.linspace(start, end, STATES + 1)
        nearest = collision.least_clearance(pepper, motion(local).position, scene, start_time + local, to=to)
        if nearest.distance < found.distance:
            found, at = nearest, float(local[nearest.index])
        if forbidden is None and nearest.forbidden is not None:
            forbidden = float(local[nearest.forbidden])
        looked += 1
        first, last = np.searchsorted(pieces.breaks, [start, end], side="right")
        rates = pieces.rates[max(first - 1, 0) : last]
        between = 0.5 * (end - start) / STATES * collision.approach_speed(pepper, rates, scene)
        enough = nearest.distance > least + between or nearest.distance <= least or between < FINEST
        if enough:
            bound = min(bound, nearest.distance - between)
        else:
            cuts = np.linspace(start, end, PARTS + 1).tolist()
            waiting += list(pairwise(cuts))[::-1]
        if found.distance <= least:
            break
        if looked >= MOST_STRETCHES:
            bound = -np.inf  # nothing is known about the remaining time intervals
            break
    return ProvenClearance(found, at, min(bound, found.distance), forbidden)
