"""From a planner's polyline to way-points whose spline is collision-free."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin import planners
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.motion.problem import RESOLUTION, PathProblem
from pepper_kin.trajectory.path import as_cubic_path

Array = NDArray[np.float64]

_PIECES = 6
_ROUNDED = (6, 12, 24, 48)  # pieces of a path that is rounded everywhere alike
_MOST_WAYPOINTS = 400
_SHORTCUTS = 120
_LEAST_GAIN = 0.005  # of the length: what a short-cut has to save
_DENSE = (0.01, 0.0025)  # distances of way-points that follow a polyline [m], in the metric


def waypoints_of(room: PathProblem, path: planners.Path, *, seed: int, timeout: float) -> Array | None:
    """Shorten and smooth a polyline, and return way-points for `retime`.

    `retime` draws a spline through way-points; so the spline itself is checked here, and way-points are added
    until it is valid everywhere, as `Examiner.is_clear` says, which looks far
    more closely than the search.

    Args:
        room: The planning problem, of the joints that move.
        path: A valid polyline of those joints.
        seed: Seed of short-cutting.
        timeout: Time budget of short-cutting [s].

    Returns:
        Way-points, shape (m, n) [rad or m]; the polyline's own ends come first and last.  None where no
        spline along the polyline is valid.
    """
    problem = room.problem
    short = planners.shortcut(
        problem, path, seed=seed, timeout=timeout, iterations=_SHORTCUTS, resolution=problem.spacing,
        least_gain=_LEAST_GAIN,
    )  # fmt: skip
    found = _rounded(room, short)
    for candidate in (short, path):
        found = _smooth(room, candidate) if found is None else found
    return _followed(room, (short, path)) if found is None else found


def _rounded(room: PathProblem, path: planners.Path) -> Array | None:
    """Return few way-points along a path that is rounded everywhere alike; None where none are clear."""
    for pieces in _ROUNDED:
        points = room.embed(planners.rounded_waypoints(path, pieces))
        if _is_clear(room, points, room.relaxed_margins):
            return points
    return None


def _smooth(room: PathProblem, path: planners.Path) -> Array | None:
    """Return the fewest equidistant points of a rounded path whose spline is clear; None where none are."""
    try:
        curve = planners.smooth(room.relaxed, path, spacing=path.length / _PIECES, resolution=RESOLUTION)
    except InfeasibleError:
        return None
    pieces = _PIECES
    while pieces <= _MOST_WAYPOINTS:
        points = room.embed(curve(np.linspace(curve.breaks[0], curve.breaks[-1], pieces + 1)))
        if _is_clear(room, points, room.relaxed_margins):
            return points
        pieces *= 2
    return None


def _followed(room: PathProblem, paths: tuple[planners.Path, ...]) -> Array | None:
    """Return points so dense that their spline follows a polyline that has no room to round its corners."""
    for path in paths:
        for apart in _DENSE:
            points = room.embed(path.resample(apart).points)
            if _is_clear(room, points, (0.0, 0.0)):
                return points
    return None


def _is_clear(room: PathProblem, points: Array, margins: tuple[float, float]) -> bool:
    """Whether margins are kept all along the spline through way-points, shape (m, n)."""
    return room.is_clear(as_cubic_path(room.checks.pepper, points), margins)
