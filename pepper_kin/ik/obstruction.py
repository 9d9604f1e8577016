"""Explanation of unreached targets: obstructions, contradictions, and joints that would help."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pepper_kin.arrays import read_only
from pepper_kin.collision.checker import checker_for
from pepper_kin.collision.own_contacts import advice_on_own_links
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast.search import alternatives, search_compiled
from pepper_kin.ik.problem import SearchBudget, TaskProblem
from pepper_kin.ik.result import IKStatus
from pepper_kin.ik.solvers import make_solver
from pepper_kin.ik.tasks.task import words_for_length

RESTARTS = 3
"""Number of restarts of a search that asks whether a target can be reached at all."""

MOST_TASKS = 12
"""Maximum number of tasks among which contradictions are searched: each takes two searches."""

MUTED_WEIGHT, MUTED_TOLERANCE = 1e-8, 1e6
"""Strength and tolerance of a task that shall not count: its gradient is far below the posture term's."""

POSTURES = 24
"""Number of starts for postures that meet the tasks and whose contacts are counted."""


def what_would_help(problem: TaskProblem, whole: TaskProblem, solver: str, budget: SearchBudget) -> str:
    """Return the joints that, if free too, would let the target be reached, without collision checks.

    The answer is the joint group that frees the fewest further joints.

    Args:
        problem: Problem with the joints that may move.
        whole: Problem with all joints on which the tasks depend.
        solver: Name of the solver.
        budget: Budget of the search.

    Returns:
        Words such as "the torso" or "all joints"; empty if even all joints do not help.
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


def what_is_in_the_way(problem: TaskProblem, collisions: Collisions, budget: SearchBudget) -> str:
    """Return the two bodies that touch most often where the tasks are met, with the penetration depth.

    Args:
        problem: The problem.
        collisions: Collision checks.
        budget: Budget of the search; its seed draws postures.

    Returns:
        A clause; empty if no posture meets the tasks.
    """
    pepper, tasks, q0, movable = problem.pepper, problem.tasks, problem.q0, problem.movable
    first = search_compiled(pepper, tasks, q0, movable, budget)
    postures = [first.q] if first.status is IKStatus.SOLVED else []
    postures += alternatives(pepper, tasks, q0, movable, budget.seed, POSTURES, budget.max_iterations)
    checker = checker_for(pepper, collisions.scene, collisions.margin)
    depths: dict[tuple[str, str], list[float | None]] = {}
    for q in postures:
        for contact in checker.contact_points(q, collisions.margin):
            kept = collisions.margin if None in contact.links else 0.0
            if contact.distance is None or contact.distance <= kept:
                depth = None if contact.distance is None else kept - contact.distance
                depths.setdefault(contact.names, []).append(depth)
    if not depths:
        return ""
    names, found = max(depths.items(), key=lambda item: len(item[1]))
    known = [depth for depth in found if depth is not None]
    deep = f", {words_for_length(float(np.median(known)))} deep on the median" if known else ""
    advice = advice_on_own_links(pepper, names)
    said = f"; {advice}" if advice else ""
    return (
        f"of {len(postures)} postures that reach it, all collisions aside, {len(found)} have {names[0]} and "
        f"{names[1]} {'too near' if collisions.margin else 'touching'}{deep}{said}"
    )


def what_contradicts(problem: TaskProblem, solver: str, budget: SearchBudget) -> tuple[str, ...]:
    """Return the names of tasks that can be met one by one but not together, without collision checks.

    A deletion filter (Chinneck and Dravnieks, 1991) drops each task without which the others still cannot be
    met; the remaining tasks can be met as soon as any one of them is dropped.

    Args:
        problem: Problem whose tasks are not met together.
        solver: Name of the solver.
        budget: Budget of the search.

    Returns:
        Two names or more; empty if a task is not met even alone, or no contradiction was found.
    """
    kept = [k for k, task in enumerate(problem.tasks) if math.isfinite(task.tolerance)]
    if not 2 <= len(kept) <= MOST_TASKS:
        return ()
    if not all(_solvable(_with_only(problem, [k]), solver, budget) for k in kept):
        return ()
    for k in tuple(kept):
        rest = [other for other in kept if other != k]
        if len(rest) >= 2 and not _solvable(_with_only(problem, rest), solver, budget):
            kept = rest
    return tuple(problem.tasks[k].name for k in kept)


def _with_only(problem: TaskProblem, places: Sequence[int]) -> TaskProblem:
    """Return a problem in which only some tasks count, with the same machine code."""
    tasks = list(problem.tasks)
    for k, task in enumerate(tasks):
        if k not in places:
            weight = MUTED_WEIGHT / task.strength * task.weight
            tasks[k] = task.altered(weight=weight, tolerance=MUTED_TOLERANCE)
    return replace(problem, tasks=tuple(tasks))


def _solvable(problem: TaskProblem, solver: str, budget: SearchBudget) -> bool:
    """Whether a problem is solved without collision checks."""
    nothing = Collisions(problem.pepper, None)
    found = make_solver(solver, problem).search(nothing, budget._replace(restarts=RESTARTS))
    return found.status is IKStatus.SOLVED
