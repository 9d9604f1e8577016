"""Joint velocities from which every joint can still stop within its limits, in discrete time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.linear_algebra import symmetric_eigen
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Ints1

ACCELERATION, VELOCITY, POSITION, LOCKED = 0, 1, 2, 3
"""Kinds of limit that a velocity bound comes from."""

# Ratio of the acceleration limits that an approach plans its braking with; the rest is for corrections.
RESERVE = 0.7

# Damping of the joint speeds [m/rad]: a direction in which the joints move the frame less than this is
# damped.
DAMPING = 3e-3

# Smallest singular value [m/rad] that costs are computed with, and norm of a residual that counts as zero.
LOST = 1e-3
VANISHED = 1e-9


class JointLimits(NamedTuple):
    """Limits of every joint; infinite for a joint without a limit.

    Attributes:
        lower: Lower position limits [rad or m], shape (n,).
        upper: Upper position limits, shape (n,).
        velocity: Maximum speeds [rad/s or m/s], shape (n,).
        acceleration: Maximum accelerations [rad/s^2 or m/s^2], shape (n,).
        movable: Which joints may move, shape (n,).
    """

    lower: Floats1
    upper: Floats1
    velocity: Floats1
    acceleration: Floats1
    movable: Flags1


class VelocityInterval(NamedTuple):
    """Interval of the next velocity of every joint; never empty, because `brake` is always within.

    Attributes:
        low: Minimum velocity [rad/s or m/s], shape (n,).
        high: Maximum velocity [rad/s or m/s], shape (n,).
        brake: Velocity at maximum deceleration [rad/s or m/s], shape (n,).
        low_kind: Kind of limit of `low` (ACCELERATION, ...), shape (n,).
        high_kind: Kind of limit of `high`, shape (n,).
    """

    low: Floats1
    high: Floats1
    brake: Floats1
    low_kind: Ints1
    high_kind: Ints1


@compiled("float64(float64, float64, float64)")
def stopping_speed(distance: float, deceleration: float, dt: float) -> float:
    """Return the maximum speed v from which a joint stops within a distance.

    In steps of dt at v, v - a dt, v - 2 a dt, ... a joint travels, with N = floor(v / (a dt)),

        s(v) = dt ((N + 1) v - a dt N (N + 1) / 2).

    Its inverse is v = s / ((N + 1) dt) + a dt N / 2 with N (N + 1) / 2 <= s / (a dt^2) < (N + 1) (N + 2) / 2.
    A joint at v(s) that brakes has v - a dt <= v(s - v dt) at the next tick: it can always go on braking.

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


@compiled
def bound_velocities(
    q: Floats1, v: Floats1, limits: JointLimits, dt: float, bounds: VelocityInterval
) -> None:
    """Write the velocities from which position, velocity and acceleration limits can be kept forever.

    Args:
        q: Joint positions [rad or m], shape (n,).
        v: Velocities of the last tick, which kept the limits [rad/s or m/s], shape (n,).
        limits: Limits of the joints.
        dt: Length of a tick [s].
        bounds: Output.
    """
    low, high, brake = bounds.low, bounds.high, bounds.brake
    low_kind, high_kind, velocity = bounds.low_kind, bounds.high_kind, limits.velocity
    for i in range(q.size):
        reach = limits.acceleration[i] * dt
        brake[i] = math.copysign(max(abs(v[i]) - reach, 0.0), v[i])
        if not limits.movable[i]:
            low[i], high[i] = brake[i], brake[i]
            low_kind[i], high_kind[i] = LOCKED, LOCKED
            continue
        high[i], high_kind[i] = v[i] + reach, ACCELERATION
        low[i], low_kind[i] = v[i] - reach, ACCELERATION
        if velocity[i] < high[i]:
            high[i], high_kind[i] = velocity[i], VELOCITY
        if -velocity[i] > low[i]:
            low[i], low_kind[i] = -velocity[i], VELOCITY
        above = stopping_speed(max(limits.upper[i] - q[i], 0.0), limits.acceleration[i], dt)
        below = -stopping_speed(max(q[i] - limits.lower[i], 0.0), limits.acceleration[i], dt)
        if above < high[i]:
            high[i], high_kind[i] = above, POSITION
        if below > low[i]:
            low[i], low_kind[i] = below, POSITION
        # Rounding, or a velocity from outside, must not leave `brake` outside the interval.
        high[i], low[i] = max(high[i], brake[i]), min(low[i], brake[i])


