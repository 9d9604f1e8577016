"""Trajectories at discrete times: states, their units, and sample times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.core.splines import derivatives_on_segments, quintic_hermite
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model.joint_vectors import as_finite, as_numbers, check_positive

if TYPE_CHECKING:
    from pepper_kin.model import PepperModel
    from pepper_kin.trajectory.trajectory import Trajectory

# quantity -> unit for a joint in radians, unit for a joint in meters
UNITS = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s^2", "m/s^2"),
    "jerk": ("rad/s^3", "m/s^3"),
    "torque": ("N m", "N"),
    "reference": ("rad", "m"),
    "reference_velocity": ("rad/s", "m/s"),
    **{f"external_force_{axis}": ("N", "N") for axis in "xyz"},
    **{f"external_moment_{axis}": ("N m", "N m") for axis in "xyz"},
    "external_known": ("1", "1"),
}
TIME_TOLERANCE = 1e-9
EXAMINED_EVERY = 0.001
"""Time between the states of a motion that are examined [s]."""

_LONG = 300.0  # duration up to which EXAMINED_EVERY holds [s]
_MOST_SAMPLES = 10_000_000
_Value = TypeVar("_Value", "Samples", "Trajectory")


def unit_of(quantity: str, joint_unit: str = "rad") -> str:
    """Return the unit of a quantity of a joint whose position is in "rad" or "m".

    Raises:
        UnknownNameError: for an unknown quantity; the message lists the known ones.
    """
    if quantity not in UNITS:
        raise UnknownNameError("quantity", quantity, UNITS)
    return UNITS[quantity][joint_unit == "m"]


class State(NamedTuple):
    """Joint positions, velocities and accelerations at some times.

    Attributes:
        position: q [rad or m], shape (..., n).
        velocity: dq/dt [rad/s or m/s], shape (..., n).
        acceleration: d2q/dt2 [rad/s^2 or m/s^2], shape (..., n).
    """

    position: Array
    velocity: Array
    acceleration: Array


def examination_step(duration: float) -> float:
    """Return the time between examined states [s]: 1 ms, or more for motions longer than 300 s."""
    return EXAMINED_EVERY * max(1.0, float(np.ceil(duration / _LONG)))


def sample_times(duration: float, dt: float) -> Array:
    """Return 0, dt, 2 dt, ... and exactly the duration [s], shape (T,).

    Raises:
        InvalidValueError: for a dt that is not above zero, or below a ten-millionth of the duration.
    """
    dt = check_positive("dt", dt, "s")
    if duration / dt > _MOST_SAMPLES:
        raise InvalidValueError("dt", f"{dt} s", f"at least {duration / _MOST_SAMPLES:.3g} s")
    time: Array = dt * np.arange(int(np.ceil(duration / dt)) + 1, dtype=float)
    count = int(np.searchsorted(time, duration - max(TIME_TOLERANCE, 1e-9 * duration)))
    time = time[: count + 1] if count < time.size else np.append(time, duration)
    time[-1] = duration
    return time


@dataclass(frozen=True, eq=False)
class Samples(FrozenArrays):
    """A trajectory at discrete times; the arrays are read-only.

    Attributes:
        joint_names: Order of the columns.
        time: Times [s], shape (T,), increasing from 0.
        position: Joint positions [rad or m], shape (T, n).
        velocity: Joint velocities [rad/s or m/s], shape (T, n).
        acceleration: Joint accelerations [rad/s^2 or m/s^2], shape (T, n).
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
        """Return the trajectory of degree 5 that has each sample's position, velocity and acceleration.

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
    """Refuse a trajectory whose joints are not the robot's, in the robot's order.

    Raises:
        InvalidValueError: for such a trajectory, naming its joints and the robot's.
    """
    if joint_names != pepper.joint_names:
        raise InvalidValueError(
            "joints of the trajectory", ", ".join(joint_names), ", ".join(pepper.joint_names)
        )


def known(kind: type[_Value], names: tuple[str, ...], units: tuple[str, ...], **arrays: Array) -> _Value:
    """Return a trajectory or samples of arrays that are known to be valid, without checks."""
    value = object.__new__(kind)
    for array in arrays.values():
        array.setflags(write=False)
    value.__dict__.update(joint_names=names, joint_units=units, **arrays)
    return value


def checked_derivatives(coefficients: Array, segment: ArrayLike, local_time: ArrayLike, count: int) -> Array:
    """Return the value and first derivatives of given pieces, after checks of indices and times.

    Args:
        coefficients: Coefficients, constant term first, shape (m, k, n).
        segment: Indices of segments, negative ones from the end, shape (...).
        local_time: Time since the start of the segment [s], shape (...).
        count: Number of derivatives including the value, at most 4.

    Returns:
        Value and derivatives, shape (count, ..., n).

    Raises:
        InvalidValueError: for a segment that does not exist, a time that is not finite, or shapes that do not
            broadcast.
    """
    place, time = as_numbers(segment, "segment"), as_numbers(local_time, "local_time")
    most = len(coefficients)
    wrong = (place != np.floor(place)) | (place < -most) | (place >= most)
    if wrong.any():
        raise InvalidValueError("segment", place[wrong].flat[0], f"whole numbers from 0 to {most - 1}")
    if np.isinf(time).any():
        raise InvalidValueError("local_time", "infinity", "finite times [s]")
    try:
        return derivatives_on_segments(coefficients, place.astype(np.int64), time, count)
    except ValueError:
        shapes = f"shapes {place.shape} and {time.shape}"
        raise InvalidValueError("segment and local_time", shapes, "shapes that go together") from None
