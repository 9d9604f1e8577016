"""Which planner searches, and which of several goals is worth its path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pepper_kin import planners
from pepper_kin.exceptions import InvalidValueError, MissingDependencyError

PLANNERS = ("rrt_connect", "rrt_star")

ITERATIONS_TO_COMPARE = 300
"""Samples for the path to each further goal, once there is a path to one."""

MOST_COMPARED = 1
"""Further goals to which paths are searched, nearest first."""

SHORTCUTS_TO_COMPARE = 40
"""Short-cuts tried before paths to different goals are compared."""

GAIN_TO_COMPARE = 0.02
"""Part of the length that each of them has to save."""

SHARE_OF_TIME = 0.02
"""Part of the time budget that they may take."""


def check_planner(planner: str, constrained: bool, compiled: bool) -> None:
    """Refuse a planner that there is not, or that does not do what is asked of it.

    Raises:
        InvalidValueError: for an unknown planner, one that the installed OMPL lacks, and options that
            constraints leave no choice of.
        MissingDependencyError: for a planner of OMPL's where that is not installed.
    """
    own = ", ".join(map(repr, PLANNERS))
    if planner not in PLANNERS:
        available = planners.available_ompl_planners()
        if planner in planners.OMPL_PLANNERS and not available:
            raise MissingDependencyError("ompl", "pip install 'pepper_kin[ompl]'", f"planner {planner!r}")
        if planner not in available:
            lacking = " (the installed ompl lacks it)" if planner in planners.OMPL_PLANNERS else ""
            allowed = ", ".join((own, *map(repr, available)))
            raise InvalidValueError("planner", f"{planner!r}{lacking}", f"one of {allowed}")
    if constrained and planner != PLANNERS[0]:
        raise InvalidValueError("planner", repr(planner), f"{PLANNERS[0]!r} (the default) with constraints")
    if constrained and not compiled:
        raise InvalidValueError("compiled", compiled, "True with constraints")


def find_path(
    problem: planners.Problem, planner: str, *, seed: int, timeout: float, compare: bool
) -> planners.Result:
    """Search a path.

    Args:
        problem: What to plan.
        planner: "rrt_connect", "rrt_star" or a name of OMPL's.
        seed: Seed of all random choices.
        timeout: Time budget [s].
        compare: Whether paths to further goals are searched too, and the shortest is returned, shortened.
    """
    if planner == "rrt_star":
        return planners.rrt_star(problem, seed=seed, timeout=timeout)
    if planner != "rrt_connect":
        return planners.ompl_plan(problem, planner, seed=seed, timeout=timeout)
    first = planners.rrt_connect(problem, seed=seed, timeout=timeout)
    if first.path is None or not compare or len(problem.goals) == 1:
        return first
    best, shortest = first, _shortened(problem, first.path, seed, timeout)
    checked, spent = first.states_checked, first.time
    straight = problem.metric.distance(problem.start, problem.goals)
    others = [int(k) for k in np.argsort(straight, kind="stable") if k != first.goal_index]
    for k in others[:MOST_COMPARED]:
        if spent >= timeout or straight[k] >= shortest.length:
            break
        found = planners.rrt_connect(
            problem.towards(k), seed=seed, timeout=timeout - spent, max_iterations=ITERATIONS_TO_COMPARE
        )
        checked, spent = checked + found.states_checked, spent + found.time
        if found.path is not None:
            path = _shortened(problem, found.path, seed, timeout)
            if path.length < shortest.length:
                best, shortest = replace(found, goal_index=k), path
    return replace(best, path=shortest, cost=shortest.length, states_checked=checked, time=spent)


def _shortened(problem: planners.Problem, path: planners.Path, seed: int, timeout: float) -> planners.Path:
    """Return a path after a few short-cuts, checked as closely as the search itself checks."""
    return planners.shortcut(
        problem, path, seed=seed, iterations=SHORTCUTS_TO_COMPARE, resolution=problem.spacing,
        least_gain=GAIN_TO_COMPARE, timeout=SHARE_OF_TIME * timeout,
    )  # fmt: skip
