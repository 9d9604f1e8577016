"""Which planner searches, and which of several goals is worth its path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pepper_kin import planners

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
