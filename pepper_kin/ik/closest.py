"""Search for the closest configuration where tasks of different weights compete."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast.search import BatchSearch, FastSolver, search_compiled
from pepper_kin.ik.problem import SearchBudget, TaskProblem, joints_used
from pepper_kin.ik.tasks.structure import known_structures

STARTS, ROUNDS, ROUND, STEPS = 64, 6, 16, 60
"""Number of random starts, number of rounds, mixed starts per round, and maximum number of steps from
each."""

PARENTS, REDRAWN = 4, 0.4
"""Number of best minima from which starts are mixed, and probability of a joint to be drawn anew. For two
problems whose best minimum one random start in 128 leads to, 128 random starts missed it 9 times of 48; 128
starts of which half were mixed missed it once."""

SAME = 1e-6
"""Relative difference of costs below which two minima are the same."""


def closest(problem: TaskProblem, collisions: Collisions, budget: SearchBudget, q: Array) -> Array:
    """Return the configuration of least cost among q and the ends of further descents, shape (n,) [rad or m].

    The thresholds of a descent (posture term, gain of the last step, agreement of starts) are scaled for
    weights around 1. A task of weight 0.01 that is 5 cm off adds 1e-7 to the cost, no more than the posture
    term. Here weights are scaled to a minimum of 1.

    Args:
        problem: Tasks that are not met together; at least one has a finite tolerance.
        collisions: Collision checks, which count if q is free.
        budget: Seed, steps and deadline of the search.
        q: Best configuration so far, shape (n,) [rad or m].
    """
    least = min(task.weight for task in problem.tasks if math.isfinite(task.tolerance))
    scaled = replace(problem, tasks=tuple(task.weighted(1.0 / least) for task in problem.tasks))
    must_be_free = collisions.considered and collisions.free(q)

    def cost(end: Array) -> float:
        return scaled.task_cost(scaled.residuals(end))

    def is_better(end: Array) -> bool:
        return cost(end) < cost(best) and (not must_be_free or collisions.free(end))

    best, solver = q, FastSolver(scaled)
    ends = _ends(scaled, budget, cost(q))
    free = collisions.free_many(ends) if must_be_free else np.ones(len(ends), dtype=bool)
    if free.any():
        best = ends[int(np.argmax(free))]
    for clear in (False, True) if must_be_free else (False,):
        polished = solver.descend(best, collisions, budget, clear=clear)
        if is_better(polished):
            return polished
    return best


def _ends(problem: TaskProblem, budget: SearchBudget, worst: float) -> Array:
    """Return minima below a cost, without collision checks, the best first, shape (m, n) [rad or m]."""
    pepper, q0 = problem.pepper, problem.q0
    index = np.flatnonzero(problem.movable & joints_used(pepper, problem.tasks))
    low, high = np.maximum(problem.lower, q0 - np.pi)[index], np.minimum(problem.upper, q0 + np.pi)[index]
    generator = np.random.default_rng(budget.seed)
    ends, costs = np.empty((0, q0.size)), np.empty(0)
    for count in (STARTS, *[ROUND] * ROUNDS):
        starts, drawn = np.tile(q0, (count, 1)), generator.uniform(low, high, (count, index.size))
        if len(ends):
            kept = generator.random(drawn.shape) > REDRAWN
            drawn[kept] = ends[np.arange(count) % min(PARENTS, len(ends))][:, index][kept]
        starts[:, index] = drawn
        found, their_costs = _descents(problem, budget, starts)
        ends, costs = np.concatenate([ends, found]), np.concatenate([costs, their_costs])
        order = np.argsort(costs, kind="stable")
        ends, costs = ends[order], costs[order]
        new = np.diff(costs, prepend=-1.0) > SAME * costs
        ends, costs = ends[new], costs[new]
    return ends[costs < worst]


def _descents(problem: TaskProblem, budget: SearchBudget, starts: Array) -> tuple[Array, Array]:
    """Return the ends of searches from starts, shape (m, n) each [rad or m], and their costs, shape (m,)."""
    pepper, tasks, movable = problem.pepper, problem.tasks, problem.movable
    budget = budget._replace(restarts=0, max_iterations=min(STEPS, budget.max_iterations), thorough=False)
    if known_structures(tasks) is not None:
        rows = BatchSearch(pepper, tasks, starts, movable, budget)
        rows.solve(0, len(starts))
        ends, _, errors, *_ = rows.answers()
        if not any(task.largest for task in tasks):
            return ends, 0.5 * errors**2 @ [task.strength**2 for task in tasks]
    else:
        ends = np.array([search_compiled(pepper, tasks, start, movable, budget).q for start in starts])
    return ends, np.array([problem.task_cost(problem.residuals(end)) for end in ends])
