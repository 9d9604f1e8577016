"""Base classes of inverse-kinematics tasks."""

from __future__ import annotations

import copy
import inspect
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.structure import TaskStructure, TaskVariables
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_real, shown

POSITION_TOLERANCE = 1e-3
ANGLE_TOLERANCE = math.radians(0.5)

# W: hard tasks count W times their weight; a soft residual of 1 m shifts them by about 1 / W^2 = 0.1 mm.
HARD_WEIGHT = 100.0


class Task(FrozenArrays, ABC):
    """Objective of a configuration: a residual r(q) that should vanish.

    Tasks are frozen values.  A solver minimizes sum_i s_i^2 |r_i(q)|^2 over all tasks i (meters and radians
    count alike at equal weights); a task is met if `error` is within `tolerance`.  The strength s_i is the
    weight w_i, or W w_i for a hard task, with W = HARD_WEIGHT; see `pepper_kin.ik.priorities`.

    Symbols used in all formulas: (o, R) position and orientation of the frame in the world, J_v and J_w the
    linear and angular rows of its Jacobian in world axes, [a]x the matrix of the cross product with a.

    Attributes:
        frame: Name of the task's frame; None for tasks on joints.
        label: Name of the moved part in words.
        weight: w_i, above zero.
        tolerance: Maximum error of a task that is met [unit]; infinite for a preference.
        hard: Whether the task has priority over soft tasks until it is within its tolerance.
        yields: Whether the task before this one in a list has priority, as a position over its orientation.
        unit: Unit of `error` and `tolerance`, "m" or "rad"; `unit_on` takes the robot into account.
        aspect: Quantity of the part that the task sets, such as "position"; empty if the label says it.
        target_name: Name of the attribute that holds one target, or N targets for `solve_batch`.
        target_axes: Number of axes of one target.
        largest: Whether the error is the largest component of r instead of its norm.
        has_machine_code: Whether the class has an `expression` that fits its residual; otherwise solvers
            evaluate the task in Python.
    """

    frame: str | None
    label: str
    weight: float
    tolerance: float
    hard: bool = False
    yields: bool = False
    unit: ClassVar[str]
    aspect: ClassVar[str] = ""
    target_name: ClassVar[str] = "target"
    target_axes: ClassVar[int] = 1
    largest: ClassVar[bool] = False
    has_machine_code: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        # A user's subclass may have a residual that differs from the compiled one.
        own = (getattr(cls, name, None) for name in ("expression", "residual", "jacobian", "size"))
        ours = all(getattr(part, "__module__", "").startswith("pepper_kin.") for part in own)
        cls.has_machine_code = ours and cls.expression is not Task.expression

    @property
    def count(self) -> int | None:
        """Number N of targets; None for a single one."""
        targets: Array = getattr(self, self.target_name)
        return None if targets.ndim == self.target_axes else len(targets)

    @property
    def name(self) -> str:
        """Name of the task in words, such as "position of left hand"."""
        return f"{self.aspect} of {self.label}" if self.aspect else self.label

    @property
    def strength(self) -> float:
        """Strength s_i: the weight, times HARD_WEIGHT for a hard task."""
        return HARD_WEIGHT * self.weight if self.hard else self.weight

    def altered(self, **attributes: object) -> Self:
        """Return a copy of the task with other values of attributes, which are not checked."""
        other = copy.copy(self)
        for name, value in attributes.items():
            object.__setattr__(other, name, value)
        return other

    def weighted(self, factor: float) -> Self:
        """Return a copy of the task with its weight multiplied by a factor."""
        return self.altered(weight=factor * self.weight)

    def at(self, row: int) -> Self:
        """Return the task with one of its N targets; the task itself if it has a single one."""
        if self.count is None:
            return self
        return self.altered(**{self.target_name: read_only(getattr(self, self.target_name)[row])})

    def on(self, pepper: PepperModel) -> Self:
        """Return the task for a robot, with groups of joints replaced by their joints."""
        return self

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot that lacks a frame or joint of the task; the base class checks the frame.

        Raises:
            UnknownNameError: listing the robot's names.
            InvalidValueError: if a joint vector of the task does not fit the robot.
        """
        if self.frame is not None:
            pepper.frame_id(self.frame)

    @abstractmethod
    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return r(q), shape (m,) [m or rad], at joint positions q, shape (n,) [rad or m]."""

    @abstractmethod
    def jacobian(self, pepper: PepperModel, q: Array) -> Array:
        """Return dr/dq, shape (m, n), at joint positions q, shape (n,) [rad or m]."""

    def dependence(self, pepper: PepperModel, q: Array) -> Array:
        """Return a matrix, shape (k, n), whose columns of joints without influence vanish.

        The matrix is the Jacobian, unless the Jacobian vanishes if the task is met.
        """
        return self.jacobian(pepper, q)

    def unit_on(self, pepper: PepperModel) -> str:
        """Return the unit of `error` and `tolerance` on a robot, "m" or "rad"."""
        return self.unit

    def size(self, residual: Array) -> float:
        """Return the error of a residual r, shape (m,) [unit]: |r|, or the largest component if `largest`."""
        return float(np.abs(residual).max() if self.largest else np.linalg.norm(residual))

    def error(self, pepper: PepperModel, q: Array) -> float:
        """Return the error at q, shape (n,) [rad or m], in the task's unit."""
        return self.size(self.residual(pepper, q))

    @abstractmethod
    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the error at q, shape (n,) [rad or m], and the target in words."""

    @abstractmethod
    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the value that q, shape (n,) [rad or m], reaches instead of the target, in words."""

    def structure(self) -> TaskStructure | None:
        """Return the structure for which code is compiled; None for a task evaluated in Python."""
        return self._structure() if self.has_machine_code else None

    def _structure(self) -> TaskStructure | None:
        """Return the structure of a task of a class with an `expression`."""
        raise NotImplementedError(f"{type(self).__name__} has an expression and no structure")

    @staticmethod
    def expression(task: TaskStructure, motion: TaskVariables, target: Any) -> tuple[Any, Any]:
        """Return r and dr/dq as CasADi expressions, equal to `residual` and `jacobian`.

        Args:
            task: The structure of the task.
            motion: Variables of the robot: frames, center of mass and torques.
            target: Symbols of the numbers that describe the target, as `target_of` flattens it.
        """
        raise NotImplementedError("a task without machine code")

    @staticmethod
    def moved_by(pepper: PepperModel, task: TaskStructure) -> np.ndarray:
        """Return whether the expression depends on each joint, shape (n,).

        It may depend on the joints that move the frame, or on named joints. Columns may still vanish by
        symmetry; a search then does not move the joint.
        """
        used = np.zeros(pepper.n, dtype=bool)
        names = task.joints or pepper.joint_names
        used[pepper.joints_above(task.frame) if task.frame else [pepper.joint_index(x) for x in names]] = True
        return used


