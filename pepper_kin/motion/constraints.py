"""IK tasks as constraints that hold all along a path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.ik.fast.expression import residuals
from pepper_kin.ik.problem import flatten_tasks
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.structure import TaskStructure, known_structures, target_of
from pepper_kin.kernels import Kernel, compile_function, source_digest
from pepper_kin.model import PepperModel, kept_for_robot, robot_digest

if TYPE_CHECKING:
    import casadi

SOURCES = tuple(
    f"pepper_kin.{name}" for name in ("symbolic", "model", "ik.fast", "ik.tasks", "motion.constraints")
)
"""Packages and modules whose code the kernels depend on."""


def as_constraints(
    pepper: PepperModel, constraints: Sequence[Task | TaskGroup], loads: Loads = ()
) -> tuple[Task, ...]:
    """Return tasks as constraints of a path, with groups split; loads count for the center of mass.

    Raises:
        InvalidValueError: for no task, a task with several targets, or an infinite tolerance.
        UnknownNameError: for a frame or joint that the robot lacks.
    """
    tasks = tuple(with_loads(flatten_tasks(pepper, constraints), loads))
    for task in tasks:
        if not np.isfinite(task.tolerance):
            raise InvalidValueError(f"tolerance of {task.label}", task.tolerance, "a finite tolerance")
    return tasks


def with_equalities(task: Task) -> Task:
    """Return a task as a hard one, which IK meets before all soft tasks."""
    return task.altered(hard=True)


def with_constraints(goal: ArrayLike | Sequence[Any], constraints: Sequence[Task]) -> Any:
    """Return a goal, with the constraints added as hard tasks if it consists of tasks.

    Args:
        goal: Joint positions [rad or m], shape (n,) or (m, n), which are returned unchanged; or tasks.
        constraints: The constraints.
    """
    if not isinstance(goal, Sequence) or not goal or not isinstance(goal[0], (Task, TaskGroup)):
        return goal
    parts: list[Any] = []
    for item in goal:
        parts += item.parts if isinstance(item, TaskGroup) else [item]
    return [*parts, *(with_equalities(task) for task in constraints)]


def manifold_of(
    pepper: PepperModel, constraints: Sequence[Task | TaskGroup], frozen: Array, free: NDArray[np.int64]
) -> planners.ConstraintManifold:
    """Return the configurations that meet tasks to their tolerances, for some joints of a robot.

    Residuals and their Jacobian are compiled at the first use of the tasks' kinds and frames, and cached on
    disk.  Tasks of classes outside `pepper_kin.ik` are called in Python, which is slow.

    Args:
        pepper: The robot.
        constraints: Tasks with one target and a finite tolerance each.
        frozen: A whole configuration with the other joints' positions [rad or m], shape (n,).
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
        # If the error is the largest component, each component is a separate constraint.
        first, apart = len(tolerances), task.largest
        count = size if apart else 1
        groups += [first + (k if apart else 0) for k in range(size)]
        tolerances += [task.tolerance] * count
        names += [task.name] * count
    function: planners.CompiledManifold | InPython
    structures = soft_structures(tasks)
    if structures is None:
        function = InPython(pepper, tasks, frozen, free)
    else:
        function = _machine_code(_kernel(pepper, structures), tasks, frozen, free)
    return planners.ConstraintManifold(
        function, int(free.size), sum(sizes), np.array(tolerances), np.array(groups), tuple(names)
    )


def residuals_of(
    pepper: PepperModel, tasks: Sequence[Task], frozen: Array, free: NDArray[np.int64]
) -> Callable[[Array], tuple[Array, Array]]:
    """Return the function from states of some joints, shape (m, k), to residuals and their Jacobians.

    Args:
        pepper: The robot.
        tasks: Constraints, as `as_constraints` returns them.
        frozen: A whole configuration with the other joints' positions [rad or m], shape (n,).
        free: Indices of the joints that move, shape (k,).

    Returns:
        A function that returns residuals, shape (m, r), and Jacobians, shape (m, r, k).
    """
    python, structures = InPython(pepper, tuple(tasks), frozen, free), soft_structures(tasks)
    if structures is None:
        return python
    kernel = _kernel(pepper, structures)
    targets = np.concatenate([target_of(task) for task in tasks])

    def evaluate(states: Array) -> tuple[Array, Array]:
        """Return residuals, shape (m, r), and Jacobians, shape (m, r, k), at states, shape (m, k)."""
        numbers = np.asarray(kernel(python.whole(states), targets))
        rows = numbers.shape[1] // (1 + pepper.n)
        return numbers[:, :rows], numbers[:, rows:].reshape(len(states), rows, pepper.n)[:, :, free]

    return evaluate


class InPython:
    """Residuals and Jacobians of tasks by their Python code, state by state.

    Args:
        pepper: The robot.
        tasks: The tasks.
        frozen: A whole configuration with the other joints' positions [rad or m], shape (n,).
        free: Indices of the joints that move, shape (k,).
    """

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
        """Return residuals, shape (m, r), and their Jacobians, shape (m, r, k), at states, shape (m, k)."""
        q = self.whole(states)
        values = [np.concatenate([task.residual(self._pepper, x) for task in self._tasks]) for x in q]
        slopes = [np.concatenate([task.jacobian(self._pepper, x) for task in self._tasks]) for x in q]
        return np.array(values), np.array(slopes)[:, :, self._free]


def soft_structures(tasks: Sequence[Task]) -> tuple[TaskStructure, ...] | None:
    """Return the structures of tasks, all soft; None if a task has no machine code."""
    known = known_structures(tasks)
    return None if known is None else tuple(structure._replace(hard=False) for structure in known)


def _machine_code(
    kernel: Kernel, tasks: tuple[Task, ...], frozen: Array, free: NDArray[np.int64]
) -> planners.CompiledManifold:
    """Return tasks of known kinds as a manifold in machine code.

    Args:
        kernel: Kernel of the tasks' structures.
        tasks: The tasks.
        frozen: A whole configuration with the other joints' positions [rad or m], shape (n,).
        free: Indices of the joints that move, shape (k,).
    """
    kernel_input = np.concatenate([frozen, *[target_of(task) for task in tasks]])
    (written,), work = kernel.signature.output_sizes, kernel.work_size
    address = kernel.address_of("single", inputs=kernel_input.size, outputs=written, work=work)
    return planners.CompiledManifold(
        address, kernel_input, free, free, frozen.size, work, keep_alive=kernel, size=written
    )


@kept_for_robot(most=64)
def _kernel(pepper: PepperModel, structures: tuple[TaskStructure, ...]) -> Kernel:
    """Return the compiled kernel of residuals and their Jacobian."""
    key = f"constraints {structures!r} of {robot_digest(pepper)} by {source_digest(*SOURCES)}"
    return compile_function(lambda: _expression(pepper, structures), key=key)


def _expression(pepper: PepperModel, structures: tuple[TaskStructure, ...]) -> casadi.Function:
    """Return the CasADi function (q, targets) -> residuals, then their Jacobian by q, row by row."""
    import casadi

    q = casadi.SX.sym("q", pepper.n)
    targets = casadi.SX.sym("targets", sum(task.target_size for task in structures))
    pairs = residuals(pepper, structures, q, targets)
    rows = casadi.vec(casadi.densify(casadi.vertcat(*(jacobian for _, jacobian in pairs))).T)
    output = casadi.densify(casadi.vertcat(*(residual for residual, _ in pairs), rows))
    return casadi.Function("constraints", [q, targets], [casadi.cse(output)])
