"""Piecewise polynomials: evaluation at many arguments, and the cubic spline through points."""

from __future__ import annotations

from functools import lru_cache
from math import comb

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled


@compiled("void(float64[::1], float64[:, :, ::1], float64[::1], float64[:, :, ::1])")
def evaluate_at_times(breaks: Array, coefficients: Array, time: Array, state: Array) -> None:
    """Evaluate a piecewise polynomial and its derivatives.

    At a break the values are of the later segment, at the end of the last.  Ascending times cost least.

    Args:
        breaks: Ends of the segments, ascending, shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
        time: Times within the breaks, shape (T,).
        state: Output: the value and the first derivatives, shape (d, T, n), 1 <= d <= 4.
    """
    segment, local = np.empty(time.size, np.int64), np.empty(time.size)
    last, i = breaks.size - 2, 0
    for k in range(time.size):
        t = time[k]
        if t < breaks[i] or (i < last and t >= breaks[min(i + 8, last)]):
            i, beyond = 0, last + 1  # breaks[i] <= t < breaks[beyond]
            while beyond - i > 1:
                middle = (i + beyond) // 2
                if t < breaks[middle]:
                    beyond = middle
                else:
                    i = middle
        while i < last and t >= breaks[i + 1]:
            i += 1
        segment[k], local[k] = i, t - breaks[i]
    evaluate_on_segments(coefficients, segment, local, state)


@compiled("void(float64[:, :, ::1], int64[::1], float64[::1], float64[:, :, ::1])")
def evaluate_on_segments(coefficients: Array, segment: np.ndarray, local: Array, state: Array) -> None:
    """Evaluate the polynomials of given segments and their derivatives by Horner's scheme.

    Args:
        coefficients: Constant term first, shape (m, k, n).
        segment: Indices of segments, shape (T,).
        local: Arguments, shape (T,).
        state: Output: the value and the first derivatives, shape (d, T, n), 1 <= d <= 4.
    """
    if state.shape[0] == 3 and coefficients.shape[1] == 7:
        _evaluate_degree_six(coefficients, segment, local, state)
    elif state.shape[0] == 3:
        _evaluate_states(coefficients, segment, local, state)
    else:
        _evaluate_derivatives(coefficients, segment, local, state)


@compiled
def _evaluate_derivatives(coefficients: Array, segment: np.ndarray, local: Array, state: Array) -> None:
    """Evaluate any number of derivatives; arguments and shapes as in `evaluate_on_segments`."""
    order, count, n = coefficients.shape[1], state.shape[0], coefficients.shape[2]
    for k in range(segment.size):
        i, x = segment[k], local[k]
        for d in range(count):
            for j in range(n):
                state[d, k, j] = 0.0
        for power in range(order - 1, -1, -1):
            for d in range(count - 1, 0, -1):
                for j in range(n):
                    state[d, k, j] = state[d, k, j] * x + state[d - 1, k, j]
            for j in range(n):
                state[0, k, j] = state[0, k, j] * x + coefficients[i, power, j]
        factor = 1.0
        for d in range(2, count):
            factor *= d
            for j in range(n):
                state[d, k, j] *= factor


@compiled
def _evaluate_states(coefficients: Array, segment: np.ndarray, local: Array, state: Array) -> None:
    """Evaluate a value and two derivatives at once; arguments and shapes as in `evaluate_on_segments`.

    The sums are computed in new arrays, which do not overlap others, so that joints are vectorized.
    """
    order, n = coefficients.shape[1], coefficients.shape[2]
    value, slope, bend = np.empty(n), np.empty(n), np.empty(n)
    for k in range(segment.size):
        i, x = segment[k], local[k]
        for j in range(n):
            value[j], slope[j], bend[j] = coefficients[i, order - 1, j], 0.0, 0.0
        for power in range(order - 2, -1, -1):
            for j in range(n):
                bend[j] = bend[j] * x + slope[j]
                slope[j] = slope[j] * x + value[j]
                value[j] = value[j] * x + coefficients[i, power, j]
        for j in range(n):
            state[0, k, j] = value[j]
        for j in range(n):
            state[1, k, j] = slope[j]
        for j in range(n):
            state[2, k, j] = 2 * bend[j]


