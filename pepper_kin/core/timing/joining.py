"""Transitions along a path from one state of motion into another: the first that keeps limits."""

from __future__ import annotations

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3

_SAMPLES = 65
_BACK = 1e-9  # tolerance of a negative ds/dt, up to which a transition does not reverse


@compiled("int64(float64[::1], float64[:, :, ::1], float64[:, ::1], float64[::1], float64[:, ::1], int64)")
def next_way(
    breaks: Floats1, coefficients: Floats3, ways: Floats2, times: Floats1, limits: Floats2, begin: int
) -> int:
    """Return the first transition that keeps limits at sample times and never reverses; -1 if none does.

    Args:
        breaks: Ends of the path's segments, ascending, shape (m + 1,).
        coefficients: Coefficients of the path, constant term first, shape (m, 4, n).
        ways: s as polynomials of degree 5 in time, constant term first, shape (w, 6).
        times: Durations of the transitions [s], shape (w,).
        limits: Limits of velocity, acceleration and jerk, inf for none, shape (3, n).
        begin: Index of the transition to try first.
    """
    for k in range(begin, times.size):
        keeps = True
        for i in range(_SAMPLES):
            if not _keeps(breaks, coefficients, ways[k], times[k] * i / (_SAMPLES - 1), limits):
                keeps = False
                break
        if keeps:
            return k
    return -1


@compiled(lean=True)
def _keeps(breaks: Floats1, coefficients: Floats3, way: Floats1, t: float, limits: Floats2) -> bool:
    """Return whether a transition, shape (6,), keeps limits at a time t [s]."""
    s, first, second, third = way[5], 0.0, 0.0, 0.0
    for power in range(4, -1, -1):
        third = third * t + second
        second = second * t + first
        first = first * t + s
        s = s * t + way[power]
    second, third = 2 * second, 6 * third
    if first < -_BACK:
        return False
    piece, last = 0, breaks.size - 2
    while piece < last and s >= breaks[piece + 1]:
        piece += 1
    x = min(max(s, breaks[0]), breaks[last + 1]) - breaks[piece]
    for j in range(coefficients.shape[2]):
        b, c, d = coefficients[piece, 1, j], coefficients[piece, 2, j], coefficients[piece, 3, j]
        q1, q2, q3 = b + x * (2 * c + 3 * d * x), 2 * c + 6 * d * x, 6 * d
        jerk = (q3 * first * first + 3 * q2 * second) * first + q1 * third
        acceleration = q2 * first * first + q1 * second
        if abs(jerk) > limits[2, j] or abs(acceleration) > limits[1, j] or abs(q1 * first) > limits[0, j]:
            return False
    return True
