"""Kernel and tables of the compiled search, made once for each robot and set of tasks."""

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
    """Arrays of one search at a time.

    Args:
        width: Length of a row of input.
        n: Number of joints.
        tasks: Number of tasks t.
        signals: Table of signals, see `interrupt_table`.

    Attributes:
        inputs: Input of `solve_rows`, shape (1, width).
        answers: Output of `solve_rows`, shape (1, n + t + EXTRA).
        row: View of the row of `inputs`, shape (width,).
        start: View of q0 in `row`, shape (n,) [rad or m].
        q: View of the solution in `answers`, shape (n,) [rad or m].
        outcome: View of the last numbers of `answers`, see `EXTRA`, shape (EXTRA,).
        tolerance: Squared tolerances, shape (t,).
        signals: Table of signals, see `interrupt_table`.
    """

    def __init__(self, width: int, n: int, tasks: int, signals: np.ndarray) -> None:
        self.inputs, self.answers = np.empty((1, width)), np.empty((1, n + tasks + EXTRA))
        self.row, self.tolerance = self.inputs[0], np.empty(tasks)
        self.start, self.q, self.outcome = self.row[:n], self.answers[0, :n], self.answers[0, -EXTRA:]
        self.signals = signals
        self._key: tuple[SearchBudget, bool, int] | None = None
        self._options: SearchOptions | None = None

    def options(self, budget: SearchBudget, stop_when_met: bool, dimension: int) -> SearchOptions:
        """Return the options of a search, cached for repeated arguments."""
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
    """Machine code and tables of tasks of one structure on one robot.

    Attributes:
        tables: Tables of `solve_rows`.
        index: Indices of the joints on which a task depends, shape (k,).
        bounds: Rows of lower limits, upper limits [rad or m] and ones (all may move) of `tables.joints`,
            shape (3, n).
        target_places: Slice of each task's target in a row of input; None for tasks in Python.
        width: Length of a row of input.
        python: Tasks evaluated in Python; None for tasks with machine code.
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
        """Return buffers for a search, to be appended to `spare` afterwards."""
        try:
            return self.spare.pop()
        except IndexError:
            signals = interrupt_table() if self.python is None else self.python.signals
            return SearchBuffers(self.width, self.tables.effort.size, len(self.target_places), signals)

    def check(self, buffers: SearchBuffers) -> None:
        """Raise the error of a signal handler or of a task in Python during a search."""
        raise_interrupt(buffers.signals)
        if self.python is not None:
            self.python.check()

    def bounds_of(self, movable: np.ndarray | None) -> Array:
        """Return the bounds, shape (3, n), if only some joints may move.

        Args:
            movable: Whether each joint may move, shape (n,); None for all.
        """
        if movable is None:
            return self.bounds
        bounds = self.bounds.copy()
        bounds[2] = movable[self.tables.joints]
        return bounds

    def read(self, tasks: Sequence[Task], row: Array, tolerance: Array) -> bool:
        """Write weights and targets into a row of input, and the squared tolerances.

        Args:
            tasks: Tasks of the compiled structure, with one target each.
            row: Row of input to write to, shape (width,): q, w_i^2 and the concatenated targets.
            tolerance: Squared tolerances to write to, shape (t,) [m^2 or rad^2].

        Returns:
            Whether all tolerances are finite, so that the search may end if all tasks are well met.
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
    """User-defined tasks: machine code calls the address of a kernel that runs Python.

    An error of a task or of a signal handler ends the search and is raised by `check`.

    Args:
        pepper: The robot.
        tasks: The tasks.
        index: Indices of the joints of the gradient, shape (k,).

    Attributes:
        address: Address of a C function with the interface of `task_function`, valid while this object lives.
        signals: Table of signals, which is set to stop if a task raises.
    """

    def __init__(self, pepper: PepperModel, tasks: Sequence[Task], index: np.ndarray) -> None:
        self._pepper, self._tasks, self._index = pepper, tuple(tasks), index
        self._upper = np.triu_indices(index.size)
        self._raised: BaseException | None = None
        self.signals = interrupt_table()
        # Python runs signal handlers when a function begins, where the function cannot catch their errors,
        # and when a generator resumes, where it can. `max` sends the generator the three arguments in turn.
        answers = self._answers()
        next(answers)
        self._function = _KERNEL(partial(max, key=answers.send))
        self.address = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0)

    def check(self) -> None:
        """Raise the error of a task; after an error no task is evaluated."""
        if self._raised is not None:
            raise self._raised

    def _answers(self) -> Generator[int, int, None]:
        """Receive the arguments of each call of the kernel and write its results."""
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
        while True:  # write nothing more: the search sees the signal to stop
            try:
                yield 0
            except GeneratorExit:
                return
            except BaseException:  # ignore further signals
                continue

    def _values(self, q: Array) -> Array:
        """Return squared errors, cost, gradient and the matrix's upper triangle as one vector.

        They are defined in `pepper_kin.ik.fast.expression.task_function`, for t tasks and k joints.

        Args:
            q: Joint positions [rad or m], shape (n,).

        Returns:
            The vector, shape (t + 1 + k + k (k + 1) / 2,).

        Raises:
            InvalidValueError: for a residual, Jacobian or error of a task that is not finite.
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
"""Maximum difference of two computations of an error: absolute [m or rad], and relative to a tolerance."""


def _answer_size(tasks: int, joints: int) -> int:
    """Return the length of a kernel's output, which `make_workspace` allocates."""
    return tasks + 1 + joints + joints * (joints + 1) // 2


