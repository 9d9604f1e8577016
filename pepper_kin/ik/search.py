"""The search over several starts, and what counts as the best of its finds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pepper_kin.dynamics import gravity_torque
from pepper_kin.ik.collisions import Collisions, Fence
from pepper_kin.ik.descent import Descender, Descent
from pepper_kin.ik.problem import Problem
from pepper_kin.ik.restarts import nearby, starts
from pepper_kin.ik.tasks.task import Array
from pepper_kin.model import PepperModel

# The search for the closest point ends when so many descents, of at least so many, agree this well on the
# weighted distance.  The fast solver makes up to three from each start.
AGREEING_STARTS = 4
LEAST_STARTS = 10
AGREEMENT = 1e-3

# How many more starts are spent on a find whose only fault is that its motors could not hold it.
STARTS_FOR_TORQUE = 6


class Budget(NamedTuple):
    """How much a search may spend.

    Attributes:
        seed: Draws the restarts.
        restarts: Number of restarts after the first start.
        max_iterations: Steps from each start.
        deadline: When to stop, on the clock of `time.perf_counter` [s].
    """

    seed: int
    restarts: int
    max_iterations: int
    deadline: float


@dataclass(frozen=True, eq=False)
class Find:
    """A configuration that a search came to, judged.

    Attributes:
        q: Joint positions [rad or m], shape (n,).
        met: Whether all tasks are met.
        free: Whether nothing touches.
        held: Whether the motors can hold it against gravity.
        cost: Half the weighted sum of squares of the tasks.
        motion: |diag(d) (q - q0)|, how far it is from the start.
    """

    q: Array
    met: bool
    free: bool
    held: bool
    cost: float
    motion: float

    @property
    def is_good(self) -> bool:
        """Whether there is nothing to wish for."""
        return self.met and self.free and self.held

    @property
    def rank(self) -> tuple[bool, bool, bool, float]:
        """Smaller is better: free, then met, then held, then near the start (or to the target)."""
        if self.met:
            return (not self.free, False, not self.held, self.motion)
        return (not self.free, True, False, self.cost)


@dataclass(frozen=True, eq=False)
class Search:
    """What a search found.

    Attributes:
        best: The best find.
        met_in_collision: Whether the tasks were met by a configuration that touches something.
        iterations: Steps proposed, over all starts.
        restarts: Restarts used.
        timed_out: Whether time ran out before the search was done.
    """

    best: Find
    met_in_collision: bool
    iterations: int
    restarts: int
    timed_out: bool


def search(problem: Problem, descender: Descender, collisions: Collisions, budget: Budget) -> Search:
    """Descend from q0 and, until a good find, from further starts.

    Where a descent ends in collision, a second one from the same start keeps clear all the way.

    Args:
        problem: The problem.
        descender: Searches from each start.
        collisions: What may not touch.
        budget: When to give up.

    Returns:
        The best find and how it was come by; q0 itself counts as one.
    """
    best = judge(problem, collisions, problem.q0, problem.residuals(problem.q0))
    generator = np.random.default_rng(budget.seed)
    costs: list[float] = []
    iterations = used = first_met = 0
    met_in_collision = timed_out = False
    for used, start in enumerate(starts(problem, budget.seed, budget.restarts)):
        if used % 3 and met_in_collision and best.free and not best.met:
            start = nearby(problem, best.q, generator, used)
        for descent in _descents(problem, descender, collisions, budget, start):
            find = judge(problem, collisions, descent.q, descent.residuals)
            best = min(best, find, key=lambda item: item.rank)
            iterations += descent.iterations
            timed_out |= descent.timed_out
            met_in_collision |= find.met and not find.free
            costs.append(find.cost)
        if best.met and best.free:
            first_met = first_met or used + 1
        tried_for_torque = first_met and used + 1 - first_met >= STARTS_FOR_TORQUE
        if best.is_good or timed_out or tried_for_torque or _agree(costs, met_in_collision):
            break
    return Search(best, met_in_collision, iterations, used, timed_out)


def _descents(
    problem: Problem, descender: Descender, collisions: Collisions, budget: Budget, start: Array
) -> Iterator[Descent]:
    """Yield the descent from a start and, if that ends in collision, one that keeps clear."""

    def run(fence: Fence | None) -> Descent:
        return descender.descend(start, problem.q0, budget.max_iterations, budget.deadline, fence)

    plain = run(None)
    yield plain
    if not (plain.timed_out or collisions.free(plain.q)) and collisions.free(start):
        yield run(collisions.fence())


def judge(
    problem: Problem, collisions: Collisions, q: Array, residuals: tuple[Array, ...] | list[Array]
) -> Find:
    """Return the find at q, shape (n,)."""
    return Find(
        q=q,
        met=problem.is_met(residuals),
        free=collisions.free(q),
        held=bool(torque_ratios(problem.pepper, q).max() <= 1.0),
        cost=problem.task_cost(residuals),
        motion=float(np.linalg.norm(problem.scale * (q - problem.q0))),
    )


def torque_ratios(pepper: PepperModel, q: Array) -> Array:
    """Return |g_i(q)| / effort limit of every joint, shape (n,); zero where there is no limit."""
    effort = pepper.effort_limits
    limited = np.isfinite(effort) & (effort > 0)
    return np.where(limited, np.abs(gravity_torque(pepper, q)) / np.where(limited, effort, 1.0), 0.0)


def _agree(costs: list[float], met_in_collision: bool) -> bool:
    """Whether the least weighted distance was found often enough to be believed."""
    if met_in_collision or len(costs) < LEAST_STARTS:
        return False
    distances = np.sqrt(2 * np.array(costs))
    return int(np.sum(distances < distances.min() + AGREEMENT)) >= AGREEING_STARTS
