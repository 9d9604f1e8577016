"""Optimization of the rate along a time law within limits, by an interior-point method.

A quadratic spline y(tau) > 0 minimizes the duration, with Y = (y, y', y'') at P points within limits:

    min sum_p w_p / sqrt(y_p)   subject to   |g . Y_p + c| <= 1,   |j . Y_p| <= 1 / sqrt(y_p).

Each step is one of Newton's method for multiplier times slack = mu, where mu falls (primal-dual methods: J.
Nocedal and S. Wright, Numerical Optimization, 2006, chapter 19).  Three coefficients of y act at a point, so
that the matrix is banded.  As 1 / sqrt(y) is convex, slacks after a step are at least those of the tangents,
and no step reduces those to zero: all iterates keep all limits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.path_blocks import factorize_band, solve_band
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3

POINTS = 3
"""Number of points in each segment of the spline."""

_BEGIN = 0.9  # start of the search, relative to the maximum constant rate
_FIRST = 4.0  # initial sum of multipliers times slacks, relative to the duration
_FALL = 0.1  # factor of mu in a step
_REACH = 0.99  # fraction of the step at which a slack or a multiplier would be zero
_ROUNDING = 1e-14  # increase of diagonal entries, relative
_FAR = 1e9  # lower bound of rows without one


class RateProgram(NamedTuple):
    """Limits on y at P points, whose spline has K = P / 3 segments and K + 2 coefficients.

    Attributes:
        basis: y, y' and y'' at the points for the three coefficients that act there, shape (P, 3, 3).
        weight: Quadrature weights of the points in tau [s], shape (P,).
        rows: Gains on y, y' and y'' and values at rest of R quantities, shape (R, 4, P): jerk first, then
            quantities bounded by +-1, then quantities bounded above by 1.
        jerk: Number of rows of jerk.
        both: Number of rows with two bounds, including jerk.
    """

    basis: Floats3
    weight: Floats1
    rows: Floats3
    jerk: int
    both: int


class _Sums(NamedTuple):
    """Sums over all limits at the points, shape (P,) each.

    Attributes:
        aa: Matrix entries in y and y; ab, ac, bb, bc, cc likewise in y, y' and y''.
        a: Right-hand side in y for mu = 1; b and c likewise in y' and y''.
        products: Sums of multipliers times slacks.
        jerk: Sums of the multipliers of jerk.
    """

    aa: Floats1
    ab: Floats1
    ac: Floats1
    bb: Floats1
    bc: Floats1
    cc: Floats1
    a: Floats1
    b: Floats1
    c: Floats1
    products: Floats1
    jerk: Floats1


@compiled("float64(RateProgram)", lean=True)
def greatest_even_rate(program: RateProgram) -> float:
    """Return the maximum constant y that keeps all limits; 0 if rest violates a limit at some point."""
    rows, y = program.rows, np.inf
    for r in range(rows.shape[0]):
        for p in range(rows.shape[2]):
            gain, rest = rows[r, 0, p], rows[r, 3, p]
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
    """Write the coefficients of a locally optimal y; return the duration.

    Args:
        program: The limits, which some constant rate keeps.
        y: Output: coefficients, shape (K + 2,).
        gap: Optimality gap, relative to the duration, at which to stop: the sum of all multipliers times
            slacks, which bounds the excess duration of a convex program.
        steps: Maximum number of steps.

    Returns:
        The duration [s]; inf if rest violates a limit at some point.
    """
    rows, count = program.rows, program.weight.size
    multiplier, change = np.empty((2, rows.shape[0], count)), np.empty((2, rows.shape[0], count))
    limits, state, most = multiplier.size, np.empty((8, count)), np.empty(2)
    band, step = np.empty((y.size, 3)), np.empty(y.size)
    even = greatest_even_rate(program)
    if even == 0.0:
        return np.inf
    y[:] = _BEGIN * even
    duration = _evaluate(program, y, state)
    _first_multipliers(program, state, _FIRST * duration / limits, multiplier)
    for _ in range(steps):
        left = _write_system(program, state, multiplier, _FALL / limits, band, step)
        if left <= gap * duration or not factorize_band(band):
            break
        solve_band(band, step)
        most[:] = _REACH
        for k in range(y.size):
            most[0] = max(most[0], -step[k] / y[k])
        _change(program, multiplier, step, _FALL * left / limits, state, change, most)
        y += _REACH / most[0] * step
        _add_share(multiplier, _REACH / most[1], change)
        duration = _evaluate(program, y, state)
    return duration


@compiled(lean=True)
def _evaluate(program: RateProgram, y: Floats1, state: Floats2) -> float:
    """Write Y, 1 / sqrt(y) and its derivative in y at the points, shape (>= 5, P); return the duration."""
    duration = 0.0
    for p in range(program.weight.size):
        for d in range(3):
            state[d, p] = 0.0
            for k in range(3):
                state[d, p] += program.basis[p, d, k] * y[p // POINTS + k]
        state[3, p] = 1.0 / math.sqrt(state[0, p])
        state[4, p] = -0.5 * state[3, p] / state[0, p]
        duration += program.weight[p] * state[3, p]
    return duration


@compiled(lean=True)
def _bounds(program: RateProgram, r: int) -> tuple[float, float]:
    """Return 1 if a row's bound is 1 / sqrt(y), else 0, and how much wider its lower bound is."""
    return 1.0 if r < program.jerk else 0.0, 0.0 if r < program.both else _FAR


