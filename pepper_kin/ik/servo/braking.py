"""Velocities from which a joint can still stop before its limit, counted in ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from pepper_kin.ik.servo.motion_limits import MotionLimits
from pepper_kin.ik.tasks.task import Array

ACCELERATION, VELOCITY, POSITION, LOCKED = 0, 1, 2, 3
"""What a bound comes from."""

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


@njit(cache=True, nogil=True, error_model="numpy")
def stopping_speed(distance: float, deceleration: float, dt: float) -> float:
    """Return the greatest speed v from which a joint stops within a distance.

    In steps of dt at v, v - a dt, v - 2 a dt, ... a joint travels, with N = floor(v / (a dt)),

        s(v) = dt ((N + 1) v - a dt N (N + 1) / 2).

    Its inverse is v = s / ((N + 1) dt) + a dt N / 2 with N (N + 1) / 2 <= s / (a dt^2) < (N + 1) (N + 2) / 2.
    Who keeps v(s) and brakes finds v - a dt <= v(s - v dt) at the next tick: it can always go on braking.

    Args:
        distance: s, 0 or more, infinite allowed [rad or m].
        deceleration: a, above zero, infinite allowed [rad/s^2 or m/s^2].
        dt: Length of a tick [s].

    Returns:
        v [rad/s or m/s].
    """
    quantum = deceleration * dt
    # An infinite distance never ends; an infinite deceleration stops within one tick.
    if math.isinf(distance):
        return distance
    if math.isinf(quantum):
        return distance / dt
    steps = math.floor(0.5 * (math.sqrt(1.0 + 8.0 * distance / (quantum * dt)) - 1.0))
    return distance / ((steps + 1.0) * dt) + 0.5 * quantum * steps


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
    _bounds(
        q, v, limits.lower, limits.upper, limits.velocity, limits.acceleration, limits.movable, dt,
        low, high, brake, low_kind, high_kind,
    )  # fmt: skip
    return VelocityBounds(low, high, brake, low_kind, high_kind)


@njit(cache=True, nogil=True, error_model="numpy")
def _bounds(
    q: Array, v: Array, lower: Array, upper: Array, velocity: Array, acceleration: Array, movable: np.ndarray,
    dt: float, low: Array, high: Array, brake: Array, low_kind: np.ndarray, high_kind: np.ndarray,
) -> None:  # fmt: skip
    """Write the bounds of `velocity_bounds`."""
    for i in range(q.size):
        reach = acceleration[i] * dt
        brake[i] = math.copysign(max(abs(v[i]) - reach, 0.0), v[i])
        if not movable[i]:
            low[i], high[i] = brake[i], brake[i]
            low_kind[i], high_kind[i] = LOCKED, LOCKED
            continue
        high[i], high_kind[i] = v[i] + reach, ACCELERATION
        low[i], low_kind[i] = v[i] - reach, ACCELERATION
        if velocity[i] < high[i]:
            high[i], high_kind[i] = velocity[i], VELOCITY
        if -velocity[i] > low[i]:
            low[i], low_kind[i] = -velocity[i], VELOCITY
        above = stopping_speed(max(upper[i] - q[i], 0.0), acceleration[i], dt)
        below = -stopping_speed(max(q[i] - lower[i], 0.0), acceleration[i], dt)
        if above < high[i]:
            high[i], high_kind[i] = above, POSITION
        if below > low[i]:
            low[i], low_kind[i] = below, POSITION
        # Rounding, or a velocity that was not ours, must not leave the brake outside.
        high[i], low[i] = max(high[i], brake[i]), min(low[i], brake[i])


@njit(cache=True, nogil=True, error_model="numpy")
def brake_path(v: Array, acceleration: Array, dt: float, ticks: np.ndarray) -> Array:
    """Return how far each joint has moved after some ticks, the first at v, the others braking.

    Args:
        v: Velocity of the first tick [rad/s or m/s], shape (n,).
        acceleration: a [rad/s^2 or m/s^2], shape (n,).
        dt: Length of a tick [s].
        ticks: Numbers of ticks, shape (m,).

    Returns:
        Changes of position, with sign [rad or m], shape (m, n).
    """
    path = np.empty((ticks.size, v.size))
    for i in range(v.size):
        quantum, speed = min(acceleration[i] * dt, 1e300), abs(v[i])
        moving, sign = math.floor(speed / quantum) + 1.0, np.sign(v[i])
        for k in range(ticks.size):
            count = min(float(ticks[k]), moving)
            # Ticks that are not needed count 0 times the quantum, which may be huge.
            loss = quantum * (count - 1.0) / 2.0 if count > 1.0 else 0.0
            path[k, i] = dt * sign * count * (speed - loss)
    return path


@njit(cache=True, nogil=True, error_model="numpy")
def ticks_to_rest(v: Array, acceleration: Array, dt: float) -> int:
    """Return how many ticks of `brake_path` move."""
    most = 0.0
    for i in range(v.size):
        most = max(most, math.floor(abs(v[i]) / min(acceleration[i] * dt, 1e300)))
    return int(most) + 1


def stopping_place(q: Array, v: Array, acceleration: Array, dt: float) -> Array:
    """Return where the joints come to rest after one tick at v and the hardest brake, shape (n,)."""
    last = np.array([ticks_to_rest(v, acceleration, dt)])
    place: Array = q + brake_path(v, acceleration, dt, last)[0]
    return place
