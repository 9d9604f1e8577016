"""Task priorities: hard tasks, positions of poses, and narrow tolerances first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.problem import SearchBudget, TaskProblem
from pepper_kin.ik.solvers import make_solver
from pepper_kin.ik.tasks.task import ANGLE_TOLERANCE, POSITION_TOLERANCE, Task

# Maximum weight of a preference that does not keep a task of weight 1 from its tolerance: a joint 1 rad from
# its preferred position shifts that task by some hundredths of a millimeter.
PREFERENCE = 1e-3

# Factors on the weights of hard tasks, applied in turn until they are met: HARD_WEIGHT is enough unless a
# tolerance is very narrow.
RAISED = (10.0, 100.0)

# Factors on the weight of a yielding task, applied in turn until the task before it is met.
LOWERED = (1 / 30, 1 / 100)

# Factor on the weight of a yielding task in a search for a configuration that meets the task before it.
ALONE = 1e-4

# Minimum weights of a task with a finite tolerance and of a hard task, if the maximum is 1. A task of a
# hundred times another's weight shifts by at most 0.1 mm per meter of the other's error.
LEAST_WEIGHT, LEAST_HARD_WEIGHT = 0.01, 0.1

# Factor on the weights of tasks with freedom in their tolerance, repeated until all tasks are met, and the
# maximum number of repetitions.
LOOSENED = 0.25
MOST_TIMES = 5

# Minimum ratio of a tolerance to the usual one, and maximum ratio of an error to its tolerance, at which a
# task has freedom.
WIDE = 4.0
SPARE = 0.95

# Maximum restarts of a further search if no descent from the end of the first one meets the leading tasks.
STARTS = 8

# Maximum ratio of the new error to the old one at which a configuration is replaced.
PROGRESS = 0.99


def balanced(tasks: Sequence[Task]) -> tuple[Task, ...]:
    """Return the tasks with weights that are balanced for the search, at most 1.

    Only ratios of weights matter to the result, but the thresholds of steps, damping and descents are made
    for weights around 1. All weights are divided by the largest hard weight; soft weights are then scaled so
    that none exceeds the smallest hard one. Without hard tasks, all are divided by the largest weight of a
    task with a finite tolerance. Weights of tasks with a finite tolerance have a minimum, see `LEAST_WEIGHT`;
    weights of preferences, with an infinite tolerance, do not exceed the others.
    """
    if all(task.weight == 1.0 for task in tasks):
        return tuple(tasks)
    hard = [task.weight for task in tasks if task.hard]
    others = [task.weight for task in tasks if not task.hard and math.isfinite(task.tolerance)]
    unit = max(hard or others or [task.weight for task in tasks])
    least = max(min(hard, default=unit) / unit, LEAST_HARD_WEIGHT) if hard else 1.0
    share = min(1.0, least / max(max(others, default=0.0) / unit, 1e-300)) if others else 1.0
    return tuple(
        _with_weight(task, _balanced_weight(task, task.weight / unit, share, least)) for task in tasks
    )


def _balanced_weight(task: Task, weight: float, share: float, least: float) -> float:
    """Return the balanced weight of one task from its weight relative to the largest, see `balanced`."""
    if task.hard:
        return max(weight, LEAST_HARD_WEIGHT)
    if math.isfinite(task.tolerance):
        return max(share * weight, LEAST_WEIGHT)
    return min(share * weight, least)


def equally_weighted(tasks: Sequence[Task]) -> tuple[Task, ...]:
    """Return the tasks with weights of 1, preferences with at most `PREFERENCE`.

    Whether tasks can be met together does not depend on their weights, but whether a descent succeeds does.
    """
    return tuple(
        _with_weight(task, 1.0 if math.isfinite(task.tolerance) else min(task.weight, PREFERENCE))
        for task in balanced(tasks)
    )


def _with_weight(task: Task, weight: float) -> Task:
    """Return a task with another weight."""
    return task if task.weight == weight else task.altered(weight=weight)


def is_ordered(tasks: Sequence[Task]) -> bool:
    """Return whether some tasks may be relaxed in favor of others."""
    return len(tasks) > 1 and (has_priorities(tasks) or any(_has_freedom(task) for task in tasks))


def has_priorities(tasks: Sequence[Task]) -> bool:
    """Return whether some tasks have priority independent of weights: hard tasks, and positions."""
    mixed = any(task.hard for task in tasks) and not all(task.hard for task in tasks)
    return mixed or any(task.yields for task in tasks)


@dataclass(frozen=True, eq=False)
class SolverContext:
    """Solver, collision checks and budget of further descents.

    Attributes:
        solver: Name of the solver.
        collisions: Collision checks; a free configuration stays free.
        budget: Steps of each descent, and deadline.
    """

    solver: str
    collisions: Collisions
    budget: SearchBudget


def solve_with_priorities(problem: TaskProblem, context: SolverContext, q: Array) -> Array:
    """Return a configuration that meets the tasks of priority better, by descents from the end of the search.

    The search weighs hard tasks HARD_WEIGHT times as much as others, which meets them to a fraction of a
    millimeter. If one is still not met, the weights of hard tasks are raised in steps, with a descent from q
    after each (the penalty method: Nocedal and Wright, Numerical Optimization, 2006, ch. 17). Then the
    weights of yielding tasks are lowered in steps until the tasks before them are met, and last the weights
    of tasks with freedom in a wide tolerance until all tasks are met.

    Args:
        problem: The problem.
        context: Solver, collision checks and budget.
        q: End of the search, shape (n,) [rad or m].

    Returns:
        Joint positions within the bounds, shape (n,) [rad or m]; q itself without a gain.
    """
    firm = [k for k, task in enumerate(problem.tasks) if task.hard]
    if 0 < len(firm) < len(problem.tasks):
        for factor in RAISED:
            if _worst(problem, firm, q) <= 1:
                break
            problem = _reweighted(problem, firm, factor)
            q = _better(problem, context, q, firm)
    return _relax(problem, context, _let_yield(problem, context, q))


def _let_yield(problem: TaskProblem, context: SolverContext, q: Array) -> Array:
    """Return a configuration that meets the tasks to which others yield, as far as one is found.

    Both q and the result are joint positions [rad or m], shape (n,).
    """
    tasks = problem.tasks
    pairs = enumerate(pairwise(tasks))
    leaders = [k for k, (task, after) in pairs if after.yields and (task.hard or not after.hard)]
    leaders = [k for k in leaders if _worst(problem, [k], q) > 1]
    if not leaders:
        return q
    yielding, trial = [k + 1 for k in leaders], problem
    for factor in LOWERED:
        trial = _reweighted(problem, yielding, factor)
        q = _unless_worse(problem, _better(trial, context, q, leaders), q)
        if _worst(problem, leaders, q) <= 1:
            return q
    few = context.budget._replace(restarts=min(STARTS, context.budget.restarts))
    again = make_solver(context.solver, trial).search(context.collisions, few).q
    if _is_gain(problem, context, again, q, leaders):
        return again
    # With yielding tasks of almost no weight the leading ones are met; then the yielding ones come nearer.
    trial = _reweighted(problem, yielding, ALONE)
    again = make_solver(context.solver, trial).search(context.collisions, context.budget).q
    if not _is_gain(problem, context, again, q, leaders):
        return q
    for factor in reversed(LOWERED):
        trial = _reweighted(problem, yielding, factor)
        end = _descended(trial, context, again)
        if not _is_gain(problem, context, end, again, leaders):
            break
        again = end
    return again


def _descended(problem: TaskProblem, context: SolverContext, q: Array) -> Array:
    """Return the end of a descent from q, shape (n,) each [rad or m], free of collisions if q is free."""
    clear = context.collisions.considered and context.collisions.free(q)
    return make_solver(context.solver, problem).descend(q, context.collisions, context.budget, clear=clear)


def _is_gain(
    problem: TaskProblem, context: SolverContext, new: Array, old: Array, leaders: Sequence[int]
) -> bool:
    """Whether new joint positions, shape (n,), meet the leaders and are not worse than the old ones."""
    clear = context.collisions.free(new) or not context.collisions.free(old)
    return clear and _worst(problem, leaders, new) <= 1 and _unless_worse(problem, new, old) is new


def _relax(problem: TaskProblem, context: SolverContext, q: Array) -> Array:
    """Return a configuration that meets all tasks, by lower weights of tasks with freedom; else q.

    Both q and the result are joint positions [rad or m], shape (n,).
    """
    places = range(len(problem.tasks))
    if _worst(problem, places, q) <= 1:
        return q
    end = q
    for time in range(MOST_TIMES):
        loose = [k for k in places if _has_freedom(problem.tasks[k]) and _worst(problem, [k], end) < SPARE]
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
    """Return whether a soft task's tolerance is wide."""
    usual = POSITION_TOLERANCE if task.unit == "m" else ANGLE_TOLERANCE
    return not task.hard and task.tolerance >= WIDE * usual


