"""Bang-bang motions of joints, in equal time, from a state of motion to rest at a goal or to another state.

A joint accelerates with a from velocity v to a velocity c, keeps it, and brakes with a to rest.  Signs are
such that the goal lies at a distance d beyond its stopping point, d >= v |v| / 2 a, so that c >= 0.  Its
minimum time has c = min(sqrt(a d + v^2 / 2), v_max).  In the time T of the slowest joint, joints that need
not reverse use the minimum acceleration: for d < v T / 2 they brake with v^2 / 2 d, and wait; for other
d the first formula below, with w = 0.  A joint that reverses uses all of its acceleration, and c is the
smaller root of

    d = c (T + v / a) - c^2 / a - v^2 / 2 a.

To reach a velocity w at a distance d in a time T, the minimum acceleration is used for some time and then its
opposite: with m = 2 d - T (v + w),

    a = (m +- sqrt(m^2 + T^2 (w - v)^2)) / T^2,   with the sign of m,

and if that exceeds v_max in between, with a coast at c = v_max for a > 0, -v_max for a < 0,

    a = ((c - v)^2 + (c - w)^2) / (2 (c T - d)).

Not every time above a feasible one is feasible: times are tried in turn.
"""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled

_SAME_TIME = 1e-12  # tolerance of equal times [s]
_LONGER = 1.04  # ratio of successive times that are tried
_SHORTEST = 0.005  # first time that is tried [s]


@compiled("float64(float64[:, ::1], float64[::1], float64[:, ::1], float64[:, :, ::1])")
def steer(state: Array, goal: Array, limits: Array, phases: Array) -> float:
    """Find the fastest motion of all joints to rest at a goal.

    Args:
        state: Position and velocity, shape (2, n) [rad or m, 1/s].
        goal: Goal position, shape (n,).
        limits: Limits of velocity and acceleration, finite and positive, shape (2, n).
        phases: Output: duration, and velocity, acceleration and jerk at the start of each phase, shape
            (n, 3, 4).

    Returns:
        The time of the slowest joint [s], at which all joints arrive.
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
        if v < 0.0:
            half, square = (a * longest + v) / 2, max(a * d + v * v / 2, 0.0)
            root = half + np.sqrt(max(half * half - square, 0.0))
            c = square / root if root > 0.0 else 0.0
        elif 2.0 * d < v * longest:
            a, c = min(v * v / (2.0 * d), a), 0.0
        else:
            a, c = _least_acceleration(d, v, 0.0, limits[0, j], longest)
        _write_phases(longest, sign * a, state[1, j], sign * c, 0.0, phases[j])
    return longest


@compiled
def _write_phases(time: float, a: float, v: float, c: float, w: float, phases: Array) -> None:
    """Write the phases of a joint from velocity v to c and w with acceleration +-|a|, shape (3, 4)."""
    first, last = (abs(c - v) / abs(a), abs(w - c) / abs(a)) if a != 0.0 else (0.0, 0.0)
    phases[0, 0], phases[0, 1], phases[0, 2] = first, v, abs(a) if c > v else -abs(a)
    phases[1, 0], phases[1, 1], phases[1, 2] = max(time - first - last, 0.0), c, 0.0
    phases[2, 0], phases[2, 1], phases[2, 2] = last, c, abs(a) if w > c else -abs(a)
    for k in range(3):
        phases[k, 3] = 0.0


@compiled("float64(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64, float64[:, :, ::1])")
def bridge(state: Array, target: Array, limits: Array, longest: float, phases: Array) -> float:
    """Find a short motion of all joints from position and velocity to others.

    Args:
        state: Position and velocity at the start, shape (2, n) [rad or m, 1/s].
        target: Position and velocity at the end, shape (2, n); both within the limits.
        limits: Limits of velocity and acceleration as in `steer`, then minimum and maximum position, shape
            (4, n).
        longest: Maximum duration [s].
        phases: Output, as in `steer`, shape (n, 3, 4).

    Returns:
        The duration [s]; 0 if none of those tried is feasible up to the maximum.
    """
    n, time = limits.shape[1], _SHORTEST
    for j in range(n):
        time = max(time, abs(target[1, j] - state[1, j]) / limits[1, j])
        time = max(time, abs(target[0, j] - state[0, j]) / limits[0, j])
    while time <= longest:
        enough, j = True, 0
        while enough and j < n:
            enough, j = _allowed(state, target, limits, time, j), j + 1
        if enough:
            for j in range(n):
                v, w = state[1, j], target[1, j]
                a, c = _least_acceleration(target[0, j] - state[0, j], v, w, limits[0, j], time)
                _write_phases(time, a, v, c, w, phases[j])
            return time
        time *= _LONGER
    return 0.0


@compiled
def _allowed(state: Array, target: Array, limits: Array, time: float, j: int) -> bool:
    """Return whether joint j keeps its limits in a given duration; see `bridge`."""
    d, v, w = target[0, j] - state[0, j], state[1, j], target[1, j]
    a, c = _least_acceleration(d, v, w, limits[0, j], time)
    if not abs(a) <= limits[1, j]:
        return False
    for end, speed, back in ((state[0, j], v, -a), (target[0, j], w, a)):
        if speed * c < 0.0:  # the joint reverses beyond this end
            turn = end + speed * speed / (2.0 * back)
            if turn < limits[2, j] or turn > limits[3, j]:
                return False
    return True


@compiled
def _least_acceleration(d: float, v: float, w: float, top: float, time: float) -> tuple[float, float]:
    """Return a joint's first acceleration, and the velocity at which it coasts or turns to the opposite.

    Args:
        d: Distance to go [rad or m].
        v: Velocity at the start.
        w: Velocity at the end.
        top: Limit of velocity.
        time: Duration [s].
    """
    m, change = 2.0 * d - time * (v + w), w - v
    root = np.sqrt(m * m + time * time * change * change)
    a = (m + (root if m >= 0.0 else -root)) / (time * time)
    if a == 0.0:
        return 0.0, v
    c = v + (a * time + change) / 2.0
    if abs(c) > top:
        c = top if a > 0.0 else -top
        beyond = c * time - d
        a = ((c - v) ** 2 + (c - w) ** 2) / (2.0 * beyond) if beyond != 0.0 else np.inf
    return a, c


@compiled
def _direction(state: Array, goal: Array, limits: Array, j: int) -> float:
    """Return the sign of the direction from a joint's stopping point to its goal."""
    v = state[1, j]
    return 1.0 if goal[j] - state[0, j] >= v * abs(v) / (2 * limits[1, j]) else -1.0


@compiled("int64(float64[::1], float64[:, :, ::1], float64[::1], float64[:, :, ::1])")
def join_phases(position: Array, phases: Array, breaks: Array, coefficients: Array) -> int:
    """Convert phases of joints with separate times to cubics of all joints; a joint that ends early rests.

    Args:
        position: Positions at the start, shape (n,).
        phases: Duration, and velocity, acceleration and jerk at the start of each phase, shape (n, 3, 4).
        breaks: Output: ends of the segments [s], shape (3 n + 1,).
        coefficients: Output: segments, constant term first, shape (3 n, 4, n).

    Returns:
        The number of segments; segments of less than 1e-12 s are left out.
    """
    n, count = position.size, 0
    for j in range(n):  # insertion into the sorted times
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
