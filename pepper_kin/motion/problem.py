"""A planning problem: the joints that move, their box, metric and validity."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.collision.curve_examination import is_clear_along
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.core.collision.layout import WIDEST
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import IKResult
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import (
    as_joint_vector,
    as_real,
    check_positive,
    check_within_limits,
    shown,
)
from pepper_kin.motion.checks import Checks
from pepper_kin.trajectory.path import CubicPath

RESOLUTION = 0.01  # distance between checked states [m], in the metric of `motion_bounds`
COARSE = 0.02
"""Distance between checked states if the spline is examined at much finer steps afterwards [m]."""
UNBOUNDED_RANGE = {"rad": np.pi, "m": 2.0}  # range sampled around start and goal of a joint without limits


class Ends(NamedTuple):
    """Ends of a path.

    Attributes:
        start: Start configuration [rad or m], shape (n,).
        goals: Goal configurations [rad or m], the best first, shape (m, n).
        free: Indices of the joints that move, increasing, shape (k,).
        ik: Result of inverse kinematics if the goal was given as tasks.
        kept: Margins that the ends keep to the scene and of the robot to itself [m]; None if not known yet.
    """

    start: Array
    goals: Array
    free: NDArray[np.int64]
    ik: IKResult | None = None
    kept: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class PathProblem:
    """Problem of a path search.

    Attributes:
        checks: The robot in its scene.
        start: Start configuration [rad or m], shape (n,).
        goals: Goal configurations [rad or m], shape (m, n).
        free: Indices of the joints that move, shape (k,).
        margins: Margins to the scene and of the robot to itself [m].
        box: Lower and upper bounds of the joints that move, shape (2, k).
        limits: Lower and upper limits of all joints, shape (2, n); infinite if there are none.
        diagonal: Length of the box's diagonal in the metric [m].
        metric: Metric of the joints that move, weighted by bounds on how far each moves a point of the body.
        reach: Bounds on how far each joint moves a point of the body, shape (n,), see `motion_bounds`;
            infinite if a carried prismatic joint has no limits.
        resolution: Maximum distance between checked states in the metric [m].
        least: Margin that the curve must keep to the scene at every point [m].
        margins_relaxed: Whether the margins are smaller than start and goal allow, because no path was found
            with larger ones.
    """

    checks: Checks
    start: Array
    goals: Array
    free: NDArray[np.int64]
    margins: tuple[float, float]
    box: Array
    diagonal: float
    limits: Array
    metric: planners.Metric
    reach: Array
    resolution: float
    least: float = 0.0
    margins_relaxed: bool = False

    @property
    def relaxed_margins(self) -> tuple[float, float]:
        """Half the margins, for curves: smoothing the corners of a path at a margin's boundary crosses it."""
        return max(self.margins[0] / 2, self.least), self.margins[1] / 2

    @property
    def strictly(self) -> bool:
        """Whether the curve's margin to the scene must be proven between the checked states as well."""
        return self.least > 0.0

    def finer(self) -> PathProblem:
        """Return the problem at the fine resolution, for paths that are not examined more closely."""
        return replace(self, resolution=RESOLUTION)

    @cached_property
    def moving_start(self) -> Array:
        """Start positions of the joints that move, within the box, shape (k,)."""
        return np.minimum(np.maximum(self.start[self.free], self.box[0]), self.box[1])

    @cached_property
    def moving_goals(self) -> Array:
        """Goal positions of the joints that move, within the box, shape (m, k)."""
        inside = np.minimum(np.maximum(self.goals[:, self.free], self.box[0]), self.box[1])
        return np.ascontiguousarray(inside)

    @cached_property
    def search_problem(self) -> planners.Problem:
        """The problem in the form that planners take."""
        names = self.checks.pepper.joint_names
        return planners.Problem(
            lower=self.box[0],
            upper=self.box[1],
            start=self.moving_start,
            goals=self.moving_goals,
            validity=self.checks.validity(self.start, self.free, self.margins),
            weights=self.metric.weights,
            resolution=self.resolution,
            labels=tuple(names[j] for j in self.free.tolist()),
        )

    @cached_property
    def relaxed(self) -> planners.Problem:
        """The problem with half the margins."""
        return self.search_problem.with_validity(
            self.checks.validity(self.start, self.free, self.relaxed_margins)
        )

    def is_clear(self, curve: CubicPath, margins: tuple[float, float]) -> bool:
        """Whether a curve of the joints that move keeps margins everywhere; see `is_clear_along`."""
        kept, motion = (max(margins[0], self.least), margins[1]), (self.start, self.free)
        return is_clear_along(self.checks, curve, kept, motion=motion, strictly=self.strictly)

    def embed(self, states: Array) -> Array:
        """Return whole configurations, shape (m, n), for states of the moving joints, shape (m, k)."""
        q = np.empty((len(states), self.start.size))
        q[:] = self.start
        q[:, self.free] = np.clip(states, *self.box)
        return q