@compiled
def _evaluate_degree_six(coefficients: Array, segment: np.ndarray, local: Array, state: Array) -> None:
    """Carry out `_evaluate_states` for degree six, the degree of timed paths; same arguments and shapes."""
    n = coefficients.shape[2]
    value, slope, bend = np.empty(n), np.empty(n), np.empty(n)
    for k in range(segment.size):
        i, x = segment[k], local[k]
        for j in range(n):
            p = coefficients[i, 6, j]
            d = p
            p = p * x + coefficients[i, 5, j]
            e = d
            d = d * x + p
            p = p * x + coefficients[i, 4, j]
            e = e * x + d
            d = d * x + p
            p = p * x + coefficients[i, 3, j]
            e = e * x + d
            d = d * x + p
            p = p * x + coefficients[i, 2, j]
            e = e * x + d
            d = d * x + p
            p = p * x + coefficients[i, 1, j]
            bend[j] = e * x + d
            slope[j] = d * x + p
            value[j] = p * x + coefficients[i, 0, j]
        for j in range(n):
            state[0, k, j] = value[j]
        for j in range(n):
            state[1, k, j] = slope[j]
        for j in range(n):
            state[2, k, j] = 2 * bend[j]


@compiled("void(float64[:, ::1], float64[::1], float64[:, :, ::1])")
def cubic_spline(points: Array, breaks: Array, coefficients: Array) -> None:
    """Compute the C2 cubic through points over the chord length, with unit speed along the end chords.

    The slopes at the points solve a tridiagonal system (de Boor, A Practical Guide to Splines, chapter 4),
    solved by elimination without pivoting, because its diagonal dominates.

    Args:
        points: Points, successive ones different, shape (k, n) [rad or m].
        breaks: Output: chord lengths up to the points, shape (k,).
        coefficients: Output: segments, constant term first, shape (k - 1, 4, n).
    """
    k, n = points.shape
    slope, upper = np.empty((k, n)), np.empty(k)
    breaks[0] = 0.0
    for i in range(k - 1):
        square = 0.0
        for j in range(n):
            square += (points[i + 1, j] - points[i, j]) ** 2
        breaks[i + 1] = breaks[i] + np.sqrt(square)
    for i in range(k):
        left = breaks[i] - breaks[i - 1] if i > 0 else 0.0
        right = breaks[i + 1] - breaks[i] if i < k - 1 else 0.0
        inside = 0 < i < k - 1
        pivot = 2 * (left + right) - right * upper[i - 1] if inside else 1.0
        upper[i] = left / pivot if inside else 0.0
        for j in range(n):
            before = (points[i, j] - points[i - 1, j]) / left if i > 0 else 0.0
            after = (points[i + 1, j] - points[i, j]) / right if i < k - 1 else 0.0
            if inside:
                slope[i, j] = (3 * (right * before + left * after) - right * slope[i - 1, j]) / pivot
            else:
                slope[i, j] = before + after
    for i in range(k - 2, 0, -1):
        for j in range(n):
            slope[i, j] -= upper[i] * slope[i + 1, j]
    for i in range(k - 1):
        h = breaks[i + 1] - breaks[i]
        for j in range(n):
            chord = (points[i + 1, j] - points[i, j]) / h
            coefficients[i, 0, j] = points[i, j]
            coefficients[i, 1, j] = slope[i, j]
            coefficients[i, 2, j] = (3 * chord - 2 * slope[i, j] - slope[i + 1, j]) / h
            coefficients[i, 3, j] = (slope[i, j] + slope[i + 1, j] - 2 * chord) / (h * h)


@compiled("float64(float64[:, ::1])")
def polyline_length(points: Array) -> float:
    """Return the length of a polyline through points, shape (k, n) [rad and m mixed]."""
    length = 0.0
    for i in range(1, points.shape[0]):
        square = 0.0
        for j in range(points.shape[1]):
            square += (points[i, j] - points[i - 1, j]) ** 2
        length += np.sqrt(square)
    return length


