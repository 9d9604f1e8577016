"""What a sensor says, and what it was said about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import Scene
from pepper_kin.kinematics import frame_pose, frame_poses
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False)
class Reading:
    """One sample of one sensor; arrays are read-only.

    Attributes:
        time: Of the state that was measured [s].
        value: What the sensor says.
        truth: What an ideal sensor would have said, of the same shape.
        unit: Unit of both.
        frame: The frame that they are expressed in or seen from; empty for values per joint.
    """

    time: float
    value: NDArray[Any]
    truth: NDArray[Any]
    unit: str
    frame: str

    def __post_init__(self) -> None:
        for name in ("value", "truth"):
            copy = np.array(getattr(self, name))
            copy.setflags(write=False)
            object.__setattr__(self, name, copy)

    @property
    def error(self) -> NDArray[np.float64]:
        """Value minus truth; 0 where both are the same infinity."""
        value, truth = self.value.astype(float), self.truth.astype(float)
        with np.errstate(invalid="ignore"):
            return np.where(value == truth, 0.0, value - truth)


@dataclass(frozen=True, eq=False)
class SensedState:
    """The state of robot and world that sensors look at.

    Attributes:
        pepper: The robot.
        time: [s].
        q: Joint positions [rad or m], shape (n,).
        v: Joint velocities [rad/s or m/s], shape (n,).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (n,).
        torque: Of the servos [N m or N], shape (n,).
        scene: The world around the robot.
        contacts: Where the robot is touched; see `SensorSuite.read`.
        frames: Frames whose poses will be asked for, which are found all at once.
    """

    pepper: PepperModel
    time: float
    q: NDArray[np.float64]
    v: NDArray[np.float64]
    a: NDArray[np.float64]
    torque: NDArray[np.float64]
    scene: Scene
    contacts: Sequence[Any]
    frames: Sequence[str] = ()

    def pose(self, frame: str) -> NDArray[np.float64]:
        """Return transform_frame_to_world of a frame, shape (4, 4)."""
        found = self._poses.get(frame)
        return frame_pose(self.pepper, self.q, frame) if found is None else found

    @cached_property
    def _poses(self) -> dict[str, NDArray[np.float64]]:
        return dict(zip(self.frames, frame_poses(self.pepper, self.q, self.frames), strict=True))

    @cached_property
    def touches(self) -> list[tuple[str | None, NDArray[np.float64]]]:
        """Links and objects that are touched, each with the point."""
        return [touch for contact in self.contacts for touch in touched(contact)]


def touched(contact: Any) -> list[tuple[str | None, NDArray[np.float64]]]:
    """Return what a contact touches, and where: two links or objects with their points.

    Args:
        contact: With `links` and `points`, as `pepper_kin.collision.Contact` has (points may be None, where
            it is not known where), or with `names`, one `point` and a `force`, as a twin's world has.
    """
    if hasattr(contact, "links"):
        return [] if contact.points is None else list(zip(contact.links, contact.points, strict=True))
    if not np.any(contact.force):
        return []
    return [(name, contact.point) for name in contact.names]
