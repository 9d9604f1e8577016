"""Optimization problem of inverse kinematics, which all solvers share."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, cast

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.core.inverse_kinematics.local_solver import CLOSE
from pepper_kin.dynamics import mass_matrix
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.structure import generic_configurations
from pepper_kin.ik.tasks.task import Task, TaskGroup
from pepper_kin.model import PepperModel

POSTURE_WEIGHT = 1e-3
"""eps, weight of the posture term: at a residual of a task's tolerance it shifts the optimum by
micrometers."""

OUT_OF_THE_WAY = 0.1
"""Motion of a joint that no task depends on above which a result reports the joint [rad or m]."""


class SearchBudget(NamedTuple):
    """Limits of a search.

    Attributes:
        seed: Seed of the restarts.
        restarts: Number of restarts after the first start.
        max_iterations: Maximum number of steps from each start.
        deadline: Time at which to stop, on the clock of `working_time` [s].
        thorough: Whether to continue the search if a solution collides; otherwise it is only moved clear.
        closest: Whether to search for the closest configuration if the tasks are not met.
    """

    seed: int
    restarts: int
    max_iterations: int
    deadline: float
    thorough: bool = True
    closest: bool = True


@dataclass(frozen=True, eq=False)
class TaskProblem(FrozenArrays):
    """min over q of F(q) = (sum_i s_i^2 |r_i(q)|^2 + eps^2 |q - q_ref|^2) / 2, lower <= q <= upper.

    The strength s_i is a task's weight, times HARD_WEIGHT for a hard task.  Joints that may not
    move have `lower == upper`.

    Attributes:
        pepper: The robot.
        tasks: The tasks, groups split into their parts.
        q0: Start of the search, and positions of joints that may not move [rad or m], shape (n,).
        movable: Whether each joint may move, shape (n,).
        lower: Lower bounds [rad or m], shape (n,).
        upper: Upper bounds [rad or m], shape (n,).
    """

    pepper: PepperModel
    tasks: tuple[Task, ...]
    q0: Array
    movable: np.ndarray
    lower: Array
    upper: Array

    @cached_property
    def scale(self) -> Array:
        """d, shape (n,): the weight of each joint's motion; the damping is lambda |diag(d) dq|^2."""
        return read_only(motion_scale(self.pepper, self.q0))

    def residuals(self, q: Array) -> list[Array]:
        """Return the residual of each task, shape (m_i,), without weights, at q, shape (n,) [rad or m]."""
        return [task.residual(self.pepper, q) for task in self.tasks]

    def stack(self, residuals: Sequence[Array]) -> Array:
        """Return all residuals, shape (m_i,) each, times their strengths, as one vector, shape (m,)."""
        return np.concatenate([t.strength * r for t, r in zip(self.tasks, residuals, strict=True)])

    def jacobian(self, q: Array) -> Array:
        """Return the derivative of the stacked residuals, shape (m, n), at q, shape (n,) [rad or m]."""
        return np.concatenate([task.strength * task.jacobian(self.pepper, q) for task in self.tasks])

    def task_cost(self, residuals: Sequence[Array]) -> float:
        """Return F without the posture term from the residual of each task, shape (m_i,)."""
        return 0.5 * sum(t.strength**2 * float(r @ r) for t, r in zip(self.tasks, residuals, strict=True))

    def cost(self, q: Array, residuals: Sequence[Array], reference: Array) -> float:
        """Return F(q) from the residuals r_i(q).

        Args:
            q: Joint positions [rad or m], shape (n,).
            residuals: Residual of each task at q, shape (m_i,).
            reference: q_ref [rad or m], shape (n,).
        """
        shift = (q - reference)[self.movable]
        return self.task_cost(residuals) + 0.5 * POSTURE_WEIGHT**2 * float(shift @ shift)

    def is_met(self, residuals: Sequence[Array], fraction: float = 1.0) -> bool:
        """Return whether every task's error is within a fraction of its tolerance.

        Args:
            residuals: Residual of each task, shape (m_i,).
            fraction: Allowed fraction of each tolerance.
        """
        pairs = zip(self.tasks, residuals, strict=True)
        return all(task.size(residual) <= fraction * task.tolerance for task, residual in pairs)

    def is_close(self, residuals: Sequence[Array]) -> bool:
        """Return whether the search may end: all tasks are well met and have a finite tolerance.

        Args:
            residuals: Residual of each task, shape (m_i,).
        """
        return all(np.isfinite(task.tolerance) for task in self.tasks) and self.is_met(residuals, CLOSE)

    def clip(self, q: Array) -> Array:
        """Return q, shape (n,) [rad or m], moved into the bounds."""
        return np.clip(q, self.lower, self.upper)

    def without_limits(self) -> TaskProblem:
        """Return a problem with bounds only on the joints that may not move."""
        lower = np.where(self.movable, -np.inf, self.lower)
        upper = np.where(self.movable, np.inf, self.upper)
        return replace(self, lower=read_only(lower), upper=read_only(upper))