@compiled("float64(float64[::1], float64[:, :, ::1], float64[::1], float64[::1])", lean=True)
def greatest_violation(breaks: Array, coefficients: Array, lower: Array, upper: Array) -> float:
    """Return the maximum violation of bounds by a piecewise cubic, negative if it stays inside.

    Args:
        breaks: Ends of the segments, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n).
        lower: Lower bounds, shape (n,), in the units of the coefficients.
        upper: Upper bounds, shape (n,), in the units of the coefficients.
    """
    worst = -np.inf
    segments, _, n = coefficients.shape
    for i in range(segments):
        h = breaks[i + 1] - breaks[i]
        for j in range(n):
            q, c = coefficients[i, 0, j], coefficients[i, 1, j]
            b, a = coefficients[i, 2, j], coefficients[i, 3, j]
            # Between its ends a cubic has extrema where 3 a x^2 + 2 b x + c = 0.
            disc = b * b - 3 * a * c
            root = np.sqrt(disc) if disc > 0 else 0.0
            w = -(b + root if b >= 0 else b - root)
            for x in (0.0, h, w / (3 * a) if a != 0 else 0.0, c / w if w != 0 else 0.0):
                if 0 <= x <= h:
                    value = q + x * (c + x * (b + x * a))
                    worst = max(worst, lower[j] - value, value - upper[j])
    return worst


@compiled("float64(float64[:, ::1], float64[::1], float64[::1], float64, float64[::1], float64[:, :, ::1])")
def bounded_cubic_spline(
    points: Array, lower: Array, upper: Array, same: float, breaks: Array, coefficients: Array
) -> float:
    """Compute a `cubic_spline` and return its `greatest_violation` of bounds.

    Args:
        points: Points, shape (k, n) [rad or m].
        lower: Lower bounds, shape (n,) [rad or m].
        upper: Upper bounds, shape (n,) [rad or m].
        same: Distance up to which successive points count as the same.
        breaks: Output, see `cubic_spline`, shape (k,).
        coefficients: Output, see `cubic_spline`, shape (k - 1, 4, n).

    Returns:
        The violation; inf if points are not finite or successive points are the same.
    """
    for i in range(points.shape[0]):
        square = 0.0
        for j in range(points.shape[1]):
            if not np.isfinite(points[i, j]):
                return np.inf
            if i > 0:
                square += (points[i, j] - points[i - 1, j]) ** 2
        if i > 0 and np.sqrt(square) <= same:
            return np.inf
    cubic_spline(points, breaks, coefficients)
    return greatest_violation(breaks, coefficients, lower, upper)


def derivatives_on_segments(coefficients: Array, segment: ArrayLike, local: ArrayLike, count: int) -> Array:
    """Return value and first derivatives of the polynomials of given segments, for arrays that broadcast.

    Args:
        coefficients: Constant term first, shape (m, k, n).
        segment: Indices of segments, negative ones from the end, shape (...).
        local: Arguments, shape (...).
        count: Number of derivatives including the value, at most 4.

    Returns:
        Derivatives, shape (count, ..., n).

    Raises:
        IndexError: for a segment that does not exist.
    """
    index, argument = np.broadcast_arrays(np.asarray(segment, np.int64), np.asarray(local, dtype=float))
    segments, _, n = coefficients.shape
    state = np.empty((count, *index.shape, n))
    if index.size:
        if not (-segments <= index.min() and index.max() < segments):
            raise IndexError(f"pieces {index.min()} to {index.max()} of a curve of {segments}")
        index = np.ascontiguousarray(np.where(index < 0, index + segments, index).ravel())
        argument = np.ascontiguousarray(argument.ravel())
        evaluate_on_segments(coefficients, index, argument, state.reshape(count, index.size, n))
    return state