def _unless_worse(problem: TaskProblem, new: Array, old: Array) -> Array:
    """Return the new configuration unless a hard task is unmet there and better met by the old one.

    Both are joint positions [rad or m], shape (n,).
    """
    firm = [k for k, task in enumerate(problem.tasks) if task.hard]
    return new if _worst(problem, firm, new) <= max(1.0, _worst(problem, firm, old)) else old


def _reweighted(problem: TaskProblem, places: Sequence[int], factor: float) -> TaskProblem:
    """Return a problem with the weights of some tasks multiplied by a factor."""
    tasks = [task.weighted(factor) if k in places else task for k, task in enumerate(problem.tasks)]
    return replace(problem, tasks=tuple(tasks))


def _better(problem: TaskProblem, context: SolverContext, q: Array, first: Sequence[int]) -> Array:
    """Return the end of a descent from q if it is free and meets the tasks `first` better, else q.

    Both q and the result are joint positions [rad or m], shape (n,).
    """
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


def _worst(problem: TaskProblem, places: Sequence[int], q: Array) -> float:
    """Return the largest ratio of error to tolerance of some tasks at q, shape (n,) [rad or m]."""
    pepper = problem.pepper
    parts = [problem.tasks[k].error(pepper, q) / problem.tasks[k].tolerance for k in places]
    return float(np.max(parts, initial=0.0))