@dataclass(frozen=True, eq=False, init=False, repr=False, kw_only=True)
class TargetTask(Task):
    """Base class of the library's tasks, with checks and descriptions of weight, tolerance, hard and label.

    A subclass adds its own attributes; its constructor defines other defaults and positional arguments.
    """

    weight: float = 1.0
    tolerance: float = POSITION_TOLERANCE
    hard: bool = False
    label: str = ""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if cls.__doc__:
            cls.__doc__ = f"{inspect.cleandoc(cls.__doc__)}\n\n{_COMMON}"

    def __init__(
        self,
        label: str,
        *,
        weight: float = 1.0,
        tolerance: float = POSITION_TOLERANCE,
        hard: bool = False,
        subject: str = "",
        frame: str | None = None,
        **attributes: object,
    ) -> None:
        """Set all attributes of a new task, which is frozen.

        Args:
            label: Name of the moved part in words.
            weight: Weight in the sum of squares, above zero.
            tolerance: Maximum error of a task that is met [unit].
            hard: Whether the task has priority over soft tasks.
            subject: Name of the task in messages; the label if omitted.
            frame: Name of the task's frame; None for tasks on joints.
            attributes: Checked attributes of the subclass.

        Raises:
            InvalidValueError: for an invalid weight, tolerance or `hard`.
        """
        name = subject or label
        vars(self).update(
            attributes,
            frame=frame,
            label=label,
            weight=checked_weight(weight, name),
            tolerance=checked_tolerance(tolerance, name, self.unit),
            hard=checked_hard(hard, name),
        )

    def __repr__(self) -> str:
        names = [field.name for field in fields(self)]
        first = len(fields(TargetTask))
        values = [f"{name}={getattr(self, name)!r}" for name in (*names[first:], *names[:first])]
        return f"{type(self).__qualname__}({', '.join(values)})"


_COMMON = """Attributes of all tasks:
    weight: Weight in the sum of squares.
    tolerance: Largest error of a task that is met [unit]; infinite for a mere preference.
    hard: Whether it is met even where soft tasks suffer from it.
    label: What the task moves, in words; if it may be given, and is left empty, the frames' names."""