def make_problem(
    pepper: PepperModel, tasks: Sequence[Task], q0: Array, movable: np.ndarray, keep_idle: bool
) -> TaskProblem:
    """Build a problem from checked tasks and a checked start.

    Args:
        pepper: The robot.
        tasks: The tasks.
        q0: Start within the limits, shape (n,) [rad or m].
        movable: Whether the caller lets each joint move, shape (n,).
        keep_idle: Whether joints that no task depends on may not move.

    Returns:
        The problem.
    """
    if keep_idle:
        movable = movable & joints_used(pepper, tasks)
    return TaskProblem(
        pepper=pepper,
        tasks=tuple(tasks),
        q0=read_only(q0),
        movable=movable,
        lower=read_only(np.where(movable, pepper.lower_limits, q0)),
        upper=read_only(np.where(movable, pepper.upper_limits, q0)),
    )


def joints_used(pepper: PepperModel, tasks: Iterable[Task]) -> np.ndarray:
    """Return whether any task's residual depends on each joint, shape (n,).

    The Jacobian's column of a joint without influence is zero at every q; at two generic configurations no
    other column vanishes.
    """
    used = np.zeros(pepper.n, dtype=bool)
    for q in generic_configurations(pepper):
        for task in tasks:
            used |= np.abs(task.dependence(pepper, q)).max(axis=0) > 1e-9
    return used


def moved_aside(pepper: PepperModel, idle: np.ndarray, way: Array) -> tuple[str, ...]:
    """Return the idle joints that move farther than `OUT_OF_THE_WAY`, in words: "HeadYaw by 0.12 rad".

    Args:
        pepper: The robot.
        idle: Whether no task depends on each joint, shape (n,).
        way: Distance that each joint moves [rad or m], shape (n,).
    """
    far = np.flatnonzero(idle & (way > OUT_OF_THE_WAY))
    return tuple(f"{pepper.joint_names[j]} by {way[j]:.2f} {pepper.joint_units[j]}" for j in far)


def motion_scale(pepper: PepperModel, q: Array) -> Array:
    """Return d_i = sqrt(M_ii / median M_ii), between 1/2 and 4: joints that carry more mass move less.

    sum_i M_ii dq_i^2 is twice the kinetic energy of a unit-time step, without cross terms.

    Args:
        pepper: The robot.
        q: Joint positions at which the mass matrix M is evaluated [rad or m], shape (n,).

    Returns:
        d, shape (n,).
    """
    return scale_of(mass_matrix(pepper, q))


def scale_of(inertia: Array) -> Array:
    """Return the scale of `motion_scale` from a mass matrix, shape (n, n)."""
    own = np.maximum(np.diagonal(inertia), 1e-9)
    middle = np.sort(own)[[(own.size - 1) // 2, own.size // 2]].mean()  # np.median loads numpy.ma
    return np.clip(np.sqrt(own / middle), 0.5, 4.0)


def flatten_tasks(
    pepper: PepperModel, tasks: Task | TaskGroup | Iterable[Task | TaskGroup], *, batch: bool = False
) -> list[Task]:
    """Return the parts of all tasks, checked against the robot.

    Args:
        pepper: The robot.
        tasks: Tasks and groups.
        batch: Whether a task may have N targets.

    Raises:
        InvalidValueError: for no task, or anything that is not a task.
        UnknownNameError: for a frame or joint that the robot lacks.
    """
    items = tasks
    if type(tasks) is not list:
        items = [tasks] if isinstance(tasks, (Task, TaskGroup)) else tasks
        if not isinstance(items, Iterable) or isinstance(items, (str, bytes)):
            raise InvalidValueError("tasks", repr(tasks), "a list of tasks such as HandPosition")
    flat: list[Task] = []
    for item in cast("Iterable[Any]", items):
        kind = _kind_of(cast("Hashable", type(item)))
        if kind is Task:
            flat.append(item)
        elif kind is TaskGroup:
            flat.extend(item.parts)
        else:
            raise InvalidValueError("tasks", repr(item), "tasks such as HandPosition or LookAt")
    if not flat:
        raise InvalidValueError("tasks", "none", "at least one task")
    for task in flat:
        if task.count is not None and not batch:
            raise InvalidValueError(
                f"target of {task.label}", f"{task.count} targets", "one target; `solve_batch` takes many"
            )
        task.check(pepper)
    return [task.on(pepper) for task in flat]


@lru_cache(maxsize=256)
def _kind_of(items: Hashable) -> type | None:
    """Return Task or TaskGroup for their subclasses, else None; asking an abstract class is slow."""
    return next((kind for kind in (Task, TaskGroup) if issubclass(cast("type", items), kind)), None)


def movable_joints(
    pepper: PepperModel, joints: str | Iterable[str] | None, *, allow_none: bool = False
) -> np.ndarray:
    """Return whether each joint may move, shape (n,).

    Args:
        pepper: The robot.
        joints: Names of joints and groups, see `PepperModel.resolve_joints`.
        allow_none: Whether an empty selection is allowed.

    Raises:
        UnknownNameError: for an unknown group or joint.
        InvalidValueError: for an empty selection.
    """
    movable = np.zeros(pepper.n, dtype=bool)
    names = pepper.resolve_joints(joints, allow_none=allow_none)
    movable[[pepper.joint_index(name) for name in names]] = True
    return movable
