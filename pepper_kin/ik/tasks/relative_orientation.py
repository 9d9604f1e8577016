"""Turn a frame into an orientation relative to another frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.ik.tasks.frame_orientation import checked_rotation
from pepper_kin.ik.tasks.relative_motion import relative_jacobian, relative_pose
from pepper_kin.ik.tasks.relative_position import words_for_pair
from pepper_kin.ik.tasks.task import (
    ANGLE_TOLERANCE,
    Array,
    Task,
    words_for_angle,
    words_for_turn,
)
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False, init=False)
class RelativeOrientation(Task):
    """Frame a has an orientation R_t as seen from frame b: r(q) = log(R_b^T R_a R_t^T), in the axes of b.

    |r| is the angle between the two orientations, dr/dq = L(r)^-1 R_b^T (J_w,a - J_w,b), with L the left
    Jacobian of SO(3), as in `FrameOrientation`.

    Attributes:
        frame: a, a name of `pepper.frame_names`.
        reference: b, another one.
        target: R_t, the rotation matrix from a to b, shape (3, 3), read-only.
        weight: Weight in the sum of squares.
        tolerance: Largest angle of a task that is met [rad].
        hard: Whether it is met even where soft tasks suffer from it.
        yields: Whether the task before it in a list is preferred where not both can be met.
        label: What is turned, in words; both frames' names if left empty.
    """

    frame: str
    reference: str
    target: Array
    weight: float
    tolerance: float
    hard: bool
    yields: bool
    label: str
    unit: ClassVar[str] = "rad"
    aspect: ClassVar[str] = "orientation"
    target_axes: ClassVar[int] = 2

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
        self._fill(
            name, weight, tolerance, hard,
            frame=frame, reference=reference, label=name,
            target=checked_rotation(target, f"orientation of {name}"),
            yields=yields,
        )  # fmt: skip

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot without one of the frames."""
        pepper.frame_id(self.frame)
        pepper.frame_id(self.reference)

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return log(R_b^T R_a R_t^T) [rad], shape (3,)."""
        import pinocchio

        return np.array(pinocchio.log3(self._turn(pepper, q)))

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return L(r)^-1 R_b^T (J_w,a - J_w,b), shape (3, n)."""
        import pinocchio

        # Pinocchio gives the inverse of the right Jacobian, which is the transpose of the left one's.
        inverse = np.array(pinocchio.Jlog3(self._turn(pepper, q))).T
        return inverse @ relative_jacobian(pepper, q, self.frame, self.reference)[3:]

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return how far the frame is turned away, in words, at joint positions q, shape (n,) [rad or m]."""
        return f"{self.label} is turned {words_for_angle(self.error(pepper, q))} away from its orientation"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the remaining rotation to the target, in the axes of the reference, in words.

        The joint positions are q, shape (n,) [rad or m].
        """
        turn = words_for_turn(-self.residual(pepper, q), f"the axes of {self.reference}")
        return f"an orientation {turn} from its target"

    def _turn(self, pepper: PepperModel, q: Array) -> Array:
        """Return R_b^T R_a R_t^T, shape (3, 3), at joint positions q, shape (n,) [rad or m]."""
        return relative_pose(pepper, q, self.frame, self.reference)[0] @ self.target.T
