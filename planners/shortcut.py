"""Shortening of a valid path by random short-cuts."""

from __future__ import annotations

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from .compiled_validity import CompiledValidity
from .deadline import Deadline
from .metric import Metric
from .oracle import Oracle
from .path import Path
from .problem import FINEST_RESOLUTION, Problem
from .vectors import FloatArray, whole_number

LEAST_GAIN = 1e-5
"""Of the length: less is not worth asking the oracle for."""

FLAT = 1e-9
"""Of the length: a way-point this near to the chord of its neighbours is dropped."""

_FINER = 8  # an accepted edge hugs obstacles, so it is checked more closely than an edge of a search


def shortcut(
    problem: Problem,
    path: Path,
    *,
    seed: int = 0,
    iterations: int = 200,
    timeout: float = 1.0,
    resolution: float | None = None,
    least_gain: float = LEAST_GAIN,
) -> Path:
    """Shorten a valid path; the result is never longer, and has the same ends.

    Each iteration picks two places of the path, way-points or points on edges, and tries to replace what lies
    between: by the straight edge, or (every other time) by letting a single coordinate run straight while the
    others keep their course, which removes the detour of one coordinate where the whole edge is blocked.

    Source of the single-coordinate variant: R. Geraerts and M. H. Overmars, Creating high-quality paths for
    motion planning, Int. J. of Robotics Research 26(8), 2007.

    If the problem's oracle is machine code (`CompiledValidity`), so is this; it then makes other choices for
    a seed.

    Args:
        problem: Supplies the oracle, the metric and the resolution; its start and goals are not used.
        path: A valid path of the problem's coordinates.
        seed: Seed of the choices; the same seed gives the same path unless time runs out.
        iterations: Number of attempts.
        timeout: Time budget [s].
        resolution: Greatest distance between checked states of a new edge [length unit of the metric]; an
            eighth of the problem's if omitted, because short-cuts tend to graze obstacles.
        least_gain: Part of the path's length, from 0 to below 1, that a short-cut has to save.  With a
            hundredth, most time goes into short-cuts that matter.

    Returns:
        The shortened path.  Edges that were not replaced are not checked again.

    Raises:
        InvalidValueError: The path has another number of coordinates, or an option is not allowed.
    """
    code = problem.oracle if isinstance(problem.oracle, CompiledValidity) else None
    if code is not None:
        from .compiled_shortcut import shorten_compiled  # loads machine code, which is not this run's time
    deadline = Deadline(timeout)
    if path.n != problem.n:
        raise InvalidValueError(
            "path", f"{path.n} coordinates", f"{problem.n} coordinates, as in the problem"
        )
    seed, iterations = whole_number("seed", seed), whole_number("iterations", iterations)
    if not 0.0 <= least_gain < 1.0:
        raise InvalidValueError("least_gain", least_gain, "a number from 0 to below 1")
    if len(path) < 3:
        return path
    if resolution is None:
        resolution = max(problem.spacing / _FINER, FINEST_RESOLUTION * problem.diagonal)
    oracle = problem.counting_oracle(deadline, resolution)
    metric = problem.metric
    if code is not None:
        points = shorten_compiled(
            problem, code, path.points, deadline, seed, iterations, oracle.resolution, float(least_gain)
        )
        return Path.trusted(points, metric)
    points = _without_flat(path.points, metric)
    return Path.trusted(_shorten(oracle, points, deadline, seed, iterations, least_gain), metric)


def _shorten(
    oracle: Oracle, points: FloatArray, deadline: Deadline, seed: int, iterations: int, least_gain: float
) -> FloatArray:
    rng, metric = np.random.default_rng(seed), oracle.metric
    for iteration in range(iterations):
        if deadline.expired or len(points) < 3:
            break
        lengths = metric.arc_lengths(points)
        if (places := _two_places(rng, lengths)) is None:
            continue
        before, middle, after = _cut(points, lengths, *places)
        if iteration % 2 and metric.n > 1:
            candidate = _one_coordinate_straight(middle, metric, int(rng.integers(metric.n)))
        else:
            candidate = middle[[0, -1]]
        gain = metric.arc_lengths(middle)[-1] - metric.arc_lengths(candidate)[-1]
        if gain > least_gain * lengths[-1] and oracle.polyline_valid(candidate):
            points = _without_flat(np.concatenate((before, candidate, after)), metric)
    return points


def _two_places(rng: np.random.Generator, lengths: FloatArray) -> tuple[float, float] | None:
    """Return two arc lengths that are not on the same edge: of two way-points, or anywhere."""
    if rng.random() < 0.5:
        first, last = np.sort(rng.choice(len(lengths), 2, replace=False))
        return (lengths[first], lengths[last]) if last - first > 1 else None
    low, high = np.sort(rng.random(2)) * lengths[-1]
    inside = np.searchsorted(lengths, high, side="left") - np.searchsorted(lengths, low, side="right")
    return (float(low), float(high)) if inside > 0 else None


def _cut(
    points: FloatArray, lengths: FloatArray, low: float, high: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Split a polyline at two arc lengths into before, between (with both ends), and after."""
    first = int(np.searchsorted(lengths, low, side="left"))
    last = int(np.searchsorted(lengths, high, side="right"))
    ends = np.array([[np.interp(s, lengths, column) for column in points.T] for s in (low, high)])
    inner = points[np.searchsorted(lengths, low, side="right") : np.searchsorted(lengths, high, side="left")]
    return points[:first], np.concatenate((ends[:1], inner, ends[1:])), points[last:]


def _one_coordinate_straight(piece: FloatArray, metric: Metric, coordinate: int) -> FloatArray:
    lengths = metric.arc_lengths(piece)
    straight = piece.copy()
    change = piece[-1, coordinate] - piece[0, coordinate]
    straight[1:-1, coordinate] = piece[0, coordinate] + lengths[1:-1] / lengths[-1] * change
    return straight


def _without_flat(points: FloatArray, metric: Metric) -> FloatArray:
    """Drop way-points that lie on the edge between their neighbours."""
    tolerance = FLAT * metric.arc_lengths(points)[-1]
    kept = [0]
    for i in range(1, len(points) - 1):
        chord, offset = ((points[[i + 1, i]] - points[kept[-1]]) * metric.weights).copy()
        square = float(chord @ chord)
        along = min(max(float(offset @ chord) / square, 0.0), 1.0) if square > 0.0 else 0.0
        if float(np.linalg.norm(offset - along * chord)) > tolerance:
            kept.append(i)
    return points[[*kept, len(points) - 1]] if len(points) > 1 else points
