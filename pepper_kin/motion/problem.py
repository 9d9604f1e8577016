"""A robot's motion as a planner sees it: the joints that move, their box, their metric and an oracle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_positive, check_within_limits
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.metric import joint_reaches

Array = NDArray[np.float64]

RESOLUTION = 0.01  # [m], in the metric of `joint_reaches`
UNBOUNDED_RANGE = {"rad": np.pi, "m": 2.0}  # sampled around start and goal where a joint has no limits


class PathProblem(NamedTuple):
    """Where a path is sought.

    Attributes:
        problem: The joints that move, with the margin kept.
        relaxed: The same with half the margin, which a rounded path needs beside it.
        embed: From states of the moving joints, shape (m, k), to whole configurations, shape (m, n).
    """

    problem: planners.Problem
    relaxed: planners.Problem
    embed: Callable[[Array], Array]


def path_problem(
    checks: Checks, start: Array, goals: Array, free: NDArray[np.int64], margin: float
) -> PathProblem:
    """Return the problem of moving from a start, shape (n,), to one of some goals, shape (m, n).

    Args:
        checks: The robot in its scene.
        start: Start configuration; joints that are not free stay there.
        goals: Goal configurations.
        free: Places of the joints that move, shape (k,).
        margin: Distance to keep where the ends allow it [m].
    """
    pepper = checks.pepper
    kept, kept_self = checks.margins(start, goals, margin)
    held = tuple((item.frame, item.extent) for item in checks.exact.scene.attached.values())
    ends = np.vstack([start, goals])
    spare = np.array([UNBOUNDED_RANGE[unit] for unit in pepper.joint_units])
    lower = np.where(np.isfinite(pepper.lower_limits), pepper.lower_limits, ends.min(axis=0) - spare)
    upper = np.where(np.isfinite(pepper.upper_limits), pepper.upper_limits, ends.max(axis=0) + spare)
    problem = planners.Problem(
        lower=lower[free],
        upper=upper[free],
        start=np.clip(start, lower, upper)[free],
        goals=np.clip(goals, lower, upper)[:, free],
        oracle=checks.oracle(start, free, (kept, kept_self), for_edges=True),
        weights=joint_reaches(pepper, held)[free],
        resolution=RESOLUTION,
        labels=tuple(pepper.joint_names[j] for j in free),
    )
    half = checks.oracle(start, free, (kept / 2, kept_self / 2), for_edges=False)

    def embed(states: Array) -> Array:
        q = np.tile(start, (len(states), 1))
        q[:, free] = np.clip(states, problem.lower, problem.upper)
        return q

    return PathProblem(problem, replace(problem, oracle=half), embed)


def checked_start(pepper: PepperModel, start: ArrayLike, margin: float, timeout: float) -> Array:
    """Check what was asked for; return the start, shape (n,).

    Raises:
        InvalidValueError: for a start of wrong shape or with NaN, a margin or timeout that is none.
        LimitError: for a start outside the joint limits.
    """
    check_positive("timeout", timeout, "[s]")
    if not (np.isfinite(margin) and margin >= 0):
        raise InvalidValueError("margin", margin, "a finite distance of 0 or more [m]")
    q_start = as_joint_vectors(pepper, start, "start")
    if q_start.ndim != 1:
        raise InvalidValueError("start", f"shape {q_start.shape}", f"shape ({pepper.n},)")
    check_within_limits(pepper, q_start, "start")
    return np.clip(q_start, pepper.lower_limits, pepper.upper_limits)
