"""Motions between the states that are examined: extremes, bounds on rates, the least clearance.

Extremes are those of piecewise polynomials over their whole length, not of samples: the greatest Bernstein
coefficient of a piece bounds it, and pieces are halved until none is above the greatest value found by more
than rounding (`pepper_kin.core.certificates.polynomials`).

Of a quantity x(t) with |x''| <= b that is known at both ends of a gap of length h, no value between is more
than b h^2 / 8 beyond the line between the ends.  The bounds b are proven from the tree of joints.  Let a bar
denote bounds on the norm of a vector and of its derivatives on a piece of the motion, x_k >= |d^k x / dt^k|.
Sums of vectors have the sums of the bounds, products (dot, cross, matrix times vector) those of Leibniz,

    (x y)_k = sum_i C(k, i) x_i y_{k-i}.

From the floor outward, with u a unit vector fixed in a link, e and q the axis and position of its joint,
omega its angular velocity, p the joint's origin and c the center of mass (du/dt = omega x u):

    omega = omega_parent + e dq/dt,   p = p_parent + (a way fixed in the parent) + (e q where it slides),
    F = m (d2c/dt2 - g),   N = d(I omega)/dt;

inward, forces and moments about the joints' origins are summed, and tau = e . N, or e . F if the joint
slides.  Only lengths of vectors enter, so that the bounds are several times too large: over a millisecond
they still amount to a small part of a limit.
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
"""Pieces longer than so many steps of an examination are cut, at one of its states."""

_ORDER = 4  # of the derivatives of positions
RELATIVE_TOLERANCE = 1e-9  # of a limit, for rounding
ALLOWANCE = 1e-3
"""Share of a torque's or speed's limit by which its bound between the states examined may be beyond it."""
_CLOSER = (2, 4, 8, 16)  # parts of a gap between states, where that is too long for a bound
STATES = 32
"""Intervals between the states of a stretch that is looked at once."""
PARTS = 4
"""Stretches that a stretch is cut into where its bound does not suffice."""
FINEST = 1e-6
"""Bound [m] beyond what is asked below which no stretch is cut: distances by coal are off by as much."""
MOST_STRETCHES = 2000
"""Stretches that are looked at; motions that keep less than some micrometers for long would take more."""


class Extremes(NamedTuple):
    """Greatest and least values of the columns of a piecewise polynomial, shape (n,) each.

    Attributes:
        high: The greatest values.
        high_time: Where they are attained [s].
        low: The least values.
        low_time: Where these are attained [s].
    """

    high: Array
    high_time: Array
    low: Array
    low_time: Array


def extremes_of(breaks: Array, coefficients: Array, order: int = 0) -> Extremes:
    """Return the extremes of a derivative of a piecewise polynomial, to 1e-13 of the greatest bound.

    Args:
        breaks: Ends of the pieces [s], shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
        order: Of the derivative, 0 or more.
    """
    found = np.empty((coefficients.shape[2], 2, 2))
    extremes(np.ascontiguousarray(breaks), np.ascontiguousarray(coefficients), order, found)
    (high, high_time), (less, low_time) = np.moveaxis(found, 0, -1)
    return Extremes(high, high_time, -less, low_time)


class Parts(NamedTuple):
    """A trajectory cut into short pieces.

    Attributes:
        breaks: Their ends [s], shape (m + 1,).
        segment: The trajectory's piece that each is a part of, shape (m,).
        offset: Time from the start of that piece to its own [s], shape (m,).
        rates: Bounds on |d^k q / dt^k| on each, k = 0 ... 4 [rad/s^k or m/s^k], shape (5, m, n).
    """

    breaks: Array
    segment: NDArray[np.intp]
    offset: Array
    rates: Array


def cut(trajectory: Trajectory, longest: float) -> Parts:
    """Return a trajectory in short pieces with bounds on its derivatives.

    Args:
        trajectory: The trajectory.
        longest: Pieces longer than this are cut at its multiples [s].
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
        loads: What is carried.
    """

    def __init__(self, pepper: PepperModel, rates: Array, loads: Loads = ()) -> None:
        self._pepper, self._model = pepper, pepper.inner_model
        chain = _chain(pepper, tuple(loads))
        self._gain = np.abs(np.asarray(pepper.full_map))
        full = rates @ self._gain.T
        # The constant part of a mimic joint's position counts where it slides.
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
            [N/s^2] and [N m/s^2], shape (m,), the moment as the axes of the base see it.
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
        """Return bounds on a derivative of the base's velocity in its own axes, and of its turning.

        Args:
            order: Of the derivative, 2 or 3: of velocities, or of accelerations twice more.

        Returns:
            [m/s^(order + 1)] and [rad/s^(order + 1)], shape (m,).
        """
        place = [self._model.joints[self._model.getJointId(joint)].idx_v for joint in BASE_JOINTS]
        speed = np.hypot(self._full[:, place[0], 1:], self._full[:, place[1], 1:])
        unit = self._links[:, self._base(), UNIT:]
        linear = sum(comb(order, k) * unit[:, k] * speed[:, order - k] for k in range(order + 1))
        return np.asarray(linear), self._full[:, place[2], order + 1]

    def _base(self) -> int:
        """Return the joint that carries the base, 0 where it does not move."""
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
        masses.append((place.parentJoint, load.mass, lever, load.tensor))  # of which the norm counts
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
    """Whether a joint of Pinocchio's slides; all others turn about an axis."""
    return "P" in str(joint.shortname()).removeprefix("JointModel")[:1]  # type: ignore[attr-defined]


