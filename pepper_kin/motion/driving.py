"""Paths of a robot with a differential base: car-like curves of the base, with the body held meanwhile."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model.wheels import Wheels
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.goals import fault_of
from pepper_kin.motion.margins import falling_problems, narrowest, relaxation_sentence
from pepper_kin.motion.obstruction import why_no_path
from pepper_kin.motion.path_search import PathSearch
from pepper_kin.motion.plan_request import CheckedRequest, base_places
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.problem import COARSE, Ends, PathProblem
from pepper_kin.planners.compiled import power_basis
from pepper_kin.trajectory.path import CubicPath

SPACINGS = (0.2, 0.1, 0.05)
"""Distances of a spline's control points along a drive, relative to the turning radius, tried in turn."""
_WIDER = 1.01
"""Radius of the planned curves over the turning radius: the spline's radius is 0.7 % smaller than planned."""
_LEAST_PIECES = 4  # minimum number of pieces of a drive between two stops
_SAME = 1e-9
_NO_LEGS = "No goal can be driven to with the body held as at an end or in a named posture."
_NO_SPLINE = "A path was found, but no spline along it keeps clear."


_Outcome: TypeAlias = Callable[[], tuple[PlanStatus, str]]
"""Status and message of a search, computed on request: finding the obstruction can take longer than a
search."""
_Curve: TypeAlias = tuple[CubicPath | None, int, _Outcome]


def plan_drive(request: CheckedRequest, ends: Ends) -> Plan:
    """Plan to goals that need a drive of the base, with the body held; it moves before, after, or both.

    The body is held as at the start, as at the goal, in the neutral position, or in a named posture: the
    first of them that is free at both ends and along the whole drive.

    Args:
        request: The checked request.
        ends: Start and valid goals, the best first.
    """
    checks, ended, start, free = request.checks, request.ended, ends.start, ends.free
    base, checked = base_places(checks.pepper), 0
    longest, why, reason = 0, None, ""
    for goal in ends.goals:
        bodies = _held(checks, start, goal, base, free)
        for way, body in enumerate(bodies):
            legs = _legs(start, goal, base, body)
            held = [q for leg in legs for q in leg if not (checks.free(q) and checks.holds(q[None])[0])]
            if held:
                reason = reason or _blocked(checks, held[0])
                continue
            curves: list[CubicPath] = []
            shift = np.zeros_like(start)  # offset of the yaw by full turns that the drive has made
            gave = ""
            for begin, end in legs:
                left = request.deadline - working_time()
                left = max(left if way == len(bodies) - 1 else left / 2, 1e-3)  # others need time, too
                curve, states, outcome = _Leg(request, begin + shift, end + shift, base, free).curve(left)
                checked += states
                if curve is None:
                    longest, why = (states, outcome) if states >= longest else (longest, why)
                    break
                curves.append(curve)
                gave = gave or outcome()[1]
                shift[base[2]] += (_end(curve) - end - shift)[base[2]]
            if len(curves) == len(legs):
                path = _in_turn(curves)
                points = np.vstack([path.coefficients[:, 0], _end(path)])
                words = f"Drive of {_length(path, base):.2f} m{_leg_words(legs, base)}.{gave}"
                return ended.solved(checks.exact, points, words, curve=path, states_checked=checked)
    status, message = (PlanStatus.NO_PATH_IN_TIME, _NO_LEGS + reason) if why is None else why()
    return ended(status, message, states_checked=checked)


def _blocked(checks: Checks, q: Array) -> str:
    """Return a sentence on why the body cannot be held as in q, shape (n,), while the base drives."""
    fault = fault_of(checks.exact, q, "body held so", checks.statics)
    return "" if fault is None else f" {fault[1]}"


def _held(
    checks: Checks, start: Array, goal: Array, base: NDArray[np.int64], free: NDArray[np.int64]
) -> list[Array]:
    """Return configurations [rad or m], shape (n,) each, whose body posture may be held, each posture once.

    Args:
        checks: The robot in its scene.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration [rad or m], shape (n,).
        base: Indices of the base's joints, shape (3,).
        free: Indices of the joints that move, shape (k,).
    """
    pepper, body = checks.pepper, np.setdiff1d(free, base)
    held = [start, goal]
    if body.size:
        for posture in (pepper.neutral(), *map(pepper.posture, pepper.posture_names)):
            resting = start.copy()
            resting[body] = posture[body]
            held.append(resting)
    bodies: dict[bytes, Array] = {}
    for q in held:
        bodies.setdefault(q[body].tobytes(), q)
    return list(bodies.values())


def _legs(start: Array, goal: Array, base: NDArray[np.int64], held: Array) -> list[tuple[Array, Array]]:
    """Return the ends of up to three legs: a motion of the body, a drive, and another motion of the body.

    Args:
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration [rad or m], shape (n,).
        base: Indices of the base's joints, shape (3,).
        held: A configuration with the body posture that is held [rad or m], shape (n,).
    """
    before, after = held.copy(), held.copy()
    before[base], after[base] = start[base], goal[base]
    legs = [(start, before), (before, after), (after, goal)]
    return [(a, b) for a, b in legs if np.abs(a - b).max() > _SAME]


def _leg_words(legs: list[tuple[Array, Array]], base: NDArray[np.int64]) -> str:
    """Return words on when the body moves, from the ends of legs, shape (n,) each, and the base's indices."""
    if len(legs) == 1:
        return " with the body held"
    if len(legs) == 3:
        return " between two motions of the body"
    first_drives = bool(np.abs(legs[0][0] - legs[0][1])[base].max() > _SAME)
    return ", then the body moves" if first_drives else " after the body has moved"


