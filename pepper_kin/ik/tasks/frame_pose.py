"""Bring a frame to a pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.frame_orientation import FrameOrientation
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE, POSITION_TOLERANCE, Array, Task, TaskGroup, as_targets
from pepper_kin.model.shapes import read_only


@dataclass(frozen=True, eq=False, init=False)
class FramePose(TaskGroup):
    """A frame has a given position and orientation; the result says which of the two was met.

    Attributes:
        frame: A name of `pepper.frame_names`.
        target: transform_frame_to_world, shape (4, 4), read-only.
        position: The position's task.
        orientation: The orientation's task.
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
    ) -> None:
        name = label or str(frame)
        pose = read_only(as_targets(target, f"target of {name}", (4, 4)))
        if np.abs(pose[..., 3, :] - (0.0, 0.0, 0.0, 1.0)).max(initial=0.0) > 1e-9:
            raise InvalidValueError(f"target of {name}", pose[..., 3, :].tolist(), "a last row of 0, 0, 0, 1")
        position = FramePosition(frame, pose[..., :3, 3], weight, tolerance, name)
        orientation = FrameOrientation(
            frame, pose[..., :3, :3], orientation_weight, orientation_tolerance, name
        )
        object.__setattr__(self, "frame", frame)
        object.__setattr__(self, "target", pose)
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "orientation", orientation)

    @property
    def parts(self) -> tuple[Task, ...]:
        """Position and orientation."""
        return (self.position, self.orientation)
