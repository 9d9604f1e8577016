"""The closest configuration where tasks of different weights compete."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast.compiled_tasks import compiled_tasks
from pepper_kin.ik.fast.search import BatchSearch, FastSolver, search_compiled
from pepper_kin.ik.problem import Problem, SearchBudget

STARTS, STEPS = 128, 60
"""Further starts, and steps from each at most.  Of 1200 answers one then missed the least cost known by more
than 2 %; with half as many starts and 100 steps, in three quarters of the time, six did."""


def closest(problem: Problem, collisions: Collisions, budget: SearchBudget, q: Array) -> Array:
    """Return the configuration of least cost of q and where further starts lead, both shape (n,) [rad or m].

    What a descent is compared with, that is its posture term, the gain of its last step and how far starts
    agree, has the scale of weights around 1.  A task of weight 0.01 that is 5 cm off adds 1e-7 to the cost,
    no more than the posture term does.  Here the least weight is 1.

    Args:
        problem: Tasks that are not met together; at least one has a finite tolerance.
        collisions: What may not touch, unless something does at q.
        budget: Its seed, steps and deadline count.
        q: What was found so far, shape (n,) [rad or m].
    """
    least = min(task.weight for task in problem.tasks if math.isfinite(task.tolerance))
    scaled = replace(problem, tasks=tuple(task.weighted(1.0 / least) for task in problem.tasks))
    must_be_free = collisions.free(q)

    def cost(end: Array) -> float:
        return scaled.task_cost(scaled.residuals(end))

    def is_better(end: Array, than: Array) -> bool:
        return cost(end) < cost(than) and (not must_be_free or collisions.free(end))

    best = next((end for end in _ends(scaled, collisions, budget) if is_better(end, q)), q)
    solver = FastSolver(scaled)
    for clear in (False, True) if collisions.considered and collisions.free(best) else (False,):
        polished = solver.descend(best, collisions, budget, clear=clear)
        if is_better(polished, best):
            return polished
    return best


def _ends(problem: Problem, collisions: Collisions, budget: SearchBudget) -> Array:
    """Return where searches from random starts end, the best first, shape (STARTS, n) [rad or m]."""
    pepper, tasks, q0, movable = problem.pepper, problem.tasks, problem.q0, problem.movable
    ready = compiled_tasks(pepper, tasks)
    index = ready.index[movable[ready.index]]
    low, high = np.maximum(problem.lower, q0 - np.pi)[index], np.minimum(problem.upper, q0 + np.pi)[index]
    starts = np.tile(q0, (STARTS, 1))
    starts[:, index] = np.random.default_rng(budget.seed).uniform(low, high, (STARTS, index.size))
    budget = budget._replace(restarts=0, max_iterations=min(STEPS, budget.max_iterations), thorough=False)
    if ready.python is None:
        rows = BatchSearch(
            pepper, tasks, starts, movable, budget, scene=collisions.scene, margin=collisions.margin
        )
        rows.solve(0, STARTS)
        ends, _, errors, *_ = rows.answers()
    else:
        found = [search_compiled(pepper, tasks, start, movable, budget, collisions) for start in starts]
        ends = np.array([one.q for one in found])
        errors = np.array([[np.linalg.norm(r) for r in problem.residuals(end)] for end in ends])
    return np.asarray(ends[np.argsort(errors**2 @ [task.strength**2 for task in tasks], kind="stable")])