def quintic_hermite(step: Array, value: Array, slope: Array, bend: Array) -> Array:
    """Return the quintics with given values, first and second derivatives at the ends.

    Args:
        step: Lengths of the segments, shape (m,).
        value: Values at the ends of the segments, shape (m + 1, n).
        slope: First derivatives at the ends, shape (m + 1, n).
        bend: Second derivatives at the ends, shape (m + 1, n).

    Returns:
        Coefficients, constant term first, shape (m, 6, n).
    """
    h = step[:, None]
    # Differences at the end of a segment from the Taylor polynomial of its start.
    d0 = value[1:] - value[:-1] - h * slope[:-1] - h**2 / 2 * bend[:-1]
    d1 = slope[1:] - slope[:-1] - h * bend[:-1]
    d2 = bend[1:] - bend[:-1]
    cubic = (10 * d0 - 4 * h * d1 + h**2 / 2 * d2) / h**3
    quartic = (-15 * d0 + 7 * h * d1 - h**2 * d2) / h**4
    quintic = (6 * d0 - 3 * h * d1 + h**2 / 2 * d2) / h**5
    return np.stack([value[:-1], slope[:-1], bend[:-1] / 2, cubic, quartic, quintic], axis=1)


@compiled("boolean(float64[::1], float64, float64)", lean=True)
def clamp(values: Array, greatest: float, slack: float) -> bool:
    """Clamp values, shape (T,), to [0, greatest]; return whether none exceeded it by more than the slack."""
    for k in range(values.size):
        if not (values[k] >= -slack and values[k] <= greatest + slack):  # also true for NaN
            return False
        values[k] = min(max(values[k], 0.0), greatest)
    return True


@compiled(
    "Tuple(int64, int64)(float64[::1], float64[:, :, ::1], float64[::1], float64, float64[::1], "
    "float64[:, :, ::1])"
)
def cut_out(
    breaks: Array, coefficients: Array, ends: Array, apart: float, knots: Array, pieces: Array
) -> tuple[int, int]:
    """Write the part of a piecewise polynomial between two arguments, shifted so that it starts at 0.

    Args:
        breaks: Ends of the segments, ascending, shape (m + 1,).
        coefficients: Constant term first, shape (m, k, n).
        ends: The two arguments, shape (2,).
        apart: Distance from one of them up to which breaks are left out.
        knots: Output: breaks of the part, in the first entries of shape (m + 1,).
        pieces: Output: coefficients of the part, shape (m, k, n).

    Returns:
        The number of segments, and the number of coefficients up to the highest power that is not zero.
    """
    powers, n, last = coefficients.shape[1], coefficients.shape[2], breaks.size - 2
    count, order, i, begin = 0, 1, 0, ends[0]
    while begin < ends[1]:
        k = i  # the next break
        while k <= last and breaks[k] <= begin + apart:
            k += 1
        finish = breaks[k] if k <= last and breaks[k] < ends[1] - apart else ends[1]
        middle = 0.5 * (begin + finish)
        while i < last and breaks[i + 1] <= middle:
            i += 1
        by = begin - breaks[i]
        for p in range(powers):
            for j in range(n):
                pieces[count, p, j] = coefficients[i, p, j]
        for p in range(order, powers):
            for j in range(n):
                if coefficients[i, p, j] != 0.0:
                    order = p + 1
        if by != 0.0:  # repeated Horner: the Taylor shift
            for first in range(powers - 1):
                for p in range(powers - 2, first - 1, -1):
                    for j in range(n):
                        pieces[count, p, j] += by * pieces[count, p + 1, j]
        knots[count], begin, count = begin - ends[0], finish, count + 1
    knots[count] = ends[1] - ends[0]
    return count, order


def shifted(coefficients: Array, by: Array) -> Array:
    """Return the polynomials p(x + by) for given polynomials p(x).

    Args:
        coefficients: Constant term first, shape (m, k, n).
        by: Shift of each polynomial, shape (m,).

    Returns:
        Coefficients, shape (m, k, n).
    """
    moved, rows = coefficients.copy(), np.flatnonzero(by)  # often one segment of hundreds, or none
    gains, gaps = _binomials(coefficients.shape[1])
    powers = by[rows, None] ** np.arange(coefficients.shape[1])
    moved[rows] = (gains * powers[:, gaps]) @ coefficients[rows]
    return moved


@lru_cache(maxsize=16)
def _binomials(count: int) -> tuple[Array, NDArray[np.intp]]:
    """Return the binomials C(j, i), and j - i, or 0 for j < i; shape (count, count)."""
    gains = np.array([[comb(j, i) for j in range(count)] for i in range(count)], dtype=float)
    gaps = np.arange(count) - np.arange(count)[:, None]
    return gains, np.maximum(gaps, 0)