class Examined(NamedTuple):
    """States of a motion that are examined, and bounds on how it goes on between them.

    Attributes:
        step: Time between the regular ones [s].
        time: When [s], shape (T,).
        state: Arrays of shape (T, n).
        part: Of `rates`, to which each state belongs, shape (T,).
        gap: Longest time between successive states of each piece [s], shape (m,).
        bounds: Bounds on second derivatives on the pieces.
        rates: Bounds on |dq/dt| there, shape (m, n).
        breaks: Ends of the pieces [s], shape (m + 1,).
        trajectory: The motion.
        parts: How it is cut into the pieces.
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
        """Return states in some pieces alone, with gaps a `count`-th as long."""
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
            size: Its absolute values at the states, shape (T, w).
            second: Bounds on its second derivative on the pieces, shape (m, w).
        """
        highest = np.zeros_like(second)
        np.maximum.at(highest, self.part, size)
        return np.asarray(highest + second * (self.gap**2 / 8)[:, None])

    def between(self, size_of: Callable[[State], Array], size: Array, second: Array, limit: Array) -> Array:
        """Return what a quantity may be greater by between the states than at all of them, shape (w,).

        Args:
            size_of: Returns its absolute values, shape (T, w).
            size: Those at the states.
            second: Bounds on its second derivative on the pieces, shape (m, w).
            limit: Of the quantity, shape (w,).
        """
        value = size.max(axis=0)
        bound = self.proven(
            self.at_most(size, second),
            lambda closer: closer.at_most(size_of(closer.state), second),
            np.where(value <= limit * (1 + RELATIVE_TOLERANCE), limit * (1 + ALLOWANCE), np.inf),
        )
        return np.maximum(bound - value, 0.0)

    def proven(self, bound: Array, bound_of: Callable[[Examined], Array], most: Array) -> Array:
        """Return bounds over the motion, shape (w,), from closer states where they are not below `most`.

        Args:
            bound: Bounds on the pieces, shape (m, w); replaced where better ones are found.
            bound_of: Returns those by other states; those of pieces without a state are not used.
            most: Up to which a bound need not be better, shape (w,).
        """
        for count in _CLOSER:
            pieces = np.flatnonzero((bound > most).any(axis=1))
            if not pieces.size:
                break
            bound[pieces] = np.minimum(bound[pieces], bound_of(self.closer(pieces, count))[pieces])
        return np.asarray(bound.max(axis=0))


def examined_states(pepper: PepperModel, trajectory: Trajectory, loads: Loads) -> Examined:
    """Return states at every millisecond, and on both sides of every knot."""
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
    """Return value and first derivatives of the polynomials, shape (T, n) each."""
    state = np.empty((count, segment.size, trajectory.n))
    evaluate(trajectory.coefficients, segment, local, state)
    return list(state)


class ProvenClearance(NamedTuple):
    """What was found.

    Attributes:
        nearest: The least distance that was measured, and its pair.
        time: Its time from the start of the motion [s].
        bound: What no distance is below, between the states too [m].
        forbidden: The first time at which a table of joint ranges forbids the posture [s]; None for never.
    """

    nearest: LeastClearance
    time: float
    bound: float
    forbidden: float | None


class Pieces(NamedTuple):
    """Pieces of a motion.

    Attributes:
        breaks: Their ends [s], shape (m + 1,).
        rates: Bounds on |dq/dt| on each [rad/s or m/s], shape (m, n).
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
    """Return the least distance along a motion, and a bound for all of it.

    A distance that shrinks at most with the speed v is, between two states h apart, no more than v h / 2
    below the lesser of its values there.  Where that does not suffice to prove that the least distance asked
    is kept, the motion is cut into stretches with speeds of their own, and these into shorter ones, until it
    does, until something is nearer, or until v h / 2 is less than `FINEST`.

    Args:
        pepper: The robot.
        motion: Its motion.
        times: Regular times of it [s], shape (T,).
        pieces: Its pieces.
        scene: The world around it.
        start_time: Time of the scene at which the motion begins [s].
        to: Which pairs count: "self" or "obstacles".
        least: The least distance asked [m].
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
            bound = -np.inf  # nothing is known of the stretches that wait
            break
    return ProvenClearance(found, at, min(bound, found.distance), forbidden)
