"""A path from anywhere as a curve, and as states so dense that nothing passes between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, PiecewiseCubic
from pepper_kin.collision import Scene
from pepper_kin.collision.curve_examination import cut, reach_along
from pepper_kin.core.collision.curve_check import SHORTEST, count_intervals
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.path import CubicPath, PlannedPath, planned_curve
from pepper_kin.trajectory.samples import refuse_other_joints

AnyPath: TypeAlias = "ArrayLike | PiecewiseCubic | PlannedPath | Trajectory"
MOST_STATES = 4_000_000
"""States of one path, an hour's or 2 km: half a gigabyte for Pepper, and minutes to look at them."""
INSTANTS = 0.001
"""Between states of a trajectory, where they are not nearer for the body's sake [s]."""


@dataclass(frozen=True, eq=False)
class DenseStates:
    """States of a motion in order.

    Attributes:
        positions: Joint positions [rad or m], shape (N, n).
        places: Where they are: number of the way-point and share of the edge behind it, the curve's
            parameter, or the time [s]; shape (N,), rising.
    """

    positions: Array
    places: Array


def checked_path(pepper: PepperModel, path: Any) -> Array | CubicPath | Trajectory:
    """Return way-points, shape (k, n) with k >= 1, a curve or a trajectory, of anything that may be one.

    Args:
        pepper: The robot.
        path: Way-points [rad or m], shape (k, n); a piecewise cubic curve, such as `Plan.curve`; a plan; or a
            trajectory.

    Raises:
        InvalidValueError: for a wrong shape, NaN, or a trajectory of other joints.
        InfeasibleError: for a plan that failed, with its reason.
    """
    if isinstance(path, Trajectory):
        refuse_other_joints(pepper, path.joint_names)
        return path
    if isinstance(path, PlannedPath):
        path = planned_curve(path)
    if isinstance(path, PiecewiseCubic):
        curve = path if isinstance(path, CubicPath) else CubicPath(path.breaks, path.coefficients)
        if curve.coefficients.shape[2] != pepper.n:
            raise InvalidValueError("path", f"{curve.coefficients.shape[2]} joints", f"{pepper.n} joints")
        return curve
    points = np.atleast_2d(as_joint_vectors(pepper, path, "way-points"))
    if points.ndim != 2 or not len(points):
        raise InvalidValueError("way-points", f"shape {points.shape}", f"shape (k, {pepper.n}), k >= 1")
    return points


def polyline(points: Array) -> CubicPath:
    """Return the straight edges between way-points, shape (k, n), k >= 2, as a curve over their numbers."""
    coefficients = np.zeros((len(points) - 1, 4, points.shape[1]))
    coefficients[:, 0], coefficients[:, 1] = points[:-1], np.diff(points, axis=0)
    return CubicPath(np.arange(len(points)).astype(np.float64), coefficients)


def dense_states(
    pepper: PepperModel, scene: Scene | None, path: Array | CubicPath | Trajectory, step: float = SHORTEST
) -> DenseStates:
    """Return states, ends included, between which no point of the body moves more than a step [m].

    Args:
        pepper: The robot.
        scene: The world, with what the robot holds; None for the robot alone.
        path: Way-points [rad or m], shape (k, n); a curve or a trajectory.
        step: The greatest distance that a point moves [m].

    Raises:
        InvalidValueError: for a path so long that these are more than `MOST_STATES`.
    """
    if isinstance(path, Trajectory):
        return _of_trajectory(pepper, scene, path, step)
    if not isinstance(path, CubicPath):
        if len(path) == 1:
            return DenseStates(path, np.zeros(1))
        path = polyline(path)
    reach = reach_along(pepper, scene, path)
    counts = np.empty(len(path.coefficients), np.int64)
    count = count_intervals(path.breaks, path.coefficients, reach, step, counts)
    _refuse_many(pepper, count, _way(path), reach, step)
    parts = cut(path.breaks, path.coefficients, reach, step)
    last = len(path.breaks) - 2
    segment = np.append(parts.segment, last)
    local = np.append(parts.begin, path.breaks[-1] - path.breaks[-2])
    return DenseStates(path.at(segment, local), path.breaks[segment] + local)


def _way(curve: CubicPath) -> Array:
    """Return how far joints go from end to end of its pieces, summed up, shape (n,) [rad or m]."""
    h, (_, first, second, third) = np.diff(curve.breaks)[:, None], curve.coefficients.swapaxes(0, 1)
    return np.asarray(np.abs((first + (second + third * h) * h) * h).sum(axis=0))


def _refuse_many(pepper: PepperModel, count: float, way: Array, reach: Array, step: float) -> None:
    """Refuse a path of too many states.

    Args:
        pepper: The robot.
        count: Number of states.
        way: How far each joint goes [rad or m], shape (n,).
        reach: How far a joint moves a point of the body, shape (n,).
        step: Between two states a point moves as far [m].

    Raises:
        InvalidValueError: naming the joint that moves the body farthest, and its way.
    """
    if not 0 <= count <= MOST_STATES:
        j = int(np.argmax(way * np.where(way > 0, reach, 0.0)))
        got = f"one along which {pepper.joint_names[j]} goes {way[j]:.6g} {pepper.joint_units[j]}"
        allowed = f"at most {MOST_STATES:,} states {1000 * step:g} mm apart: give it in parts"
        raise InvalidValueError("path", got, allowed)


def _of_trajectory(pepper: PepperModel, scene: Scene | None, path: Trajectory, step: float) -> DenseStates:
    if path.duration / INSTANTS > MOST_STATES:
        allowed = f"at most {MOST_STATES * INSTANTS:g} s; cut it into parts with between()"
        raise InvalidValueError("duration", f"{path.duration:.6g} s", allowed)
    count = max(1, math.ceil(path.duration / INSTANTS))
    times = np.linspace(0.0, path.duration, count + 1)
    positions = path(times).position
    reach = reach_along(pepper, scene, polyline(positions))
    steps = np.abs(np.diff(positions, axis=0))
    share = np.ceil(steps @ reach / step)
    _refuse_many(pepper, float(share.sum()), steps.sum(axis=0), reach, step)
    parts = np.maximum(1, share).astype(np.int64)
    if parts.max() > 1:
        width = np.repeat(np.diff(times) / parts, parts)
        inner = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        times = np.append(np.repeat(times[:-1], parts) + inner * width, path.duration)
        positions = path(times).position
    return DenseStates(positions, times)
