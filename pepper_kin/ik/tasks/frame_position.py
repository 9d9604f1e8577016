"""Task that brings the origin of a frame to a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, frame_structure
from pepper_kin.ik.tasks.task import POSITION_TOLERANCE, PointTask, as_targets
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False, init=False, repr=False)
class FramePosition(PointTask):
    """The origin of a frame is at a point of the world: r(q) = o(q) - p, dr/dq = J_v, error |r| [m].

    Attributes:
        frame: Name of a frame, see `pepper.frame_names`.
        target: The point p in the world [m], shape (3,), read-only.
    """

    frame: str
    target: Array
    aspect: ClassVar[str] = "position"

    def __init__(
        self,
        frame: str,
        target: ArrayLike,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        label: str = "",
        *,
        hard: bool = False,
    ) -> None:
        name = label or str(frame)
        point = read_only(as_targets(target, f"target of {name}", (3,)))
        super().__init__(name, weight=weight, tolerance=tolerance, hard=hard, frame=frame, target=point)

    def place(self, pepper: PepperModel, q: Array) -> Array:
        """Return o(q) [m], shape (3,)."""
        return frame_pose(pepper, q, self.frame)[:3, 3]

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return J_v, shape (3, n)."""
        return frame_jacobian(pepper, q, self.frame)[:3]

    def _structure(self) -> TaskStructure:
        return frame_structure(FramePosition, self.frame, self.hard)

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return o(q) - p and J_v."""
        pose, jacobian = motion.frames[task.frame]
        return pose[:, 3] - target, jacobian[:3, :]
