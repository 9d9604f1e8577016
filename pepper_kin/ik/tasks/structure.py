"""Structure of tasks, for which machine code is compiled, and variables of their expressions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.center_of_mass import center_of_mass, center_of_mass_jacobian
from pepper_kin.symbolic.inverse_dynamics import gravity_torque

if TYPE_CHECKING:
    from pepper_kin.ik.tasks.task import Task


class TaskStructure(NamedTuple):
    """The part of a task for which code is compiled; similar tasks share one.

    Attributes:
        kind: Class of the task, whose `expression` is compiled.
        frame: Name of the frame; empty for tasks on joints.
        axis: Axis in the frame, or normal in the world; empty for tasks without one.
        joints: Names of the joints of a task on joints; empty for all.
        target_size: Number of values that describe the target.
        reference: Name of the reference frame of `frame` or the center of mass, or of the frame where a line
            begins; empty for the world.
        corners: Corners of the polygon of contacts, x and y in turn [m]; empty for tasks without one.
        hard: Whether the task is hard.
        source: Serialized function of an `Expression`, see `Expression.source`.
    """

    kind: type[Task]
    frame: str = ""
    axis: tuple[float, ...] = ()
    joints: tuple[str, ...] = ()
    target_size: int = 3
    reference: str = ""
    corners: tuple[float, ...] = ()
    hard: bool = False
    source: str = ""


@lru_cache(maxsize=4096)
def frame_structure(
    kind: type[Task], frame: str, hard: bool, target_size: int = 3, axis: bytes = b"", reference: str = ""
) -> TaskStructure:
    """Return the structure of a task on a frame; cached, since making it takes as long as some steps."""
    return TaskStructure(
        kind, frame, tuple(np.frombuffer(axis).tolist()), (), target_size, reference, (), hard
    )


def known_structures(tasks: Sequence[Task]) -> tuple[TaskStructure, ...] | None:
    """Return the structure of each task; None if one task has no machine code."""
    found = []
    for task in tasks:
        structure = task.structure()
        if structure is None:
            return None
        found.append(structure)
    return tuple(found)


def target_of(task: Task) -> Array:
    """Return the numbers that describe a task's target, flattened, shape (target_size,)."""
    target: Array = getattr(task, task.target_name)
    return target if target.ndim == 1 else target.ravel()


@dataclass(frozen=True, eq=False)
class TaskVariables:
    """Variables of the expressions of tasks.

    Attributes:
        pepper: The robot.
        q: Joint positions, shape (n,).
        frames: Pose (3, 4) and Jacobian (6, n) of each frame.
    """

    pepper: PepperModel
    q: Any
    frames: Mapping[str, tuple[Any, Any]]

    @cached_property
    def center(self) -> tuple[Any, Any]:
        """Center of mass, shape (3,) [m], and its Jacobian, shape (3, n)."""
        return center_of_mass(self.pepper)(self.q), center_of_mass_jacobian(self.pepper)(self.q)

    @cached_property
    def gravity_torque(self) -> Any:
        """Torques that hold the robot still [N m or N], shape (n,)."""
        return gravity_torque(self.pepper)(self.q)

    def joints(self, names: Sequence[str]) -> tuple[Any, Any]:
        """Return the positions of named joints, or of all without names, and their Jacobian by q."""
        import casadi

        rows = [self.pepper.joint_index(name) for name in names or self.pepper.joint_names]
        return self.q[rows], casadi.SX(casadi.sparsify(casadi.DM(np.eye(self.pepper.n)[rows])))

    def without(self, jacobian: Any, moving: np.ndarray) -> Any:
        """Return a Jacobian with structural zeros for the joints that are not moving, shape (n,)."""
        import casadi

        rows = jacobian.shape[0]
        columns = [jacobian[:, k] if moving[k] else casadi.SX(rows, 1) for k in range(self.pepper.n)]
        return casadi.horzcat(*columns)


def generic_configurations(pepper: PepperModel) -> list[Array]:
    """Return two configurations at which an expression of q vanishes only if it always vanishes."""
    span = np.minimum(pepper.upper_limits, np.pi) - np.maximum(pepper.lower_limits, -np.pi)
    low = np.maximum(pepper.lower_limits, -np.pi)
    shares = 1 - 0.2 * np.sin(np.arange(pepper.n))
    return [low + fraction * span * shares for fraction in (0.3819, 0.7236)]


def joints_that_change(pepper: PepperModel, derivative: Callable[[Array], Array]) -> np.ndarray:
    """Return whether each joint's column of a derivative, shape (k, n), is not always zero, shape (n,).

    Joints that move two frames together have columns of rounding errors in a relative Jacobian.
    """
    used = np.zeros(pepper.n, dtype=bool)
    for q in generic_configurations(pepper):
        used |= np.abs(derivative(q)).max(axis=0) > 1e-9
    return used
