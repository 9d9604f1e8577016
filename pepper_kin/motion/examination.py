"""Examination of a whole curve, with steps as long as the clearance proves enough."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.collision.curve_check import (
    Intervals,
    count_intervals,
    is_clear,
    write_intervals,
)
from pepper_kin.motion.checks import Checks


class Examiner:
    """Examines curves of one motion.

    Args:
        checks: The robot in its scene.
        standing: A configuration in which the joints stand that do not move, shape (n,).
        moving: Places of the joints that move, shape (k,).
    """

    def __init__(self, checks: Checks, standing: Array, moving: NDArray[np.int64]) -> None:
        self._checks, self._standing, self._moving = checks, standing, moving

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
        """Whether margins are kept and gravity is held along a curve; see `core.collision.curve_check`.

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
        check = self._checks.of_motion(self._standing, self._moving)
        arguments = check, breaks, coefficients, reach, *margins, held, strictly
        return bool(self._checks.run(is_clear, *arguments))


def hull_of(breaks: Array, coefficients: Array) -> tuple[Array, Array]:
    """Return lower and upper ends, shape (n,) each, of a box that holds a curve: its Bezier points'.

    Args:
        breaks: Where its cubic segments begin and end, shape (m + 1,).
        coefficients: Of each segment in powers of the way since its begin, constant first, shape (m, 4, n).
    """
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
