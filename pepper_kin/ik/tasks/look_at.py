"""Task that directs a camera at a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.ik.tasks import symbolic_angles
from pepper_kin.ik.tasks.direction import cross_matrix, direction_residual, sideways_basis, unit_and_length
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

_AHEAD, _AHEAD_OPTICAL = read_only((1.0, 0.0, 0.0)), read_only((0.0, 0.0, 1.0))


@dataclass(frozen=True, eq=False, init=False, repr=False)
class LookAt(TargetTask):
    """The axis of a camera passes through a point p in front of it.

    r(q) = (theta / sin theta) B d with d = R^T u, u = (p - o) / |p - o|, see `direction_residual`;
    |r| = theta, the angle between the camera's axis and the point, up to pi for a point behind.  With
    rho = |p - o|,

        dd/dq = R^T ([u]x J_w - (I - u u^T) J_v / rho).

    Attributes:
        target: The point p in the world [m], shape (3,), read-only.
        frame: Frame of the camera. The view axis is x, or z if the name ends in `_optical_frame` (ROS REP
            103).
        axis: The view axis in the frame, shape (3,), read-only.
        basis: Two directions across the axis in the frame, shape (2, 3), read-only.
    """

    target: Array
    frame: str
    axis: Array
    basis: Array
    unit: ClassVar[str] = "rad"

    def __init__(
        self,
        point: ArrayLike,
        camera: str = "CameraTop_frame",
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        name = f"gaze of {camera}"
        optical = str(camera).endswith("_optical_frame")
        axis = _AHEAD_OPTICAL if optical else _AHEAD
        super().__init__(
            name, weight=weight, tolerance=tolerance, hard=hard, frame=camera,
            target=read_only(as_targets(point, f"point of {name}", (3,))),
            axis=axis, basis=sideways_basis(axis),
        )  # fmt: skip

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return the remaining rotation [rad], shape (2,)."""
        pose = frame_pose(pepper, q, self.frame)
        direction, _ = unit_and_length(self.target - pose[:3, 3])
        return direction_residual(self.axis, self.basis, pose[:3, :3].T @ direction)[0]

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return dr/dd dd/dq, shape (2, n)."""
        pose, jacobian = frame_pose(pepper, q, self.frame), frame_jacobian(pepper, q, self.frame)
        rotation, (direction, distance) = pose[:3, :3], unit_and_length(self.target - pose[:3, 3])
        slope = direction_residual(self.axis, self.basis, rotation.T @ direction)[1]
        turning = cross_matrix(direction) @ jacobian[3:]
        moving = (jacobian[:3] - np.outer(direction, direction @ jacobian[:3])) / distance
        return slope @ rotation.T @ (turning - moving)

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the angle between view axis and point in words, at q, shape (n,) [rad or m]."""
        angle = words_for_angle(self.error(pepper, q))
        return f"{self.label} passes {angle} beside {words_for_vector(self.target)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the direction of the view axis in the world in words, at q, shape (n,) [rad or m]."""
        axis = frame_pose(pepper, q, self.frame)[:3, :3] @ self.axis
        return f"direction {words_for_vector(axis)}"

    def _structure(self) -> TaskStructure:
        return frame_structure(LookAt, self.frame, self.hard, axis=self.axis.tobytes())

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return the remaining rotation and dr/dd dd/dq."""
        pose, jacobian = motion.frames[task.frame]
        axis, turn = np.array(task.axis), pose[:, :3].T
        sight, distance = symbolic_angles.unit_and_length(target - pose[:, 3])
        residual, slope = symbolic_angles.direction_residual(axis, sideways_basis(axis), turn @ sight)
        ahead = slope @ turn
        across = (ahead - (ahead @ sight) @ sight.T) / distance
        turning = (ahead @ symbolic_angles.skew(sight)) @ jacobian[3:, :]
        return residual, turning - across @ jacobian[:3, :]
