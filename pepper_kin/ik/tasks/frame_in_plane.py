"""Origin of a frame in a plane, as a task: at a height, over an edge, along a wall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
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
from pepper_kin.model.joint_vectors import as_finite


@dataclass(frozen=True, eq=False, init=False)
class FrameInPlane(Task):
    """The origin o of a frame lies in a plane: r(q) = n . (o(q) - p), dr/dq = n^T J_v, error |r| [m].

    "fast" compiles the normal in: a first solution with another normal takes some tenths of a second more.

    Attributes:
        frame: A name of `pepper.frame_names`.
        target: A point p of the plane, in the world [m], shape (3,) or (N, 3) for `solve_batch`, read-only.
        normal: n, unit vector in the world, shape (3,), read-only; upwards if not given: a height.
        weight: Weight in the sum of squares.
        tolerance: Largest distance of a task that is met [m].
        hard: Whether it is met even where soft tasks suffer from it.
        label: What is kept there, in words; the frame's name if left empty.
    """

    frame: str
    target: Array
    normal: Array
    weight: float
    tolerance: float
    hard: bool
    label: str
    unit: ClassVar[str] = "m"
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
        across = as_finite(normal, f"normal of {name}", (3,))
        length = float(np.linalg.norm(across))
        if length < 1e-9:
            raise InvalidValueError(f"normal of {name}", across, "a vector that is not zero")
        self._fill(
            name, weight, tolerance, hard,
            frame=frame, label=name,
            target=read_only(as_targets(target, f"target of {name}", (3,))),
            normal=read_only(across / length),
        )  # fmt: skip

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return n . (o(q) - p) [m], shape (1,)."""
        return np.array([self.normal @ (frame_pose(pepper, q, self.frame)[:3, 3] - self.target)])

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return n^T J_v, shape (1, n)."""
        return self.normal[None] @ frame_jacobian(pepper, q, self.frame)[:3]

    def size(self, residual: Array) -> float:
        """Return the distance from the plane [m] of a residual, shape (1,)."""
        return float(abs(residual[0]))

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return how far the frame is from the plane, in words, at q, shape (n,) [rad or m]."""
        distance = words_for_length(self.error(pepper, q))
        return f"{self.label} is {distance} off the plane through {words_for_vector(self.target)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the position of the frame in the world in words, at q, shape (n,) [rad or m]."""
        return f"point {words_for_vector(frame_pose(pepper, q, self.frame)[:3, 3])}"