@compiled
def brake_joints(bounds: VelocityInterval, joints: Flags1, gentle: Floats1) -> None:
    """Narrow velocity bounds so that some joints brake.

    Args:
        bounds: Changed.
        joints: Which joints brake, shape (n,).
        gentle: Velocities of the smallest sufficient deceleration [rad/s or m/s], shape (n,); near the end of
            its range a joint decelerates more.
    """
    low, high = bounds.low, bounds.high
    for i in range(gentle.size):
        if joints[i]:
            softest = min(max(gentle[i], low[i]), high[i])
            low[i], high[i] = min(bounds.brake[i], softest), max(bounds.brake[i], softest)
            bounds.low_kind[i] = bounds.high_kind[i] = LOCKED


@compiled
def brake_path(v: Floats1, acceleration: Floats1, dt: float) -> Floats2:
    """Return how far each joint has moved at each tick of braking, with sign, shape (m, n) [rad or m].

    Args:
        v: Velocity of the first tick [rad/s or m/s], shape (n,).
        acceleration: a, deceleration of the joints after the first tick [rad/s^2 or m/s^2], shape (n,).
        dt: Length of a tick [s].

    Returns:
        Displacements from before the first tick, which are zero, to the last tick in which a joint moves.
    """
    last = 0.0
    for i in range(v.size):
        last = max(last, math.floor(abs(v[i]) / min(acceleration[i] * dt, 1e300)))
    path = np.empty((int(last) + 2, v.size))
    for i in range(v.size):
        quantum, speed = min(acceleration[i] * dt, 1e300), abs(v[i])
        moving, sign = math.floor(speed / quantum) + 1.0, np.sign(v[i])
        for k in range(path.shape[0]):
            count = min(float(k), moving)
            # Ticks that are not needed count 0 times the quantum, which may be huge.
            loss = quantum * (count - 1.0) / 2.0 if count > 1.0 else 0.0
            path[k, i] = dt * sign * count * (speed - loss)
    return path


@compiled
def approach_rate(
    jacobian: Floats2,
    wanted: Floats1,
    weights: Floats1,
    limits: JointLimits,
    dt: float,
    gain: float,
    singularity: float,
) -> tuple[float, float]:
    """Return the rate of approach [1/s], and the factor by which singularities reduce the speed.

    With J D^-1 = U S V^T (D scales the joints; locked ones are left out) and e the unit vector of the
    residual, g = |S^-1 U^T e| is the joint speed for one unit of residual.  The factor is
    min(1, 1 / (g sigma)) with sigma the threshold: 1 where the direction is easy, falling to zero with the
    singular value of a direction that is being lost; the direction itself is kept.

    Args:
        jacobian: J, shape (m, n).
        wanted: Residual or rate, shape (m,).
        weights: d of D = diag(d), shape (n,).
        limits: Limits of the joints.
        dt: Length of a tick [s].
        gain: Maximum ratio of an error that is removed per second [1/s].
        singularity: sigma [m/rad].
    """
    m, n = jacobian.shape
    size = 0.0
    for k in range(m):
        size += wanted[k] * wanted[k]
    size = math.sqrt(size)
    if size < VANISHED:
        return gain, 1.0
    scaled, square, vectors = np.zeros((m, n)), np.empty((m, m)), np.empty((m, m))
    values, along, weighted = np.empty(m), np.empty(m), np.empty(m)
    moving = 0
    for i in range(n):
        if limits.movable[i]:
            moving += 1
            for k in range(m):
                scaled[k, i] = jacobian[k, i] / weights[i]
    for a in range(m):
        for b in range(m):
            total = 0.0
            for i in range(n):
                total += scaled[a, i] * scaled[b, i]
            square[a, b] = total
    symmetric_eigen(square, values, vectors)
    for k in range(m):
        total = 0.0
        for a in range(m):
            total += vectors[a, k] * wanted[a]
        along[k], values[k] = total, max(values[k], 0.0)
    for a in range(m):
        total = 0.0
        for k in range(m):
            total += vectors[a, k] * along[k] / (values[k] + DAMPING * DAMPING)
        weighted[a] = total
    pull = gain
    for i in range(n):
        if limits.movable[i]:
            step = 0.0
            for a in range(m):
                step += scaled[a, i] * weighted[a]
            distance = max(abs(step) / weights[i], 1e-12)
            speed = min(stopping_speed(distance, RESERVE * limits.acceleration[i], dt), limits.velocity[i])
            pull = min(pull, speed / distance)
    # With more directions than joints the rest is always lost, and tells nothing about a singularity.
    effort = 0.0
    for k in range(max(0, m - moving), m):
        cost = along[k] / (size * max(math.sqrt(values[k]), LOST))
        effort += cost * cost
    effort = math.sqrt(effort) * singularity
    return pull, 1.0 if effort <= 1.0 else 1.0 / effort
