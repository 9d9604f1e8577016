"""IK tasks as constraints that hold all along a path."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin import planners
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.ik.problem import flatten_tasks
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, RobotMemory, robot_digest

if TYPE_CHECKING:
    import casadi

    from pepper_kin.ik.fast.structure import Structure

Array = NDArray[np.float64]

LARGEST = ("JointPosture", "CenterOfMassOverWheels")
"""Tasks whose error is the largest component of the residual: each component is a constraint of its own."""

SOURCES = tuple(f"pepper_kin.{name}" for name in ("symbolic", "model", "ik.fast", "ik.tasks", "motion"))
"""Packages on which the kernels depend."""

_kept: RobotMemory[tuple[Structure, ...], Kernel] = RobotMemory()


def as_constraints(pepper: PepperModel, constraints: Sequence[Task | TaskGroup]) -> tuple[Task, ...]:
    """Return tasks as constraints of a path, groups taken apart.

    Raises:
        InvalidValueError: for no task, a task with several targets, or one of infinite tolerance.
        UnknownNameError: for a frame or joint that the robot lacks.
    """
    tasks = tuple(flatten_tasks(pepper, constraints))
    for task in tasks:
        if not np.isfinite(task.tolerance):
            raise InvalidValueError(f"tolerance of {task.label}", task.tolerance, "a finite tolerance")
    return tasks


def hardened(task: Task) -> Task:
    """Return a task that IK meets before all soft ones."""
    hard = copy.copy(task)
    object.__setattr__(hard, "hard", True)
    hard.__dict__.pop("_fast_structure", None)
    return hard


def manifold_of(
    pepper: PepperModel, constraints: Sequence[Task | TaskGroup], frozen: Array, free: NDArray[np.int64]
) -> planners.ConstraintManifold:
    """Return the configurations that meet tasks to their tolerances, for some joints of a robot.

    Residuals and their Jacobian are compiled, at the first use of tasks of these kinds on these frames, and
    kept on disk.  Tasks of other classes than those of `pepper_kin.ik` are called in Python, which is slow.

    Args:
        pepper: The robot.
        constraints: Tasks with one target and a finite tolerance each.
        frozen: A whole configuration [rad or m], shape (n,): what the other joints keep.
        free: Indices of the joints that move, shape (k,).

    Raises:
        InvalidValueError: for no task, a task with several targets, or one of infinite tolerance.
        UnknownNameError: for a frame or joint that the robot lacks.
    """
    tasks = as_constraints(pepper, constraints)
    sizes = [task.residual(pepper, frozen).size for task in tasks]
    groups: list[int] = []
    tolerances: list[float] = []
    names: list[str] = []
    for task, size in zip(tasks, sizes, strict=True):
        first, apart = len(tolerances), type(task).__name__ in LARGEST or _kind(task) in LARGEST
        count = size if apart else 1
        groups += [first + (k if apart else 0) for k in range(size)]
        tolerances += [task.tolerance] * count
        names += [task.name] * count
    function: planners.CompiledManifold | _InPython
    if all(_kind(task) for task in tasks):
        function = _machine_code(pepper, tasks, frozen, free)
    else:
        function = _InPython(pepper, tasks, frozen, free)
    return planners.ConstraintManifold(
        function, int(free.size), sum(sizes), np.array(tolerances), np.array(groups), tuple(names)
    )


def residuals_of(
    pepper: PepperModel, tasks: Sequence[Task], frozen: Array, free: NDArray[np.int64]
) -> Callable[[Array], tuple[Array, Array]]:
    """Return the function from states of some joints, shape (m, k), to residuals and their Jacobians.

    Args:
        pepper: The robot.
        tasks: As `as_constraints` returns them.
        frozen: A whole configuration [rad or m], shape (n,): what the other joints keep.
        free: Indices of the joints that move, shape (k,).

    Returns:
        A callable to arrays of shape (m, r) and (m, r, k).
    """
    python = _InPython(pepper, tuple(tasks), frozen, free)
    if not all(_kind(task) for task in tasks):
        return python
    from pepper_kin.ik.fast.structure import target_of

    kernel = _kernel(pepper, tuple(_structure(task) for task in tasks))
    targets = np.concatenate([target_of(task) for task in tasks])

    def evaluate(states: Array) -> tuple[Array, Array]:
        numbers = np.asarray(kernel(python.whole(states), targets))
        rows = numbers.shape[1] // (1 + pepper.n)
        return numbers[:, :rows], numbers[:, rows:].reshape(len(states), rows, pepper.n)[:, :, free]

    return evaluate


class _InPython:
    """Tasks of a user's own classes, state by state."""

    def __init__(
        self, pepper: PepperModel, tasks: tuple[Task, ...], frozen: Array, free: NDArray[np.int64]
    ) -> None:
        self._pepper, self._tasks, self._frozen, self._free = pepper, tasks, frozen, free

    def whole(self, states: Array) -> Array:
        """Return whole configurations, shape (m, n), for states of the free joints, shape (m, k)."""
        q = np.tile(self._frozen, (len(states), 1))
        q[:, self._free] = states
        return q

    def __call__(self, states: Array) -> tuple[Array, Array]:
        q = self.whole(states)
        values = [np.concatenate([task.residual(self._pepper, x) for task in self._tasks]) for x in q]
        slopes = [np.concatenate([task.jacobian(self._pepper, x) for task in self._tasks]) for x in q]
        return np.array(values), np.array(slopes)[:, :, self._free]


