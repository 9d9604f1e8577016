"""Examination of a whole curve, with steps that grow with the clearance."""

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
    """Return whether margins are kept and gravity is held along a curve; see `core.collision.curve_check`.

    Args:
        checks: The robot in its scene.
        curve: The curve, or a cubic motion [rad or m].
        margins: Margins to the scene and to the robot itself [m].
        motion: Configuration that has the positions of the joints that do not move, shape (n,), and indices
            of the joints that may move, shape (k,); None: taken from the curve.
        held: Whether to check that the joints can hold still along the curve.
        strictly: Whether the margin to the scene is proven at every point, also between the examined states.
    """
    breaks, coefficients = (np.require(a, float, ["C"]) for a in (curve.breaks, curve.coefficients))
    if motion is None:
        motion = coefficients[0, 0].copy(), np.flatnonzero((coefficients[:, 1:] != 0.0).any(axis=(0, 1)))
    reach = np.require(reach_along(checks.pepper, checks.exact.scene, curve), float, ["C"])
    arguments = checks.of_motion(*motion), breaks, coefficients, reach, *margins, held, strictly
    return bool(checks.run(is_clear, *arguments))


def reach_along(pepper: PepperModel, scene: Scene | None, curve: PiecewiseCubic) -> Array:
    """Return the motion bounds of the joints along a curve, shape (n,), see `motion_bounds`."""
    held = held_by(scene)
    reach = motion_bounds(pepper, held=held)
    if np.isfinite(reach).all():
        return reach
    return motion_bounds(pepper, *hull_of(curve.breaks, curve.coefficients), held)


def hull_of(breaks: Array, coefficients: Array) -> tuple[Array, Array]:
    """Return lower and upper corners, shape (n,) each, of the box around a curve's Bezier points.

    Args:
        breaks: Ends of the cubic segments, shape (m + 1,).
        coefficients: Coefficients from the start of each segment, constant first, shape (m, 4, n).
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
    """Divide a curve into intervals in none of which a point of the body moves farther than a step.

    Args:
        breaks: Ends of the segments, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n).
        reach: Motion bound of each joint, shape (n,) [m/rad, or 1].
        step: Maximum distance in an interval [m].
    """
    counts = np.empty(len(coefficients), np.int64)
    total = count_intervals(breaks, coefficients, reach, step, counts)
    parts = Intervals(np.empty(total, np.int64), np.empty(total), np.empty(total))
    write_intervals(breaks, counts, parts)
    return parts
