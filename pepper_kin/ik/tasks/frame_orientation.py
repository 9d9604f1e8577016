"""Task that brings a frame to an orientation."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, frame_structure
from pepper_kin.ik.tasks.symbolic_angles import rotation_residual
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE, TargetTask, as_targets, words_for_angle, words_for_turn
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.poses import check_rotations


class OrientationTask(TargetTask):
    """A rotation R equals R_t: r(q) = log(R R_t^T), the rotation vector from target to frame.

    |r| is the angle between the two orientations.  With R' = [w]x R and w = J_w q',

        dr/dq = L(r)^-1 J_w,

    where L is the left Jacobian of SO(3) (Sola, Deray, Atchuthan, A micro Lie theory for state estimation in
    robotics, 2018, eq. 146).
    """

    target: Array
    unit: ClassVar[str] = "rad"
    aspect: ClassVar[str] = "orientation"
    target_axes: ClassVar[int] = 2

    @abstractmethod
    def rotation(self, pepper: PepperModel, q: Array) -> Array:
        """Return R, shape (3, 3), at joint positions q, shape (n,) [rad or m]."""

    @abstractmethod
    def angular_jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return J_w, shape (3, n), at joint positions q, shape (n,) [rad or m]."""

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return log(R R_t^T) [rad], shape (3,)."""
        import pinocchio

        return np.array(pinocchio.log3(self.rotation(pepper, q) @ self.target.T))

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return L(r)^-1 J_w, shape (3, n)."""
        import pinocchio

        # Pinocchio gives the inverse of the right Jacobian, the transpose of the left Jacobian's inverse.
        inverse = np.array(pinocchio.Jlog3(self.rotation(pepper, q) @ self.target.T)).T
        return inverse @ self.angular_jacobian(pepper, q)

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the angle to the target in words, at joint positions q, shape (n,) [rad or m]."""
        return f"{self.label} is turned {words_for_angle(self.error(pepper, q))} away from its orientation"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the remaining rotation to the target in words, at q, shape (n,) [rad or m]."""
        turn = words_for_turn(-self.residual(pepper, q), self._axes())
        return f"an orientation {turn} from its target"

    def _axes(self) -> str:
        """Return the axes of the residual in words."""
        return "the world's axes"


@dataclass(frozen=True, eq=False, init=False, repr=False)
class FrameOrientation(OrientationTask):
    """A frame has a given orientation: r(q) = log(R R_t^T), in the axes of the world.

    |r| is the angle between the two orientations; see `OrientationTask` for dr/dq.

    Attributes:
        frame: Name of a frame, see `pepper.frame_names`.
        target: R_t, the rotation matrix from frame to world, shape (3, 3), read-only.
        yields: Whether the task before this one in a list has priority.
    """

    frame: str
    target: Array
    yields: bool

    def __init__(
        self,
        frame: str,
        target: ArrayLike,
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        label: str = "",
        *,
        hard: bool = False,
        yields: bool = False,
    ) -> None:
        name = label or str(frame)
        turned = checked_rotation(target, f"orientation of {name}")
        super().__init__(
            name, weight=weight, tolerance=tolerance, hard=hard, frame=frame, target=turned, yields=yields
        )

    def rotation(self, pepper: PepperModel, q: Array) -> Array:
        """Return R of the frame, shape (3, 3)."""
        return frame_pose(pepper, q, self.frame)[:3, :3]

    def angular_jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return J_w of the frame, shape (3, n)."""
        return frame_jacobian(pepper, q, self.frame)[3:]

    def _structure(self) -> TaskStructure:
        return frame_structure(FrameOrientation, self.frame, self.hard, 9)

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return log(R R_t^T) and L(r)^-1 J_w."""
        import casadi

        pose, jacobian = motion.frames[task.frame]
        wanted = casadi.reshape(target, 3, 3)  # row-major numbers: this is R_t^T
        residual, inverse = rotation_residual(pose[:, :3] @ wanted)
        return residual, inverse @ jacobian[3:, :]


def checked_rotation(matrix: ArrayLike, quantity: str) -> Array:
    """Return a rotation matrix, shape (3, 3), or N matrices, shape (N, 3, 3), as a read-only copy.

    Raises:
        InvalidValueError: for a matrix that is not orthonormal and right-handed to 1e-6.
    """
    return read_only(check_rotations(as_targets(matrix, quantity, (3, 3)), quantity))
