"""Velocities from which a joint can still stop before its limit, counted in ticks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pepper_kin.core.braking import LOCKED, VelocityInterval, bound_velocities
from pepper_kin.ik.tasks.task import Array
from pepper_kin.servo.motion_limits import MotionLimits

KINDS = ("acceleration", "velocity", "position", "lock")


@dataclass(frozen=True, eq=False)
class VelocityBounds:
    """What the next velocity may be, joint by joint; never empty, for `brake` is always within.

    Attributes:
        low: Least velocity [rad/s or m/s], shape (n,).
        high: Greatest velocity, shape (n,).
        brake: The velocity of the hardest brake, shape (n,).
        low_kind: What `low` comes from, an index of `KINDS`, shape (n,).
        high_kind: What `high` comes from, shape (n,).
    """

    low: Array
    high: Array
    brake: Array
    low_kind: np.ndarray
    high_kind: np.ndarray

    def braking(self, joints: np.ndarray) -> VelocityBounds:
        """Return bounds that make some joints, shape (n,) of bool, brake."""
        return replace(
            self,
            low=np.where(joints, self.brake, self.low),
            high=np.where(joints, self.brake, self.high),
            low_kind=np.where(joints, LOCKED, self.low_kind),
            high_kind=np.where(joints, LOCKED, self.high_kind),
        )


def velocity_bounds(q: Array, v: Array, limits: MotionLimits, dt: float) -> VelocityBounds:
    """Return the velocities that keep position, velocity and acceleration limits for ever.

    Args:
        q: Joint positions [rad or m], shape (n,).
        v: Velocities of the last tick, which kept the limits, shape (n,).
        limits: The limits.
        dt: Length of a tick [s].
    """
    low, high, brake = np.empty((3, q.size))
    low_kind, high_kind = np.empty((2, q.size), dtype=np.int64)
    bound_velocities(q, v, limits.table, dt, VelocityInterval(low, high, brake, low_kind, high_kind))
    return VelocityBounds(low, high, brake, low_kind, high_kind)
