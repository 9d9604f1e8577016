"""Tasks that bring a frame to a pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.frame_orientation import FrameOrientation
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE, POSITION_TOLERANCE, Task, TaskGroup, as_targets


@dataclass(frozen=True, eq=False, init=False)
class FramePose(TaskGroup):
    """A frame has a given position and orientation; the result says which of the two was met.

    If not both can be met, as with an arm of five joints, the position has priority, and the orientation
    comes as near as it then can.

    Args:
        frame: Name of a frame, see `pepper.frame_names`.
        target: transform_frame_to_world, shape (4, 4).
        weight: Weight of the position.
        tolerance: Maximum error of a position that is met [m].
        orientation_weight: Weight of the orientation.
        orientation_tolerance: Maximum error of an orientation that is met [rad].
        label: Name of the moved part in words; the frame's name if empty.
        hard: Whether the position has priority over soft tasks.
        orientation_hard: Whether the orientation has priority over soft tasks; `hard` if None.
        position_first: Whether the position has priority over the orientation; otherwise the weights decide.

    Attributes:
        frame: Name of the frame.
        target: transform_frame_to_world, shape (4, 4), read-only.
        position: Task of the position.
        orientation: Task of the orientation.
    """

    frame: str
    target: Array
    position: FramePosition
    orientation: FrameOrientation

    def __init__(
        self,
        frame: str,
        target: ArrayLike,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        orientation_weight: float = 1.0,
        orientation_tolerance: float = ANGLE_TOLERANCE,
        label: str = "",
        *,
        hard: bool = False,
        orientation_hard: bool | None = None,
        position_first: bool = True,
    ) -> None:
        name = label or str(frame)
        pose = checked_pose(target, f"target of {name}")
        position = FramePosition(frame, pose[..., :3, 3], weight, tolerance, name, hard=hard)
        orientation = FrameOrientation(
            frame, pose[..., :3, :3], orientation_weight, orientation_tolerance, name,
            hard=hard if orientation_hard is None else orientation_hard, yields=position_first,
        )  # fmt: skip
        vars(self).update(frame=frame, target=pose, position=position, orientation=orientation)

    @property
    def parts(self) -> tuple[Task, ...]:
        """Position and orientation."""
        return (self.position, self.orientation)


def checked_pose(target: ArrayLike, quantity: str) -> Array:
    """Return a pose, shape (4, 4), or N poses, shape (N, 4, 4), as a read-only copy.

    Raises:
        InvalidValueError: for another shape, NaN, infinity, or another last row than 0, 0, 0, 1.
    """
    pose = read_only(as_targets(target, quantity, (4, 4)))
    if np.abs(pose[..., 3, :] - (0.0, 0.0, 0.0, 1.0)).max(initial=0.0) > 1e-9:
        raise InvalidValueError(quantity, pose[..., 3, :].tolist(), "a last row of 0, 0, 0, 1")
    return pose
