"""A trajectory at discrete times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.core.splines import quintic_hermite
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite

if TYPE_CHECKING:
    from pepper_kin.model import PepperModel
    from pepper_kin.trajectory.trajectory import Trajectory

_Value = TypeVar("_Value", "Samples", "Trajectory")


@dataclass(frozen=True, eq=False)
class Samples(FrozenArrays):
    """A trajectory at discrete times; the arrays are read-only.

    Attributes:
        joint_names: Order of the columns.
        time: [s], shape (T,), rising from 0.
        position: [rad or m], shape (T, n).
        velocity: [rad/s or m/s], shape (T, n).
        acceleration: [rad/s^2 or m/s^2], shape (T, n).
        joint_units: "rad" or "m" for each joint; all "rad" if omitted.
    """

    joint_names: tuple[str, ...]
    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    joint_units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        names, units = names_and_units(self.joint_names, self.joint_units)
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "joint_units", units)
        object.__setattr__(self, "time", read_only(as_finite(self.time, "time", (None,))))
        shape = (self.time.size, len(names))
        for quantity in ("position", "velocity", "acceleration"):
            object.__setattr__(self, quantity, read_only(as_finite(getattr(self, quantity), quantity, shape)))

    def __len__(self) -> int:
        return int(self.time.size)

    def to_trajectory(self) -> Trajectory:
        """Return the trajectory of degree 5 that meets position, velocity and acceleration at every sample.

        Returns:
            The trajectory; between samples it is the quintic Hermite interpolant.

        Raises:
            InvalidValueError: for fewer than two samples, or times that do not increase from 0.
        """
        from pepper_kin.trajectory.trajectory import Trajectory

        if len(self) < 2:
            raise InvalidValueError("samples", len(self), "at least 2")
        step = np.diff(self.time)
        if self.time[0] != 0.0 or np.any(step <= 0):
            raise InvalidValueError("time", "times that do not increase from 0", "times that increase from 0")
        segments = quintic_hermite(step, self.position, self.velocity, self.acceleration)
        return Trajectory(self.joint_names, self.time, segments, self.joint_units)


def names_and_units(names: Sequence[str], units: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return joints' names and units as tuples, checked; "rad" for all where no units are given."""
    names = tuple(names)
    if not names or len(set(names)) != len(names):
        raise InvalidValueError("joint_names", names, "one or more names, each once")
    units = tuple(units) or ("rad",) * len(names)
    if len(units) != len(names) or not set(units) <= {"rad", "m"}:
        raise InvalidValueError("joint_units", units, f"'rad' or 'm' for each of {len(names)} joints")
    return names, units


def refuse_other_joints(pepper: PepperModel, joint_names: tuple[str, ...]) -> None:
    """Refuse a trajectory of other joints than the robot's, or in another order.

    Raises:
        InvalidValueError: naming both.
    """
    if joint_names != pepper.joint_names:
        raise InvalidValueError(
            "joints of the trajectory", ", ".join(joint_names), ", ".join(pepper.joint_names)
        )


def known(kind: type[_Value], names: tuple[str, ...], units: tuple[str, ...], **arrays: Array) -> _Value:
    """Return a trajectory or samples of arrays, of any shape, that are known to be right."""
    value = object.__new__(kind)
    for array in arrays.values():
        array.setflags(write=False)
    value.__dict__.update(joint_names=names, joint_units=units, **arrays)
    return value
