"""Damped steps down to the nearest minimum."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from pepper_kin.ik.collisions import Fence
from pepper_kin.ik.problem import Problem
from pepper_kin.ik.solvers.step_solver import StepSolver
from pepper_kin.ik.tasks.task import Array

FIRST_DAMPING = 1e-3
LEAST_DAMPING = 1e-8
MOST_DAMPING = 1e4

RAISE = 4.0
LOWER = 3.0

# A minimum is reached when a step, or what it gains, is smaller than this (relative to the cost).
SMALL_STEP = 1e-6
SMALL_GAIN = 1e-7


@dataclass(frozen=True, eq=False)
class Descent:
    """Where a search from one start ended.

    Attributes:
        q: Joint positions [rad or m], shape (n,).
        residuals: Of each task, without weights.
        cost: Half the weighted sum of squares of the tasks, without the posture's term.
        iterations: Steps proposed.
        timed_out: Whether time ran out first.
    """

    q: Array
    residuals: tuple[Array, ...]
    cost: float
    iterations: int
    timed_out: bool


class Descender(ABC):
    """Searches from a start down to the nearest minimum of one problem."""

    @abstractmethod
    def descend(
        self, start: Array, reference: Array, max_iterations: int, deadline: float, fence: Fence | None = None
    ) -> Descent:
        """Return where the search from a start ends; the arguments are those of the function `descend`."""


class StepDescender(Descender):
    """Descends by the steps of a step solver.

    Args:
        problem: The problem.
        solver: Proposes the steps.
    """

    def __init__(self, problem: Problem, solver: StepSolver) -> None:
        self._problem, self._solver = problem, solver

    def descend(
        self, start: Array, reference: Array, max_iterations: int, deadline: float, fence: Fence | None = None
    ) -> Descent:
        """Return the outcome of `descend`."""
        return descend(self._problem, self._solver, start, reference, max_iterations, deadline, fence)


def descend(
    problem: Problem,
    solver: StepSolver,
    start: Array,
    reference: Array,
    max_iterations: int,
    deadline: float,
    fence: Fence | None = None,
) -> Descent:
    """Search from a start by damped Gauss-Newton steps (Levenberg-Marquardt) within the bounds.

    A step is taken only if it lowers F, so the cost never grows; otherwise the damping grows and the next
    step is shorter.

    Args:
        problem: The problem.
        solver: Proposes the steps.
        start: Joint positions within the bounds [rad or m], shape (n,).
        reference: q_ref of the posture term, shape (n,).
        max_iterations: Number of steps proposed at most.
        deadline: When to stop, on the clock of `time.perf_counter` [s].
        fence: Keeps the search clear of collisions, if given; the start has to be free.

    Returns:
        The best configuration found.
    """
    q = problem.clip(start)
    residuals = problem.residuals(q)
    cost = problem.cost(q, residuals, reference)
    damping, iterations, timed_out, backed = FIRST_DAMPING, 0, False, False
    if fence is not None:
        fence.admits(q)
    while iterations < max_iterations and damping < MOST_DAMPING and not problem.is_close(residuals):
        if time.perf_counter() > deadline:
            timed_out = True
            break
        iterations += 1
        half_spaces = fence.half_spaces(q) if fence is not None else None
        step = solver.step(q, residuals, reference, damping, half_spaces)
        if step is None:
            damping *= 10
            continue
        trial = problem.clip(q + step)
        new_residuals = problem.residuals(trial)
        new_cost = problem.cost(trial, new_residuals, reference)
        gain, size = cost - new_cost, float(np.abs(trial - q).max())
        if not gain > 0 or (fence is not None and not fence.admits(trial)):
            if size < SMALL_STEP:
                break
            damping, backed = max(RAISE * damping, FIRST_DAMPING), True
            continue
        q, residuals, cost = trial, new_residuals, new_cost
        damping, backed = (damping if backed else max(damping / LOWER, LEAST_DAMPING)), False
        if size < SMALL_STEP or gain < SMALL_GAIN * cost:
            break
    return Descent(q, tuple(residuals), problem.task_cost(residuals), iterations, timed_out)
