"""Margins along a path: how they are relaxed where no path keeps them, and what a curve is proven to keep."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.collision import CollisionChecker, Scene
from pepper_kin.collision.checker import RANGE_RADIUS
from pepper_kin.collision.curve_examination import is_clear_along
from pepper_kin.core.collision.curve_check import SHORTEST
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_real
from pepper_kin.motion.checks import LEAST_MARGIN, Checks
from pepper_kin.motion.problem import (
    RESOLUTION,
    Ends,
    PathProblem,
    checked_margin,
    path_problem,
)
from pepper_kin.trajectory.path import CubicPath

LEAST_SEARCHED = SHORTEST
"""The smallest margin that is searched with [m]: the curve keeps half of it at states that lie so near to one
another that nothing touches in between."""

FIRST_SHARE = 0.5
"""Share of the time in which the requested margin is searched with; smaller ones share the rest."""

_SMALLER = (0.5, 0.25, 0.125)  # of the margin requested
_HALVINGS = 6  # of the margin, when it is asked what a curve keeps
_LOOKED_AT = 60  # states of a path, where it is asked what is nearest
_NEAR = 0.02  # [m] what is farther away is not in the way


def checked_least(margin: float, least: float) -> float:
    """Return the margin that must be kept all along [m].

    Raises:
        InvalidValueError: for what is no distance from 0 to the margin, or a margin that is none.
    """
    checked_margin(margin)
    if not 0.0 <= as_real(least) <= margin:
        raise InvalidValueError("least_margin", least, f"a distance from 0 to margin, {margin:g} [m]")
    return float(least)


def falling_problems(
    checks: Checks, ends: Ends, margins: tuple[float, float], resolution: float = RESOLUTION
) -> Iterator[tuple[PathProblem, float]]:
    """Yield the problem at margins that fall, and the share of the time at which the search of each ends.

    Margins that make no difference, since start or goal do not keep them, are left out.

    Args:
        checks: The robot in its scene.
        ends: Start and goals, and which part of the requested margin they keep.
        margins: The margin requested, and what must be kept [m].
        resolution: See `path_problem`.
    """
    margin, least = margins
    start, goals, free, _, kept = ends
    last = max(least, min(margin, LEAST_SEARCHED))
    before = path_problem(checks, start, goals, free, margin, resolution, least, kept)
    if max(before.margins) <= last:
        yield before, 1.0
        return
    yield before, FIRST_SHARE
    smaller = [*(share * margin for share in _SMALLER if share * margin > last), last]
    for number, margin in enumerate(smaller, start=1):
        problem = replace(
            path_problem(checks, start, goals, free, margin, resolution, least), margins_relaxed=True
        )
        if problem.margins != before.margins or number == len(smaller):
            yield problem, FIRST_SHARE + (1.0 - FIRST_SHARE) * number / len(smaller)
        before = problem


def relaxation_sentence(problem: PathProblem, curve: CubicPath, margin: float) -> str:
    """Return a sentence on a margin that was not kept as requested, and its value; empty where it was.

    Args:
        problem: What was planned, at the margin kept.
        curve: The curve found.
        margin: The margin requested [m].
    """
    kept = 1000 * problem.margins[0]
    if not problem.margins_relaxed:
        ends = " A margin of {:.2g} mm is kept, since start or goal do not keep more."
        return "" if problem.margins[0] >= margin else ends.format(kept)
    s = np.linspace(curve.breaks[0], curve.breaks[-1], _LOOKED_AT)
    segment = np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)
    where = _nearest(problem, curve.at(segment, s - curve.breaks[segment]))
    return f" The margin was relaxed from {1000 * margin:.2g} to {kept:.2g} mm{where}."


def narrowest(problem: PathProblem, path: planners.Path | planners.CarCurve) -> str:
    """Return a sentence on where a path of the joints that move passes nearest to something."""
    where = _nearest(problem, problem.embed(path(np.linspace(0.0, path.length, _LOOKED_AT))))
    return f" It is narrowest{where}." if where else ""


def _nearest(problem: PathProblem, states: Array) -> str:
    """Return words on what is nearest, and where, at configurations along a path, shape (m, n).

    A thing of the scene is named before a part of the robot, whose margin is only what its joints leave.
    """
    checks, where = problem.checks, "{:.0f} % along the path"
    kept = _greatest(lambda margin: bool(checks.free(states, margin).all()), _NEAR)
    if kept < _NEAR:
        farther = kept + 2.0 * _NEAR / 2**_HALVINGS
        place = int(np.argmin(checks.free(states, farther)))
        pairs = checks.exact.with_margins(farther, 0.0).contacts(states[place])
        names, distance = pairs[0] if pairs else (), kept
    else:
        place = int(np.argmin(checks.exact.clearance(states)))
        pair = checks.exact.closest_pair(states[place])
        names, distance = ((), 0.0) if pair is None else (pair.names, pair.distance)
    if not names:
        return ""
    share = where.format(100 * place / (len(states) - 1))
    return f" where {' and '.join(names)} are {1000 * distance:.1f} mm apart, {share}"


def own_margin(checker: CollisionChecker, ends: Iterable[Array], most: float) -> float:
    """Return the distance that the robot's own parts keep on a motion [m], 0 where its ends leave none.

    It is at most half of what they keep at the ends, since joints near one another have to move.  Ends at
    which they touch do not count: no motion goes there.

    Args:
        checker: Of the robot and what it holds.
        ends: Ends of the motion, shape (n,) each [rad or m].
        most: The most that is kept [m].
    """
    kept, ranges = most, checker.dependent_ranges
    for q in ends:
        near = float(checker.clearance(q, to="self"))
        if near <= 0.0 or any(table.violated(q) for table in ranges):
            continue
        kept = min(kept, near / 2.0)
        while kept > LEAST_MARGIN and any(table.violated(q, kept / RANGE_RADIUS) for table in ranges):
            kept /= 2.0
    return kept if kept > LEAST_MARGIN else 0.0


def proven_margin(
    pepper: PepperModel, scene: Scene, path: Array, curve: CubicPath | None, most: float
) -> float:
    """Return a distance that is proven to be kept from the scene at every point of a curve [m].

    The greatest is sought among multiples of a 64th of the most.  0 says that the curve has been examined at
    states half a millimeter apart, none of which touches anything.

    Args:
        pepper: The robot.
        scene: The world around it, with what it holds.
        path: Way-points, shape (k, n).
        curve: The curve; None where the robot stays at the only way-point.
        most: The most that is asked for [m].
    """
    checks = Checks(pepper, scene)
    if curve is None:
        return _greatest(lambda margin: bool(checks.free(path[0], margin)), most)
    return _greatest(lambda m: is_clear_along(checks, curve, (m, 0.0), held=False, strictly=True), most)


def _greatest(holds: Callable[[float], bool], most: float) -> float:
    """Return about the greatest number up to the most that holds, if smaller ones do."""
    if holds(most):
        return most
    low, high = 0.0, most
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
