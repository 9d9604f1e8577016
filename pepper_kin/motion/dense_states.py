"""A path from anywhere as a curve, and as states so dense that nothing passes between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision import Scene
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.core.collision.curve_check import SHORTEST
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.motion.examination import cut, hull_of
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.path import CubicPath, PiecewiseCubic, PlannedPath, planned_curve

Array = NDArray[np.float64]

AnyPath: TypeAlias = "ArrayLike | PiecewiseCubic | PlannedPath | Trajectory"
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
        if path.joint_names != pepper.joint_names:
            names = ", ".join(path.joint_names), ", ".join(pepper.joint_names)
            raise InvalidValueError("joints of the trajectory", *names)
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


def reach_along(pepper: PepperModel, scene: Scene | None, curve: CubicPath) -> Array:
    """Return how far a joint moves a point of the body along a curve, shape (n,), see `motion_bounds`."""
    held = () if scene is None else tuple((item.frame, item.extent) for item in scene.attached.values())
    reach = motion_bounds(pepper, held=held)
    if np.isfinite(reach).all():
        return reach
    return motion_bounds(pepper, *hull_of(curve.breaks, curve.coefficients), held)


def dense_states(
    pepper: PepperModel, scene: Scene | None, path: Array | CubicPath | Trajectory, step: float = SHORTEST
) -> DenseStates:
    """Return states, ends included, between which no point of the body moves more than a step [m].

    Args:
        pepper: The robot.
        scene: The world, with what the robot holds; None for the robot alone.
        path: Way-points [rad or m], shape (k, n); a curve or a trajectory.
        step: The greatest distance that a point moves [m].
    """
    if isinstance(path, Trajectory):
        return _of_trajectory(pepper, scene, path, step)
    if not isinstance(path, CubicPath):
        if len(path) == 1:
            return DenseStates(path, np.zeros(1))
        path = polyline(path)
    reach = reach_along(pepper, scene, path)
    parts = cut(path.breaks, path.coefficients, reach, step)
    last = len(path.breaks) - 2
    segment = np.append(parts.segment, last)
    local = np.append(parts.begin, path.breaks[-1] - path.breaks[-2])
    return DenseStates(path.at(segment, local), path.breaks[segment] + local)


def _of_trajectory(pepper: PepperModel, scene: Scene | None, path: Trajectory, step: float) -> DenseStates:
    count = max(1, math.ceil(path.duration / INSTANTS))
    times = np.linspace(0.0, path.duration, count + 1)
    positions = path(times).position
    reach = reach_along(pepper, scene, polyline(positions))
    moved = np.abs(np.diff(positions, axis=0)) @ reach
    parts = np.maximum(1, np.ceil(moved / step)).astype(np.int64)
    if parts.max() > 1:
        width = np.repeat(np.diff(times) / parts, parts)
        inner = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        times = np.append(np.repeat(times[:-1], parts) + inner * width, path.duration)
        positions = path(times).position
    return DenseStates(positions, times)
