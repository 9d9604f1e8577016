"""Bring the origin of a frame to a point of another frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.frozen_arrays import read_only
from pepper_kin.ik.tasks.relative_motion import relative_jacobian, relative_pose
from pepper_kin.ik.tasks.task import (
    POSITION_TOLERANCE,
    Array,
    Task,
    as_targets,
    words_for_length,
    words_for_vector,
)
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False, init=False)
class RelativePosition(Task):
    """The origin of frame a is at a point p of frame b: r(q) = R_b^T (o_a - o_b) - p, error |r| [m].

    dr/dq = R_b^T (J_v,a - J_v,b + [o_a - o_b]x J_w,b), see `relative_jacobian`.

    Attributes:
        frame: a, a name of `pepper.frame_names`.
        reference: b, another one.
        target: The point p in the axes of b [m], shape (3,), read-only.
        weight: Weight in the sum of squares.
        tolerance: Largest distance of a task that is met [m].
        hard: Whether it is met even where soft tasks suffer from it.
        label: What is moved, in words; both frames' names if left empty.
    """

    frame: str
    reference: str
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
        self._fill(
            name, weight, tolerance, hard,
            frame=frame, reference=reference, label=name,
            target=read_only(as_targets(target, f"target of {name}", (3,))),
        )  # fmt: skip

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot without one of the frames."""
        pepper.frame_id(self.frame)
        pepper.frame_id(self.reference)

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return R_b^T (o_a - o_b) - p [m], shape (3,)."""
        return relative_pose(pepper, q, self.frame, self.reference)[1] - self.target

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return dr/dq in the axes of b, shape (3, n)."""
        return relative_jacobian(pepper, q, self.frame, self.reference)[:3]

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return how far from the point the frame stops, in words, at q, shape (n,) [rad or m]."""
        distance = words_for_length(self.error(pepper, q))
        return f"{self.label} stops {distance} short of {words_for_vector(self.target)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the frame's position in the reference in words, at q, shape (n,) [rad or m]."""
        return f"point {words_for_vector(relative_pose(pepper, q, self.frame, self.reference)[1])}"


def words_for_pair(frame: str, reference: str) -> str:
    """Return "a seen from b".

    Raises:
        InvalidValueError: where both are the same.
    """
    if frame == reference:
        raise InvalidValueError("frame and reference", f"{frame!r} twice", "two different frames")
    return f"{frame} seen from {reference}"
