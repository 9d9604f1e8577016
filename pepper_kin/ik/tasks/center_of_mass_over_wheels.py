"""Center of mass within the polygon of the wheels, as a task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.dynamics import WHEEL_CONTACTS
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.frozen_arrays import read_only
from pepper_kin.ik.tasks.center_of_mass import LABEL, center_jacobian_of, center_of
from pepper_kin.ik.tasks.direction import cross_matrix
from pepper_kin.ik.tasks.structure import Motion, Structure, joints_that_change
from pepper_kin.ik.tasks.symbolic_angles import skew
from pepper_kin.ik.tasks.task import POSITION_TOLERANCE, TargetTask, as_targets, words_for_length
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite


@dataclass(frozen=True, eq=False, init=False, repr=False)
class CenterOfMassOverWheels(TargetTask):
    """The center of mass is over the wheels' triangle, at least a margin m away from each side.

    With y the center of mass on the floor as the base sees it, n_k the inward unit normal of side k and a_k a
    corner on it,

        r_k(q) = max(0, m - n_k . (y - a_k)),    dr_k/dq = -n_k^T dy/dq where r_k > 0, else 0:

    an inequality, zero and without influence inside.  The error is the largest r_k: m less the margin that
    `pepper_kin.dynamics.tip_over_margin` gives at rest.

    Attributes:
        target: The margin m [m], shape (), read-only.
        contacts: Corners in the base's frame [m], shape (k, 2), read-only.
        normals: n_k, shape (k, 2), read-only.
        base_frame: Frame that the contacts move with.
        loads: What the robot carries; a search sets it from its scene.
    """

    target: Array
    contacts: Array
    normals: Array
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
        contacts: ArrayLike = WHEEL_CONTACTS,
        base_frame: str = "base_footprint",
    ) -> None:
        corners = as_finite(contacts, f"contacts of {LABEL}", (None, 2))
        normals, widest = _inward_normals(corners)
        margins = as_targets(margin, f"margin of {LABEL}", ())
        if margins.size and margins.max() > widest:
            allowed = f"at most {widest:.4f} m, more than any point between the contacts has"
            raise InvalidValueError(f"margin of {LABEL}", f"{margins.max():.4f} m", allowed)
        super().__init__(
            LABEL, weight=weight, tolerance=tolerance, hard=hard, target=read_only(margins),
            contacts=read_only(corners), normals=read_only(normals), base_frame=base_frame, loads=(),
        )  # fmt: skip

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot without the base's frame."""
        pepper.frame_id(self.base_frame)

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return the lack of margin to each side [m], shape (k,)."""
        return np.asarray(np.maximum(0.0, self.target - self.distances(pepper, q)))

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return -n_k^T dy/dq where the margin is too small, zero elsewhere, shape (k, n)."""
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
        return -self.normals @ change[:2]

    def distances(self, pepper: PepperModel, q: Array) -> Array:
        """Return distances to the sides' lines [m], negative outside, shape (k,), at q, shape (n,)."""
        pose = frame_pose(pepper, q, self.base_frame)
        place = pose[:3, :3].T @ (center_of(pepper, self.loads, q) - pose[:3, 3])
        return np.asarray(np.einsum("ki,ki->k", self.normals, place[:2] - self.contacts))

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return in words how much of the margin is lacking, at joint positions q, shape (n,) [rad or m]."""
        lack, margin = self.error(pepper, q), float(self.target)
        return f"{self.label} lacks {words_for_length(lack)} of a margin of {_words_for_margin(margin)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the distance to the nearest side in words, at joint positions q, shape (n,) [rad or m]."""
        distance = float(self.distances(pepper, q).min())
        if distance < 0:
            return f"{words_for_length(-distance)} outside the wheels"
        return f"{words_for_length(distance)} inside the wheels"

    def _structure(self) -> Structure | None:
        if self.loads:
            return None
        corners = tuple(self.contacts.ravel().tolist())
        return Structure(
            CenterOfMassOverWheels, target_size=1, reference=self.base_frame, corners=corners, hard=self.hard
        )

    @staticmethod
    def moved_by(pepper: PepperModel, task: Structure) -> np.ndarray:
        """Return which joints move the center of mass as the base sees it, shape (n,)."""
        wheels = _of_structure(task)
        return joints_that_change(pepper, lambda q: wheels.dependence(pepper, q))

    @staticmethod
    def expression(task: Structure, motion: Motion, target: Any) -> tuple[Any, Any]:
        """Return r_k and dr_k/dq."""
        import casadi

        wheels = _of_structure(task)
        center, jacobian = motion.center
        base, other = motion.frames[task.reference]
        turn, line = base[:, :3].T, center - base[:, 3]
        place = (turn @ line)[:2]
        inward = casadi.DM(wheels.normals)
        lack = target - (inward @ place - casadi.DM((wheels.normals * wheels.contacts).sum(axis=1)))
        change = (turn @ (jacobian - other[:3, :] + skew(line) @ other[3:, :]))[:2, :]
        slopes = -(inward @ motion.without(change, wheels.moved_by(motion.pepper, task)))
        rows = [casadi.if_else(lack[k] > 0, 1.0, 0.0) * slopes[k, :] for k in range(len(wheels.normals))]
        return casadi.fmax(lack, 0.0), casadi.vertcat(*rows)


def _of_structure(task: Structure) -> CenterOfMassOverWheels:
    """Return a task of a structure, with a margin that any contacts allow."""
    return CenterOfMassOverWheels(-1.0, contacts=np.reshape(task.corners, (-1, 2)), base_frame=task.reference)


def _words_for_margin(margin: float) -> str:
    return words_for_length(margin) if margin >= 0 else f"-{words_for_length(-margin)}"


def _inward_normals(corners: Array) -> tuple[Array, float]:
    """Return the inward unit normals of a convex polygon and a bound on the margin inside: 2 area / girth.

    Args:
        corners: Corners in the base's frame [m], shape (k, 2), counter-clockwise.

    Returns:
        The normals, shape (k, 2), of the side that starts at each corner; the bound [m].

    Raises:
        InvalidValueError: unless the corners are those of a convex polygon in counter-clockwise order.
    """
    sides = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([-sides[:, 1], sides[:, 0]])
    reach = np.einsum("ki,kji->kj", normals, corners[None] - corners[:, None])
    turns = np.einsum("ki,ki->k", normals, np.roll(sides, -1, axis=0))
    if len(corners) < 3 or np.any(turns <= 0) or np.any(reach < -1e-12):
        wanted = "corners of a convex polygon, counter-clockwise, shape (k >= 3, 2)"
        raise InvalidValueError(f"contacts of {LABEL}", corners.tolist(), wanted)
    lengths = np.linalg.norm(sides, axis=1)
    x, y = corners.T
    area = 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    return normals / lengths[:, None], 2 * area / float(lengths.sum())
