"""Task priorities: hard tasks, positions of poses, and narrow tolerances first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.problem import Problem, SearchBudget
from pepper_kin.ik.solvers import make_solver
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE, POSITION_TOLERANCE, Array, Task

# Factors on the weight of hard tasks, one after the other, until they are met: HARD_WEIGHT is enough unless
# a tolerance is very narrow.
RAISED = (10.0, 100.0)

# Factors on the weight of a task that yields, one after the other, until the task before it is met.
LOWERED = (1 / 30, 1 / 100)

# Factor on the weights of tasks with room in their tolerance, again and again, until all are met.
LOOSENED = 0.25
MOST_TIMES = 5

# A tolerance so many times the usual one has room, and an error below this part of it leaves some.
WIDE = 4.0
ROOM = 0.95

# Starts of a further search, where no descent from the end of the first one meets the tasks of priority.
STARTS = 8

# The error has to fall below this part of what it was for another configuration to be taken.
PROGRESS = 0.99


def balanced(tasks: Sequence[Task]) -> tuple[Task, ...]:
    """Return the tasks with the soft weights scaled so that none exceeds the least weight of a hard task.

    Only among themselves soft weights matter then, however large they are.
    """
    for task in tasks:
        if task.hard:
            break
    else:
        return tuple(tasks)
    least = min(task.weight for task in tasks if task.hard)
    most = max((task.weight for task in tasks if not task.hard), default=0.0)
    if most <= least:
        return tuple(tasks)
    return tuple(task if task.hard else task.weighted(least / most) for task in tasks)


def is_ordered(tasks: Sequence[Task]) -> bool:
    """Whether some tasks may give way to others."""
    if len(tasks) < 2:
        return False
    mixed = any(task.hard for task in tasks) and not all(task.hard for task in tasks)
    return mixed or any(task.yields or _has_freedom(task) for task in tasks)


@dataclass(frozen=True, eq=False)
class SolverContext:
    """How to search on.

    Attributes:
        solver: Name of the solver.
        collisions: What may not touch; a free configuration stays free.
        budget: Steps of each descent, and the deadline.
    """

    solver: str
    collisions: Collisions
    budget: SearchBudget


def solve_with_priorities(problem: Problem, context: SolverContext, q: Array) -> Array:
    """Return a configuration that meets better what comes first, searched from where the search ended.

    The search itself weighs hard tasks HARD_WEIGHT times as much as others, which meets them to a fraction of
    a millimeter.  Where one is still not met, its weight is raised in steps and the descent goes on from q
    (the penalty method: Nocedal and Wright, Numerical Optimization, 2006, ch. 17).  Then tasks that yield get
    smaller weights in the same way, until those before them are met, and last the tasks that are met with
    room to spare in a wide tolerance, until all are.

    Args:
        problem: The problem.
        context: How to search.
        q: Where the search ended, shape (n,) [rad or m].

    Returns:
        Joint positions within the bounds, shape (n,); q itself where nothing is gained.
    """
    firm = [k for k, task in enumerate(problem.tasks) if task.hard]
    if 0 < len(firm) < len(problem.tasks):
        for factor in RAISED:
            if _worst(problem, firm, q) <= 1:
                break
            problem = _reweighted(problem, firm, factor)
            q = _better(problem, context, q, firm)
    return _relax(problem, context, _let_yield(problem, context, q))


def _let_yield(problem: Problem, context: SolverContext, q: Array) -> Array:
    """Return where the tasks with one that yields to them are met, as far as they can be."""
    tasks = problem.tasks
    leaders = [k - 1 for k in range(1, len(tasks)) if _gives_way(tasks[k], tasks[k - 1])]
    leaders = [k for k in leaders if _worst(problem, [k], q) > 1]
    if not leaders:
        return q
    yielding, trial = [k + 1 for k in leaders], problem
    for factor in LOWERED:
        trial = _reweighted(problem, yielding, factor)
        q = _unless_worse(problem, _better(trial, context, q, leaders), q)
        if _worst(problem, leaders, q) <= 1:
            return q
    again = _search_again(trial, context)
    if (context.collisions.free(again) or not context.collisions.free(q)) and _worst(
        problem, leaders, again
    ) <= 1:
        return _unless_worse(problem, again, q)
    return q


def _relax(problem: Problem, context: SolverContext, q: Array) -> Array:
    """Return where all tasks are met, if lowering the weights of those with room leads there, else q."""
    places = range(len(problem.tasks))
    if _worst(problem, places, q) <= 1:
        return q
    end = q
    for time in range(MOST_TIMES):
        loose = [k for k in places if _has_freedom(problem.tasks[k]) and _worst(problem, [k], end) < ROOM]
        if not loose:
            break
        problem = _reweighted(problem, loose, LOOSENED)
        tight = [k for k in places if _worst(problem, [k], end) > 1]
        before, end = end, _better(problem, context, end, tight)
        if _worst(problem, places, end) <= 1:
            return end
        if end is before and time == 0:
            break
    return q


def _has_freedom(task: Task) -> bool:
    usual = POSITION_TOLERANCE if task.unit == "m" else ANGLE_TOLERANCE
    return not task.hard and task.tolerance >= WIDE * usual


def _gives_way(task: Task, before: Task) -> bool:
    return task.yields and (before.hard or not task.hard)


def _unless_worse(problem: Problem, new: Array, old: Array) -> Array:
    """Return the new configuration unless a hard task is unmet there and better met by the old one."""
    firm = [k for k, task in enumerate(problem.tasks) if task.hard]
    return new if _worst(problem, firm, new) <= max(1.0, _worst(problem, firm, old)) else old


def _reweighted(problem: Problem, places: Sequence[int], factor: float) -> Problem:
    """Return the problem with the weights of some tasks multiplied."""
    tasks = [task.weighted(factor) if k in places else task for k, task in enumerate(problem.tasks)]
    return replace(problem, tasks=tuple(tasks))


def _better(problem: Problem, context: SolverContext, q: Array, first: Sequence[int]) -> Array:
    """Return where a descent from q ends if the tasks `first` are better met there, else q."""
    collisions, budget = context.collisions, context.budget
    solver = make_solver(context.solver, problem)
    before = _worst(problem, first, q)
    for clear in (False, True):
        if clear and not (collisions.considered and collisions.free(q)):
            break
        end = solver.descend(q, collisions, budget, clear=clear)
        if _worst(problem, first, end) < PROGRESS * before and collisions.free(end):
            return end
    return q


def _search_again(problem: Problem, context: SolverContext) -> Array:
    """Return the outcome of a search from the start."""
    budget = context.budget._replace(restarts=min(STARTS, context.budget.restarts))
    return make_solver(context.solver, problem).search(context.collisions, budget).q


def _worst(problem: Problem, places: Sequence[int], q: Array) -> float:
    """Return the largest error of some tasks, as a part of the tolerance."""
    pepper = problem.pepper
    parts = [problem.tasks[k].error(pepper, q) / problem.tasks[k].tolerance for k in places]
    return float(np.max(parts, initial=0.0))
