"""Velocities from which a joint can still stop before its limit, counted in ticks."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.braking import LOCKED, JointLimits, VelocityInterval, bound_velocities

KINDS = ("acceleration", "velocity", "position", "lock")


def braked(bounds: VelocityInterval, joints: np.ndarray, gentle: Array) -> VelocityInterval:
    """Return bounds that make some joints brake.

    Args:
        bounds: The bounds.
        joints: Which, shape (n,) of bool.
        gentle: Velocities of the gentlest brake that will do [rad/s or m/s], shape (n,); near the end of its
            range a joint brakes harder.
    """
    gentle = np.clip(gentle, bounds.low, bounds.high)
    low, high = np.minimum(bounds.brake, gentle), np.maximum(bounds.brake, gentle)
    return bounds._replace(
        low=np.where(joints, low, bounds.low),
        high=np.where(joints, high, bounds.high),
        low_kind=np.where(joints, LOCKED, bounds.low_kind),
        high_kind=np.where(joints, LOCKED, bounds.high_kind),
    )


def velocity_bounds(q: Array, v: Array, limits: JointLimits, dt: float) -> VelocityInterval:
    """Return the velocities that keep position, velocity and acceleration limits for ever.

    Args:
        q: Joint positions [rad or m], shape (n,).
        v: Velocities of the last tick, which kept the limits, shape (n,).
        limits: The limits.
        dt: Length of a tick [s].
    """
    low, high, brake = np.empty((3, q.size))
    low_kind, high_kind = np.empty((2, q.size), dtype=np.int64)
    bounds = VelocityInterval(low, high, brake, low_kind, high_kind)
    bound_velocities(q, v, limits, dt, bounds)
    return bounds
