"""Whether a whole curve is clear: steps are as long as the margin that is kept there proves enough."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1
from pepper_kin.motion.checks import FINEST, Checks

Array = NDArray[np.float64]

STEPS = (0.008, 0.002, FINEST)
"""Distances that any point of the body moves between states, from far from everything to near [m]."""


class Intervals(NamedTuple):
    """Parts of a piecewise polynomial curve.

    Attributes:
        piece: The piece of each, shape (N,).
        begin: The parameter at its start, counted from the piece's first break, shape (N,).
        width: Its width, shape (N,).
    """

    piece: Ints1
    begin: Floats1
    width: Floats1


class Examiner:
    """Examines curves of one motion: the tables of what moves are made once for all of them.

    Args:
        checks: The robot in its scene.
        standing: A configuration in which the joints stand that do not move, shape (n,).
        moving: Places of the joints that move, shape (k,).
    """

    def __init__(self, checks: Checks, standing: Array, moving: NDArray[np.int64]) -> None:
        self._checks, self._standing, self._moving = checks, standing, moving
        self._tests: dict[tuple[tuple[float, float], bool], Callable[[Array], NDArray[np.bool_]]] = {}

    def is_clear(
        self,
        breaks: Array,
        coefficients: Array,
        reach: Array,
        margins: tuple[float, float],
        *,
        held: bool = True,
        strictly: bool = False,
    ) -> bool:
        """Whether margins are kept and gravity is held along a piecewise cubic curve.

        The curve is cut into intervals on which no point of the body moves farther than 8 mm.  Where the
        state in the middle of one keeps a distance of half that, nothing touches in all of the interval.
        Others are cut into intervals of 2 mm, and those into ones of half a millimeter, whose middles need
        only keep the margins asked for.

        Args:
            breaks: Ends of the pieces, shape (m + 1,).
            coefficients: Constant term first, shape (m, 4, n) [rad or m].
            reach: How far a joint moves a point of the body, shape (n,), see `motion_bounds`.
            margins: To the scene and to the robot itself [m].
            held: Whether to ask if the joints can hold still along the curve.
            strictly: Whether the margin to the scene is proven to be kept at every point, between the states
                that are looked at as well.
        """
        breaks, coefficients, reach = (np.require(a, float, ["C"]) for a in (breaks, coefficients, reach))
        parts = cut(breaks, coefficients, reach, STEPS[0])
        kept = self._test(margins, False)
        for step, shorter in zip(STEPS, (*STEPS[1:], None), strict=True):
            states = middles(coefficients, parts)
            if held and step == STEPS[0] and not self._held(breaks, coefficients, reach, states):
                return False
            proven = margins[0] + step / 2 if strictly else max(margins[0], step / 2)
            if shorter is None:
                last = self._test((proven, margins[1]), False) if strictly else kept
                return bool(last(states).all())
            far = self._test((proven, max(margins[1], step / 2)), True)
            near = np.flatnonzero(~far(states))
            if not near.size:
                return True
            if not kept(states[near]).all():
                return False
            count = round(step / shorter)
            width = np.repeat(parts.width[near] / count, count)
            begin = np.repeat(parts.begin[near], count) + width * (np.arange(width.size) % count)
            parts = Intervals(np.repeat(parts.piece[near], count), begin, width)
        return False

    def _held(self, breaks: Array, coefficients: Array, reach: Array, states: Array) -> bool:
        """Whether a curve, of which states every 8 mm are given, can be held still all along."""
        statics = self._checks.statics
        if statics.step < STEPS[0]:
            states = middles(coefficients, cut(breaks, coefficients, reach, statics.step))
        return bool(statics.hold_along(states).all())

    def _test(self, margins: tuple[float, float], surely: bool) -> Callable[[Array], NDArray[np.bool_]]:
        """Return the test of states at margins, see `Checks.along`."""
        found = self._tests.get((margins, surely))
        if found is None:
            found = self._checks.along(self._standing, self._moving, margins, surely=surely)
            self._tests[margins, surely] = found
        return found


def hull_of(breaks: Array, coefficients: Array) -> tuple[Array, Array]:
    """Return lower and upper ends, each of shape (n,), of a box that holds a curve: its Bezier points'."""
    h = np.diff(breaks)[:, None]
    constant, first, second, third = coefficients.swapaxes(0, 1)
    points = (
        constant,
        constant + first * h / 3,
        constant + (2 * first + second * h) * h / 3,
        constant + (first + (second + third * h) * h) * h,
    )
    return np.min(points, axis=(0, 1)), np.max(points, axis=(0, 1))


def cut(breaks: Array, coefficients: Array, reach: Array, step: float) -> Intervals:
    """Cut a curve into intervals on none of which any point of the body moves farther than a step.

    A point moves at most sum_j reach_j |dq_j|, and |dq_j/ds| on a piece is at most the greatest of the
    control values of that quadratic, since it is a Bezier curve.

    Args:
        breaks: Ends of the pieces, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n).
        reach: How far a joint moves a point of the body, shape (n,) [m/rad, or 1].
        step: [m].
    """
    counts = np.empty(len(coefficients), np.int64)
    total = count_intervals(breaks, coefficients, reach, step, counts)
    parts = Intervals(np.empty(total, np.int64), np.empty(total), np.empty(total))
    write_intervals(breaks, counts, parts)
    return parts


def middles(coefficients: Array, parts: Intervals) -> Array:
    """Return the states in the middle of intervals of a curve, shape (N, n)."""
    states = np.empty((parts.piece.size, coefficients.shape[2]))
    write_middles(coefficients, parts, states)
    return states


@compiled("int64(float64[::1], float64[:, :, ::1], float64[::1], float64, int64[::1])")
def count_intervals(
    breaks: Floats1, coefficients: Floats3, reach: Floats1, step: float, counts: Ints1
) -> int:
    """Write the number of intervals of each piece; return their sum.  See `cut`."""
    total = 0
    for i in range(coefficients.shape[0]):
        h, speed = breaks[i + 1] - breaks[i], 0.0
        for j in range(reach.size):
            first, second, third = coefficients[i, 1, j], coefficients[i, 2, j], coefficients[i, 3, j]
            middle = first + second * h
            last = middle + (second + 3.0 * third * h) * h
            speed += reach[j] * max(abs(first), abs(middle), abs(last))
        counts[i] = max(1, math.ceil(h * speed / step))
        total += counts[i]
    return total


@compiled("void(float64[::1], int64[::1], Intervals)")
def write_intervals(breaks: Floats1, counts: Ints1, parts: Intervals) -> None:
    """Write as many equal intervals of each piece as counted."""
    place = 0
    for i in range(counts.size):
        h = (breaks[i + 1] - breaks[i]) / counts[i]
        for k in range(counts[i]):
            parts.piece[place], parts.begin[place], parts.width[place] = i, k * h, h
            place += 1


@compiled("void(float64[:, :, ::1], Intervals, float64[:, ::1])")
def write_middles(coefficients: Floats3, parts: Intervals, states: Floats2) -> None:
    """Write the states in the middle of intervals, shape (N, n)."""
    for k in range(parts.piece.size):
        x, i = parts.begin[k] + 0.5 * parts.width[k], parts.piece[k]
        for j in range(states.shape[1]):
            value = coefficients[i, 2, j] + x * coefficients[i, 3, j]
            states[k, j] = coefficients[i, 0, j] + x * (coefficients[i, 1, j] + x * value)
