"""Bring the origin of a frame to a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from numpy.typing import ArrayLike

from pepper_kin.frozen_arrays import read_only
from pepper_kin.ik.tasks.task import (
    POSITION_TOLERANCE,
    Array,
    Task,
    as_targets,
    words_for_length,
    words_for_vector,
)
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False, init=False)
class FramePosition(Task):
    """The origin of a frame is at a point of the world: r(q) = o(q) - p, dr/dq = J_v, error |r| [m].

    Attributes:
        frame: A name of `pepper.frame_names`.
        target: The point p in the world [m], shape (3,), read-only.
        weight: Weight in the sum of squares.
        tolerance: Largest distance of a task that is met [m].
        hard: Whether it is met even where soft tasks suffer from it.
        label: What is moved, in words; the frame's name if left empty.
    """

    frame: str
    target: Array
    weight: float
    tolerance: float
    hard: bool
    label: str
    unit: ClassVar[str] = "m"
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
        self._fill(
            name, weight, tolerance, hard,
            frame=frame, label=name,
            target=read_only(as_targets(target, f"target of {name}", (3,))),
        )  # fmt: skip

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return o(q) - p [m], shape (3,)."""
        return frame_pose(pepper, q, self.frame)[:3, 3] - self.target

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return J_v, shape (3, n)."""
        return frame_jacobian(pepper, q, self.frame)[:3]

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return how far from the point the frame stops, in words, at q, shape (n,) [rad or m]."""
        distance = words_for_length(self.error(pepper, q))
        return f"{self.label} stops {distance} short of {words_for_vector(self.target)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the position of the frame in the world in words, at q, shape (n,) [rad or m]."""
        return f"point {words_for_vector(frame_pose(pepper, q, self.frame)[:3, 3])}"
