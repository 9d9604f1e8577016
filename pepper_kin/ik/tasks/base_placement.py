"""Tasks on position and yaw of a planar base."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables
from pepper_kin.ik.tasks.task import (
    ANGLE_TOLERANCE,
    POSITION_TOLERANCE,
    PointTask,
    TargetTask,
    Task,
    TaskGroup,
    as_targets,
    words_for_angle,
)
from pepper_kin.model import PepperModel

BASE_POSITION = ("BaseX", "BaseY")
BASE_YAW = ("BaseYaw",)


class BaseTask(TargetTask):
    """A task that acts on joints of a planar base."""

    target: Array
    joints: ClassVar[tuple[str, ...]]

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot whose base does not move.

        Raises:
            InvalidValueError: naming the joints that the robot lacks.
        """
        missing = [name for name in self.joints if name not in pepper.joint_names]
        if missing:
            raise InvalidValueError(
                f"robot of {self.name}",
                f"{pepper.name!r} without {' and '.join(missing)}",
                "one with a planar base, as load_pepper(base='planar')",
            )

    def indices(self, pepper: PepperModel) -> list[int]:
        """Return the indices of the joints in the robot's joint vector."""
        return [pepper.joint_index(name) for name in self.joints]

    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return the rows of the identity that select the joints, shape (m, n); q, shape (n,), is unused."""
        return np.eye(pepper.n)[self.indices(pepper)]


@dataclass(frozen=True, eq=False, init=False, repr=False)
class BasePosition(BaseTask, PointTask):
    """The base is at a point p of the floor: r(q) = (BaseX, BaseY) - p, error |r| [m].

    Attributes:
        target: p, x and y in the world [m], shape (2,), read-only.
    """

    target: Array
    aspect: ClassVar[str] = "position"
    ground: ClassVar[str] = " of the floor"
    joints: ClassVar[tuple[str, ...]] = BASE_POSITION

    def __init__(
        self,
        point: ArrayLike,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        what = "position of base"
        target = read_only(as_targets(point, what, (2,)))
        super().__init__("base", weight=weight, tolerance=tolerance, hard=hard, subject=what, target=target)

    def place(self, pepper: PepperModel, q: Array) -> Array:
        """Return (BaseX, BaseY) [m], shape (2,)."""
        return np.asarray(q[self.indices(pepper)])

    def _structure(self) -> TaskStructure:
        return TaskStructure(BasePosition, joints=self.joints, target_size=2, hard=self.hard)

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return (BaseX, BaseY) - p and the rows of the identity."""
        positions, selection = motion.joints(task.joints)
        return positions - target, selection


@dataclass(frozen=True, eq=False, init=False, repr=False)
class BaseYaw(BaseTask):
    """The base faces a direction: r(q) = BaseYaw - yaw without full turns, in [-pi, pi); error |r| [rad].

    Attributes:
        target: Target yaw [rad], shape (), read-only.
    """

    target: Array
    unit: ClassVar[str] = "rad"
    aspect: ClassVar[str] = "yaw"
    target_axes: ClassVar[int] = 0
    joints: ClassVar[tuple[str, ...]] = BASE_YAW

    def __init__(
        self,
        yaw: ArrayLike,
        weight: float = 1.0,
        tolerance: float = ANGLE_TOLERANCE,
        *,
        hard: bool = False,
    ) -> None:
        what = "yaw of base"
        target = read_only(as_targets(yaw, what, ()))
        super().__init__("base", weight=weight, tolerance=tolerance, hard=hard, subject=what, target=target)

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return the shortest rotation from the target yaw [rad], shape (1,)."""
        turn = q[self.indices(pepper)] - self.target
        return np.asarray(turn - 2 * math.pi * np.floor(turn / (2 * math.pi) + 0.5))

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the base's yaw error in words, at joint positions q, shape (n,) [rad or m]."""
        angle, wanted = words_for_angle(self.error(pepper, q)), math.degrees(float(self.target))
        return f"{self.label} is turned {angle} away from a yaw of {wanted:.1f} deg"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the base's yaw in words, at joint positions q, shape (n,) [rad or m]."""
        return f"a yaw of {math.degrees(q[self.indices(pepper)[0]]):.1f} deg"

    def _structure(self) -> TaskStructure:
        return TaskStructure(BaseYaw, joints=self.joints, target_size=1, hard=self.hard)

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return the shortest rotation from the target yaw, and the row of the identity."""
        import casadi

        positions, selection = motion.joints(task.joints)
        turn = positions - target
        return turn - 2 * math.pi * casadi.floor(turn / (2 * math.pi) + 0.5), selection


@dataclass(frozen=True, eq=False, init=False)
class BasePlacement(TaskGroup):
    """A planar base has a target position and yaw; either may be left out.

    The robot needs a planar base, as of `load_pepper(base="planar")`. A wide tolerance asks for a placement
    near the target, an infinite one makes it a preference.

    Args:
        position: x and y in the world [m], shape (2,); None to leave it out.
        yaw: Yaw of the base about the world's z axis [rad], a number; None to leave it out.
        weight: Weight of the position.
        tolerance: Maximum error of a position that is met [m].
        yaw_weight: Weight of the yaw.
        yaw_tolerance: Maximum error of a yaw that is met [rad].
        hard: Whether the position has priority over soft tasks.
        yaw_hard: Whether the yaw has priority over soft tasks; `hard` if None.

    Attributes:
        position: Task of the position, None if left out.
        yaw: Task of the yaw, None if left out.

    Raises:
        InvalidValueError: if both are left out, and for a wrong shape, NaN or infinity.
    """

    position: BasePosition | None
    yaw: BaseYaw | None

    def __init__(
        self,
        position: ArrayLike | None = None,
        yaw: ArrayLike | None = None,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        yaw_weight: float = 1.0,
        yaw_tolerance: float = ANGLE_TOLERANCE,
        *,
        hard: bool = False,
        yaw_hard: bool | None = None,
    ) -> None:
        if position is None and yaw is None:
            raise InvalidValueError("placement of base", "neither", "a position, a yaw, or both")
        stands = None if position is None else BasePosition(position, weight, tolerance, hard=hard)
        firm = hard if yaw_hard is None else yaw_hard
        faces = None if yaw is None else BaseYaw(yaw, yaw_weight, yaw_tolerance, hard=firm)
        vars(self).update(position=stands, yaw=faces)

    @property
    def parts(self) -> tuple[Task, ...]:
        """Tasks of position and yaw, without a part that is left out."""
        return tuple(part for part in (self.position, self.yaw) if part is not None)
