"""A robot's motion as a planner sees it: the joints that move, their box, metric and validity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_positive, check_within_limits
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.examination import Examiner, hull_of
from pepper_kin.trajectory.path import CubicPath

Array = NDArray[np.float64]

RESOLUTION = 0.01  # [m], in the metric of `motion_bounds`
COARSE = 0.02
"""The same where the examination of the spline, which is far closer, tells whether that was close enough."""
UNBOUNDED_RANGE = {"rad": np.pi, "m": 2.0}  # sampled around start and goal where a joint has no limits


@dataclass(frozen=True, eq=False)
class PathProblem:
    """Where a path is sought.

    Attributes:
        checks: The robot in its scene.
        problem: The joints that move, with the margins kept.
        start: Start configuration, shape (n,).
        free: Places of the joints that move, shape (k,).
        margins: Kept to the scene and to the robot itself [m].
        reach: How far a joint moves a point of the body, shape (n,), see `motion_bounds`; infinite where a
            joint that is carried slides without limits.
        held: What hangs on the robot, see `motion_bounds`.
        least: What the curve must keep from the scene at every point [m].
        gave_way: Whether the margins are smaller than start and goal allow, since no path was found with
            greater ones.
    """

    checks: Checks
    problem: planners.Problem
    start: Array
    free: NDArray[np.int64]
    margins: tuple[float, float]
    reach: Array
    held: tuple[tuple[str, float], ...] = ()
    least: float = 0.0
    gave_way: bool = False

    @property
    def relaxed_margins(self) -> tuple[float, float]:
        """Half the margins: a curve that rounds the corners of a path along a margin's edge needs room."""
        return max(self.margins[0] / 2, self.least), self.margins[1] / 2

    def finer(self) -> PathProblem:
        """Return the problem at the resolution that paths have where nothing examines them more closely."""
        return replace(self, problem=self.problem.resolved(RESOLUTION))

    @cached_property
    def relaxed(self) -> planners.Problem:
        """The problem with half the margins."""
        return self.problem.with_validity(self.checks.validity(self.start, self.free, self.relaxed_margins))

    @cached_property
    def examiner(self) -> Examiner:
        """What examines curves of the joints that move."""
        return Examiner(self.checks, self.start, self.free)

    def is_clear(self, curve: CubicPath, margins: tuple[float, float]) -> bool:
        """Whether margins are kept all along a curve of the joints that move; see `Examiner.is_clear`."""
        reach = self.reach
        if not np.isfinite(reach).all():
            reach = motion_bounds(self.checks.pepper, *hull_of(curve.breaks, curve.coefficients), self.held)
        kept = max(margins[0], self.least), margins[1]
        return self.examiner.is_clear(
            curve.breaks, curve.coefficients, reach, kept, strictly=self.least > 0.0
        )

    def embed(self, states: Array) -> Array:
        """Return whole configurations, shape (m, n), for states of the moving joints, shape (m, k)."""
        q = np.empty((len(states), self.start.size))
        q[:] = self.start
        q[:, self.free] = np.clip(states, self.problem.lower, self.problem.upper)
        return q


def path_problem(
    checks: Checks,
    start: Array,
    goals: Array,
    free: NDArray[np.int64],
    margin: float,
    resolution: float = RESOLUTION,
    least: float = 0.0,
) -> PathProblem:
    """Return the problem of moving from a start, shape (n,), to one of some goals, shape (m, n).

    Args:
        checks: The robot in its scene.
        start: Start configuration; joints that are not free stay there.
        goals: Goal configurations.
        free: Places of the joints that move, shape (k,).
        margin: Distance to keep where the ends allow it [m].
        resolution: Greatest distance between states that are looked at [m], in the metric.
        least: What the curve must keep from the scene at every point, as the ends do [m].
    """
    pepper = checks.pepper
    kept, kept_self = checks.margins(start, goals, margin)
    kept, held = max(kept, least), held_by(checks)
    ends = np.vstack([start, goals])
    spare = np.array([UNBOUNDED_RANGE[unit] for unit in pepper.joint_units])
    lower = np.where(np.isfinite(pepper.lower_limits), pepper.lower_limits, ends.min(axis=0) - spare)
    upper = np.where(np.isfinite(pepper.upper_limits), pepper.upper_limits, ends.max(axis=0) + spare)
    reach = motion_bounds(pepper, held=held)
    weights = reach if np.isfinite(reach).all() else motion_bounds(pepper, lower, upper, held)
    problem = planners.Problem(
        lower=lower[free],
        upper=upper[free],
        start=np.clip(start, lower, upper)[free],
        goals=np.clip(goals, lower, upper)[:, free],
        validity=checks.validity(start, free, (kept, kept_self)),
        weights=weights[free],
        resolution=resolution,
        labels=tuple(pepper.joint_names[j] for j in free),
    )
    return PathProblem(checks, problem, start, free, (kept, kept_self), reach, held, least)


def held_by(checks: Checks) -> tuple[tuple[str, float], ...]:
    """Return what hangs on the robot, see `motion_bounds`."""
    return tuple((item.frame, item.extent) for item in checks.exact.scene.attached.values())


def checked_start(pepper: PepperModel, start: ArrayLike, margin: float, timeout: float) -> Array:
    """Check what was asked for; return the start, shape (n,).

    Raises:
        InvalidValueError: for a start of wrong shape or with NaN, a margin or timeout that is none.
        LimitError: for a start outside the joint limits.
    """
    check_positive("timeout", timeout, "[s]")
    checked_margin(margin)
    q_start = as_joint_vectors(pepper, start, "start")
    if q_start.ndim != 1:
        raise InvalidValueError("start", f"shape {q_start.shape}", f"shape ({pepper.n},)")
    check_within_limits(pepper, q_start, "start")
    return np.clip(q_start, pepper.lower_limits, pepper.upper_limits)


def checked_margin(margin: float) -> float:
    """Return a distance to keep [m].

    Raises:
        InvalidValueError: for what is none.
    """
    if not (np.isfinite(margin) and margin >= 0):
        raise InvalidValueError("margin", margin, "a finite distance of 0 or more [m]")
    return margin
