"""Residuals and Jacobians of tasks at many configurations, by machine code."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.ik.fast.compiled_tasks import SOURCES
from pepper_kin.ik.fast.expression import rows_function
from pepper_kin.ik.tasks.structure import TaskStructure, known_structures
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, RobotMemory, robot_digest

_kept: RobotMemory[tuple[TaskStructure, ...], Kernel] = RobotMemory()


class TaskRows:
    """Residuals of tasks with K targets, or one for all, at K configurations, times a factor for each task.

    Args:
        pepper: The robot.
        tasks: The tasks, groups split into their parts; tasks without machine code are evaluated in Python.
        count: K.
        factors: Factor on each task's residual.
        allowed: Offsets subtracted from the residuals, shape (K, m); None for none.

    Attributes:
        lengths: Whether each component of the residuals is in meters, shape (m,).
    """

    def __init__(
        self,
        pepper: PepperModel,
        tasks: Sequence[Task],
        count: int,
        factors: Sequence[float],
        allowed: Array | None = None,
    ) -> None:
        self._pepper, self._tasks, self._count = pepper, tuple(tasks), count
        sizes = [task.at(0).residual(pepper, pepper.neutral()).size for task in tasks]
        self.lengths = np.repeat([task.unit_on(pepper) == "m" for task in tasks], sizes)
        self._allowed = 0.0 if allowed is None else allowed
        self._ends, self._factors = np.cumsum(sizes)[:-1], np.repeat(factors, sizes)
        structures = known_structures(tasks)
        self._kernel, self._targets = None, np.zeros((count, 0))
        if structures is not None:
            self._kernel = _kernel_of(pepper, structures)
            targets = [np.asarray(getattr(task, task.target_name)) for task in tasks]
            rows = [
                np.broadcast_to(
                    target.reshape(1 if task.count is None else count, -1), (count, of.target_size)
                )
                for task, target, of in zip(tasks, targets, structures, strict=True)
            ]
            self._targets = np.concatenate(rows, axis=1)

    def __call__(self, q: Array) -> tuple[Array, Array]:
        """Return residuals, shape (K, m), and Jacobians, shape (K, m, n), at q, shape (K, n)."""
        residual, jacobian = self._rows(q)
        return residual * self._factors, jacobian * self._factors[:, None]

    def errors(self, q: Array) -> Array:
        """Return the error of each task without its factor [m or rad], shape (K, tasks)."""
        parts = np.split(self._rows(q)[0], self._ends, axis=1)
        return np.stack(
            [
                np.abs(part).max(axis=1) if task.largest else np.linalg.norm(part, axis=1)
                for task, part in zip(self._tasks, parts, strict=True)
            ],
            axis=1,
        )

    def _rows(self, q: Array) -> tuple[Array, Array]:
        """Return residuals, shape (K, m), and Jacobians, shape (K, m, n), without factors, at q."""
        if self._kernel is not None:
            residual, jacobian = self._kernel(q, self._targets)
            return np.asarray(residual, float) - self._allowed, np.asarray(jacobian, float)
        pairs = [([task.at(k) for task in self._tasks], q[k]) for k in range(self._count)]
        residuals = [np.concatenate([t.residual(self._pepper, x) for t in tasks]) for tasks, x in pairs]
        jacobians = [np.concatenate([t.jacobian(self._pepper, x) for t in tasks]) for tasks, x in pairs]
        return np.array(residuals) - self._allowed, np.array(jacobians)


def _kernel_of(pepper: PepperModel, structures: tuple[TaskStructure, ...]) -> Kernel:
    """Return the kernel of tasks' residuals and Jacobians, cached for the robot."""
    known = _kept.of(pepper)
    found = known.get(structures)
    if found is None:
        key = f"rows {structures!r} of {robot_digest(pepper)} by {source_digest(*SOURCES)}"
        made = compile_function(lambda: rows_function(pepper, structures), key=key)
        found = known.setdefault(structures, made)
    return found
