"""Sensor readings and their truth."""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import FrozenArrays, read_only
from pepper_kin.collision import Scene
from pepper_kin.kinematics import frame_poses
from pepper_kin.model import PepperModel


@dataclass(frozen=True, eq=False)
class Reading(FrozenArrays):
    """One sample of one sensor; arrays are read-only.

    Attributes:
        time: Time of the measured state [s].
        value: Reading of the sensor.
        truth: Reading of an ideal sensor, of the value's shape.
        unit: Unit of value and truth.
        frame: Frame that the values are expressed in or measured from; empty for values per joint.
    """

    time: float
    value: NDArray[Any]
    truth: NDArray[Any]
    unit: str
    frame: str

    def __post_init__(self) -> None:
        for name in ("value", "truth"):
            value = np.asarray(getattr(self, name))
            object.__setattr__(self, name, read_only(value, value.dtype))

    @property
    def error(self) -> NDArray[np.float64]:
        """Value minus truth; 0 if both are the same infinity."""
        value, truth = self.value.astype(float), self.truth.astype(float)
        with np.errstate(invalid="ignore"):
            return np.where(value == truth, 0.0, value - truth)


class Surroundings(Protocol):
    """A moving world: its present scene and contacts."""

    @property
    def contacts(self) -> Sequence[Any]:
        """Present contacts; see `SensorSuite.read`."""

    def snapshot(self) -> Scene:
        """Return the present scene."""


class StillWorld(NamedTuple):
    """A world at one time."""

    scene: Scene
    contacts: Sequence[Any]

    def snapshot(self) -> Scene:
        """Return the scene."""
        return self.scene


class SensedState:
    """State of robot and world for sensors; quantities are computed at their first use.

    Args:
        pepper: The robot.
        time: Time [s].
        vectors: Joint positions [rad or m], velocities, accelerations, and torques of the servos [N m or N],
            shape (n,) each.
        world: Present world around the robot.
        frames: Names of frames whose poses will be needed, which are computed together.
    """

    def __init__(
        self,
        pepper: PepperModel,
        time: float,
        vectors: Iterable[NDArray[np.float64]],
        world: Surroundings,
        frames: Sequence[str],
    ) -> None:
        self.pepper, self.time = pepper, time
        self.q, self.v, self.a, self.torque = vectors
        self._world, self._frames = world, frames

    def pose(self, frame: str) -> NDArray[np.float64]:
        """Return transform_frame_to_world of a frame, shape (4, 4)."""
        return self._poses[frame]

    @cached_property
    def _poses(self) -> dict[str, NDArray[np.float64]]:
        return dict(zip(self._frames, frame_poses(self.pepper, self.q, self._frames), strict=True))

    @cached_property
    def scene(self) -> Scene:
        """The world around the robot."""
        return self._world.snapshot()

    @cached_property
    def contacts(self) -> Sequence[Any]:
        """Contacts of the robot; see `SensorSuite.read`."""
        return self._world.contacts


def touched(contact: Any, links: Container[str]) -> list[tuple[str, NDArray[np.float64]]]:
    """Return the links that a contact touches, of given ones, each with its point.

    Args:
        contact: With `links` and `points`, as `pepper_kin.collision.Contact` has (points may be None, where
            it is not known where), or with `names`, one `point` and a `force`, as a twin's world has.
        links: Names of the links that are looked for.
    """
    if hasattr(contact, "links"):
        if contact.points is None:
            return []
        return [pair for pair in zip(contact.links, contact.points, strict=True) if pair[0] in links]
    names = [name for name in contact.names if name in links]
    if not names or not np.any(contact.force):
        return []
    return [(name, contact.point) for name in names]
