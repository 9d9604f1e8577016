"""A trajectory as references for every timestep."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.trajectory import Trajectory

Array = NDArray[np.float64]


class Reference(NamedTuple):
    """References at times in steps of the twin, from 0; shape (T, n) each.

    Attributes:
        position: [rad or m].
        velocity: [rad/s or m/s].
        acceleration: [rad/s^2 or m/s^2].
    """

    position: Array
    velocity: Array
    acceleration: Array


def sampled(pepper: PepperModel, trajectory: Trajectory, hold_time: float, timestep: float) -> Reference:
    """Sample a trajectory at every step, and its end, at rest, for the hold time.

    Args:
        pepper: The robot.
        trajectory: What to follow.
        hold_time: Time to hold the end afterwards [s].
        timestep: Of the twin [s].

    Raises:
        InvalidValueError: for other joints, or a hold time that is not a finite number of at least 0.
    """
    if trajectory.joint_names != pepper.joint_names:
        raise InvalidValueError(
            "joints of the trajectory", ", ".join(trajectory.joint_names), ", ".join(pepper.joint_names)
        )
    if not (np.isfinite(hold_time) and hold_time >= 0):
        raise InvalidValueError("hold_time", hold_time, "a finite time of at least 0 s")
    steps = int(np.ceil((trajectory.duration + hold_time) / timestep - 1e-9))
    time: Array = timestep * np.arange(steps + 1, dtype=float)
    position, velocity, acceleration = trajectory(np.minimum(time, trajectory.duration))
    rest = int(np.searchsorted(time, trajectory.duration, side="right"))
    velocity[rest:], acceleration[rest:] = 0.0, 0.0
    return Reference(position, velocity, acceleration)
