"""Shortening and rounding of a path on a manifold."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from .cbirrt import Explorer, require_fit, walk
from .constraint_manifold import ConstraintManifold, edges_hold, project_rows
from .deadline import Deadline, load_code
from .path import Path
from .problem import Problem
from .vectors import BoolArray, FloatArray, finite_points, require_inside, seed_number, whole_number

_LEAST_GAIN = 1e-3  # minimum gain relative to the piece: walks along a manifold are not exactly straight
_WIDEST = 6  # number of points of the path per point of the widest window of the rounding
_NARROWEST = 2  # minimum width of the window of the rounding, in points
_PASSES = 2  # number of averaging passes


def constrained_shortcut(
    problem: Problem,
    manifold: ConstraintManifold,
    path: Path,
    *,
    seed: int = 0,
    iterations: int = 100,
    timeout: float = 1.0,
) -> Path:
    """Shorten a path on a manifold; the result is never longer, and has the same ends.

    Each iteration picks two waypoints and tries to replace the path between them by the walk along the
    manifold straight from one to the other.

    Args:
        problem: Supplies box, validity, metric and resolution; its start and goals are not used.
        manifold: The constraints.
        path: A path of `cbirrt`.
        seed: Seed of the choices; the same seed gives the same path unless time runs out.
        iterations: Number of attempts.
        timeout: Time budget [s].

    Returns:
        The path, its waypoints on the manifold as dense as before.

    Raises:
        InvalidValueError: The path or the manifold has another number of coordinates than the problem, or an
            option is not allowed.
    """
    load_code(walk, project_rows, edges_hold)
    require_fit(problem, manifold)
    problem.require_same("path", path.n)
    seed, iterations = seed_number(seed), whole_number("iterations", iterations)
    deadline, rng, points = Deadline(timeout), np.random.default_rng(seed), path.points
    with Explorer(problem, manifold, deadline) as explorer:
        for iteration in range(iterations):
            if deadline.expired or len(points) < 3:
                break
            first, last = np.sort(rng.choice(len(points), 2, replace=False))
            if iteration == 0:
                first, last = 0, len(points) - 1
            segment = float(problem.metric.arc_lengths(points[first : last + 1])[-1])
            straight = float(problem.metric.distance(points[first], points[last]))
            if last - first < 2 or straight > (1.0 - _LEAST_GAIN) * segment:
                continue
            states, reached = explorer.walk(points[first], points[last], exact=True, longest=segment)
            candidate = np.concatenate((points[first : first + 1], states))
            if reached and problem.metric.arc_lengths(candidate)[-1] < (1.0 - _LEAST_GAIN) * segment:
                points = np.concatenate((points[:first], candidate, points[last + 1 :]))
    return Path.trusted(np.array(points), problem.metric)


def constrained_smooth(
    problem: Problem, manifold: ConstraintManifold, path: Path, *, timeout: float = 1.0
) -> Path:
    """Round the corners of a path on a manifold.

    The path is resampled at equal distances, averaged over a Hann window that is as wide as validity allows,
    and moved back onto the manifold.  The ends stay.

    Args:
        problem: Supplies box, validity, metric and resolution; its start and goals are not used.
        manifold: The constraints.
        path: A path of `cbirrt` or `constrained_shortcut`.
        timeout: Time budget [s].

    Returns:
        The rounded path, its waypoints at nearly equal distances; the path given if no rounder one is valid.

    Raises:
        InvalidValueError: The path or the manifold has another number of coordinates than the problem, or an
            option is not allowed.
    """
    load_code(walk, project_rows, edges_hold)
    require_fit(problem, manifold)
    problem.require_same("path", path.n)
    deadline, best = Deadline(timeout), path.points
    with Explorer(problem, manifold, deadline) as explorer:
        for _ in range(_PASSES):
            even = _equally_spaced(explorer, Path.trusted(np.array(best), problem.metric))
            width = len(even) // _WIDEST
            while width >= _NARROWEST and not deadline.expired:
                rounded, done = explorer.project(_averaged(even, width))
                rounded[[0, -1]] = path.points[[0, -1]]
                if done[1:-1].all() and explorer.polyline_holds(rounded):
                    best = rounded
                    break
                width //= 2
    return Path.trusted(np.array(best), problem.metric)


def project(
    problem: Problem, manifold: ConstraintManifold, states: ArrayLike
) -> tuple[FloatArray, BoolArray]:
    """Move states onto a manifold, by damped Gauss-Newton steps that are the smallest in the metric.

    Args:
        problem: Supplies the box, within which the states stay, and the metric.
        manifold: The constraints.
        states: States inside the box, shape (m, n).

    Returns:
        The moved states, shape (m, n), and which meet the constraints to half their tolerances, shape (m,).
        The method is local: a state may fail whose neighbor succeeds.

    Raises:
        InvalidValueError: The states have the wrong shape, are not finite or not inside the box.
    """
    require_fit(problem, manifold)
    rows = finite_points("states", states, problem.n, problem.labels)
    for k in np.flatnonzero(((rows < problem.lower) | (rows > problem.upper)).any(axis=1))[:1]:
        require_inside(f"states[{k}]", rows[k], problem.lower, problem.upper, problem.labels)
    with Explorer(problem, manifold, Deadline()) as explorer:
        return explorer.project(rows)


def _equally_spaced(explorer: Explorer, path: Path) -> FloatArray:
    """Return points of a polyline at equal distances, well below the resolution."""
    count = max(4, math.ceil(2.0 * path.length / explorer.resolution))
    return path(np.linspace(0.0, path.length, count + 1))


def _averaged(points: FloatArray, width: int) -> FloatArray:
    """Return means over some points to either side, mirrored through the ends so that the ends stay."""
    before = 2.0 * points[0] - points[width:0:-1]
    after = 2.0 * points[-1] - points[-2 : -width - 2 : -1]
    padded = np.concatenate((before, points, after))
    window = np.hanning(2 * width + 3)[1:-1]
    window /= window.sum()
    return np.stack([np.convolve(column, window, mode="valid") for column in padded.T], axis=1)