def _kind(task: Task) -> str:
    """Return the kind of a task that can be compiled; empty for others.

    A class derived from one of the library's may have a residual of its own, which is not what is compiled.
    """
    if not all(slot.__module__.startswith("pepper_kin.") for slot in (type(task).residual, type(task).size)):
        return ""
    from pepper_kin.ik.fast.structure import structure_of  # loads a solver in machine code: only here

    try:
        return structure_of(task).kind
    except InvalidValueError:
        return ""


def _structure(task: Task) -> Structure:
    from pepper_kin.ik.fast.structure import structure_of

    return structure_of(task)._replace(hard=False)


def _machine_code(
    pepper: PepperModel, tasks: tuple[Task, ...], frozen: Array, free: NDArray[np.int64]
) -> planners.CompiledManifold:
    from pepper_kin.ik.fast.structure import target_of

    kernel = _kernel(pepper, tuple(_structure(task) for task in tasks))
    given = np.concatenate([frozen, *[target_of(task) for task in tasks]])
    return planners.CompiledManifold(
        kernel.single_address, given, free, free, pepper.n, kernel.work_size, keep_alive=kernel
    )


def _kernel(pepper: PepperModel, structures: tuple[Structure, ...]) -> Kernel:
    """Return the kernel of `_residuals`, made once and kept."""
    known = _kept.of(pepper)
    if structures not in known:
        key = f"constraints {structures!r} of {robot_digest(pepper)} by {source_digest(*SOURCES)}"
        known[structures] = compile_function(lambda: _residuals(pepper, structures), key=key)
    return known[structures]


def _residuals(pepper: PepperModel, structures: tuple[Structure, ...]) -> casadi.Function:
    """Return the function (q, targets) -> all residuals, then their Jacobian by q, row by row."""
    import casadi

    from pepper_kin.ik.fast.expression import _motion
    from pepper_kin.ik.fast.task_residuals import task_residual

    q = casadi.SX.sym("q", pepper.n)
    targets = casadi.SX.sym("targets", sum(task.target_size for task in structures))
    motion = _motion(pepper, structures, q)
    values, slopes, place = [], [], 0
    for task in structures:
        target = targets[place : place + task.target_size]
        place += task.target_size
        residual, jacobian = task_residual(pepper, task, motion, target)
        values.append(residual)
        slopes.append(jacobian)
    rows = casadi.vec(casadi.densify(casadi.vertcat(*slopes)).T)
    output = casadi.densify(casadi.vertcat(*values, rows))
    return casadi.Function("constraints", [q, targets], [casadi.cse(output)])
