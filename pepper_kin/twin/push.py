"""Pushes: external forces on a point of the robot for some time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.dynamics import external_torque
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import MOST, as_finite, as_real


@dataclass(frozen=True, eq=False)
class Push(FrozenArrays):
    """A constant force; arrays are read-only.

    Attributes:
        frame: Name of the frame that it acts on.
        force: Force in world axes [N], shape (3,).
        point: Point of action in the frame's axes [m], shape (3,).
        start: Start time on the twin's clock [s].
        duration: Duration [s]; may be infinite.
    """

    frame: str
    force: Array
    point: Array
    start: float
    duration: float

    @classmethod
    def checked(
        cls,
        pepper: PepperModel,
        frame: str,
        force: ArrayLike,
        point: ArrayLike | None,
        start: float,
        duration: float,
    ) -> Push:
        """Return a push, after checks.

        Args:
            pepper: The robot.
            frame: Name of the frame that it acts on.
            force: Force in world axes [N], shape (3,).
            point: Point of action in the frame's axes [m], shape (3,); the frame's origin if None.
            start: Start time on the twin's clock [s].
            duration: Duration [s].

        Raises:
            UnknownNameError: for a frame that the robot lacks.
            InvalidValueError: for a wrong value, naming its quantity.
        """
        pepper.frame_id(frame)
        place = np.zeros(3) if point is None else as_finite(point, "point", (3,), MOST)
        if not math.isfinite(as_real(start)):
            raise InvalidValueError("start", start, "a finite time [s]")
        if not as_real(duration) > 0:
            raise InvalidValueError("duration", duration, "a time above 0 s, or infinity")
        force = as_finite(force, "force", (3,), MOST)
        arm, size = float(np.linalg.norm(place)), float(np.linalg.norm(force))
        if arm * size > MOST:  # its moment, which would otherwise be refused only later
            raise InvalidValueError(
                "force", f"{size:g} N at a point {arm:g} m away", f"a moment up to {MOST:g} N m"
            )
        return cls(frame, read_only(force), read_only(place), float(start), float(duration))

    def acts_within(self, begin: float, end: float) -> bool:
        """Return whether the push acts at some time between two times [s]."""
        return self.start < end and begin < self.start + self.duration

    def acts_at(self, time: float) -> bool:
        """Return whether the push acts at a time [s]."""
        return self.start <= time < self.start + self.duration

    def load(self, pepper: PepperModel, q: Array) -> Array:
        """Return its joint torques J(q)^T f [N m or N], shape (n,), at q [rad or m], shape (n,)."""
        moment: Array = np.zeros(3)
        if self.point.any():
            offset = frame_pose(pepper, q, self.frame)[:3, :3] @ self.point
            moment = np.asarray(np.cross(offset, self.force), dtype=np.float64)
        return external_torque(pepper, q, {self.frame: np.concatenate([self.force, moment])})

    def wrench(self, pepper: PepperModel, q: Array) -> Array:
        """Return its force [N] and moment about the world's origin [N m], in world axes, shape (6,).

        Args:
            pepper: The robot.
            q: Joint positions [rad or m], shape (n,).
        """
        pose = frame_pose(pepper, q, self.frame)
        place = pose[:3, :3] @ self.point + pose[:3, 3]
        return np.concatenate([self.force, np.cross(place, self.force)])


def loads_of(pushes: Sequence[Push], pepper: PepperModel, q: Array, time: float) -> tuple[Array, Array]:
    """Return joint torques [N m or N], shape (n,), and wrench, shape (6,), of all pushes at a time [s].

    The joint positions are q [rad or m], shape (n,); see `Push.wrench` for the wrench.
    """
    load, wrench = np.zeros(pepper.n), np.zeros(6)
    for push in pushes:
        if push.acts_at(time + 1e-9):
            load += push.load(pepper, q)
            wrench += push.wrench(pepper, q)
    return load, wrench
