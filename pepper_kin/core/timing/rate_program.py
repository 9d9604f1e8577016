"""The fastest rate along a time law within limits, by an interior-point method.

A quadratic spline y(tau) > 0 minimizes the duration, with Y = (y, y', y'') at P points within limits:

    min sum_p w_p / sqrt(y_p)   subject to   |g . Y_p + c| <= 1,   |j . Y_p| <= 1 / sqrt(y_p).

Each step is one of Newton's method for multiplier times slack = mu, where mu falls (primal-dual methods: J.
Nocedal and S. Wright, Numerical Optimization, 2006, chapter 19).  Three coefficients of y act at a point, so
that the matrix is a band.  As 1 / sqrt(y) is convex, slacks after a step are at least those of the tangents,
which no step uses up: all iterates keep all limits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.path_blocks import factorize_band, solve_band
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3

POINTS = 4
"""Points of each piece of the spline."""

_BEGIN = 0.9  # of the greatest even rate, where the search starts
_FIRST = 4.0  # sum of multipliers times slacks at first, as a share of the duration
_FALL = 0.1  # of mu in a step
_REACH = 0.99  # of the way to where a slack or a multiplier would be zero
_ROUNDING = 1e-14  # of a diagonal
_SUMS = 11  # matrix at a point (6), its right-hand side for mu = 1 (3), multipliers times slacks, multipliers


class RateProgram(NamedTuple):
    """Limits on y at P points, whose spline has K = P / 4 pieces and K + 2 coefficients.

    Attributes:
        basis: y, y' and y'' at the points for the three coefficients that act there, shape (P, 3, 3).
        weight: Of the points in integrals over tau [s], shape (P,).
        rows: Gains on y, y' and y'' and values at rest of R quantities, shape (P, 4, R): jerk first, then
            what must stay within +-1, then what must stay below 1.
        jerk: Number of rows of jerk.
        both: Number of rows with two bounds, those of jerk among them.
    """

    basis: Floats3
    weight: Floats1
    rows: Floats3
    jerk: int
    both: int


@compiled("float64(RateProgram)", lean=True)
def greatest_even_rate(program: RateProgram) -> float:
    """Return the greatest constant y that keeps all limits; 0 where rest at some point does not."""
    rows, y = program.rows, np.inf
    for p in range(rows.shape[0]):
        for r in range(rows.shape[2]):
            gain, rest = rows[p, 0, r], rows[p, 3, r]
            if r < program.jerk:
                y = min(y, abs(gain) ** (-2 / 3)) if gain != 0 else y
            elif rest >= 1 or (r < program.both and rest <= -1):
                return 0.0
            elif gain > 0:
                y = min(y, (1 - rest) / gain)
            elif gain < 0 and r < program.both:
                y = min(y, (-1 - rest) / gain)
    return y


@compiled("float64(RateProgram, float64[::1], float64, int64)")
def fastest_rate(program: RateProgram, y: Floats1, gap: float, steps: int) -> float:
    """Write coefficients of a y that is a local optimum.

    Args:
        program: The limits, which some even rate keeps.
        y: Receives the coefficients, shape (K + 2,).
        gap: Share of the duration at which to stop: the sum of all multipliers times slacks, by which
            the duration of a convex program is above the least.
        steps: Number of steps at most.

    Returns:
        The duration [s]; inf where some point is none at which to rest.
    """
    rows, count = program.rows, program.rows.shape[0]
    limits = program.both + rows.shape[2]
    multiplier, change = np.empty((2, count, rows.shape[2])), np.zeros((2, count, rows.shape[2]))
    state, sums, most = np.empty((count, 9)), np.empty((count, _SUMS)), np.empty(2)
    band, step = np.empty((y.size, 3)), np.empty(y.size)
    even = greatest_even_rate(program)
    if even == 0.0:
        return np.inf
    y[:] = _BEGIN * even
    duration = _evaluate(program, y, state)
    _first_multipliers(program, state, _FIRST * duration / (limits * count), multiplier)
    for _ in range(steps):
        _add_up(program, multiplier, state, sums)
        left = sums[:, 9].sum()
        if left <= gap * duration:
            break
        mu = _FALL * left / (limits * count)
        _write_system(program, state, sums, mu, band, step)
        if not factorize_band(band):
            break
        solve_band(band, step)
        most[:] = _REACH
        for k in range(y.size):
            most[0] = max(most[0], -step[k] / y[k])
        _change(program, multiplier, step, mu, state, change, most)
        y += _REACH / most[0] * step
        _add_share(multiplier, _REACH / most[1], change)
        duration = _evaluate(program, y, state)
    return duration


@compiled(lean=True)
def _evaluate(program: RateProgram, y: Floats1, state: Floats2) -> float:
    """Write Y, 1 / sqrt(y) and its derivative in y at the points, shape (P, >= 5); return the duration."""
    duration = 0.0
    for p in range(state.shape[0]):
        for d in range(3):
            state[p, d] = 0.0
            for k in range(3):
                state[p, d] += program.basis[p, d, k] * y[p // POINTS + k]
        state[p, 3] = 1.0 / math.sqrt(state[p, 0])
        state[p, 4] = -0.5 * state[p, 3] / state[p, 0]
        duration += program.weight[p] * state[p, 3]
    return duration


@compiled(lean=True)
def _first_multipliers(program: RateProgram, state: Floats2, mu: float, multiplier: Floats3) -> None:
    """Write multipliers whose products with the slacks are mu, shape (2, P, R)."""
    rows = program.rows
    for p in range(rows.shape[0]):
        for r in range(rows.shape[2]):
            value = rows[p, 3, r]
            for d in range(3):
                value += rows[p, d, r] * state[p, d]
            bound = state[p, 3] if r < program.jerk else 1.0
            multiplier[0, p, r] = mu / (bound - value)
            multiplier[1, p, r] = mu / (bound + value) if r < program.both else 0.0


@compiled(lean=True)
def _add_up(program: RateProgram, multiplier: Floats3, state: Floats2, sums: Floats2) -> None:
    """Write the sums over all limits at each point, shape (P, 11)."""
    jerk, both, rows = program.jerk, program.both, program.rows
    for p in range(rows.shape[0]):
        at, own, upper, lower = state[p], sums[p], multiplier[0, p], multiplier[1, p]
        for k in range(_SUMS):
            own[k] = 0.0
        _add_rows(rows[p], upper, (0, jerk), (1.0, at[3], at[4]), at, own)
        _add_rows(rows[p], lower, (0, jerk), (-1.0, at[3], at[4]), at, own)
        curvature = 0.75 * (program.weight[p] - own[10]) * at[3] / (at[0] * at[0])
        own[0] += max(curvature, 0.0)
        _add_rows(rows[p], upper, (jerk, rows.shape[2]), (1.0, 1.0, 0.0), at, own)
        _add_rows(rows[p], lower, (jerk, both), (-1.0, 1.0, 0.0), at, own)


@compiled(lean=True, vector=True)
def _add_rows(
    rows: Floats2, multiplier: Floats1, columns: tuple[int, int], side: tuple[float, float, float],
    at: Floats1, sums: Floats1,
) -> None:  # fmt: skip
    """Add one side of some rows at a point to its sums.

    Args:
        rows: Shape (4, R).
        multiplier: Shape (R,).
        columns: First row, and that after the last.
        side: 1 for upper bounds or -1 for lower ones, the bound and its derivative in y.
        at: Y, shape (>= 3,).
        sums: Shape (11,).
    """
    (sign, bound, slope), y, first, second = side, at[0], at[1], at[2]
    aa, ab, ac, bb, bc, cc = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    a_sum, b_sum, c_sum, products, total = 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(columns[0], columns[1]):
        a, b, c = sign * rows[0, r], sign * rows[1, r], sign * rows[2, r]
        slack = bound - (a * y + b * first + c * second + sign * rows[3, r])
        inverse, a = 1.0 / slack, a - slope
        a_sum, b_sum, c_sum = a_sum - inverse * a, b_sum - inverse * b, c_sum - inverse * c
        products, total = products + multiplier[r] * slack, total + multiplier[r]
        weight = multiplier[r] * inverse
        aa, ab, ac = aa + weight * a * a, ab + weight * a * b, ac + weight * a * c
        bb, bc, cc = bb + weight * b * b, bc + weight * b * c, cc + weight * c * c
    sums[0], sums[1], sums[2], sums[3] = sums[0] + aa, sums[1] + ab, sums[2] + ac, sums[3] + bb
    sums[4], sums[5], sums[6], sums[7] = sums[4] + bc, sums[5] + cc, sums[6] + a_sum, sums[7] + b_sum
    sums[8], sums[9], sums[10] = sums[8] + c_sum, sums[9] + products, sums[10] + total


@compiled(lean=True)
def _write_system(
    program: RateProgram, state: Floats2, sums: Floats2, mu: float, band: Floats2, right: Floats1
) -> None:
    """Write the matrix of a step as a lower band, shape (K + 2, 3), and its right side, shape (K + 2,)."""
    for i in range(right.size):
        right[i] = band[i, 0] = band[i, 1] = band[i, 2] = 0.0
    for p in range(sums.shape[0]):
        aa, ab, ac, bb, bc, cc = sums[p, 0], sums[p, 1], sums[p, 2], sums[p, 3], sums[p, 4], sums[p, 5]
        a_sum = mu * sums[p, 6] - program.weight[p] * state[p, 4]
        basis, begin = program.basis[p], p // POINTS
        for k in range(3):
            u, v, w = basis[0, k], basis[1, k], basis[2, k]
            right[begin + k] += u * a_sum + mu * (v * sums[p, 7] + w * sums[p, 8])
            a, b, c = aa * u + ab * v + ac * w, ab * u + bb * v + bc * w, ac * u + bc * v + cc * w
            for other in range(k + 1):
                value = a * basis[0, other] + b * basis[1, other] + c * basis[2, other]
                band[begin + k, 2 - k + other] += value
    for i in range(right.size):
        band[i, 2] *= 1.0 + _ROUNDING


@compiled(lean=True)
def _change(
    program: RateProgram, multiplier: Floats3, step: Floats1, mu: float, state: Floats2, change: Floats3,
    most: Floats1,
) -> None:  # fmt: skip
    """Write the changes of multipliers, shape (2, P, R), and by which share slacks and these shrink at most.

    `most` keeps the greater of what it has and the shares of slacks and of multipliers, shape (2,).
    """
    jerk, both, rows = program.jerk, program.both, program.rows
    for p in range(rows.shape[0]):
        at, upper, lower = state[p], multiplier[0, p], multiplier[1, p]
        for d in range(3):
            at[5 + d] = 0.0
            for k in range(3):
                at[5 + d] += program.basis[p, d, k] * step[p // POINTS + k]
        at[8] = mu
        _change_rows(rows[p], upper, (0, jerk), (1.0, at[3], at[4]), at, change[0, p], most)
        _change_rows(rows[p], lower, (0, jerk), (-1.0, at[3], at[4]), at, change[1, p], most)
        _change_rows(rows[p], upper, (jerk, rows.shape[2]), (1.0, 1.0, 0.0), at, change[0, p], most)
        _change_rows(rows[p], lower, (jerk, both), (-1.0, 1.0, 0.0), at, change[1, p], most)


@compiled(lean=True, vector=True)
def _change_rows(
    rows: Floats2, multiplier: Floats1, columns: tuple[int, int], side: tuple[float, float, float],
    at: Floats1, change: Floats1, most: Floats1,
) -> None:  # fmt: skip
    """Do what `_change` does for one side of some rows at a point.

    Args:
        rows: Shape (4, R).
        multiplier: Shape (R,).
        columns: First row, and that after the last.
        side: 1 for upper bounds or -1 for lower ones, the bound and its derivative in y.
        at: Y, two numbers, changes of Y, and mu, shape (9,).
        change: Written, shape (R,).
        most: Shape (2,).
    """
    (sign, bound, slope), y, first, second = side, at[0], at[1], at[2]
    dy, dfirst, dsecond, mu = at[5], at[6], at[7], at[8]
    shrink, fall = most[0], most[1]
    for r in range(columns[0], columns[1]):
        a, b, c = sign * rows[0, r], sign * rows[1, r], sign * rows[2, r]
        inverse = 1.0 / (bound - (a * y + b * first + c * second + sign * rows[3, r]))
        less = (a * dy + b * dfirst + c * dsecond - slope * dy) * inverse
        grown = mu * inverse + multiplier[r] * less
        change[r] = grown - multiplier[r]
        shrink, fall = max(shrink, less), max(fall, 1.0 - grown / multiplier[r])
    most[0], most[1] = shrink, fall


@compiled(lean=True)
def _add_share(multiplier: Floats3, share: float, change: Floats3) -> None:
    """Add a share of the changes to the multipliers."""
    for side in range(2):
        for p in range(multiplier.shape[1]):
            for r in range(multiplier.shape[2]):
                multiplier[side, p, r] += share * change[side, p, r]
