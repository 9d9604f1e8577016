"""Margins along a path: their relaxation if no path keeps them, and the margin proven along a curve."""

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
"""Smallest margin of a search [m]: the curve keeps half of it at states between which nothing touches."""

FIRST_SHARE = 0.5
"""Fraction of the time for a search with the requested margin; smaller margins share the rest."""

_SMALLER = (0.5, 0.25, 0.125)  # smaller margins, relative to the requested one
_HALVINGS = 6  # bisection steps when the margin of a curve is determined
_LOOKED_AT = 60  # number of states of a path at which the nearest body is determined
_NEAR = 0.02  # distance beyond which a body is not in the way [m]


def checked_least(margin: float, least: float) -> float:
    """Return the margin that the whole curve must keep [m].

    Raises:
        InvalidValueError: for a value outside [0, margin], or an invalid margin.
    """
    checked_margin(margin)
    if not 0.0 <= as_real(least) <= margin:
        raise InvalidValueError("least_margin", least, f"a distance from 0 to margin, {margin:g} [m]")
    return float(least)


def falling_problems(
    checks: Checks, ends: Ends, margins: tuple[float, float], resolution: float = RESOLUTION
) -> Iterator[tuple[PathProblem, float]]:
    """Yield the problem at decreasing margins, and the fraction of the time at which each search ends.

    Margins that make no difference, because start or goal do not keep them, are left out.

    Args:
        checks: The robot in its scene.
        ends: Start and goals, and the margins that they keep.
        margins: Requested margin, and margin that must be kept [m].
        resolution: Maximum distance between checked states, in the metric [m].
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
    """Return a sentence on a margin that was reduced, and its value; empty if the requested one is kept.

    Args:
        problem: The planning problem, with the margin that was kept.
        curve: The curve found.
        margin: Requested margin [m].
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
    """Return a sentence on the narrowest place along a path of the joints that move."""
    where = _nearest(problem, problem.embed(path(np.linspace(0.0, path.length, _LOOKED_AT))))
    return f" It is narrowest{where}." if where else ""


def _nearest(problem: PathProblem, states: Array) -> str:
    """Return words on the nearest bodies, and where, at configurations along a path, shape (m, n).

    An object of the scene is named in preference to a part of the robot, whose margin depends only on the
    joints.
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
    """Return the margin between the robot's own parts on a motion [m], 0 if its ends leave none.

    It is at most half of the parts' distance at the ends, since joints near one another have to move.  Ends
    in contact do not count: no motion goes there.

    Args:
        checker: Collision checker of the robot and attached objects.
        ends: Ends of the motion [rad or m], shape (n,) each.
        most: Maximum margin [m].
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

    The maximum is searched among multiples of a 64th of `most`.  0 means that the curve has been examined at
    states half a millimeter apart, none of which touches anything.

    Args:
        pepper: The robot.
        scene: The world around the robot, with attached objects.
        path: Waypoints [rad or m], shape (k, n).
        curve: The curve; None if the robot stays at the only waypoint.
        most: Maximum distance to prove [m].
    """
    checks = Checks(pepper, scene)
    if curve is None:
        return _greatest(lambda margin: bool(checks.free(path[0], margin)), most)
    return _greatest(lambda m: is_clear_along(checks, curve, (m, 0.0), held=False, strictly=True), most)


def _greatest(holds: Callable[[float], bool], most: float) -> float:
    """Return by bisection about the largest number up to `most` for which `holds` is true."""
    if holds(most):
        return most
    low, high = 0.0, most
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