SOURCES = tuple(
    f"pepper_kin.{name}"
    for name in (
        "symbolic", "model", "ik.fast", "ik.tasks", "ik.problem", "batch.states", "dynamics.center_of_mass",
        "dynamics.support_polygon", "kinematics.frames", "kinematics.jacobian",
    )
)  # fmt: skip
"""Packages and modules on which the kernels depend, also for the joints found numerically."""

_kept: RobotMemory[tuple[TaskStructure, ...], CompiledTasks] = RobotMemory()
_lock = threading.Lock()


def compiled_tasks(pepper: PepperModel, tasks: Sequence[Task]) -> CompiledTasks:
    """Return compiled tasks of a robot; the first call compiles them or reads them from disk.

    Tasks of classes without machine code are evaluated in Python, and prepared at each call.
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
    """Compile the kernel of tasks, or read it from disk, and return it with its tables."""
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
    """Return the tables of tasks with a kernel or in Python.

    Args:
        pepper: The robot.
        index: Indices of the joints on which a task depends, ascending, shape (k,).
        target_sizes: Length of each task's target in a row of input; None for a task in Python.
        address: Address of the kernel of tasks in Python; not used with `made`.
        made: Kernel of tasks with machine code, or None.
        python: Tasks evaluated in Python, or None.
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
        # The kernel, which drops an axis of length 1, is used so that a first answer does not wait for
        # Pinocchio.
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
    """Return the squared tolerance for machine code, smaller by more than rounding errors.

    Errors that other code computes again are then within the tolerance, too.
    """
    if allowed == np.inf:
        return np.inf
    least = max(allowed - RELATIVE_ROUNDING * allowed - ROUNDING, 0.5 * allowed)
    return least * least


def used_joints(pepper: PepperModel, tasks: Sequence[TaskStructure]) -> np.ndarray:
    """Return the indices of the joints on which any task depends, ascending, shape (k,)."""
    used = np.any([task.kind.moved_by(pepper, task) for task in tasks], axis=0)
    return np.flatnonzero(used).astype(np.int64)


@lru_cache(maxsize=64)
def unit_points(dimension: int, total: int, seed: int) -> tuple[Array, Array]:
    """Return x_0 and alpha of the points for restarts, see `SearchOptions`, shape (total,) each.

    Args:
        dimension: k; the first k numbers make points of the k-dimensional unit cube.
        total: n >= k; the further numbers are for n dimensions.
        seed: Seed of x_0.
    """
    return read_only(np.random.default_rng(seed).random(total)), _advance(dimension, total)


@lru_cache(maxsize=64)
def _advance(dimension: int, total: int) -> Array:
    """Return alpha of `unit_points`, shape (total,)."""
    whole, part = (_golden_ratio(m) ** -(1.0 + np.arange(m)) for m in (total, dimension))
    return read_only(np.concatenate([part, whole[dimension:]]))


def _golden_ratio(dimension: int) -> float:
    """Return the real root phi of phi^(m+1) = phi + 1, with m the dimension."""
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimension + 1))
    return ratio
