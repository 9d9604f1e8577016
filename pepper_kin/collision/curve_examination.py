"""Examination of a whole curve, with steps as long as the clearance proves enough."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array, PiecewiseCubic
from pepper_kin.collision.curve_checks import CurveChecks, held_by
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.collision.scene import Scene
from pepper_kin.core.collision.curve_check import (
    Intervals,
    count_intervals,
    is_clear,
    write_intervals,
)
from pepper_kin.model import PepperModel


def is_clear_along(
    checks: CurveChecks,
    curve: PiecewiseCubic,
    margins: tuple[float, float] = (0.0, 0.0),
    *,
    motion: tuple[Array, NDArray[np.int64]] | None = None,
    held: bool = True,
    strictly: bool = False,
) -> bool:
    """Whether margins are kept and gravity is held along a curve; see `core.collision.curve_check`.

    Args:
        checks: The robot in its scene.
        curve: The curve, or a cubic motion [rad or m].
        margins: To the scene and to the robot itself [m].
        motion: A configuration in which the joints stand that do not move, shape (n,), and the places of
            those that may move, shape (k,); None: those of the curve.
        held: Whether to ask if the joints can hold still along the curve.
        strictly: Whether the margin to the scene is proven to be kept at every point, between the states that
            are looked at as well.
    """
    breaks, coefficients = (np.require(a, float, ["C"]) for a in (curve.breaks, curve.coefficients))
    if motion is None:
        motion = coefficients[0, 0].copy(), np.flatnonzero((coefficients[:, 1:] != 0.0).any(axis=(0, 1)))
    reach = np.require(reach_along(checks.pepper, checks.exact.scene, curve), float, ["C"])
    arguments = checks.of_motion(*motion), breaks, coefficients, reach, *margins, held, strictly
    return bool(checks.run(is_clear, *arguments))


def reach_along(pepper: PepperModel, scene: Scene | None, curve: PiecewiseCubic) -> Array:
    """Return how far a joint moves a point of the body along a curve, shape (n,), see `motion_bounds`."""
    held = held_by(scene)
    reach = motion_bounds(pepper, held=held)
    if np.isfinite(reach).all():
        return reach
    return motion_bounds(pepper, *hull_of(curve.breaks, curve.coefficients), held)


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
