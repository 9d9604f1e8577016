"""From a planner's polyline to way-points whose spline is collision-free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pepper_kin import planners
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.model import PepperModel
from pepper_kin.motion.problem import PathProblem
from pepper_kin.trajectory.path import CubicPath, as_cubic_path

_PIECES = 6
_ROUNDED = (6, 12, 24, 48)  # pieces of a path that is rounded everywhere alike
_MOST_WAYPOINTS = 400
_SHORTCUTS = 120
_LEAST_GAIN = 0.005  # of the length: what a short-cut has to save

# States checked along the final curve, in each length of the problem's resolution.
_FINER, _FINER_INTERPRETED = 20.0, 1.5


def waypoints_of(room: PathProblem, path: planners.Path, *, seed: int, timeout: float) -> NDArray[np.float64]:
    """Shorten and smooth a polyline, and return way-points for `retime`.

    `retime` draws a spline through way-points; so the spline itself is checked here, and way-points are added
    until it is valid everywhere at the problem's resolution.

    Args:
        room: The planning problem, of the joints that move.
        path: A valid polyline of those joints.
        seed: Seed of short-cutting.
        timeout: Time budget of short-cutting [s].

    Returns:
        Way-points, shape (m, n) [rad or m]; the polyline's own ends come first and last.
    """
    problem, checks = room.problem, room.checks
    pepper, embed = checks.pepper, room.embed
    compiled = checks.compiled
    # Machine code looks at the final curve far more closely, so that short-cuts need not be.
    fine = problem.spacing if compiled else problem.spacing / 4
    short = planners.shortcut(
        problem, path, seed=seed, timeout=timeout, iterations=_SHORTCUTS, resolution=fine,
        least_gain=_LEAST_GAIN,
    )  # fmt: skip
    if compiled:
        quick = _rounded(room, short)
        if quick is not None:
            return quick
    relaxed = room.relaxed
    for candidate in (short, path):
        try:
            curve = planners.smooth(relaxed, candidate, spacing=candidate.length / _PIECES)
        except InfeasibleError:
            continue
        found = _interpolated(pepper, relaxed, curve, embed, _FINER if compiled else _FINER_INTERPRETED)
        if found is not None:
            return found
    # A polyline with no room to round its corners: way-points so dense that their spline follows it.
    return embed(short.resample(problem.spacing).points)


def _rounded(room: PathProblem, path: planners.Path) -> NDArray[np.float64] | None:
    """Return few way-points along a rounded path whose spline is clear; None where none are."""
    from pepper_kin.motion.examination import is_clear
    from pepper_kin.motion.native_curve import rounded_waypoints
    from pepper_kin.trajectory.fast_solver import quick_spline

    polyline, lengths = np.array(path.points), np.array(path.arc_lengths)
    for pieces in _ROUNDED:
        points = room.embed(rounded_waypoints(polyline, lengths, pieces))
        spline = quick_spline(room.checks.pepper, points)
        if spline is not None and is_clear(room.checks, *spline, room.reach, room.relaxed_margins):
            return points
    return None


def _interpolated(
    pepper: PepperModel,
    problem: planners.Problem,
    curve: planners.SmoothPath,
    embed: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    finer: float,
) -> NDArray[np.float64] | None:
    """Return the fewest equidistant points of a curve whose spline is valid; None where none are."""
    pieces = _PIECES
    while pieces <= _MOST_WAYPOINTS:
        points = embed(curve(np.linspace(curve.breaks[0], curve.breaks[-1], pieces + 1)))
        if _spline_is_valid(problem, as_cubic_path(pepper, points), embed, finer):
            return points
        pieces *= 2
    return None


def _spline_is_valid(
    problem: planners.Problem,
    spline: CubicPath,
    embed: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    finer: float,
) -> bool:
    moving = np.flatnonzero(np.isnan(embed(np.full((1, problem.n), np.nan))[0]))
    ends = spline.at(np.arange(len(spline.breaks) - 1), np.diff(spline.breaks))
    lengths = problem.metric.distance(spline.coefficients[:, 0][:, moving], ends[:, moving])
    counts = np.maximum(2, np.ceil(finer * lengths / problem.spacing).astype(int))
    states = np.concatenate(
        [
            spline.at(np.full(count, i), np.linspace(0, h, count))
            for i, (count, h) in enumerate(zip(counts, np.diff(spline.breaks), strict=True))
        ]
    )
    return bool(problem.oracle(np.ascontiguousarray(states[:, moving])).all())
