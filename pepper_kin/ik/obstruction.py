"""Why a target was not reached."""

from __future__ import annotations

from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.descenders import make_descender
from pepper_kin.ik.problem import Problem
from pepper_kin.ik.restarts import starts
from pepper_kin.ik.result import Status
from pepper_kin.ik.search import Budget, Search, search

# Starts for the question whether a less bounded robot would reach the target.
STARTS = 3

# Targets that can be met take few steps.
STEPS = 60


def find_status(problem: Problem, found: Search, solver: str, budget: Budget) -> Status:
    """Return how a search ended.

    The target is blocked by collision where it was met while touching something, and by limits where the same
    joints meet it once their limits are taken away; otherwise it is out of reach.

    Args:
        problem: The problem.
        found: The search's outcome.
        solver: Name of the solver.
        budget: The search's budget; its deadline holds here too.
    """
    if found.best.met and found.best.free:
        return Status.SOLVED
    if found.timed_out:
        return Status.TIMED_OUT
    if found.met_in_collision:
        return Status.CLOSEST_COLLISION
    unlimited = problem.without_limits()
    steps = min(STEPS, budget.max_iterations)
    descender = make_descender(solver, unlimited)
    for start in (found.best.q, *starts(unlimited, budget.seed, STARTS)):
        descent = descender.descend(start, start, steps, budget.deadline)
        if descent.timed_out:
            return Status.TIMED_OUT
        if unlimited.is_met(descent.residuals):
            return Status.CLOSEST_LIMITS
    return Status.CLOSEST_UNREACHABLE


def would_all_joints_help(whole: Problem, solver: str, budget: Budget) -> bool:
    """Whether a problem in which every joint may move is solved, collisions left out."""
    found = search(
        whole, make_descender(solver, whole), Collisions(whole.pepper, None), budget._replace(restarts=STARTS)
    )
    return found.best.met
