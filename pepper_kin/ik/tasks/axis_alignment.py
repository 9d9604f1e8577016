"""Task that aligns an axis of a frame with a direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks import symbolic_angles
from pepper_kin.ik.tasks.direction import cross_matrix, direction_residual, sideways_basis, unit_vector
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, frame_structure
from pepper_kin.ik.tasks.task import (
    ANGLE_TOLERANCE,
    TargetTask,
    as_targets,
    words_for_angle,
    words_for_vector,
)
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel

# The x axis, the default axis.
AHEAD = (1.0, 0.0, 0.0)
_AHEAD = read_only(AHEAD)


@dataclass(frozen=True, eq=False, init=False, repr=False)
class AxisAlignment(TargetTask):
    """An axis a of a frame points along a direction u of the world; the rotation about it is free.

    r(q) = (theta / sin theta) B d with d = R^T u, see `direction_residual`; |r| = theta, the angle between
    them.  R' = [J_w q']x R gives dd/dq = R^T [u]x J_w.

    Attributes:
        frame: Name of a frame, see `pepper.frame_names`.
        direction: u, unit vector in the world, shape (3,), read-only.
        axis: a, unit vector in the frame, shape (3,), read-only.
        basis: B, two directions across the axis in the frame, shape (2, 3), read-only.
    """

    frame: str
    direction: Array
    axis: Array
    basis: Array
    unit: ClassVar[str] = "rad"
    aspect: ClassVar[str] = "direction"
    target_name: ClassVar[str] = "direction"

    def __init__(
        self,
        frame: str,
        direction: ArrayLike,
        axis: ArrayLike = AHEAD,
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        label: str = "",
        *,
        hard: bool = False,
    ) -> None:
        name = label or str(frame)
        ahead = _AHEAD if axis is AHEAD else unit_vector(axis, f"axis of {name}")
        super().__init__(
            name, weight=weight, tolerance=tolerance, hard=hard, frame=frame,
            direction=_units(direction, f"direction of {name}"), axis=ahead, basis=sideways_basis(ahead),
        )  # fmt: skip

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return the remaining rotation [rad], shape (2,)."""
        return self._turn(pepper, q)[0]

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return dr/dd R^T [u]x J_w, shape (2, n)."""
        _, slope, rotation = self._turn(pepper, q)
        angular = frame_jacobian(pepper, q, self.frame)[3:]
        return slope @ rotation.T @ cross_matrix(self.direction) @ angular

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the angle between axis and direction in words, at q, shape (n,) [rad or m]."""
        angle = words_for_angle(self.error(pepper, q))
        return f"{self.label} points {angle} away from direction {words_for_vector(self.direction)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the axis's direction in the world in words, at joint positions q, shape (n,) [rad or m]."""
        axis = frame_pose(pepper, q, self.frame)[:3, :3] @ self.axis
        return f"direction {words_for_vector(axis)}"

    def _turn(self, pepper: PepperModel, q: Array) -> tuple[Array, Array, Array]:
        """Return r, shape (2,) [rad], dr/dd, shape (2, 3), and R, shape (3, 3), at q, shape (n,)."""
        rotation = frame_pose(pepper, q, self.frame)[:3, :3]
        residual, slope = direction_residual(self.axis, self.basis, rotation.T @ self.direction)
        return residual, slope, rotation

    def _structure(self) -> TaskStructure:
        return frame_structure(AxisAlignment, self.frame, self.hard, axis=self.axis.tobytes())

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return the remaining rotation and dr/dd R^T [u]x J_w."""
        pose, jacobian = motion.frames[task.frame]
        axis, turn = np.array(task.axis), pose[:, :3].T
        residual, slope = symbolic_angles.direction_residual(axis, sideways_basis(axis), turn @ target)
        return residual, (slope @ turn @ symbolic_angles.skew(target)) @ jacobian[3:, :]


def _units(vectors: ArrayLike, quantity: str) -> Array:
    """Return a vector, shape (3,), or N vectors, shape (N, 3), normalized and read-only.

    Raises:
        InvalidValueError: for a wrong shape, NaN, infinity or a vector shorter than 1e-9.
    """
    array = as_targets(vectors, quantity, (3,))
    if array.ndim == 1:
        return unit_vector(array, quantity)
    lengths = np.linalg.norm(array, axis=-1, keepdims=True)
    if lengths.size and lengths.min() < 1e-9:
        raise InvalidValueError(quantity, array[lengths[..., 0].argmin()], "a vector that is not zero")
    return read_only(array / lengths)