class PointTask(TargetTask):
    """A position reaches a point: r(q) = place(q) - target, error |r| [m]."""

    target: Array
    unit: ClassVar[str] = "m"
    ground: ClassVar[str] = ""

    @abstractmethod
    def place(self, pepper: PepperModel, q: Array) -> Array:
        """Return the position [m], shape of the target, at joint positions q, shape (n,) [rad or m]."""

    def residual(self, pepper: PepperModel, q: Array) -> Array:
        """Return place(q) - target [m], shape of the target."""
        return np.asarray(self.place(pepper, q) - self.target)

    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return the distance from the target point in words, at q, shape (n,) [rad or m]."""
        distance = words_for_length(self.error(pepper, q))
        return f"{self.label} stops {distance} short of {words_for_vector(self.target)}"

    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return the reached position in words, at joint positions q, shape (n,) [rad or m]."""
        return f"point {words_for_vector(self.place(pepper, q))}{self.ground}"


class TaskGroup(FrozenArrays, ABC):
    """Several tasks under one name, such as the position and the orientation of a pose.

    Solvers use the parts, and a result reports the error of each part.
    """

    @property
    @abstractmethod
    def parts(self) -> tuple[Task, ...]:
        """Tasks of the group."""


def checked_weight(weight: float, label: str) -> float:
    """Return a weight as a float.

    Raises:
        InvalidValueError: unless the weight is finite and above zero.
    """
    return _number(weight, f"weight of {label}", "a finite number above 0", infinite=False)


def checked_tolerance(tolerance: float, label: str, unit: str) -> float:
    """Return a tolerance as a float; infinity is allowed and accepts any error.

    Raises:
        InvalidValueError: unless it is above zero.
    """
    allowed = f"a number above 0 [{unit}], infinite for a mere preference"
    return _number(tolerance, f"tolerance of {label}", allowed, infinite=True)


def checked_hard(hard: bool, label: str) -> bool:
    """Return `hard` as a bool.

    Raises:
        InvalidValueError: unless `hard` is True or False.
    """
    if not isinstance(hard, (bool, np.bool_)):
        raise InvalidValueError(f"hard of {label}", repr(hard), "True or False")
    return bool(hard)


def _number(value: float, quantity: str, allowed: str, infinite: bool) -> float:
    """Return a number above zero as a float."""
    number = as_real(value)
    if not number > 0 or (math.isinf(number) and not infinite):
        raise InvalidValueError(quantity, shown(value), allowed)
    return number


def as_targets(value: ArrayLike, quantity: str, shape: tuple[int | None, ...]) -> Array:
    """Convert to one target of a shape, or to N targets, shape (N, ...), for `solve_batch`.

    Raises:
        InvalidValueError: for another shape, NaN or infinity.
    """
    # Most targets are a few floats: testing each of them is quicker than NumPy's test of all.
    if (
        isinstance(value, np.ndarray)
        and value.dtype == np.float64
        and value.shape == shape
        and all(map(math.isfinite, value.ravel().tolist()))
    ):
        return value
    try:
        depth = np.ndim(value) if shape and isinstance(value, list | tuple) else getattr(value, "ndim", 0)
    except ValueError:  # lists of different lengths
        depth = 0
    if depth == len(shape) + 1:
        return as_finite(value, quantity, (None, *shape))
    return as_finite(value, quantity, shape)


def words_for_length(value: float) -> str:
    """Return a length [m] as text in meters, centimeters or millimeters: "4.2 cm"."""
    if value >= 1.0:
        return f"{value:.2f} m"
    return f"{100 * value:.1f} cm" if value >= 0.01 else f"{1000 * value:.2g} mm"


def words_for_angle(value: float) -> str:
    """Return an angle [rad] as text in degrees: "12.3 deg"."""
    degrees = math.degrees(value)
    return f"{degrees:.1f} deg" if degrees >= 1.0 else f"{degrees:.2g} deg"


def words_for(value: float, unit: str) -> str:
    """Return an amount as text with its unit; lengths and angles in a suitable unit."""
    if unit in ("m", "rad"):
        return words_for_length(value) if unit == "m" else words_for_angle(value)
    return f"{value:.3g} {unit}".rstrip()


def words_for_vector(vector: Array) -> str:
    """Return "(x, y, z)" with three decimals of a vector of any length, shape (k,)."""
    return "(" + ", ".join(f"{value + 0.0:.3f}" for value in np.round(vector, 3)) + ")"


def words_for_turn(vector: Array, axes: str = "the world's axes") -> str:
    """Return a rotation vector [rad] in words for "an orientation ... from its target".

    Args:
        vector: Rotation vector, shape (3,) [rad].
        axes: Name of the axes of the components.

    Returns:
        Text such as "(1.0, 2.0, 3.0) deg about the world's axes", or "less than 0.1 deg".
    """
    degrees = np.degrees(vector)
    if np.linalg.norm(degrees) < 0.1:
        return "less than 0.1 deg"
    return f"({', '.join(f'{value + 0.0:.1f}' for value in np.round(degrees, 1))}) deg about {axes}"
