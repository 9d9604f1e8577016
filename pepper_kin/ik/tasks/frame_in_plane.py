"""Task that keeps the origin of a frame in a plane, such as at a height, over an edge or along a wall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.ik.tasks.direction import unit_vector
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables, frame_structure
from pepper_kin.ik.tasks.task import (
    POSITION_TOLERANCE,
    PointTask,
    as_targets,
    words_for_length,
    words_for_vector,
)
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False, init=False, repr=False)
class FrameInPlane(PointTask):
    """The origin o of a frame lies in a plane: r(q) = n . (o(q) - p), dr/dq = n^T J_v, error |r| [m].

    "fast" compiles the normal into the code: the first solution with another normal takes some tenths of a
    second more.

    Attributes:
        frame: Name of a frame, see `pepper.frame_names`.
        target: Point p of the plane in the world [m], shape (3,) or (N, 3) for `solve_batch`, read-only.
        normal: n, unit vector in the world, shape (3,), read-only; upward by default, for a height.
    """

    frame: str
    target: Array
    normal: Array
    aspect: ClassVar[str] = "plane"

    def __init__(
        self,
        frame: str,
        target: ArrayLike,
        normal: ArrayLike = (0.0, 0.0, 1.0),
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        label: str = "",
        *,
        hard: bool = False,
    ) -> None:
        name = label or str(frame)
        across = unit_vector(normal, f"normal of {name}")
        point = read_only(as_targets(target, f"target of {name}", (3,)))
        super().__init__(
            name, weight=weight, tolerance=tolerance, hard=hard, frame=frame, target=point, normal=across
        )

    def place(self, pepper: PepperModel, q: Array) -> Array:
        """Return o(q) [m], shape (3,)."""
        return frame_pose(pepper, q, self.frame)[:3, 3]

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return n . (o(q) - p) [m], shape (1,)."""
        return np.array([self.normal @ (self.place(pepper, q) - self.target)])

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return n^T J_v, shape (1, n)."""
        return self.normal[None] @ frame_jacobian(pepper, q, self.frame)[:3]

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the frame's distance from the plane in words, at q, shape (n,) [rad or m]."""
        distance = words_for_length(self.error(pepper, q))
        return f"{self.label} is {distance} off the plane through {words_for_vector(self.target)}"

    def _structure(self) -> TaskStructure:
        return frame_structure(FrameInPlane, self.frame, self.hard, axis=self.normal.tobytes())

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return n . (o(q) - p) and n^T J_v."""
        pose, jacobian = motion.frames[task.frame]
        normal = np.array([task.axis])
        return normal @ (pose[:, 3] - target), normal @ jacobian[:3, :]
