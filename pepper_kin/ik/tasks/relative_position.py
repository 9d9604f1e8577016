"""Task that brings the origin of a frame to a point of another frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.ik.tasks.relative_motion import RelativeTask, relative_jacobian, relative_pose, words_for_pair
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, frame_structure
from pepper_kin.ik.tasks.symbolic_angles import skew
from pepper_kin.ik.tasks.task import POSITION_TOLERANCE, PointTask, as_targets
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False, init=False, repr=False)
class RelativePosition(RelativeTask, PointTask):
    """The origin of frame a is at a point p of frame b: r(q) = R_b^T (o_a - o_b) - p, error |r| [m].

    dr/dq = R_b^T (J_v,a - J_v,b + [o_a - o_b]x J_w,b), see `relative_jacobian`.

    Attributes:
        frame: Name of frame a, see `pepper.frame_names`.
        reference: Name of another frame b.
        target: The point p in the axes of b [m], shape (3,), read-only.
    """

    frame: str
    reference: str
    target: Array
    aspect: ClassVar[str] = "position"

    def __init__(
        self,
        frame: str,
        reference: str,
        target: ArrayLike,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        label: str = "",
        *,
        hard: bool = False,
    ) -> None:
        pair = words_for_pair(frame, reference)
        name = label or pair
        point = read_only(as_targets(target, f"target of {name}", (3,)))
        super().__init__(
            name, weight=weight, tolerance=tolerance, hard=hard,
            frame=frame, reference=reference, target=point,
        )  # fmt: skip

    def place(self, pepper: PepperModel, q: Array) -> Array:
        """Return R_b^T (o_a - o_b) [m], shape (3,)."""
        return relative_pose(pepper, q, self.frame, self.reference)[1]

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return dr/dq in the axes of b, shape (3, n)."""
        return relative_jacobian(pepper, q, self.frame, self.reference)[:3]

    def _structure(self) -> TaskStructure:
        return frame_structure(RelativePosition, self.frame, self.hard, reference=self.reference)

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return R_b^T (o_a - o_b) - p and its derivative."""
        pose, jacobian = motion.frames[task.frame]
        relative_to, other = motion.frames[task.reference]
        turn, line = relative_to[:, :3].T, pose[:, 3] - relative_to[:, 3]
        change = turn @ (jacobian[:3, :] - other[:3, :] + skew(line) @ other[3:, :])
        return turn @ line - target, motion.without(change, RelativeTask.moved_by(motion.pepper, task))
