"""Targets that can be dragged: the hands and the gaze."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.ik import HandPosition, LookAt
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel
from pepper_kin.viewer.drawable import Color

GAZE_DISTANCE = 0.5
"""Distance of the gaze target from the camera while it is not set [m]."""
GAZE_WEIGHT = 0.3
"""Weight of the gaze: an unreachable gaze must not pull the robot away from the hands' targets."""

CAMERA = "CameraTop_frame"
_HANDS = {"left hand": "left", "right hand": "right"}
_FRAMES = {"left hand": "LArm_effector", "right hand": "RArm_effector", "gaze": CAMERA}
COLORS: dict[str, Color] = {
    "left hand": (0.93, 0.36, 0.20, 1.0),
    "right hand": (0.55, 0.27, 0.80, 1.0),
    "gaze": (0.12, 0.44, 0.92, 1.0),
}
RADIUS = 0.03


@dataclass
class SharedTarget:
    """A target.

    Attributes:
        position: Position in the world [m], shape (3,).
        on: Whether the robot should reach it; otherwise it moves with the hand or gaze.
    """

    position: NDArray[np.float64]
    on: bool = False


class SharedTargets:
    """The targets that a robot can have, by name: "left hand", "right hand" and "gaze".

    Args:
        pepper: Model of the robot; without hands or camera it has fewer targets.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self._pepper = pepper
        frames = set(pepper.frame_names)
        self._targets = {
            name: SharedTarget(np.zeros(3)) for name, frame in _FRAMES.items() if frame in frames
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all targets."""
        return tuple(self._targets)

    @property
    def any_on(self) -> bool:
        """Whether the robot should reach any target."""
        return any(target.on for target in self._targets.values())

    def __getitem__(self, name: str) -> SharedTarget:
        if name not in self._targets:
            raise UnknownNameError("target", name, self.names)
        return self._targets[name]

    def release(self) -> None:
        """Release all targets."""
        for target in self._targets.values():
            target.on = False

    def keep_with(self, q: NDArray[np.float64]) -> None:
        """Move the targets that are not set to hands and gaze at q, shape (n,) [rad or m]."""
        free = [name for name, target in self._targets.items() if not target.on]
        poses = frame_poses(self._pepper, q, [_FRAMES[name] for name in free])
        for name, pose in zip(free, poses, strict=True):
            ahead = GAZE_DISTANCE * pose[:3, 0] if name == "gaze" else 0.0
            self._targets[name].position = pose[:3, 3] + ahead

    def tasks(self) -> list[Task]:
        """Return the tasks of the set targets."""
        return [_task(name, target) for name, target in self._targets.items() if target.on]

    def positions(self) -> NDArray[np.float64]:
        """Return all positions, shape (k, 3) [m]."""
        return np.array([target.position for target in self._targets.values()]).reshape(-1, 3)

    def as_dict(self) -> dict[str, dict[str, object]]:
        """Return the targets as values for JSON."""
        return {
            name: {"position": np.round(target.position, 4).tolist(), "on": target.on}
            for name, target in self._targets.items()
        }


def _task(name: str, target: SharedTarget) -> Task:
    if name in _HANDS:
        return HandPosition(_HANDS[name], target.position)
    return LookAt(target.position, camera=CAMERA, weight=GAZE_WEIGHT)
