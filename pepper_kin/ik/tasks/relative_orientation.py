"""Task that brings a frame to an orientation relative to another frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.ik.tasks.frame_orientation import OrientationTask, checked_rotation
from pepper_kin.ik.tasks.relative_motion import RelativeTask, relative_jacobian, relative_pose, words_for_pair
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, frame_structure
from pepper_kin.ik.tasks.symbolic_angles import rotation_residual
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False, init=False, repr=False)
class RelativeOrientation(RelativeTask, OrientationTask):
    """Frame a has an orientation R_t relative to frame b: r(q) = log(R_b^T R_a R_t^T), in the axes of b.

    |r| is the angle between the two orientations, dr/dq = L(r)^-1 R_b^T (J_w,a - J_w,b), with L the left
    Jacobian of SO(3), as in `OrientationTask`.

    Attributes:
        frame: Name of frame a, see `pepper.frame_names`.
        reference: Name of another frame b.
        target: R_t, the rotation matrix from a to b, shape (3, 3), read-only.
        yields: Whether the task before this one in a list has priority.
    """

    frame: str
    reference: str
    target: Array
    yields: bool

    def __init__(
        self,
        frame: str,
        reference: str,
        target: ArrayLike,
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        label: str = "",
        *,
        hard: bool = False,
        yields: bool = False,
    ) -> None:
        pair = words_for_pair(frame, reference)
        name = label or pair
        turned = checked_rotation(target, f"orientation of {name}")
        super().__init__(
            name, weight=weight, tolerance=tolerance, hard=hard,
            frame=frame, reference=reference, target=turned, yields=yields,
        )  # fmt: skip

    def rotation(self, pepper: PepperModel, q: Array) -> Array:
        """Return R_b^T R_a, shape (3, 3)."""
        return relative_pose(pepper, q, self.frame, self.reference)[0]

    def angular_jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return R_b^T (J_w,a - J_w,b), shape (3, n)."""
        return relative_jacobian(pepper, q, self.frame, self.reference)[3:]

    def _axes(self) -> str:
        return f"the axes of {self.reference}"

    def _structure(self) -> TaskStructure:
        return frame_structure(RelativeOrientation, self.frame, self.hard, 9, reference=self.reference)

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return log(R_b^T R_a R_t^T) and its derivative."""
        import casadi

        pose, jacobian = motion.frames[task.frame]
        relative_to, other = motion.frames[task.reference]
        turn = relative_to[:, :3].T
        residual, inverse = rotation_residual(turn @ pose[:, :3] @ casadi.reshape(target, 3, 3))
        change = (inverse @ turn) @ (jacobian[3:, :] - other[3:, :])
        return residual, motion.without(change, RelativeTask.moved_by(motion.pepper, task))
