"""Base class of inverse-kinematics tasks."""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from typing import ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.frozen_arrays import FrozenArrays, read_only
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, as_real, shown

Array: TypeAlias = NDArray[np.float64]

POSITION_TOLERANCE = 1e-3
ANGLE_TOLERANCE = math.radians(0.5)

# W: hard tasks count W times their weight; a soft residual of 1 m shifts them by about 1 / W^2 = 0.1 mm.
HARD_WEIGHT = 100.0


class Task(FrozenArrays, ABC):
    """Something that a configuration should fulfill: a residual r(q) that should vanish.

    Tasks are frozen values.  A solver minimizes sum_i s_i^2 |r_i(q)|^2 over all tasks i (meters and radians
    count alike at equal weights); the task is met where `error` is within `tolerance`.  The strength s_i is
    the weight w_i, or W w_i for a hard task, with W = HARD_WEIGHT; see `pepper_kin.ik.priorities`.

    Symbols used in all formulas: (o, R) position and orientation of the frame in the world, J_v and J_w the
    linear and angular rows of its Jacobian in world axes, [a]x the matrix of the cross product with a.

    Attributes:
        frame: The frame that the task acts on; None where it acts on joints.
        label: What the task moves, in words.
        weight: w_i, above zero.
        tolerance: Largest error of a task that is met [unit]; infinite for a mere preference.
        hard: Whether it is met to its tolerance even where soft tasks suffer from it.
        yields: Whether the task before it in a list is preferred where not both can be met, as a position to
            its orientation.
        unit: Unit of `error` and `tolerance`, "m" or "rad"; `unit_on` takes the robot into account.
        aspect: What of `label` the task is about, such as "position"; empty where the label says all.
        target_name: Name of the attribute that may hold N targets, for `solve_batch` only.
        target_axes: Number of axes of one target.
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

    def _fill(self, name: str, weight: float, tolerance: float, hard: bool, **fields: object) -> None:
        """Set the fields of a new task, which is frozen; `name` is what messages call it.

        Raises:
            InvalidValueError: for a weight, a tolerance or a hardness that is none.
        """
        vars(self).update(
            fields,
            weight=checked_weight(weight, name),
            tolerance=checked_tolerance(tolerance, name, self.unit),
            hard=checked_hard(hard, name),
        )

    @property
    def count(self) -> int | None:
        """Number N of targets; None for a single one."""
        targets: Array = getattr(self, self.target_name)
        return None if targets.ndim == self.target_axes else len(targets)

    @property
    def name(self) -> str:
        """The task in words, such as "position of left hand"."""
        return f"{self.aspect} of {self.label}" if self.aspect else self.label

    @property
    def strength(self) -> float:
        """s_i: the weight, times HARD_WEIGHT where the task is hard."""
        return HARD_WEIGHT * self.weight if self.hard else self.weight

    def weighted(self, factor: float) -> Self:
        """Return the task with its weight multiplied."""
        other = copy.copy(self)
        object.__setattr__(other, "weight", factor * self.weight)
        return other

    def at(self, row: int) -> Self:
        """Return the task with one of its N targets; the task itself where it has only one."""
        if self.count is None:
            return self
        one = copy.copy(self)
        object.__setattr__(one, self.target_name, read_only(getattr(self, self.target_name)[row]))
        return one

    def on(self, pepper: PepperModel) -> Self:
        """Return the task for a robot, with groups of joints replaced by their joints."""
        return self

    def check(self, pepper: PepperModel) -> None:
        """Refuse a robot that lacks a frame or joint of the task: its frame, where a task says no more.

        Raises:
            UnknownNameError: listing what the robot has.
            InvalidValueError: where a joint vector of the task does not fit the robot.
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
        """Return a matrix, shape (k, n), whose column of a joint vanishes where the joint has no influence.

        It is the Jacobian, unless that vanishes wherever the task is met.
        """
        return self.jacobian(pepper, q)

    def unit_on(self, pepper: PepperModel) -> str:
        """Return the unit of `error` and `tolerance` on a robot, "m" or "rad"."""
        return self.unit

    def size(self, residual: Array) -> float:
        """Return the error of a residual, shape (m,) [unit]: |r|, unless a task defines another."""
        return float(np.linalg.norm(residual))

    def error(self, pepper: PepperModel, q: Array) -> float:
        """Return how far q, shape (n,) [rad or m], is from meeting the task [unit]."""
        return self.size(self.residual(pepper, q))

    @abstractmethod
    def shortfall(self, pepper: PepperModel, q: Array) -> str:
        """Return in words how far q, shape (n,) [rad or m], is from meeting the task, with the target."""

    @abstractmethod
    def attained(self, pepper: PepperModel, q: Array) -> str:
        """Return in words what q, shape (n,) [rad or m], reaches in the target's place."""


