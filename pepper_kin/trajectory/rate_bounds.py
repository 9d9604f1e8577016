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

from math import comb
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.certificates.polynomials import derivative_bounds
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
