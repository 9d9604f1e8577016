"""The state of a motion at given times, and the times at which it is looked at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import check_positive

TIME_TOLERANCE = 1e-9
EXAMINED_EVERY = 0.001
"""Time between the states of a motion that are looked at [s]."""

_LONG = 300.0  # [s] duration up to which that is so
_MOST_SAMPLES = 10_000_000


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
    """Return the time between states that an examination looks at [s]: 1 ms, or more where that is long."""
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
