"""Python interface of the compiled search."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.inverse_kinematics.collision_free_search import descend_row, finish_rows
from pepper_kin.core.inverse_kinematics.local_solver import CollisionTests
from pepper_kin.core.inverse_kinematics.multi_start import solve_rows
from pepper_kin.core.inverse_kinematics.search import (
    CANDIDATES,
    COLLISION,
    EXTRA,
    STATUS,
    STOP,
    UNREACHABLE,
    SearchOptions,
    TaskTables,
)
from pepper_kin.ik.collisions import NO_TESTS, Collisions
from pepper_kin.ik.fast.compiled_tasks import compiled_tasks, squared_tolerance, unit_points
from pepper_kin.ik.problem import SearchBudget, TaskProblem
from pepper_kin.ik.result import IKStatus, SearchResult
from pepper_kin.ik.solver import TaskSolver
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kernels.working_time import not_counted, on_perf_counter
from pepper_kin.model import PepperModel

STATUSES = (
    IKStatus.SOLVED,
    IKStatus.CLOSEST_UNREACHABLE,
    IKStatus.CLOSEST_LIMITS,
    IKStatus.CLOSEST_COLLISION,
    IKStatus.TIMED_OUT,
    IKStatus.TIMED_OUT,
)
"""Status of each number that the compiled search writes."""


def _finish(
    tables: TaskTables, bounds: Array, options: SearchOptions, tests: CollisionTests, inputs: Array,
    answers: Array, begin: int, end: int,
) -> None:  # fmt: skip
    """Continue the rows that `solve_rows` has left; loading the code does not count as searching time."""
    before = on_perf_counter(0.0)
    with not_counted():
        finish = finish_rows.native
    options = options._replace(deadline=options.deadline + on_perf_counter(0.0) - before)
    finish(tables, bounds, options, tests, inputs, answers, begin, end)


def search_compiled(
    pepper: PepperModel,
    tasks: Sequence[Task],
    q0: Array,
    movable: np.ndarray | None,
    budget: SearchBudget,
    collisions: Collisions | None = None,
) -> SearchResult:
    """Search for one set of targets.

    Args:
        pepper: The robot.
        tasks: The tasks.
        q0: Start within the limits, shape (n,) [rad or m].
        movable: Joints that may move, shape (n,); None for all.
        budget: Limits of the search.
        collisions: Collision checks and loads; None for none.

    Raises:
        Exception: the error of a task in Python or of a signal handler.
    """
    ready = compiled_tasks(pepper, tasks)
    buffers = ready.buffers()
    buffers.start[:] = q0
    finite = ready.read(tasks, buffers.row, buffers.tolerance)
    options = buffers.options(budget, finite, ready.tables.task_joints)
    tests, tables = NO_TESTS, ready.tables
    if collisions is not None:
        tests = collisions.tests(buffers.signals)
        if collisions.loads:
            tables = tables._replace(gravity=collisions.holding(tables.gravity, buffers.signals))
    bounds = ready.bounds if movable is None else ready.bounds_of(movable)
    solve_rows.native(tables, bounds, options, tests, buffers.inputs, buffers.answers, 0, 1)
    status, iterations, used = buffers.outcome.tolist()
    if status == COLLISION or (status == UNREACHABLE and budget.thorough):
        _finish(tables, bounds, options, tests, buffers.inputs, buffers.answers, 0, 1)
        status, iterations, used = buffers.outcome.tolist()
    q = buffers.q.copy()
    q.setflags(write=False)
    if status == STOP:
        ready.check(buffers)
        if collisions is not None:
            collisions.check()
    ready.spare.append(buffers)
    return SearchResult(q, STATUSES[int(status)], int(iterations), int(used))


class FastSolver(TaskSolver):
    """Compiled search for one problem.

    Args:
        problem: The problem.
    """

    def __init__(self, problem: TaskProblem) -> None:
        self._problem = problem

    def search(self, collisions: Collisions, budget: SearchBudget) -> SearchResult:
        """Return the result of a search from q0 and further starts."""
        problem = self._problem
        return search_compiled(problem.pepper, problem.tasks, problem.q0, problem.movable, budget, collisions)

    def descend(self, start: Array, collisions: Collisions, budget: SearchBudget, *, clear: bool) -> Array:
        """Return the end of a local search, shape (n,) [rad or m].

        Args:
            start: Start [rad or m], shape (n,), which is first moved into the bounds.
            collisions: Collision checks.
            budget: Number of steps and deadline.
            clear: Whether to keep clear of collisions; the start has to be free.
        """
        problem = self._problem
        ready = compiled_tasks(problem.pepper, problem.tasks)
        buffers = ready.buffers()
        finite = ready.read(problem.tasks, buffers.row, buffers.tolerance)
        buffers.start[:] = problem.clip(start)
        options = buffers.options(budget, finite, ready.tables.task_joints)
        tests = collisions.tests(buffers.signals) if clear else NO_TESTS
        bounds = ready.bounds_of(problem.movable)
        descend_row(ready.tables, bounds, options, tests, buffers.row, problem.q0.copy(), clear)
        q: Array = buffers.start.copy()
        ready.check(buffers)
        collisions.check()
        ready.spare.append(buffers)
        return q


class BatchSearch:
    """Search for many sets of targets, in parts on any thread.

    Args:
        pepper: The robot.
        tasks: Tasks with machine code, some of which have N targets.
        starts: Starts q0 of each row within the limits, shape (N, n) [rad or m].
        movable: Joints that may move, shape (n,); None for all.
        budget: Limits of the search of each row.
        around: Collision checks and loads; None for none.
        hopeless: Whether each row is proven unsolvable, so that one descent is enough, shape (N,); None for
            no such row.

    Attributes:
        statuses: Status of each number that `answers` returns.
    """

    def __init__(
        self,
        pepper: PepperModel,
        tasks: Sequence[Task],
        starts: Array,
        movable: np.ndarray | None,
        budget: SearchBudget,
        *,
        around: Collisions | None = None,
        hopeless: np.ndarray | None = None,
    ) -> None:
        ready = compiled_tasks(pepper, tasks)
        n, t = pepper.n, len(tasks)
        self.statuses = STATUSES
        self._inputs = np.empty((len(starts), ready.width))
        self._inputs[:, :n] = starts
        self._inputs[:, n : n + t] = [task.weight**2 for task in tasks]
        for place, task in zip(ready.target_places, tasks, strict=True):
            assert place is not None
            targets = getattr(task, task.target_name)
            self._inputs[:, place] = targets.reshape(-1, place.stop - place.start)
        buffers = ready.buffers()
        buffers.tolerance[:] = [squared_tolerance(task.tolerance) for task in tasks]
        finite = all(task.tolerance < math.inf for task in tasks)
        options = buffers.options(budget, finite, ready.tables.task_joints)
        self._answers = np.empty((len(starts), n + t + EXTRA))
        # Hopeless rows are sorted behind the others, so that each kind is searched in one call.
        self._order = np.arange(len(starts)) if hopeless is None else np.argsort(hopeless, kind="stable")
        self._hopeful = len(starts) if hopeless is None else int(np.sum(~hopeless))
        if hopeless is not None:
            self._inputs = self._inputs[self._order]
        self._ready, self._sizes, self._buffers = ready, (n, t), buffers
        self._fixed = (ready.tables, ready.bounds_of(movable), options)
        self._around = Collisions(pepper, None, loads=()) if around is None else around

    def solve(self, begin: int, end: int) -> None:
        """Solve the rows from `begin` to `end`; the interpreter is free for other threads meanwhile.

        Raises:
            KeyboardInterrupt: after Ctrl-C, or another error of a signal handler.
        """
        collisions = self._around.again()  # a copy with memory of this thread
        tests = collisions.tests(self._buffers.signals)
        tables, bounds, options = self._fixed
        tables = tables._replace(gravity=collisions.holding(tables.gravity, self._buffers.signals))
        parts = (
            (begin, min(end, self._hopeful), options),
            (
                max(begin, self._hopeful),
                end,
                options._replace(restarts=0),
            ),
        )
        for first, last, how in parts:
            if first >= last:
                continue
            status = self._answers[first:last, sum(self._sizes) + STATUS]
            solve_rows.native(tables, bounds, how, tests, self._inputs, self._answers, first, last)
            if np.isin(status, (COLLISION, UNREACHABLE)).any() and not (status == STOP).any():
                _finish(tables, bounds, how, tests, self._inputs, self._answers, first, last)
            if (status == STOP).any():
                self._ready.check(self._buffers)
                collisions.check()

    def answers(self) -> tuple[Array, np.ndarray, Array, np.ndarray, np.ndarray]:
        """Return q [rad or m], status numbers, errors [m or rad], iterations and restarts of all rows."""
        n, t = self._sizes
        answers = np.empty_like(self._answers)
        answers[self._order] = self._answers
        counts = answers[:, n + t :].astype(np.int64)
        errors = np.sqrt(answers[:, n : n + t])
        return answers[:, :n].copy(), counts[:, 0], errors, counts[:, 1], counts[:, 2]


def alternatives(
    pepper: PepperModel,
    tasks: Sequence[Task],
    q0: Array,
    movable: np.ndarray | None,
    seed: int,
    count: int,
    max_iterations: int,
    *,
    around: Collisions | None = None,
) -> list[Array]:
    """Return the solutions found from `count` starts, the nearest to q0 first.

    The starts are ever farther from q0, on the way to points that fill the joint box evenly. With `around`,
    solutions in collision are moved clear or left out.

    Args:
        pepper: The robot.
        tasks: The tasks, one target each.
        q0: Joint positions to which solutions shall be near [rad or m], shape (n,).
        movable: Joints that may move, shape (n,); None for all.
        seed: Seed of the starts.
        count: Number of starts.
        max_iterations: Maximum number of steps from each start.
        around: Collision checks and loads; None for none.

    Returns:
        Joint positions [rad or m], shape (n,) each.
    """
    ready = compiled_tasks(pepper, tasks)
    index, k = ready.index, ready.index.size
    here = q0[index]
    low, high = np.maximum(ready.bounds[0, :k], here - np.pi), np.minimum(ready.bounds[1, :k], here + np.pi)
    first, advance = (part[:k] for part in unit_points(k, q0.size, seed))
    points = (first + (1.0 + CANDIDATES * np.arange(count)[:, None]) * advance) % 1.0
    reach = np.linspace(1 / max(count, 1), 1, count)[:, None]
    starts = np.tile(q0, (count, 1))
    starts[:, index] += reach * (low + points * (high - low) - here)
    if movable is not None:
        starts[:, ~movable] = q0[~movable]
    return solutions_from(pepper, tasks, q0, movable, starts, max_iterations, around=around)


def solutions_from(
    pepper: PepperModel,
    tasks: Sequence[Task],
    q0: Array,
    movable: np.ndarray | None,
    starts: Array,
    max_iterations: int,
    *,
    around: Collisions | None = None,
) -> list[Array]:
    """Return the solutions found from given starts, the nearest to q0 first.

    Joints that no task depends on keep the start's positions; their distance from q0 counts unweighted. With
    `around`, solutions in collision are moved clear or left out.

    Args:
        pepper: The robot.
        tasks: The tasks, one target each.
        q0: Joint positions to which solutions shall be near [rad or m], shape (n,).
        movable: Joints that may move, shape (n,); None for all.
        starts: Joint positions of the starts [rad or m], shape (m, n).
        max_iterations: Maximum number of steps from each start.
        around: Collision checks and loads; None for none.

    Returns:
        Joint positions [rad or m], shape (n,) each.
    """
    budget = SearchBudget(0, 0, max_iterations, math.inf, thorough=False)
    ready = compiled_tasks(pepper, tasks)
    if ready.python is None:
        rows = BatchSearch(pepper, tasks, starts, movable, budget, around=around)
        rows.solve(0, len(starts))
        q, status, *_ = rows.answers()
        solved = q[status == STATUSES.index(IKStatus.SOLVED)]
    else:
        found = [search_compiled(pepper, tasks, start, movable, budget, around) for start in starts]
        solved = np.array([one.q for one in found if one.status is IKStatus.SOLVED]).reshape(-1, q0.size)
    k, scale = ready.index.size, np.ones(q0.size)
    scale[ready.index] = ready.tables.scale[:k]
    motion = ((solved - q0) ** 2 * scale).sum(axis=1)
    return list(solved[np.argsort(motion, kind="stable")])
