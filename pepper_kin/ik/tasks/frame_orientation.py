"""Turn a frame into an orientation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.frozen_arrays import read_only
from pepper_kin.ik.tasks.task import (
    ANGLE_TOLERANCE,
    Array,
    Task,
    as_targets,
    words_for_angle,
    words_for_turn,
)
from pepper_kin.kinematics import frame_jacobian, frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.poses import check_rotations


@dataclass(frozen=True, eq=False, init=False)
class FrameOrientation(Task):
    """A frame has a given orientation: r(q) = log(R R_t^T), the rotation vector from target to frame.

    It is stated in world axes; |r| is the angle between the two orientations.  With R' = [w]x R,

        dr/dq = L(r)^-1 J_w,

    where L is the left Jacobian of SO(3) (Sola, Deray, Atchuthan, A micro Lie theory for state estimation in
    robotics, 2018, eq. 146).

    Attributes:
        frame: A name of `pepper.frame_names`.
        target: R_t, the rotation matrix from frame to world, shape (3, 3), read-only.
        weight: Weight in the sum of squares.
        tolerance: Largest angle of a task that is met [rad].
        hard: Whether it is met even where soft tasks suffer from it.
        yields: Whether the task before it in a list is preferred where not both can be met.
        label: What is turned, in words; the frame's name if left empty.
    """

    frame: str
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
        target: ArrayLike,
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        label: str = "",
        *,
        hard: bool = False,
        yields: bool = False,
    ) -> None:
        name = label or str(frame)
        self._fill(
            name, weight, tolerance, hard,
            frame=frame, label=name,
            target=checked_rotation(target, f"orientation of {name}"),
            yields=yields,
        )  # fmt: skip

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return log(R R_t^T) [rad], shape (3,)."""
        import pinocchio

        return np.array(pinocchio.log3(self._turn(pepper, q)))

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return L(r)^-1 J_w, shape (3, n)."""
        import pinocchio

        # Pinocchio gives the inverse of the right Jacobian, which is the transpose of the left one's.
        inverse = np.array(pinocchio.Jlog3(self._turn(pepper, q))).T
        return inverse @ frame_jacobian(pepper, q, self.frame)[3:]

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return how far the frame is turned away, in words, at joint positions q, shape (n,) [rad or m]."""
        return f"{self.label} is turned {words_for_angle(self.error(pepper, q))} away from its orientation"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the remaining rotation to the target in words, at q, shape (n,) [rad or m]."""
        return f"an orientation {words_for_turn(-self.residual(pepper, q))} from its target"

    def _turn(self, pepper: PepperModel, q: Array) -> Array:
        """Return R R_t^T, shape (3, 3), at joint positions q, shape (n,) [rad or m]."""
        return frame_pose(pepper, q, self.frame)[:3, :3] @ self.target.T


def checked_rotation(matrix: ArrayLike, quantity: str) -> Array:
    """Return a rotation matrix, shape (3, 3), or N of them, shape (N, 3, 3), as a read-only copy.

    Raises:
        InvalidValueError: where it is not orthonormal and right-handed to 1e-6.
    """
    return read_only(check_rotations(as_targets(matrix, quantity, (3, 3)), quantity))
