"""Waypoints near a planner's polyline whose spline is collision-free, if uniform smoothing collides."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.motion.problem import RESOLUTION, PathProblem
from pepper_kin.trajectory.path import CubicPath, as_cubic_path

_SEGMENTS = 6
_MOST_WAYPOINTS = 400
_DENSE = (0.01, 0.0025)  # distances of waypoints along a polyline in the metric, tried in turn [m]


class Way(NamedTuple):
    """A path that has been examined.

    Attributes:
        points: Waypoints [rad or m], shape (m, n).
        curve: The spline through the waypoints.
    """

    points: Array
    curve: CubicPath


def way_near(problem: PathProblem, paths: tuple[planners.Path, ...]) -> Way | None:
    """Return the first polyline that smooths into a valid spline, or else follows closely; None if none does.

    `retime` follows a spline through waypoints; therefore the spline itself is examined, and waypoints are
    added until it is valid everywhere by `is_clear_along`, which checks far more closely than a search.

    Args:
        problem: The planning problem of the joints that move.
        paths: Valid polylines of these joints, the best first.
    """
    found = None
    for path in paths:
        found = _smooth(problem, path) if found is None else found
    return _followed(problem, paths) if found is None else found


def way_through(problem: PathProblem, points: Array, margins: tuple[float, float]) -> Way | None:
    """Return the spline through waypoints [rad or m], shape (m, n), if it keeps margins [m] everywhere."""
    curve = as_cubic_path(problem.checks.pepper, points)
    return Way(points, curve) if problem.is_clear(curve, margins) else None


def _smooth(problem: PathProblem, path: planners.Path) -> Way | None:
    """Return the fewest equidistant points of a smoothed path whose spline is clear, or None."""
    try:
        curve = planners.smooth(problem.relaxed, path, spacing=path.length / _SEGMENTS, resolution=RESOLUTION)
    except InfeasibleError:
        return None
    segments = _SEGMENTS
    while segments <= _MOST_WAYPOINTS:
        points = problem.embed(curve(np.linspace(curve.breaks[0], curve.breaks[-1], segments + 1)))
        found = way_through(problem, points, problem.relaxed_margins)
        if found is not None:
            return found
        segments *= 2
    return None


def _followed(problem: PathProblem, paths: tuple[planners.Path, ...]) -> Way | None:
    """Return points so dense that their spline follows a polyline with its corners, or None."""
    for path in paths:
        for apart in _DENSE:
            found = way_through(problem, problem.embed(path.resample(apart).points), (0.0, 0.0))
            if found is not None:
                return found
    return None
