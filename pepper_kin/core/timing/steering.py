"""Joints from position and velocity to rest at a goal: bang-bang with a coast, all in the same time.

A joint goes from velocity v with acceleration a to a velocity c, keeps it, and brakes with a to rest.  Signs
are such that the goal lies at a distance d beyond its stopping point, d >= v |v| / 2 a, so that c >= 0.  Its
least time has c = min(sqrt(a d + v^2 / 2), v_max).  In a longer time T, with v <= c,

    d = c (T + v / a) - c^2 / a - v^2 / 2 a,

whose lesser root it is; where that is less than v the joint slows down first, d = v^2 / 2 a + c (T - v / a).
It ends at rest, where it could wait: every time above the least is possible.
"""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled

_SAME_TIME = 1e-12  # [s]


@compiled("float64(float64[:, ::1], float64[::1], float64[:, ::1], float64[:, :, ::1])")
def steer(state: Array, goal: Array, limits: Array, phases: Array) -> float:
    """Find the fastest motion of all joints to rest at a goal.

    Args:
        state: Position and velocity, shape (2, n) [rad or m, 1/s].
        goal: Position, shape (n,).
        limits: Of velocity and acceleration, finite and above zero, shape (2, n).
        phases: Receives duration, and velocity, acceleration and jerk at the start of each phase, shape
            (n, 3, 4).

    Returns:
        The time of the slowest joint [s], in which all of them arrive.
    """
    n, longest = goal.size, 0.0
    for j in range(n):
        a, sign = limits[1, j], _direction(state, goal, limits, j)
        d, v = sign * (goal[j] - state[0, j]), sign * state[1, j]
        c = min(np.sqrt(max(a * d + v * v / 2, 0.0)), limits[0, j])
        ramps = (abs(c - v) + c) / a
        left = d - (v + c) / 2 * abs(c - v) / a - c * c / (2 * a)
        longest = max(longest, ramps + (max(left, 0.0) / c if c > 0.0 else 0.0))
    for j in range(n):
        a, sign = limits[1, j], _direction(state, goal, limits, j)
        d, v = sign * (goal[j] - state[0, j]), sign * state[1, j]
        beyond = d - v * abs(v) / (2 * a)
        if v > 0.0 and beyond <= v * (longest - v / a):
            c = beyond / (longest - v / a) if beyond > 0.0 else 0.0
        else:
            half, square = (a * longest + v) / 2, max(a * d + v * v / 2, 0.0)
            root = half + np.sqrt(max(half * half - square, 0.0))
            c = square / root if root > 0.0 else 0.0
        first, last = abs(c - v) / a, c / a
        phases[j, 0, 0], phases[j, 0, 1] = first, state[1, j]
        phases[j, 0, 2] = sign * (a if c > v else -a)
        phases[j, 1, 0], phases[j, 1, 1], phases[j, 1, 2] = max(longest - first - last, 0.0), sign * c, 0.0
        phases[j, 2, 0], phases[j, 2, 1], phases[j, 2, 2] = last, sign * c, -sign * a
        for k in range(3):
            phases[j, k, 3] = 0.0
    return longest


@compiled
def _direction(state: Array, goal: Array, limits: Array, j: int) -> float:
    """Return the sign of the way from a joint's stopping point to its goal."""
    v = state[1, j]
    return 1.0 if goal[j] - state[0, j] >= v * abs(v) / (2 * limits[1, j]) else -1.0


@compiled("int64(float64[::1], float64[:, :, ::1], float64[::1], float64[:, :, ::1])")
def join_phases(position: Array, phases: Array, breaks: Array, coefficients: Array) -> int:
    """Write phases of joints, each with its own times, as cubics of all; who ends early rests.

    Args:
        position: Positions at the start, shape (n,).
        phases: Duration, and velocity, acceleration and jerk at the start of each phase, shape (n, 3, 4).
        breaks: Receives the ends of the pieces [s], shape (3 n + 1,).
        coefficients: Receives the pieces, constant term first, shape (3 n, 4, n).

    Returns:
        The number of pieces; pieces of less than 1e-12 s are left out.
    """
    n, count = position.size, 0
    for j in range(n):  # insertion into the ordered times
        end = 0.0
        for k in range(3):
            end += phases[j, k, 0]
            place = count
            while place > 0 and breaks[place] > end:
                place -= 1
            if end - breaks[place] * (place > 0) <= _SAME_TIME:
                continue
            if place < count and breaks[place + 1] - end <= _SAME_TIME:
                continue
            for i in range(count, place, -1):
                breaks[i + 1] = breaks[i]
            breaks[place + 1] = end
            count += 1
    breaks[0] = 0.0
    for j in range(n):
        k, begin, q = 0, 0.0, position[j]
        for i in range(count):
            middle = (breaks[i] + breaks[i + 1]) / 2
            while k < 3 and begin + phases[j, k, 0] < middle:
                step, v, a, jerk = phases[j, k, 0], phases[j, k, 1], phases[j, k, 2], phases[j, k, 3]
                q += step * (v + step * (a / 2 + step * jerk / 6))
                begin, k = begin + step, k + 1
            v, a, jerk = 0.0, 0.0, 0.0
            if k < 3:
                v, a, jerk = phases[j, k, 1], phases[j, k, 2], phases[j, k, 3]
            t = breaks[i] - begin if k < 3 else 0.0
            coefficients[i, 0, j] = q + t * (v + t * (a / 2 + t * jerk / 6))
            coefficients[i, 1, j] = v + t * (a + t * jerk / 2)
            coefficients[i, 2, j], coefficients[i, 3, j] = (a + t * jerk) / 2, jerk / 6
    return count
