"""Bounds on the second derivatives of torques, forces and speeds, for what happens between examined instants.

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

from functools import cached_property
from math import comb
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.splines import shifted
from pepper_kin.dynamics.load import Loads
from pepper_kin.model import PepperModel
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.trajectory.extremes import derivative, greatest_size
from pepper_kin.trajectory.sampling import TIME_TOLERANCE

if TYPE_CHECKING:
    from pepper_kin.trajectory.trajectory import Trajectory

CUT = 20
"""Pieces longer than so many steps of an examination are cut, at one of its states."""

_ORDER = 4  # of the derivatives of positions


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
    coefficients = trajectory.coefficients[segment]
    moved = offset > 0
    coefficients[moved] = shifted(coefficients[moved], offset[moved])
    rates = np.stack([greatest_size(width, derivative(coefficients, order)) for order in range(_ORDER + 1)])
    return Parts(breaks, segment, offset, rates)


def _product(first: Array, second: Array, order: int) -> Array:
    """Return bounds on a product of vectors and its derivatives up to an order, shape (order + 1, m)."""
    return np.stack(
        [sum(comb(k, i) * first[i] * second[k - i] for i in range(k + 1)) for k in range(order + 1)]
    )


class _Link(NamedTuple):
    """Bounds on what moves with a joint; the first axis is the derivative's order.

    Attributes:
        turning: On the angular velocity, orders 0 to 3.
        unit: On a unit vector fixed in it, orders 0 to 4.
        origin: On the joint's origin, of which the orders 1 to 4 count.
    """

    turning: Array
    unit: Array
    origin: Array


class RateBounds:
    """Bounds on second derivatives along the pieces of a motion; arrays have the shape (m, ...).

    Args:
        pepper: The robot.
        rates: Bounds on |d^k q / dt^k|, k = 0 ... 4, shape (5, m, n).
        loads: What is carried.
    """

    def __init__(self, pepper: PepperModel, rates: Array, loads: Loads = ()) -> None:
        self._pepper, self._loads, self._model = pepper, loads, pepper.inner_model
        gain = np.abs(np.asarray(pepper.full_map))
        self._full = rates @ gain.T
        # The constant part of a mimic joint's position counts where it slides.
        self._full[0] += np.abs(pepper.to_full(np.zeros(pepper.n)))
        self._links = self._outward()

    def _outward(self) -> list[_Link]:
        model, count = self._model, self._full.shape[1]
        still = np.zeros((_ORDER + 1, count))
        unit = still.copy()
        unit[0] = 1.0
        links = [_Link(still[:-1], unit, still)]
        for i in range(1, model.njoints):
            above, joint = links[model.parents[i]], model.joints[i]
            moves = self._full[:, :, joint.idx_v]
            origin = above.origin + np.linalg.norm(model.jointPlacements[i].translation) * above.unit
            if _slides(joint):
                links.append(_Link(above.turning, above.unit, origin + _product(above.unit, moves, _ORDER)))
                continue
            turning = above.turning + _product(above.unit, moves[1:], _ORDER - 1)
            unit = np.zeros_like(still)
            unit[0] = 1.0
            for k in range(_ORDER):
                unit[k + 1] = sum(comb(k, of) * turning[of] * unit[k - of] for of in range(k + 1))
            links.append(_Link(turning, unit, origin))
        return links

    @cached_property
    def _wrenches(self) -> tuple[list[Array], list[Array]]:
        """Bounds on the forces that joints carry and the moments about their origins, orders 0 to 2."""
        model, links, count = self._model, self._links, self._full.shape[1]
        forces = [np.zeros((3, count)) for _ in links]
        moments = [np.zeros((3, count)) for _ in links]
        gravity = float(np.linalg.norm(model.gravity.linear))
        masses = [
            (i, body.mass, body.lever, body.inertia) for i, body in enumerate(model.inertias) if body.mass > 0
        ]
        for load in self._loads:
            place = model.frames[self._pepper.frame_id(load.frame)]
            lever = place.placement.translation + place.placement.rotation @ np.array(load.center)
            masses.append((place.parentJoint, load.mass, lever, load.tensor))  # of which the norm counts
        for i, mass, lever, inertia in masses:
            arm = float(np.linalg.norm(lever)) * links[i].unit
            force = mass * (links[i].origin + arm)[2:]
            force[0] += mass * gravity
            # |R I R^T|_k <= lambda sum C(k, l) |R|_l |R|_{k-l}, and N is the derivative of R I R^T omega
            tensor = float(np.linalg.norm(inertia, 2)) * _product(links[i].unit, links[i].unit, 3)
            moment = _product(tensor, links[i].turning, 3)[1:]
            forces[i] += force
            moments[i] += moment + _product(arm, force, 2)
        for i in range(model.njoints - 1, 0, -1):
            parent = model.parents[i]
            way = np.linalg.norm(model.jointPlacements[i].translation) * links[parent].unit
            if _slides(model.joints[i]):
                way = way + _product(links[parent].unit, self._full[:, :, model.joints[i].idx_v], _ORDER)
            forces[parent] += forces[i]
            moments[parent] += moments[i] + _product(way, forces[i], 2)
        return forces, moments

    def torque(self) -> Array:
        """Return bounds on d2 tau / dt2 [N m/s^2 or N/s^2], shape (m, n)."""
        model, (forces, moments) = self._model, self._wrenches
        full = np.zeros((self._full.shape[1], model.nv))
        for i in range(1, model.njoints):
            place = model.joints[i].idx_v
            carried = forces[i] if _slides(model.joints[i]) else moments[i]
            full[:, place] = _product(self._links[model.parents[i]].unit, carried, 2)[2]
            full[:, place] += float(model.armature[place]) * self._full[4, :, place]
        return np.asarray(full @ np.abs(np.asarray(self._pepper.full_map)))

    def floor(self) -> tuple[Array, Array]:
        """Return bounds on the second derivatives of the floor's force and of its moment about the base.

        Returns:
            [N/s^2] and [N m/s^2], shape (m,), the moment as the axes of the base see it.
        """
        forces, moments = self._wrenches
        base = self._base()
        return forces[base][2], _product(self._links[base].unit, moments[base], 2)[2]

    def frame_speed(self, frame: str) -> Array:
        """Return bounds on the second derivative of a frame's velocity [m/s^3], shape (m,)."""
        place = self._model.frames[self._pepper.frame_id(frame)]
        link = self._links[place.parentJoint]
        return np.asarray((link.origin + np.linalg.norm(place.placement.translation) * link.unit)[3])

    def twist(self, order: int) -> tuple[Array, Array]:
        """Return bounds on a derivative of the base's velocity in its own axes, and of its turning.

        Args:
            order: Of the derivative, 2 or 3: of velocities, or of accelerations twice more.

        Returns:
            [m/s^(order + 1)] and [rad/s^(order + 1)], shape (m,).
        """
        place = [self._model.joints[self._model.getJointId(joint)].idx_v for joint in BASE_JOINTS]
        speed = np.hypot(self._full[1:, :, place[0]], self._full[1:, :, place[1]])
        unit = self._links[self._base()].unit
        return _product(unit, speed, order)[order], self._full[order + 1, :, place[2]]

    def _base(self) -> int:
        """Return the joint that carries the base, 0 where it does not move."""
        if set(BASE_JOINTS) <= set(self._pepper.joint_names):
            return int(self._model.getJointId(BASE_JOINTS[-1]))
        return 0


def _slides(joint: object) -> bool:
    """Whether a joint of Pinocchio's slides; all others turn about an axis."""
    return "P" in str(joint.shortname()).removeprefix("JointModel")[:1]  # type: ignore[attr-defined]
