"""Tasks as the compiled search takes them: a kernel and tables, made once for each robot and set of tasks."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any

import numpy as np

from pepper_kin.arrays import Array, read_only
from pepper_kin.batch import kernel
from pepper_kin.core.clock import CLOCK
from pepper_kin.core.inverse_kinematics.search import EXTRA, SearchOptions, TaskTables
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.problem import SearchBudget, joints_used, scale_of
from pepper_kin.ik.tasks.structure import TaskStructure, known_structures, target_of
from pepper_kin.ik.tasks.task import Task
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.kernels.interrupts import STOPPED, interrupt_table, raise_interrupt
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.working_time import on_perf_counter
from pepper_kin.model import PepperModel, RobotMemory, robot_digest

_KERNEL = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)


class SearchBuffers:
    """Arrays for one search at a time.

    Args:
        width: Length of a row of input.
        n: Number of joints.
        tasks: Number of tasks t.
        signals: See `interrupt_table`.

    Attributes:
        inputs: Input of `solve_rows`, shape (1, width).
        answers: Its output, shape (1, n + t + EXTRA).
        row: The row of `inputs`, shape (width,).
        start: q0 in it, shape (n,).
        q: The solution in `answers`, shape (n,).
        outcome: The numbers behind it, see `EXTRA`, shape (EXTRA,).
        tolerance: Squared tolerances, shape (t,).
        signals: See `interrupt_table`.
    """

    def __init__(self, width: int, n: int, tasks: int, signals: np.ndarray) -> None:
        self.inputs, self.answers = np.empty((1, width)), np.empty((1, n + tasks + EXTRA))
        self.row, self.tolerance = self.inputs[0], np.empty(tasks)
        self.start, self.q, self.outcome = self.row[:n], self.answers[0, :n], self.answers[0, -EXTRA:]
        self.signals = signals
        self._key: tuple[SearchBudget, bool, int] | None = None
        self._options: SearchOptions | None = None

    def options(self, budget: SearchBudget, stop_when_met: bool, dimension: int) -> SearchOptions:
        """Return the options of a search; those of the last one where nothing has changed."""
        deadline = on_perf_counter(budget.deadline)
        key = (budget._replace(deadline=deadline), stop_when_met, dimension)
        if key != self._key or self._options is None:
            first, advance = unit_points(dimension, self.q.size, budget.seed)
            self._options = SearchOptions(
                self.tolerance, first, advance, budget.restarts, budget.max_iterations, budget.thorough,
                budget.closest, stop_when_met, CLOCK, deadline, self.signals,
            )  # fmt: skip
            self._key = key
        return self._options


@dataclass(frozen=True, eq=False)
class CompiledTasks:
    """Machine code and tables for tasks of one structure on one robot.

    Attributes:
        tables: As `solve_rows` takes them.
        index: Places of the joints that move a task, shape (k,).
        bounds: Lower and upper limits of `tables.joints`, and 1 for each: all may move, shape (3, n).
        target_places: Where each task's target lies in a row of input; None for tasks in Python.
        width: Length of a row of input.
        python: The tasks in Python, where there is no machine code for them.
        spare: Buffers that no search uses.
    """

    tables: TaskTables
    index: np.ndarray
    bounds: Array
    target_places: tuple[slice | None, ...]
    width: int
    python: PythonTasks | None
    _kernels: tuple[Kernel, ...]
    spare: list[SearchBuffers] = field(default_factory=list)

    def buffers(self) -> SearchBuffers:
        """Return buffers to use; append them to `spare` afterwards."""
        try:
            return self.spare.pop()
        except IndexError:
            signals = interrupt_table() if self.python is None else self.python.signals
            return SearchBuffers(self.width, self.tables.effort.size, len(self.target_places), signals)

    def check(self, buffers: SearchBuffers) -> None:
        """Raise what a signal, or a task in Python, has raised during a search."""
        raise_interrupt(buffers.signals)
        if self.python is not None:
            self.python.check()

    def bounds_of(self, movable: np.ndarray | None) -> Array:
        """Return the bounds, shape (3, n), where only some joints may move.

        Args:
            movable: Which joints may move, shape (n,); None for all.
        """
        if movable is None:
            return self.bounds
        bounds = self.bounds.copy()
        bounds[2] = movable[self.tables.joints]
        return bounds

    def read(self, tasks: Sequence[Task], row: Array, tolerance: Array) -> bool:
        """Write weights and targets into a row of input, and the squared tolerances.

        Args:
            tasks: Tasks of this structure, one target each.
            row: Row of input to write to, shape (width,): q, w_i^2 and the targets, one after the other.
            tolerance: Squared tolerances to write to, shape (t,) [m^2 or rad^2].

        Returns:
            Whether all tolerances are finite, so that the search may end once all tasks are well met.
        """
        n, finite = self.tables.effort.size, True
        for k, (task, targets) in enumerate(zip(tasks, self.target_places, strict=True)):
            weight, allowed = task.weight, task.tolerance
            row[n + k] = weight * weight
            if targets is not None:
                row[targets] = target_of(task)
            tolerance[k] = squared_tolerance(allowed)
            finite = finite and allowed < np.inf
        return finite


class PythonTasks:
    """Tasks of a user's own classes: machine code calls the address of their kernel, which runs Python.

    What they raise ends the search and is raised by `check`; so is what the handler of a signal raises
    meanwhile.

    Args:
        pepper: The robot.
        tasks: The tasks.
        index: Places of the joints to differentiate by, shape (k,).

    Attributes:
        address: Of a C function like that of `task_function`; valid while this object lives.
        signals: Set to stop when a task raises.
    """

    def __init__(self, pepper: PepperModel, tasks: Sequence[Task], index: np.ndarray) -> None:
        self._pepper, self._tasks, self._index = pepper, tuple(tasks), index
        self._upper = np.triu_indices(index.size)
        self._raised: BaseException | None = None
        self.signals = interrupt_table()
        # Python runs handlers of signals as a function begins, where nothing in it catches what they raise,
        # and as a generator goes on, where it can.  `max` sends it the three arguments one after the other.
        answers = self._answers()
        next(answers)
        self._function = _KERNEL(partial(max, key=answers.send))
        self.address = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0)

    def check(self) -> None:
        """Raise what a task has raised; nothing is evaluated after that."""
        if self._raised is not None:
            raise self._raised

    def _answers(self) -> Generator[int, int, None]:
        """Take the arguments of the kernel, call after call, and write its results."""
        n, k = self._pepper.n, self._index.size
        size = _answer_size(len(self._tasks), k)
        try:
            while True:
                inputs, result, _ = (yield 0), (yield 0), (yield 0)
                q = floats_at(inputs, n).copy()
                floats_at(result, size)[:] = self._values(read_only(q))
        except GeneratorExit:
            return
        except BaseException as error:  # an exception cannot pass through machine code
            self._raised, self.signals[STOPPED] = error, 1
        while True:  # nothing is written from now on: the search sees that it is to stop
            try:
                yield 0
            except GeneratorExit:
                return
            except BaseException:  # a second signal: the first one is enough
                continue

    def _values(self, q: Array) -> Array:
        """Return errors, cost, gradient and the matrix's upper triangle as one vector.

        They are those of `pepper_kin.ik.fast.expression.task_function`, for t tasks that k joints move.

        Args:
            q: Joint positions [rad or m], shape (n,).

        Returns:
            Shape (t + 1 + k + k (k + 1) / 2,).

        Raises:
            InvalidValueError: where a residual, Jacobian or error of a task is not finite.
        """
        pepper, residuals, slopes, errors = self._pepper, [], [], []
        for task in self._tasks:
            residual = np.asarray(task.residual(pepper, q), dtype=float)
            slope = np.asarray(task.jacobian(pepper, q), dtype=float)
            error = float(task.size(residual))
            if not (np.isfinite(residual).all() and np.isfinite(slope).all() and np.isfinite(error)):
                raise InvalidValueError(f"residual of {task.label}", "NaN or infinity", "finite numbers")
            residuals.append(task.strength * residual)
            slopes.append(task.strength * slope[:, self._index])
            errors.append(error * error)
        residual, slope = np.concatenate(residuals), np.concatenate(slopes)
        cost = 0.5 * float(residual @ residual)
        return np.concatenate([errors, [cost], slope.T @ residual, (slope.T @ slope)[self._upper]])


ROUNDING, RELATIVE_ROUNDING = 1e-13, 1e-9
"""By how much two computations of the same error differ at most [m or rad], and as a part of a tolerance."""


def _answer_size(tasks: int, joints: int) -> int:
    """Return the length of what a kernel of tasks writes, as `make_workspace` allocates it."""
    return tasks + 1 + joints + joints * (joints + 1) // 2


SOURCES = tuple(
    f"pepper_kin.{name}"
    for name in (
        "symbolic", "model", "ik.fast", "ik.tasks", "ik.problem", "batch.states", "dynamics.center_of_mass",
        "dynamics.support_polygon", "kinematics.frames", "kinematics.jacobian",
    )
)  # fmt: skip
"""Packages and modules on which the kernels depend; joints of a center of mass are found by numbers."""

_kept: RobotMemory[tuple[TaskStructure, ...], CompiledTasks] = RobotMemory()
_lock = threading.Lock()


def compiled_tasks(pepper: PepperModel, tasks: Sequence[Task]) -> CompiledTasks:
    """Return tasks of a robot ready for the search; the first time, compile them or read them from disk.

    Tasks of classes without machine code are evaluated in Python, and prepared again each time.
    """
    structures = known_structures(tasks)
    if structures is None:
        index = np.flatnonzero(joints_used(pepper, tasks)).astype(np.int64)
        python = PythonTasks(pepper, tasks, index)
        return _compiled(pepper, index, [None] * len(tasks), python.address, python=python)
    known = _kept.of(pepper)
    found = known.get(structures)
    if found is None:
        found = _with_machine_code(pepper, structures)
        with _lock:
            found = known.setdefault(structures, found)
    return found


def _with_machine_code(pepper: PepperModel, tasks: tuple[TaskStructure, ...]) -> CompiledTasks:
    index = used_joints(pepper, tasks)

    def step() -> Any:
        from pepper_kin.ik.fast.expression import task_function

        return task_function(pepper, tasks, index)

    key = f"ik {tasks!r} of {robot_digest(pepper)} by {source_digest(*SOURCES)}"
    made = compile_function(step, key=key, batch=False)
    return _compiled(pepper, index, [task.target_size for task in tasks], made=made)


def _compiled(
    pepper: PepperModel,
    index: np.ndarray,
    target_sizes: Sequence[int | None],
    address: int = 0,
    made: Kernel | None = None,
    python: PythonTasks | None = None,
) -> CompiledTasks:
    """Return the tables of tasks from their kernel, or from Python.

    Args:
        pepper: The robot.
        index: Indices of the joints that move a task, ascending, shape (k,).
        target_sizes: Length of each task's target in a row of input; None for a task in Python.
        address: Address of the kernel of tasks in Python; not used with `made`.
        made: The kernel of tasks with machine code.
        python: The tasks in Python, where there is no machine code for them.
    """
    gravity = kernel(pepper, "gravity_torque")
    places: list[slice | None] = []
    place = pepper.n + len(target_sizes)
    for size in target_sizes:
        places.append(None if size is None else slice(place, place + size))
        place += size or 0
    limited, share = (
        np.isfinite(pepper.effort_limits) & (pepper.effort_limits > 0),
        pepper.requirements.holding_share,
    )
    others = np.ones(pepper.n, dtype=bool)
    others[index] = False
    joints = np.concatenate([index, np.flatnonzero(others)]).astype(np.int64)
    n, k, tasks = pepper.n, index.size, len(target_sizes)
    work = max(gravity.work_size, 0 if made is None else made.work_size) + 8
    if made is not None:
        address = made.address_of("single", inputs=place, outputs=_answer_size(tasks, k), work=work)
    tables = TaskTables(
        kernel=address,
        gravity=gravity.address_of("single", inputs=n, outputs=n, work=work),
        work_size=work,
        task_joints=index.size,
        joints=joints,
        # By its kernel, which drops an axis of length 1: a first answer does not wait for Pinocchio to load.
        scale=scale_of(np.reshape(kernel(pepper, "mass_matrix")(pepper.neutral()), (n, n)))[joints] ** 2,
        effort=np.where(limited, 1.0 / np.where(limited, share * pepper.effort_limits, 1.0), 0.0),
    )
    return CompiledTasks(
        tables=tables,
        index=index,
        bounds=np.array([pepper.lower_limits[joints], pepper.upper_limits[joints], np.ones(pepper.n)]),
        target_places=tuple(places),
        width=place,
        python=python,
        _kernels=(gravity,) if made is None else (gravity, made),
    )


def squared_tolerance(allowed: float) -> float:
    """Return the square of a tolerance as machine code compares with it.

    It is smaller by more than rounding: errors that are computed again, by another code, are within the
    tolerance too.
    """
    if allowed == np.inf:
        return np.inf
    least = max(allowed - RELATIVE_ROUNDING * allowed - ROUNDING, 0.5 * allowed)
    return least * least


def used_joints(pepper: PepperModel, tasks: Sequence[TaskStructure]) -> np.ndarray:
    """Return the places of the joints that move any task, ascending."""
    used = np.any([task.kind.moved_by(pepper, task) for task in tasks], axis=0)
    return np.flatnonzero(used).astype(np.int64)


@lru_cache(maxsize=64)
def unit_points(dimension: int, total: int, seed: int) -> tuple[Array, Array]:
    """Return x_0 and alpha of the points that restarts are made from, see `SearchOptions`, shape (total,).

    Args:
        dimension: k: the first k numbers are those of points of the k-dimensional unit cube.
        total: n >= k; the further numbers are as of n dimensions.
        seed: Draws x_0.
    """
    return read_only(np.random.default_rng(seed).random(total)), _advance(dimension, total)


@lru_cache(maxsize=64)
def _advance(dimension: int, total: int) -> Array:
    """Return alpha of `unit_points`."""
    whole, part = (_golden_ratio(m) ** -(1.0 + np.arange(m)) for m in (total, dimension))
    return read_only(np.concatenate([part, whole[dimension:]]))


def _golden_ratio(dimension: int) -> float:
    """Return the real root phi of phi^(m+1) = phi + 1."""
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimension + 1))
    return ratio
