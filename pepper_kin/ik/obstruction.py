"""Why a target was not reached."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.descenders import make_descender
from pepper_kin.ik.problem import Problem
from pepper_kin.ik.restarts import starts
from pepper_kin.ik.result import Status
from pepper_kin.ik.search import Budget, Search, search
from pepper_kin.model.shapes import read_only

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


def what_would_help(problem: Problem, whole: Problem, solver: str, budget: Budget) -> str:
    """Return which joints, if they were free too, would let the target be reached, collisions left out.

    Of the robot's joint groups the one that frees fewest further joints is named.

    Args:
        problem: The problem with the joints that may move.
        whole: The same with all joints that the tasks depend on.
        solver: Name of the solver.
        budget: The search's budget.

    Returns:
        Words such as "the torso" or "all joints"; empty where even all joints do not help.
    """
    missing = whole.movable & ~problem.movable
    if not missing.any() or not _solvable(whole, solver, budget):
        return ""
    pepper = problem.pepper
    groups = {name: np.isin(pepper.joint_names, pepper.joint_group(name)) for name in pepper.group_names}
    smaller = [name for name in groups if (groups[name] & missing).any() and not groups[name].all()]
    for name in sorted(smaller, key=lambda name: ((groups[name] & missing).sum(), groups[name].sum())):
        freed = problem.movable | (groups[name] & missing)
        part = replace(
            whole,
            movable=freed,
            lower=read_only(np.where(freed, whole.lower, whole.q0)),
            upper=read_only(np.where(freed, whole.upper, whole.q0)),
        )
        if not (missing & ~groups[name]).any() or _solvable(part, solver, budget):
            return f"the {name.replace('_', ' ')}"
    return "all joints"


def _solvable(problem: Problem, solver: str, budget: Budget) -> bool:
    """Whether a problem is solved, collisions left out."""
    found = search(
        problem,
        make_descender(solver, problem),
        Collisions(problem.pepper, None),
        budget._replace(restarts=STARTS),
    )
    return found.best.met
