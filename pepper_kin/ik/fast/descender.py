"""Compiled descents for the search that also minds collisions and the clock."""

from __future__ import annotations

import math
import time

import numpy as np

from pepper_kin.ik.collisions import Fence
from pepper_kin.ik.descent import Descender, Descent, StepDescender
from pepper_kin.ik.fast.loop import descend_row
from pepper_kin.ik.fast.prepared import prepare
from pepper_kin.ik.fast.search import numbers_for
from pepper_kin.ik.fast.structure import structures_of, target_of
from pepper_kin.ik.problem import Problem
from pepper_kin.ik.solvers import make_solver
from pepper_kin.ik.tasks.task import Array


class FastDescender(Descender):
    """Descends in machine code; where a descent has to keep clear, by the steps of a quadratic programme.

    Args:
        problem: The problem.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._prepared = prepare(problem.pepper, structures_of(problem.tasks))
        index = self._prepared.index
        self._bounds = self._prepared.bounds(
            problem.lower[index], problem.upper[index], problem.movable[index]
        )
        tasks = problem.tasks
        self._tolerance = np.array([task.tolerance**2 for task in tasks])
        self._numbers = numbers_for(self._prepared, all(task.tolerance < math.inf for task in tasks))
        weights = [task.weight**2 for task in tasks]
        self._parameters = np.concatenate([weights, *(target_of(task) for task in tasks)])
        self._careful: StepDescender | None = None

    def descend(
        self, start: Array, reference: Array, max_iterations: int, deadline: float, fence: Fence | None = None
    ) -> Descent:
        """Return where the search from a start ends.

        The deadline is looked at before a compiled descent, which takes well below a millisecond.
        """
        if fence is not None:
            return self._descend_carefully(start, reference, max_iterations, deadline, fence)
        problem, timed_out, iterations = self._problem, time.perf_counter() > deadline, 0
        row = np.concatenate([problem.clip(start), self._parameters])
        if not timed_out:
            iterations = descend_row(
                self._numbers, self._prepared.index, self._bounds, self._tolerance, max_iterations, row,
                np.array(reference),
            )  # fmt: skip
        q = row[: problem.pepper.n].copy()
        residuals = tuple(problem.residuals(q))
        return Descent(q, residuals, problem.task_cost(residuals), iterations, timed_out)

    def _descend_carefully(
        self, start: Array, reference: Array, max_iterations: int, deadline: float, fence: Fence
    ) -> Descent:
        if self._careful is None:
            offset = np.abs(self._problem.pepper.full_offset).max(initial=0.0) > 0
            solver = make_solver("proxsuite" if offset else "placo", self._problem)
            self._careful = StepDescender(self._problem, solver)
        return self._careful.descend(start, reference, max_iterations, deadline, fence)