class TaskGroup(FrozenArrays, ABC):
    """Several tasks under one name, such as the position and the orientation of a pose.

    The solvers see the parts, and a result reports the error of each.
    """

    @property
    @abstractmethod
    def parts(self) -> tuple[Task, ...]:
        """The tasks that it stands for."""


def checked_weight(weight: float, label: str) -> float:
    """Return a weight as a float.

    Raises:
        InvalidValueError: unless it is finite and above zero.
    """
    return _number(weight, f"weight of {label}", "a finite number above 0", infinite=False)


def checked_tolerance(tolerance: float, label: str, unit: str) -> float:
    """Return a tolerance as a float; infinity is allowed and means that any error will do.

    Raises:
        InvalidValueError: unless it is above zero.
    """
    allowed = f"a number above 0 [{unit}], infinite for a mere preference"
    return _number(tolerance, f"tolerance of {label}", allowed, infinite=True)


def checked_hard(hard: bool, label: str) -> bool:
    """Return whether a task is hard.

    Raises:
        InvalidValueError: unless it is True or False.
    """
    if not isinstance(hard, (bool, np.bool_)):
        raise InvalidValueError(f"hard of {label}", repr(hard), "True or False")
    return bool(hard)


def _number(value: float, quantity: str, allowed: str, infinite: bool) -> float:
    number = as_real(value)
    if not number > 0 or (math.isinf(number) and not infinite):
        raise InvalidValueError(quantity, shown(value), allowed)
    return number


def as_targets(value: ArrayLike, quantity: str, shape: tuple[int | None, ...]) -> Array:
    """Convert to one target of a shape, or to N of them, shape (N, ...), for `solve_batch`.

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
    if getattr(value, "ndim", len(shape)) == len(shape) + 1:
        return as_finite(value, quantity, (None, *shape))
    return as_finite(value, quantity, shape)


def words_for_length(value: float) -> str:
    """Return a length [m] in meters, centimeters or millimeters: "4.2 cm"."""
    if value >= 1.0:
        return f"{value:.2f} m"
    return f"{100 * value:.1f} cm" if value >= 0.01 else f"{1000 * value:.2g} mm"


def words_for_angle(value: float) -> str:
    """Return an angle [rad] in degrees: "12.3 deg"."""
    degrees = math.degrees(value)
    return f"{degrees:.1f} deg" if degrees >= 1.0 else f"{degrees:.2g} deg"


def words_for(value: float, unit: str) -> str:
    """Return an amount with its unit: a length and an angle in the unit that suits it."""
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
        axes: The axes that its components are along.

    Returns:
        Text such as "(1.0, 2.0, 3.0) deg about the world's axes", or "less than 0.1 deg".
    """
    degrees = np.degrees(vector)
    if np.linalg.norm(degrees) < 0.1:
        return "less than 0.1 deg"
    return f"({', '.join(f'{value + 0.0:.1f}' for value in np.round(degrees, 1))}) deg about {axes}"
