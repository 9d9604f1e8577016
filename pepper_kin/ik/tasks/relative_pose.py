"""Tasks that bring a frame to a pose relative to another frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.frame_pose import checked_pose
from pepper_kin.ik.tasks.relative_motion import relative_pose, words_for_pair
from pepper_kin.ik.tasks.relative_orientation import RelativeOrientation
from pepper_kin.ik.tasks.relative_position import RelativePosition
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE, POSITION_TOLERANCE, Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite


@dataclass(frozen=True, eq=False, init=False)
class RelativePose(TaskGroup):
    """A frame has a given pose relative to another, such as two palms that hold one box.

    The result says which of position and orientation was met; either may be left out. If not both can be met,
    the position has priority.

    Args:
        frame: Name of a frame, see `pepper.frame_names`.
        reference: Name of the reference frame.
        target: transform_frame_to_reference, shape (4, 4).
        weight: Weight of the position.
        tolerance: Maximum error of a position that is met [m].
        orientation_weight: Weight of the orientation.
        orientation_tolerance: Maximum error of an orientation that is met [rad].
        label: Name of the moved part in words; both frames' names if empty.
        without: "position" or "orientation" to leave a part out; None for both parts.
        hard: Whether the position has priority over soft tasks.
        orientation_hard: Whether the orientation has priority over soft tasks; `hard` if None.
        position_first: Whether the position has priority over the orientation.

    Attributes:
        frame: Name of the frame.
        reference: Name of the reference frame.
        target: transform_frame_to_reference, shape (4, 4), read-only.
        position: Task of the position, None if left out.
        orientation: Task of the orientation, None if left out.

    Raises:
        InvalidValueError: for a target that is not a pose, the same frame twice, or an unknown part to leave
            out.
    """

    frame: str
    reference: str
    target: Array
    position: RelativePosition | None
    orientation: RelativeOrientation | None

    def __init__(
        self,
        frame: str,
        reference: str,
        target: ArrayLike,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        orientation_weight: float = 1.0,
        orientation_tolerance: float = ANGLE_TOLERANCE,
        *,
        label: str = "",
        without: str | None = None,
        hard: bool = False,
        orientation_hard: bool | None = None,
        position_first: bool = True,
    ) -> None:
        pair = words_for_pair(frame, reference)
        name = label or pair
        if without not in (None, "position", "orientation"):
            raise InvalidValueError("without", repr(without), "'position', 'orientation' or None")
        pose = checked_pose(target, f"target of {name}")
        position = RelativePosition(frame, reference, pose[..., :3, 3], weight, tolerance, name, hard=hard)
        orientation = RelativeOrientation(
            frame, reference, pose[..., :3, :3], orientation_weight, orientation_tolerance, name,
            hard=hard if orientation_hard is None else orientation_hard,
            yields=position_first and without is None,
        )  # fmt: skip
        vars(self).update(
            frame=frame, reference=reference, target=pose,
            position=None if without == "position" else position,
            orientation=None if without == "orientation" else orientation,
        )  # fmt: skip

    @classmethod
    def as_at(cls, pepper: PepperModel, q: ArrayLike, frame: str, reference: str, **options: Any) -> Self:
        """Return the task that keeps the relative pose of a configuration.

        Args:
            pepper: The robot.
            q: Joint positions [rad or m], shape (n,).
            frame: Name of a frame, see `pepper.frame_names`.
            reference: Name of the reference frame.
            options: Further arguments of the constructor, such as `tolerance` and `hard`.

        Raises:
            UnknownNameError: for a frame that the robot lacks.
            InvalidValueError: for a wrong length of q, NaN or infinity.
        """
        target = np.eye(4)
        state = as_finite(q, "q", (pepper.n,))
        target[:3, :3], target[:3, 3] = relative_pose(pepper, state, frame, reference)
        return cls(frame, reference, target, **options)

    @property
    def parts(self) -> tuple[Task, ...]:
        """Tasks of position and orientation, without a part that is left out."""
        return tuple(part for part in (self.position, self.orientation) if part is not None)