def path_problem(
    checks: Checks,
    start: Array,
    goals: Array,
    free: NDArray[np.int64],
    margin: float,
    resolution: float = RESOLUTION,
    least: float = 0.0,
    kept: tuple[float, float] | None = None,
) -> PathProblem:
    """Return the problem of moving from a start, shape (n,), to one of some goals, shape (m, n).

    Args:
        checks: The robot in its scene.
        start: Start configuration [rad or m], shape (n,); joints that are not free stay there.
        goals: Goal configurations [rad or m], shape (m, n).
        free: Indices of the joints that move, shape (k,).
        margin: Distance to keep if the ends allow it [m].
        resolution: Maximum distance between checked states in the metric [m].
        least: Margin that the curve must keep to the scene at every point, and that the ends keep [m].
        kept: Margins that the ends keep, if known [m].
    """
    pepper, held = checks.pepper, checks.held
    limits, bounded, reach = _limits(pepper, held)
    scene_margin, own_margin = checks.margins(start, goals, free, margin) if kept is None else kept
    if bounded:
        box, diagonal, metric = _within_limits(pepper, held, free.tobytes())
    else:
        ends = np.vstack([start, goals])
        spare = np.array([UNBOUNDED_RANGE[unit] for unit in pepper.joint_units])
        around = np.stack([ends.min(axis=0) - spare, ends.max(axis=0) + spare])
        whole = np.where(np.isfinite(limits), limits, around)
        weights = reach if np.isfinite(reach).all() else motion_bounds(pepper, whole[0], whole[1], held)
        box, metric = np.ascontiguousarray(whole[:, free]), planners.Metric(weights[free])
        diagonal = float(metric.distance(*box))
    return PathProblem(
        checks=checks,
        start=start,
        goals=goals,
        free=free,
        margins=(max(scene_margin, least), own_margin),
        box=box,
        diagonal=diagonal,
        limits=limits,
        metric=metric,
        reach=reach,
        resolution=resolution,
        least=least,
    )


@kept_for_robot(most=32)
def _limits(pepper: PepperModel, held: tuple[tuple[str, float], ...]) -> tuple[Array, bool, Array]:
    """Return the limits of all joints, shape (2, n), whether all are finite, and `motion_bounds`."""
    limits = np.stack([pepper.lower_limits, pepper.upper_limits])
    return limits, bool(np.isfinite(limits).all()), motion_bounds(pepper, held=held)


@kept_for_robot(most=64)
def _within_limits(
    pepper: PepperModel, held: tuple[tuple[str, float], ...], free: bytes
) -> tuple[Array, float, planners.Metric]:
    """Return limits of joints, shape (2, k), their diagonal and metric, for a robot with finite limits."""
    places = np.frombuffer(free, np.int64)
    limits, _, reach = _limits(pepper, held)
    box = np.ascontiguousarray(limits[:, places])
    box.setflags(write=False)
    metric = planners.Metric(reach[places])
    return box, float(metric.distance(*box)), metric


def check_robot(pepper: object) -> None:
    """Refuse another type than a robot.

    Raises:
        InvalidValueError: for another type.
    """
    if not isinstance(pepper, PepperModel):
        raise InvalidValueError("pepper", repr(pepper), "a robot, such as load_pepper() returns")


def checked_start(pepper: PepperModel, start: ArrayLike, margin: float, timeout: float) -> Array:
    """Check start, margin and timeout; return the start within the limits, shape (n,).

    Raises:
        InvalidValueError: for a start of wrong shape or with NaN, or an invalid margin or timeout.
        LimitError: for a start outside the joint limits.
    """
    check_positive("timeout", timeout, "[s]")
    checked_margin(margin)
    q_start = as_joint_vector(pepper, start, "start")
    check_examined(pepper, q_start, "start")
    return np.minimum(np.maximum(q_start, pepper.lower_limits), pepper.upper_limits)


def check_examined(pepper: PepperModel, q: Array, quantity: str) -> None:
    """Refuse positions outside the joint limits, or beyond the range of the collision check.

    Args:
        pepper: The robot.
        q: Joint positions [rad or m], shape (..., n).
        quantity: Name for the message.

    Raises:
        LimitError: for a position outside its limits, naming the worst joint, its value and its limits.
        InvalidValueError: for a revolute joint without limits, or a base, beyond WIDEST.
    """
    check_within_limits(pepper, q, quantity)
    if _limited_within_widest(pepper):
        return
    far = np.abs(q) > WIDEST
    if far.any():
        index = tuple(np.argwhere(far)[0])
        joint = int(index[-1])
        unit = pepper.joint_units[joint]
        allowed = f"-{WIDEST:g} to {WIDEST:g} {unit}" + (", less by full turns" if unit == "rad" else "")
        raise InvalidValueError(quantity, f"{pepper.joint_names[joint]} = {q[index]:.6g} {unit}", allowed)


@kept_for_robot(most=1)
def _limited_within_widest(pepper: PepperModel) -> bool:
    """Whether all joint limits are within WIDEST."""
    return bool(np.abs(_limits(pepper, ())[0]).max(initial=0.0) < WIDEST)


def checked_margin(margin: float) -> float:
    """Return a distance to keep [m], after checks.

    Raises:
        InvalidValueError: for a value that is not a finite distance of 0 or more.
    """
    if not 0.0 <= as_real(margin) < math.inf:
        raise InvalidValueError("margin", shown(margin), "a finite distance of 0 or more [m]")
    return float(margin)