@compiled(lean=True)
def _first_multipliers(program: RateProgram, state: Floats2, mu: float, multiplier: Floats3) -> None:
    """Write multipliers whose products with the slacks are mu, shape (2, R, P)."""
    rows = program.rows
    for r in range(rows.shape[0]):
        jerk, wider = _bounds(program, r)
        for p in range(rows.shape[2]):
            value, bound = rows[r, 3, p], 1.0 + jerk * (state[3, p] - 1.0)
            for d in range(3):
                value += rows[r, d, p] * state[d, p]
            multiplier[0, r, p], multiplier[1, r, p] = mu / (bound - value), mu / (bound + wider + value)


@compiled(vector=True)
def _add_up(program: RateProgram, state: Floats2, multiplier: Floats3) -> _Sums:
    """Return the sums over all limits at the points.

    They are computed in new arrays, which do not overlap others, so that points are vectorized.
    """
    rows, count = program.rows, program.weight.size
    aa, ab, ac, bb = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    bc, cc, a_sum, b_sum = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    c_sum, products, jerks = np.zeros(count), np.zeros(count), np.zeros(count)
    for r in range(rows.shape[0]):
        jerk, wider = _bounds(program, r)
        for p in range(count):
            a, b, c, steep = rows[r, 0, p], rows[r, 1, p], rows[r, 2, p], jerk * state[4, p]
            value = a * state[0, p] + b * state[1, p] + c * state[2, p] + rows[r, 3, p]
            bound, upper, lower = 1.0 + jerk * (state[3, p] - 1.0), multiplier[0, r, p], multiplier[1, r, p]
            above, below = bound - value, bound + wider + value
            inverse, other = 1.0 / above, 1.0 / below
            high, low, left, right = upper * inverse, lower * other, steep - a, steep + a
            both, slope = high + low, low * right - high * left
            aa[p] += high * left * left + low * right * right
            ab[p] += slope * b
            ac[p] += slope * c
            bb[p] += both * b * b
            bc[p] += both * b * c
            cc[p] += both * c * c
            a_sum[p] += inverse * left + other * right
            b_sum[p] += (other - inverse) * b
            c_sum[p] += (other - inverse) * c
            products[p] += upper * above + lower * below
            jerks[p] += jerk * (upper + lower)
    return _Sums(aa, ab, ac, bb, bc, cc, a_sum, b_sum, c_sum, products, jerks)