def _end(path: CubicPath) -> Array:
    """Return the last configuration of a curve [rad or m], shape (n,)."""
    return path.at(len(path.breaks) - 2, path.breaks[-1] - path.breaks[-2])


def _length(path: CubicPath, base: NDArray[np.int64]) -> float:
    """Return the length of a curve in the plane [m]; `base` are the indices of x, y and yaw, shape (3,)."""
    ends = np.vstack([path.coefficients[:, 0], _end(path)])[:, base[:2]]
    return float(np.linalg.norm(np.diff(ends, axis=0), axis=1).sum())


class _Leg(NamedTuple):
    """A leg: a drive with the body held, or a motion of the body with the base held."""

    request: CheckedRequest
    begin: Array
    end: Array
    base: NDArray[np.int64]
    free: NDArray[np.int64]

    def curve(self, timeout: float) -> _Curve:
        """Return the curve, or None; the number of states checked; and a function for status and message."""
        drives = np.abs(self.begin - self.end)[self.base].max() > _SAME
        moving = self.base if drives else np.setdiff1d(self.free, self.base)
        began, states = working_time(), 0
        margins, ends = self.request.options.margins, Ends(self.begin, self.end[None], moving)
        for problem, share in falling_problems(self.request.checks, ends, margins, COARSE):
            left = max(share * timeout - (working_time() - began), 1e-3)
            curve, checked, outcome = self._driven(problem, left) if drives else self._moved(problem, left)
            states += checked
            if curve is not None:
                return curve, states, partial(_solved, relaxation_sentence(problem, curve, margins[0]))
        return None, states, outcome

    def _moved(self, problem: PathProblem, timeout: float) -> _Curve:
        """Search the body's motion with the base held; return as `curve` does."""
        problem = problem.finer()
        result = planners.rrt_connect(problem.search_problem, seed=self.request.seed, timeout=timeout)
        if result.path is None:
            return None, result.states_checked, partial(why_no_path, problem, result, self.request.seed)
        way = PathSearch(problem, self.request.seed, timeout).along(result.path)
        if way is None:
            return None, result.states_checked, partial(_no_spline, problem, result.path)
        return way.curve, result.states_checked, _solved

    def _driven(self, problem: PathProblem, timeout: float) -> _Curve:
        """Search the base's drive with the body held; return as `curve` does."""
        wheels, checked = self.request.checks.pepper.wheels, 0
        assert wheels is not None
        for closer in (problem, problem.finer()):
            found = planners.car_connect(
                closer.search_problem, _WIDER * wheels.turning_radius, backward=wheels.backward,
                seed=self.request.seed, timeout=timeout,
            )  # fmt: skip
            checked += found.states_checked
            if found.curve is None:
                return None, checked, partial(why_no_path, closer, found, self.request.seed)
            for spacing in SPACINGS:
                curve = _driven(closer, found.curve, wheels, spacing)
                if closer.is_clear(curve, closer.relaxed_margins):
                    return curve, checked, _solved
            outcome = partial(_no_spline, closer, found.curve)
        return None, checked, outcome


def _solved(words: str = "") -> tuple[PlanStatus, str]:
    return PlanStatus.SOLVED, words


def _no_spline(problem: PathProblem, found: planners.Path | planners.CarCurve) -> tuple[PlanStatus, str]:
    """Return status and message if a path was found but no spline, with the narrowest place."""
    return PlanStatus.NO_PATH_IN_TIME, _NO_SPLINE + narrowest(problem, found)


def _driven(problem: PathProblem, curve: planners.CarCurve, wheels: Wheels, spacing: float) -> CubicPath:
    """Return a cubic curve along a car's curve, with a kink, where timing stops, wherever the car reverses.

    Between kinks it is the cubic B-spline whose control points are poses of the car.  Its curvature never
    exceeds the control polygon's, and heading and direction of motion agree up to the third order of the
    spacing.
    """
    ends = np.cumsum([0.0, *np.abs(curve.lengths)])
    turns_back = np.flatnonzero(np.diff(np.sign(curve.lengths))) + 1
    stops = ends[[0, *turns_back, -1]]
    drives = [curve.part(a, b) for a, b in itertools.pairwise(stops)]
    splines = []
    for drive in drives:
        length = drive.length
        count = max(_LEAST_PIECES, math.ceil(length / (spacing * wheels.turning_radius)))
        breaks = np.linspace(0.0, length, count + 1)
        knots = np.concatenate([np.zeros(3), breaks, np.full(3, length)])
        control = np.tile(problem.start, (count + 3, 1))
        control[:, problem.free] = drive((knots[1:-3] + knots[2:-2] + knots[3:-1]) / 3.0)
        if drive is drives[-1]:
            goal = problem.search_problem.goals[0].copy()  # met exactly, except for full turns
            goal[2] += 2.0 * math.pi * round((control[-1, problem.free[2]] - goal[2]) / (2.0 * math.pi))
            control[-1, problem.free] = goal
        coefficients = np.empty((count, 4, control.shape[1]))
        power_basis(knots, control, coefficients)
        splines.append(CubicPath(breaks, coefficients))
    return _in_turn(splines)


def _in_turn(curves: list[CubicPath]) -> CubicPath:
    """Join curves, each of which begins where the previous one ends; timing stops at kinks."""
    breaks = [np.zeros(1)]
    for curve in curves:
        breaks.append(breaks[-1][-1] + (curve.breaks[1:] - curve.breaks[0]))
    return CubicPath(np.concatenate(breaks), np.concatenate([curve.coefficients for curve in curves]))
