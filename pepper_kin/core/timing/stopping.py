"""The fastest stop along a motion's own path.

The path parameter s is the motion's own time.  With x = (ds/dt)^2 and a constant u = d2s/dt2 on an interval,
d = s - s_i and x = x_i + 2 u d, a joint's acceleration

    q'' x + q' u = q''(d) x_i + (q'(d) + 2 d q''(d)) u

is a polynomial in d, whose Bernstein coefficients are linear in (x_i, u): their bounds are bounds on the
acceleration at all times.  Torques and edge moments c + b x + a u are compared at the start, the middle
and the end of an interval, with a reserve for their curvature.  The motion itself (u = 0, x = 1) keeps its
limits, and so does rest: all (0, x) with x in [0, 1] do, for the limits are convex in (u, x).  So u = 0 is
always feasible, no backward pass is needed, and the minimum u of each interval leads to the shortest stop.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats3, Ints1

_HARDEST = 1e6  # bound on |u| where nothing moves and nothing else bounds it [1/s^2]
_NONE = 1e-14  # gain up to which a row does not bound u


class StopPath(NamedTuple):
    """A motion from a given time on, in intervals within its segments, and the profile of its stop.

    Attributes:
        segment: Segment of each interval, shape (N,).
        local: Start of each interval in its segment [s], shape (N,).
        step: Length of each interval [s], shape (N,).
        taylor: Taylor coefficients of the motion at the start of each interval, shape (N, k, n).
        x: Squared speed (ds/dt)^2 at the ends of the intervals, initially 1, shape (N + 1,).
    """

    segment: Ints1
    local: Floats1
    step: Floats1
    taylor: Floats3
    x: Floats1


class StopLimits(NamedTuple):
    """Limits of a stop.

    Attributes:
        acceleration: Acceleration limits of the joints [rad/s^2 or m/s^2], shape (n,).
        effects: Torques and edge moments c at rest, c + a at unit u and c + b at unit x at the start, the
            middle and the end of each interval, shape (3, 3 N, r) [N m or N].
        low: Lower limits of the effects, shape (r,) [N m or N].
        high: Upper limits of the effects, shape (r,) [N m or N].
    """

    acceleration: Floats1
    effects: Floats3
    low: Floats1
    high: Floats1


@compiled("int64(float64[::1], float64[:, :, ::1], float64, float64, StopPath)")
def cut_path(breaks: Array, coefficients: Array, at: float, longest: float, path: StopPath) -> int:
    """Divide a motion from a given time on into intervals, until the arrays are full or the motion ends.

    Args:
        breaks: Ends of the segments [s], shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
        at: Start time [s].
        longest: Maximum length of an interval [s].
        path: Output, all but `x`.

    Returns:
        The number of intervals.
    """
    pieces, order, n = coefficients.shape
    i, count = 0, 0
    while i < pieces - 1 and at >= breaks[i + 1] - 1e-9:
        i += 1
    begin = max(at - breaks[i], 0.0)
    while i < pieces:
        left = breaks[i + 1] - breaks[i] - begin
        parts = int(np.ceil(left / longest))
        for part in range(parts):
            if count == path.step.size:
                return count
            path.segment[count], path.step[count] = i, left / parts
            x = path.local[count] = begin + part * (left / parts)
            taylor = path.taylor[count]
            for power in range(order):
                for j in range(n):
                    taylor[power, j] = coefficients[i, power, j]
            for low in range(order - 1):  # repeated Horner: the Taylor shift
                for power in range(order - 2, low - 1, -1):
                    for j in range(n):
                        taylor[power, j] += x * taylor[power + 1, j]
            count += 1
        i, begin = i + 1, 0.0
    return count


@compiled("int64(int64, float64[:, ::1], StopPath, StopLimits)")
def stop_profile(count: int, basis: Array, path: StopPath, limits: StopLimits) -> int:
    """Find the minimum speed along the path, interval by interval.

    Args:
        count: Number of intervals.
        basis: Gains from powers to Bernstein coefficients of degree k - 2, shape (k - 1, k - 1).
        path: `x` is output; the step of the last interval is shortened to where the motion rests.
        limits: The limits.

    Returns:
        The number of intervals until rest; 0 if the path ends before.
    """
    order, n = path.taylor.shape[1], path.taylor.shape[2]
    bend, pull, x = np.zeros(order), np.zeros(order), 1.0
    path.x[0] = 1.0
    for i in range(count):
        low, high, step = -_HARDEST, _HARDEST, path.step[i]
        for j in range(n):
            limit, power, moves = limits.acceleration[j], 1.0, 0.0
            for p in range(order - 1):
                slope = (p + 1) * path.taylor[i, p + 1, j]
                bend[p] = (p + 1) * (p + 2) * path.taylor[i, p + 2, j] * power if p < order - 2 else 0.0
                pull[p] = slope * power + (2 * step * bend[p - 1] if p > 0 else 0.0)
                power *= step
                moves = max(moves, abs(slope))
            if moves == 0.0:
                continue
            for k in range(order - 1):
                beta, gamma = 0.0, 0.0
                for p in range(k + 1):
                    beta += basis[k, p] * bend[p]
                    gamma += basis[k, p] * pull[p]
                low, high = _bounded(low, high, gamma, beta * x, -limit, limit)
        hardest = min(abs(low), _HARDEST)
        for r in range(limits.low.size):
            low, high = _bounded_effect(low, high, hardest, i, r, x, step, limits)
        u = low if low <= min(high, 0.0) else 0.0
        after = x + 2 * u * step
        if after <= 0.0:
            path.step[i], path.x[i + 1] = -x / (2 * u), 0.0
            return i + 1
        x = path.x[i + 1] = after
    return 0


@compiled
def _bounded(
    low: float, high: float, gain: float, value: float, least: float, most: float
) -> tuple[float, float]:
    """Return the interval [low, high] of u intersected with least <= value + gain u <= most."""
    if gain > _NONE:
        low, high = max(low, (least - value) / gain), min(high, (most - value) / gain)
    elif gain < -_NONE:
        low, high = max(low, (most - value) / gain), min(high, (least - value) / gain)
    elif value < least or value > most:
        high = -np.inf
    return low, high


@compiled
def _bounded_effect(
    low: float, high: float, hardest: float, i: int, r: int, x: float, step: float, limits: StopLimits
) -> tuple[float, float]:
    """Return the interval of u restricted by one torque or edge moment on interval i, with |u| <= hardest.

    The reserve is four times the maximum deviation of a parabola through the three values from its chords.
    """
    k, effects = 3 * i, limits.effects
    reserve = 0.0
    for part in range(3):
        second = effects[part, k, r] - 2 * effects[part, k + 1, r] + effects[part, k + 2, r]
        reserve += abs(second) / 2 * (hardest if part == 1 else 1.0)
    for place in range(3):
        rest = effects[0, k + place, r]
        a, b = effects[1, k + place, r] - rest, effects[2, k + place, r] - rest
        gain = a + b * step * place
        low, high = _bounded(low, high, gain, rest + b * x, limits.low[r] + reserve, limits.high[r] - reserve)
    return low, high


@compiled("void(int64, StopPath, float64[::1], float64[:, :, ::1])")
def stop_polynomials(count: int, path: StopPath, breaks: Array, coefficients: Array) -> None:
    """Write q(s(t)) exactly: on each interval d = w t + u t^2 / 2 in the Taylor polynomial.

    Args:
        count: Number of intervals, K.
        path: The path with its profile.
        breaks: Output: times at the ends of the intervals [s], shape (K + 1,).
        coefficients: Output: segments, constant term first, shape (K, 2 k - 1, n).
    """
    order, n = path.taylor.shape[1], path.taylor.shape[2]
    breaks[0] = 0.0
    for i in range(count):
        w, after, step = np.sqrt(path.x[i]), np.sqrt(path.x[i + 1]), path.step[i]
        half = (path.x[i + 1] - path.x[i]) / (4 * step)
        breaks[i + 1] = breaks[i] + 2 * step / (w + after)
        found = coefficients[i]
        for p in range(2 * order - 1):
            for j in range(n):
                found[p, j] = 0.0
        for power in range(order - 1, -1, -1):  # Horner: found = found (w t + half t^2) + c
            for p in range(2 * (order - 1 - power), 0, -1):
                for j in range(n):
                    found[p, j] = w * found[p - 1, j] + (half * found[p - 2, j] if p > 1 else 0.0)
            for j in range(n):
                found[0, j] = path.taylor[i, power, j]
