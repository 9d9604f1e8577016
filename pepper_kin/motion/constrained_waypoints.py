"""Way-points on a constraint manifold whose spline keeps the constraints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.ik import Task
from pepper_kin.model import PepperModel
from pepper_kin.motion.problem import PathProblem
from pepper_kin.trajectory.path import CubicPath, as_cubic_path

FEWEST_PIECES = 8
MOST_PIECES = 1024
SLACK = 0.98
"""Of a tolerance: what the spline may use of it where it is sampled while way-points are chosen."""

_BATCH = 256

SAMPLES = 6
"""Samples of a piece of the spline in the final look."""


def constrained_waypoints(
    path_problem: PathProblem, manifold: planners.ConstraintManifold, candidates: Sequence[planners.Path]
) -> Array | None:
    """Return the fewest equidistant way-points whose spline is valid and keeps the constraints.

    `retime` draws a cubic spline through way-points.  On the manifold it is off by the fourth power of their
    distance where the path is smooth, so twice as many are tried until it keeps the tolerances everywhere.
    The spline keeps half the margins where it is looked at coarsely, and is then examined closely.

    Args:
        path_problem: The planning problem, of the joints that move.
        manifold: The constraints on them.
        candidates: Paths on the manifold, best first.

    Returns:
        Way-points, shape (m, n) [rad or m]; None where not even the most dense ones will do.
    """
    pepper, problem, embed = path_problem.checks.pepper, path_problem.relaxed, path_problem.embed
    moving = np.flatnonzero(np.isnan(embed(np.full((1, problem.n), np.nan))[0]))
    for path in candidates:
        segments = FEWEST_PIECES
        while segments <= MOST_PIECES:
            states = np.clip(path(np.linspace(0.0, path.length, segments + 1)), problem.lower, problem.upper)
            states[1:-1] = planners.project(problem, manifold, states[1:-1])[0]
            points = embed(states)
            try:
                spline = as_cubic_path(pepper, points)
            except (InvalidValueError, LimitError):
                segments *= 2
                continue
            if _spline_holds(problem, manifold, spline, moving) and path_problem.is_clear(spline, (0.0, 0.0)):
                return points
            segments *= 2
    return None


def _spline_holds(
    problem: planners.Problem,
    manifold: planners.ConstraintManifold,
    spline: CubicPath,
    moving: NDArray[np.int64],
) -> bool:
    """Return whether a spline keeps constraints and bounds and is valid at the problem's resolution.

    The spline is that of whole configurations; `moving` are the places of the joints that move, shape (k,).
    """
    spans = np.diff(spline.breaks)
    ends = spline.at(np.arange(spans.size), spans)
    lengths = problem.metric.distance(spline.coefficients[:, 0][:, moving], ends[:, moving])
    counts = np.maximum(4, np.ceil(1.5 * lengths / problem.spacing).astype(int))
    rows = [spline.at(np.full(k, i), np.arange(k) / k * spans[i]) for i, k in enumerate(counts)]
    states = np.ascontiguousarray(np.concatenate([*rows, ends[-1:]])[:, moving])
    # The ends are what they are, and on the way in and out the tolerance may be used up.
    errors = manifold.errors(states) / manifold.tolerances
    at_ends = np.maximum(errors[[0, -1]].max(), SLACK)
    if errors.max() > min(at_ends, 1.0 + 1e-9):
        return False
    validator = problem.validator()
    batches = (states[k : k + _BATCH] for k in range(0, len(states), _BATCH))
    return all(bool(validator.states_valid(batch).all()) for batch in batches)


def largest_errors(pepper: PepperModel, path: Array, tasks: Sequence[Task]) -> tuple[float, ...]:
    """Return the largest error of each task along the spline through way-points, by Pinocchio.

    Nothing is shared with the machine code by which the path was found.

    Args:
        pepper: The robot.
        path: Way-points, shape (k, n) [rad or m].
        tasks: The constraints.

    Returns:
        One error for each task [m or rad].
    """
    dense = path
    if len(path) > 1:
        spline = as_cubic_path(pepper, path)
        segments = np.repeat(np.arange(len(spline.breaks) - 1), SAMPLES)
        local = np.tile(np.arange(SAMPLES) / SAMPLES, len(spline.breaks) - 1)
        dense = np.concatenate([spline.at(segments, local * np.diff(spline.breaks)[segments]), path[-1:]])
    return tuple(max(task.error(pepper, q) for q in dense) for task in tasks)