@compiled
def _write_system(
    program: RateProgram, state: Floats2, multiplier: Floats3, fall: float, band: Floats2, right: Floats1
) -> float:
    """Write the matrix of a step and its right-hand side; return the sum of multipliers times slacks.

    Args:
        program: The limits.
        state: Values at the points, see `_evaluate`, shape (>= 5, P).
        multiplier: Multipliers, shape (2, R, P).
        fall: Ratio of mu to that sum.
        band: Output: lower band of the matrix, shape (K + 2, 3).
        right: Output: right-hand side, shape (K + 2,).
    """
    sums, left = _add_up(program, state, multiplier), 0.0
    for p in range(state.shape[1]):
        left += sums.products[p]
    for i in range(right.size):
        right[i] = band[i, 0] = band[i, 1] = band[i, 2] = 0.0
    for p in range(state.shape[1]):
        weight, ab, ac, bc = program.weight[p], sums.ab[p], sums.ac[p], sums.bc[p]
        curvature = -1.5 * (weight - sums.jerk[p]) * state[4, p] / state[0, p]
        aa, bb, cc = sums.aa[p] + max(curvature, 0.0), sums.bb[p], sums.cc[p]
        a_sum, basis, begin = fall * left * sums.a[p] - weight * state[4, p], program.basis[p], p // POINTS
        for k in range(3):
            u, v, w = basis[0, k], basis[1, k], basis[2, k]
            right[begin + k] += u * a_sum + fall * left * (v * sums.b[p] + w * sums.c[p])
            a, b, c = aa * u + ab * v + ac * w, ab * u + bb * v + bc * w, ac * u + bc * v + cc * w
            for other in range(k + 1):
                value = a * basis[0, other] + b * basis[1, other] + c * basis[2, other]
                band[begin + k, 2 - k + other] += value
    for i in range(right.size):
        band[i, 2] *= 1.0 + _ROUNDING
    return left


@compiled(vector=True)
def _change(
    program: RateProgram, multiplier: Floats3, step: Floats1, mu: float, state: Floats2, change: Floats3,
    most: Floats1,
) -> None:  # fmt: skip
    """Write the changes of multipliers, and the maximum ratios by which multipliers and slacks shrink.

    Args:
        program: The limits.
        multiplier: Multipliers, shape (2, R, P).
        step: Change of the coefficients, shape (K + 2,).
        mu: Target of multiplier times slack.
        state: Values at the points, see `_evaluate`; the changes of Y are output, shape (8, P).
        change: Output: changes of the multipliers, shape (2, R, P).
        most: Maximum ratios of slacks and of multipliers, increased where exceeded, shape (2,).
    """
    rows, count = program.rows, program.weight.size
    for p in range(count):
        for d in range(3):
            state[5 + d, p] = 0.0
            for k in range(3):
                state[5 + d, p] += program.basis[p, d, k] * step[p // POINTS + k]
    shrink, fall = most[0], most[1]
    highest, lowest = np.empty(count), np.empty(count)
    for r in range(rows.shape[0]):
        jerk, wider = _bounds(program, r)
        for p in range(count):
            a, b, c, steep = rows[r, 0, p], rows[r, 1, p], rows[r, 2, p], jerk * state[4, p] * state[5, p]
            value = a * state[0, p] + b * state[1, p] + c * state[2, p] + rows[r, 3, p]
            growth = a * state[5, p] + b * state[6, p] + c * state[7, p]
            bound, upper, lower = 1.0 + jerk * (state[3, p] - 1.0), multiplier[0, r, p], multiplier[1, r, p]
            inverse, other = 1.0 / (bound - value), 1.0 / (bound + wider + value)
            less, down = (growth - steep) * inverse, -(growth + steep) * other
            high, low = mu * inverse + upper * less, mu * other + lower * down
            highest[p], lowest[p] = high - upper, low - lower
            shrink = max(shrink, max(less, down))
            fall = max(fall, max(1.0 - high / upper, 1.0 - low / lower))
        for p in range(count):
            change[0, r, p], change[1, r, p] = highest[p], lowest[p]
    most[0], most[1] = shrink, fall


@compiled(lean=True)
def _add_share(multiplier: Floats3, share: float, change: Floats3) -> None:
    """Add a fraction of the changes to the multipliers, shape (2, R, P) each."""
    for side in range(2):
        for r in range(multiplier.shape[1]):
            for p in range(multiplier.shape[2]):
                multiplier[side, r, p] += share * change[side, r, p]
