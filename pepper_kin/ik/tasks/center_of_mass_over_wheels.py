"""Task that keeps the center of mass within the polygon of the wheels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import (
    checked_polygon,
    distances_inside,
    inner_radius,
    inward_normals,
    wheel_contacts,
)
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.center_of_mass import LABEL, center_jacobian_of, center_of
from pepper_kin.ik.tasks.direction import cross_matrix
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, joints_that_change
from pepper_kin.ik.tasks.symbolic_angles import skew
from pepper_kin.ik.tasks.task import POSITION_TOLERANCE, TargetTask, as_targets, words_for_length
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False, init=False, repr=False)
class CenterOfMassOverWheels(TargetTask):
    """The center of mass is over the wheels' triangle, at least a margin m away from each side.

    With y the horizontal position of the center of mass in the base's frame, n_k the inward unit normal of
    side k and a_k a corner on it,

        r_k(q) = max(0, m - n_k . (y - a_k)),    dr_k/dq = -n_k^T dy/dq where r_k > 0, else 0:

    an inequality, zero inside, where it has no influence.  The error is the largest r_k: m less the margin
    that `pepper_kin.dynamics.tip_over_margin` gives at rest.

    Attributes:
        target: The margin m [m], shape (), read-only.
        contacts: Corners in the base's frame [m], shape (k, 2), read-only; None for the robot's wheels.
        normals: n_k, shape (k, 2), read-only; None together with the contacts.
        base_frame: Frame of the base, in which the contacts are fixed.
        loads: Carried objects; a search sets them from its scene.
    """

    target: Array
    contacts: Array | None
    normals: Array | None
    base_frame: str
    loads: Loads
    unit: ClassVar[str] = "m"
    aspect: ClassVar[str] = "margin"
    target_axes: ClassVar[int] = 0
    largest: ClassVar[bool] = True

    def __init__(
        self,
        margin: ArrayLike = 0.02,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        *,
        hard: bool = False,
        contacts: ArrayLike | None = None,
        base_frame: str = "base_footprint",
    ) -> None:
        margins = read_only(as_targets(margin, f"margin of {LABEL}", ()))
        super().__init__(
            LABEL, weight=weight, tolerance=tolerance, hard=hard, target=margins, contacts=None, normals=None,
            base_frame=base_frame, loads=(),
        )  # fmt: skip
        if contacts is not None:
            vars(self).update(_polygon(checked_polygon(contacts, f"contacts of {LABEL}"), margins))

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot without the base's frame or known wheels, or whose wheels are too close for m."""
        pepper.frame_id(self.base_frame)
        self.on(pepper)

    def on(self, pepper: PepperModel) -> CenterOfMassOverWheels:
        """Return the task with the contacts of the robot's wheels, if it has no contacts."""
        if self.contacts is not None:
            return self
        return self.altered(**_polygon(wheel_contacts(pepper, f"contacts of {LABEL}"), self.target))

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return the missing margin at each side [m], shape (k,)."""
        return np.asarray(np.maximum(0.0, self.target - self.distances(pepper, q)))

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return -n_k^T dy/dq of sides whose margin is too small, zero for others, shape (k, n)."""
        lacking = self.distances(pepper, q) < self.target
        return np.where(lacking[:, None], self.dependence(pepper, q), 0.0)

    def dependence(self, pepper: PepperModel, q: Array) -> Array:
        """Return -n_k^T dy/dq of every side, shape (k, n).

        dy/dq = R^T (J_c - J_v + [c - o]x J_w) of the base's frame (o, R).
        """
        pose = frame_pose(pepper, q, self.base_frame)
        jacobian = frame_jacobian(pepper, q, self.base_frame)
        line = cross_matrix(center_of(pepper, self.loads, q) - pose[:3, 3])
        change = pose[:3, :3].T @ (
            center_jacobian_of(pepper, self.loads, q) - jacobian[:3] + line @ jacobian[3:]
        )
        return -self._polygon_of(pepper)[1] @ change[:2]

    def distances(self, pepper: PepperModel, q: Array) -> Array:
        """Return distances to the sides' lines [m], negative outside, shape (k,), at q, shape (n,)."""
        pose = frame_pose(pepper, q, self.base_frame)
        place = pose[:3, :3].T @ (center_of(pepper, self.loads, q) - pose[:3, 3])
        return distances_inside(*self._polygon_of(pepper), place[:2])

    def _polygon_of(self, pepper: PepperModel) -> tuple[Array, Array]:
        """Return corners [m] and normals, shape (k, 2) each."""
        own = self.on(pepper)
        return own.contacts, own.normals  # type: ignore[return-value]

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the missing margin in words, at joint positions q, shape (n,) [rad or m]."""
        lack, margin = self.error(pepper, q), float(self.target)
        return f"{self.label} lacks {words_for_length(lack)} of a margin of {_words_for_margin(margin)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the distance to the nearest side in words, at joint positions q, shape (n,) [rad or m]."""
        distance = float(self.distances(pepper, q).min())
        if distance < 0:
            return f"{words_for_length(-distance)} outside the wheels"
        return f"{words_for_length(distance)} inside the wheels"

    def _structure(self) -> TaskStructure | None:
        if self.loads or self.contacts is None:
            return None
        corners = tuple(self.contacts.ravel().tolist())
        return TaskStructure(
            CenterOfMassOverWheels, target_size=1, reference=self.base_frame, corners=corners, hard=self.hard
        )

    @staticmethod
    def moved_by(pepper: PepperModel, task: TaskStructure) -> np.ndarray:
        """Return whether each joint moves the center of mass in the base's frame, shape (n,)."""
        wheels = _of_structure(task)
        return joints_that_change(pepper, lambda q: wheels.dependence(pepper, q))

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return r_k and dr_k/dq."""
        import casadi

        wheels = _of_structure(task)
        contacts, normals = wheels._polygon_of(motion.pepper)
        center, jacobian = motion.center
        base, other = motion.frames[task.reference]
        turn, line = base[:, :3].T, center - base[:, 3]
        place = (turn @ line)[:2]
        inward = casadi.DM(normals)
        lack = target - (inward @ place - casadi.DM((normals * contacts).sum(axis=1)))
        change = (turn @ (jacobian - other[:3, :] + skew(line) @ other[3:, :]))[:2, :]
        slopes = -(inward @ motion.without(change, wheels.moved_by(motion.pepper, task)))
        rows = [casadi.if_else(lack[k] > 0, 1.0, 0.0) * slopes[k, :] for k in range(len(normals))]
        return casadi.fmax(lack, 0.0), casadi.vertcat(*rows)


def _of_structure(task: TaskStructure) -> CenterOfMassOverWheels:
    """Return a task with the contacts of a structure, and a margin that all contacts allow."""
    return CenterOfMassOverWheels(-1.0, contacts=np.reshape(task.corners, (-1, 2)), base_frame=task.reference)


def _words_for_margin(margin: float) -> str:
    """Return a margin [m] in words, which may be negative."""
    return words_for_length(margin) if margin >= 0 else f"-{words_for_length(-margin)}"


def _polygon(corners: Array, margins: Array) -> dict[str, Array]:
    """Return contacts, shape (k, 2) [m], and their normals as attributes of a task.

    Raises:
        InvalidValueError: for a margin [m] larger than any point's between the contacts.
    """
    widest = inner_radius(corners)
    if margins.size and margins.max() > widest:
        allowed = f"at most {widest:.4f} m, more than any point between the contacts has"
        raise InvalidValueError(f"margin of {LABEL}", f"{margins.max():.4f} m", allowed)
    return {"contacts": read_only(corners), "normals": read_only(inward_normals(corners))}
