"""Kinks of a path, at which a motion has to stop."""

from __future__ import annotations

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats3, Ints1


@compiled("int64(float64[::1], float64[:, :, ::1], float64, int64[::1])")
def find_kinks(breaks: Floats1, curve: Floats3, least: float, kinks: Ints1) -> int:
    """Find the breaks at which the derivative of a piecewise cubic path jumps.

    Args:
        breaks: Ends of the segments, shape (m + 1,).
        curve: Coefficients, constant term first, shape (m, 4, n).
        least: Jump, relative to the derivatives, up to which it counts as rounding.
        kinks: Output: indices of the breaks, shape (>= m,).

    Returns:
        The number of kinks.
    """
    found = 0
    for i in range(1, curve.shape[0]):
        h, before, after, gap = breaks[i] - breaks[i - 1], 0.0, 0.0, 0.0
        for j in range(curve.shape[2]):
            first, second, third = curve[i - 1, 1, j], curve[i - 1, 2, j], curve[i - 1, 3, j]
            end, start = first + (2.0 * second + 3.0 * third * h) * h, curve[i, 1, j]
            before, after, gap = max(before, abs(end)), max(after, abs(start)), max(gap, abs(start - end))
        if gap > least * (before + after + least):
            kinks[found] = i
            found += 1
    return found
