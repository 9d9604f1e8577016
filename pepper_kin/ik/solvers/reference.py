"""Multi-start search with steps of another library, as a reference for the compiled search."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.core.inverse_kinematics.local_solver import SMALL_STEP
from pepper_kin.core.inverse_kinematics.search import REACH
from pepper_kin.ik.collisions import Collisions, torque_ratios
from pepper_kin.ik.fast.compiled_tasks import unit_points
from pepper_kin.ik.problem import SearchBudget, TaskProblem
from pepper_kin.ik.result import IKStatus, SearchResult
from pepper_kin.ik.solver import HalfSpaces, StepSolver, TaskSolver
from pepper_kin.ik.solvers.placo import PlacoSolver
from pepper_kin.ik.solvers.proxsuite import ProxsuiteSolver
from pepper_kin.kernels.working_time import working_time

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-3, 1e-8, 1e4
SMALL_GAIN = 1e-6

CUTS, NEAREST = 4, 1
"""Maximum number of half-spaces kept in one descent, and added per configuration."""

STARTS_WITHOUT_LIMITS, STEPS_WITHOUT_LIMITS = 3, 60
"""Numbers of starts and steps of the search that asks whether limits alone block the target."""


class Candidate(NamedTuple):
    """A configuration with its criteria in order of priority; the smallest tuple is the best.

    Attributes:
        touches: Whether anything touches.
        unmet: Whether a task is not met.
        overloaded: Whether the motors cannot hold it.
        distance: Weighted distance from q0 if the tasks are met, else their cost.
        q: Joint positions, shape (n,) [rad or m].
    """

    touches: bool
    unmet: bool
    overloaded: bool
    distance: float
    q: Array


class ReferenceSolver(TaskSolver):
    """Search with steps of another library's solver from q0 and further starts.

    Args:
        name: Name of the library, one of `SOLVERS`.
        problem: The problem.
    """

    def __init__(self, name: str, problem: TaskProblem) -> None:
        self._name, self._problem, self._steps = name, problem, 0
        self._stepper = make_step_solver(name, problem)

    def search(self, collisions: Collisions, budget: SearchBudget) -> SearchResult:
        """Return the best end of descents; if one ends in collision, another keeps clear."""
        self._steps = restarts = 0
        best, met_in_collision = self._judged(self._problem.q0, collisions), False
        for number, start in enumerate(starts(self._problem, budget.seed, budget.restarts)):
            if (number > 0 and not any(best[:3])) or working_time() > budget.deadline:
                break
            restarts = number
            for clear in (False, True):
                end = self._judged(self.descend(start, collisions, budget, clear=clear), collisions)
                best = min(best, end, key=lambda candidate: candidate[:4])
                met_in_collision |= end.touches and not end.unmet
                if not end.touches or not collisions.free(start):
                    break
        return SearchResult(
            read_only(best.q), self._status(best, met_in_collision, budget), self._steps, restarts
        )

    def descend(self, start: Array, collisions: Collisions, budget: SearchBudget, *, clear: bool) -> Array:
        """Return the end of damped steps from a start, shape (n,) each [rad or m].

        A step has to lower the cost; otherwise it is rejected and the damping grows.
        """
        problem, q, damping = self._problem, self._problem.clip(start), FIRST_DAMPING
        residuals = problem.residuals(q)
        cost = problem.cost(q, residuals, problem.q0)
        cuts = deque(collisions.half_spaces(q, NEAREST) if clear else (), maxlen=CUTS)
        for _ in range(budget.max_iterations):
            if problem.is_close(residuals) or damping > MOST_DAMPING or working_time() > budget.deadline:
                break
            self._steps += 1
            step = self._stepper.step(q, residuals, problem.q0, damping, _half_spaces(cuts, q))
            if step is None:
                damping *= 10
                continue
            trial = problem.clip(q + step)
            new_residuals = problem.residuals(trial)
            new_cost = problem.cost(trial, new_residuals, problem.q0)
            gain, size = cost - new_cost, float(np.abs(trial - q).max())
            if clear and gain > 0:
                cuts.extend(collisions.half_spaces(trial, NEAREST))
            if gain > 0 and (not clear or collisions.free(trial)):
                q, residuals, cost, damping = trial, new_residuals, new_cost, max(damping / 3, LEAST_DAMPING)
                if gain < SMALL_GAIN * cost:
                    break
            else:
                damping *= 4
            if size < SMALL_STEP:
                break
        return q

    def _judged(self, q: Array, collisions: Collisions) -> Candidate:
        """Return joint positions q, shape (n,) [rad or m], as a candidate with its criteria."""
        problem = self._problem
        residuals = problem.residuals(q)
        met, free = problem.is_met(residuals), collisions.free(q)
        held = bool(met and torque_ratios(problem.pepper, q, collisions.loads).max() <= 1.0)
        motion = float(np.linalg.norm(problem.scale * (q - problem.q0)))
        return Candidate(not free, not met, not held, motion if met else problem.task_cost(residuals), q)

    def _status(self, best: Candidate, met_in_collision: bool, budget: SearchBudget) -> IKStatus:
        """Return the status of the search; CLOSEST_LIMITS if the tasks can be met without limits."""
        if not best.touches and not best.unmet:
            return IKStatus.SOLVED
        if working_time() > budget.deadline:
            return IKStatus.TIMED_OUT
        if met_in_collision:
            return IKStatus.CLOSEST_COLLISION
        unlimited = self._problem.without_limits()
        solver, nothing = ReferenceSolver(self._name, unlimited), Collisions(unlimited.pepper, None)
        fewer = budget._replace(max_iterations=min(STEPS_WITHOUT_LIMITS, budget.max_iterations))
        for start in (best.q, *starts(unlimited, budget.seed, STARTS_WITHOUT_LIMITS)):
            end = solver.descend(start, nothing, fewer, clear=False)
            if unlimited.is_met(unlimited.residuals(end)):
                return IKStatus.CLOSEST_LIMITS
        timed_out = working_time() > budget.deadline
        return IKStatus.TIMED_OUT if timed_out else IKStatus.CLOSEST_UNREACHABLE


def make_step_solver(name: str, problem: TaskProblem) -> StepSolver:
    """Return the step solver of a problem by name, one of `SOLVERS`.

    Raises:
        InvalidValueError: if the library does not support the robot, naming one that does.
    """
    if name == "placo":
        return PlacoSolver(problem)
    return ProxsuiteSolver(problem)


def starts(problem: TaskProblem, seed: int, count: int) -> Iterator[Array]:
    """Yield q0 and then `count` points of the joint box, the first ones nearer to q0, shape (n,) [rad or m].

    The points are the compiled search's; a joint without bounds starts within pi of q0.
    """
    yield problem.q0
    index = np.flatnonzero(problem.movable)
    first, advance = unit_points(index.size, index.size, seed)
    q0 = problem.q0[index]
    low = np.maximum(problem.lower[index], q0 - np.pi)
    high = np.minimum(problem.upper[index], q0 + np.pi)
    for k in range(count):
        q = problem.q0.copy()
        reach = REACH[k] if k < len(REACH) else 1.0
        q[index] = q0 + reach * (low + (first + (k + 1.0) * advance) % 1.0 * (high - low) - q0)
        yield problem.clip(q)


def _half_spaces(cuts: deque[Array], q: Array) -> HalfSpaces | None:
    """Return the inequalities of a step from q; a margin that is violated may not shrink further.

    Args:
        cuts: Half-spaces g . q' >= b as rows of g and b, shape (n + 1,) each.
        q: Joint positions [rad or m], shape (n,).
    """
    if not cuts:
        return None
    rows = np.array(cuts)
    return HalfSpaces(-rows[:, :-1], np.maximum(rows[:, :-1] @ q - rows[:, -1], 0.0))
