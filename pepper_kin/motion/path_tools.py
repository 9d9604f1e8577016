"""Tools for given paths: shortening and smoothing, or interpolation."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.arrays import Array, PiecewiseCubic
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, check_positive, check_seed, check_whole
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.motion.checks import LEAST_MARGIN, Checks, checks_for
from pepper_kin.motion.goals import STAYS, free_joints
from pepper_kin.motion.margins import narrowest
from pepper_kin.motion.path_search import PathSearch, run
from pepper_kin.motion.plan_request import moves_base
from pepper_kin.motion.plan_result import Ending, Plan, PlanStatus
from pepper_kin.motion.problem import RESOLUTION, checked_margin, path_problem
from pepper_kin.motion.static_limits import static_limits
from pepper_kin.motion.validation import AnyPath, checked_path, dense_states, polyline, validate
from pepper_kin.planners.compiled import load_code
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.path import CubicPath, PlannedPath, planned_curve

NAME = "simplify_path"
_SAME = 1e-9  # [rad or m]
_MOST_POINTS = 1_000_000


def simplify_path(
    pepper: PepperModel,
    path: AnyPath,
    scene: Scene | None = None,
    *,
    margin: float = 0.01,
    seed: int = 0,
    timeout: float = 1.0,
    balance: Balance = "robot",
    torque_scale: TorqueScale = "robot",
    payload: Mapping[str, float] | None = None,
) -> Plan:
    """Shorten and smooth a valid path.

    Short-cuts, smoothing and the examination of the returned curve are the same as in `plan`.

    Args:
        pepper: The robot.
        path: Waypoints [rad or m], shape (k, n), joined by straight edges; a piecewise cubic curve; a plan;
            or a trajectory, whose times are ignored.
        scene: The world around the robot, with attached objects.
        margin: Distance kept to all bodies [m]; less if the path itself is nearer.
        seed: Seed of the choice of shortcuts.
        timeout: Time budget of the shortcuts [s].
        balance: Distance that the center of mass keeps from the edges of the wheels' triangle [m], with a
            reserve of 2 mm, on the given and on the returned path; "robot" for the robot's requirement; None
            to leave balance out.
        torque_scale: Fraction of the effort limits for holding torques; "robot" for the robot's requirement.
        payload: Point masses held at "left", "right" or a frame by name [kg].

    Returns:
        A plan from the path's first state to its last, for `retime`; PATH_INVALID, with the fault and its
        place, if the given path is not valid.

    Raises:
        InvalidValueError: for a wrong shape, NaN, a margin below zero, a timeout of zero, an invalid distance
            or mass, balance of a robot without wheels, or a path on which a differential base moves, because
            shortcuts would let it move sideways.
        UnknownNameError: for a frame of the payload that the robot lacks.
        InfeasibleError: for a plan that failed, with its reason.
    """
    check_positive("timeout", timeout, "[s]")
    checked_margin(margin)
    check_seed(seed)
    checks = checks_for(pepper, scene, static_limits(pepper, balance, payload, scene, torque_scale))
    followed = checked_path(pepper, path)
    load_code(run)
    ended = Ending(pepper, working_time(), seed, NAME, margin, (balance, torque_scale))
    found = validate(pepper, path, scene, balance=balance, torque_scale=torque_scale, payload=payload)
    if not found.success:
        return ended(PlanStatus.PATH_INVALID, found.message, states_checked=found.states_checked)
    points = followed if isinstance(followed, np.ndarray) else _followed(followed)
    points = np.clip(points, pepper.lower_limits, pepper.upper_limits)
    points = points[np.append(True, np.abs(np.diff(points, axis=0)).max(axis=1, initial=0.0) > _SAME)]
    if len(points) == 1:
        return ended.solved(checks.exact, points, STAYS)
    free = free_joints(pepper, None, points[0], points[1:])
    if moves_base(pepper, free):
        raise InvalidValueError("path", "a drive of a differential base", "a path on which the base stands")
    kept = _margin_of(checks, points, dense_states(pepper, scene, points, RESOLUTION).positions, free, margin)
    problem = path_problem(checks, points[0], points[1:], free, kept)
    line = planners.Path(points[:, free], problem.metric.weights)
    way = PathSearch(problem, seed, timeout).along(line)
    if way is None:
        message = f"The path is valid, but no spline along it was found that is.{narrowest(problem, line)}"
        return ended(PlanStatus.PATH_INVALID, message, states_checked=found.states_checked)
    before = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    after = float(np.linalg.norm(np.diff(way.points, axis=0), axis=1).sum())
    message = f"Path of {len(way.points)} waypoints, {after / before:.2f} times as long as the one given."
    return ended.solved(checks.exact, way.points, message, way.curve, states_checked=found.states_checked)


def _margin_of(checks: Checks, points: Array, states: Array, free: NDArray[np.int64], margin: float) -> float:
    """Return a margin that all states between waypoints keep, halved until they do [m].

    Args:
        checks: The robot in its scene.
        points: Waypoints [rad or m], shape (k, n).
        states: States between the waypoints [rad or m], shape (m, n).
        free: Indices of the joints that move, shape (j,).
        margin: Requested margin [m].
    """
    while margin > LEAST_MARGIN:
        kept = checks.margins(points[0], points[1:], free, margin)
        if checks.free(states, *kept).all():
            return margin
        margin /= 2
    return 0.0


def _followed(path: CubicPath | Trajectory) -> Array:
    """Return waypoints along a curve or trajectory, a hundredth [rad or m] or [s] apart."""
    if isinstance(path, CubicPath):
        return interpolate_path(path, step=RESOLUTION)
    times = np.linspace(0.0, path.duration, 1 + math.ceil(path.duration / RESOLUTION))
    return np.asarray(path(times).position)


def interpolate_path(
    path: ArrayLike | PiecewiseCubic | PlannedPath, *, step: float | None = None, count: int | None = None
) -> Array:
    """Return states along a path, curve or plan, for controllers and files.

    Args:
        path: Waypoints [rad or m], shape (k, n), k >= 2, joined by straight edges; a piecewise cubic curve;
            or a plan, whose curve is used.
        step: Maximum change of any joint from one state to the next [rad or m]; all waypoints, or breaks of
            the curve, are among the states.
        count: Number of states instead, at equal lengths of the polyline in joint space, or equal steps of
            the curve's parameter; first and last are the path's own.

    Returns:
        States [rad or m], shape (m, n).

    Raises:
        InvalidValueError: for both or neither of `step` and `count`, a step that is not above zero or makes
            more than a million states, a count below 2, a wrong shape or NaN.
        InfeasibleError: for a plan that failed, with its reason.
    """
    if (step is None) == (count is None):
        amount = "neither" if step is None else "both"
        raise InvalidValueError("step and count", amount, "exactly one of them")
    number = 0 if count is None else check_whole("count", count, 2, _MOST_POINTS)
    if isinstance(path, PlannedPath):
        path = planned_curve(path)
    if isinstance(path, PiecewiseCubic):
        curve = CubicPath(path.breaks, path.coefficients)
        return _even_on_curve(curve, number) if step is None else _dense_on_curve(curve, step)
    points = as_finite(path, "waypoints", (None, None))
    if len(points) < 2:
        raise InvalidValueError("waypoints", f"{len(points)} waypoint(s)", "at least 2")
    if step is not None:
        return _dense_on_curve(polyline(points), step)
    line = planners.Path(points)
    return line(np.linspace(0.0, line.length, number))


def _even_on_curve(curve: CubicPath, count: int) -> Array:
    s = np.linspace(curve.breaks[0], curve.breaks[-1], count)
    segment = np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)
    return curve.at(segment, s - curve.breaks[segment])


def _dense_on_curve(curve: CubicPath, step: float) -> Array:
    """Return the ends of equal parts of each piece on which no joint moves by more than a step [rad or m]."""
    step = check_positive("step", step, "[rad or m]")
    breaks, coefficients = curve.breaks, np.ascontiguousarray(curve.coefficients)
    spans = np.abs(_control_slopes(breaks, coefficients)).max(axis=(1, 2)) * np.diff(breaks)
    if spans.sum() / step > _MOST_POINTS:
        raise InvalidValueError("step", step, f"at least {spans.sum() / _MOST_POINTS:.3g}")
    counts = np.maximum(1, np.ceil(spans / step * (1 - 1e-12))).astype(np.int64)
    segment = np.repeat(np.arange(counts.size), counts)
    part = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    states = curve.at(segment, part * (np.diff(breaks) / counts)[segment])
    return np.concatenate([states, curve.at([counts.size - 1], breaks[-1:] - breaks[-2:-1])])


def _control_slopes(breaks: Array, coefficients: Array) -> Array:
    """Return Bernstein coefficients of dq/ds, which bound it on each segment, shape (m, 3, n).

    Args:
        breaks: Ends of the cubic segments, shape (m + 1,).
        coefficients: Coefficients of each segment, constant term first, shape (m, 4, n).
    """
    h = np.diff(breaks)[:, None]
    first, second, third = coefficients[:, 1], coefficients[:, 2], coefficients[:, 3]
    middle = first + second * h
    return np.stack([first, middle, middle + (second + 3.0 * third * h) * h], axis=1)
