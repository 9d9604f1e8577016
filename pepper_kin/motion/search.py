"""Which planner searches, and which of several goals is worth its path."""

from __future__ import annotations

from dataclasses import replace

from pepper_kin import planners
from pepper_kin.exceptions import InvalidValueError, MissingDependencyError

PLANNERS = ("rrt_connect", "rrt_star")

SHORTCUTS_TO_COMPARE = 40
"""Short-cuts tried before other goals are."""

GAIN_TO_COMPARE = 0.02
"""Part of the length that each short-cut has to save."""

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
        compare: Whether the path is shortened and ends at another goal where that is nearer from a way-point.
    """
    if planner == "rrt_star":
        return planners.rrt_star(problem, seed=seed, timeout=timeout)
    if planner != "rrt_connect":
        return planners.ompl_plan(problem, planner, seed=seed, timeout=timeout)
    first = planners.rrt_connect(problem, seed=seed, timeout=timeout)
    if first.path is None or not compare or len(problem.goals) == 1:
        return first
    shortest = _shortened(problem, first.path, seed, timeout)
    path, goal = planners.rejoin(problem, shortest, int(first.goal_index or 0))
    return replace(first, path=path, cost=path.length, goal_index=goal)


def _shortened(problem: planners.Problem, path: planners.Path, seed: int, timeout: float) -> planners.Path:
    """Return a path after a few short-cuts, checked as closely as the search itself checks."""
    return planners.shortcut(
        problem, path, seed=seed, iterations=SHORTCUTS_TO_COMPARE, resolution=problem.spacing,
        least_gain=GAIN_TO_COMPARE, timeout=SHARE_OF_TIME * timeout,
    )  # fmt: skip
