"""A trajectory as references for every timestep."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_real, shown
from pepper_kin.trajectory.samples import refuse_other_joints
from pepper_kin.trajectory.trajectory import Trajectory, checked_trajectory

MOST_STEPS = 10_000_000
"""Most steps of one run."""


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
        InvalidValueError: for other joints, a hold time that is not a finite number of at least 0, or more
            than ten million steps.
    """
    refuse_other_joints(pepper, checked_trajectory(trajectory).joint_names)
    if not 0 <= as_real(hold_time) < np.inf:
        raise InvalidValueError("hold_time", shown(hold_time), "a finite time of at least 0 s")
    count = np.ceil((trajectory.duration + hold_time) / timestep - 1e-9)
    if not count <= MOST_STEPS:
        got = f"{trajectory.duration + hold_time:g} s in steps of {timestep:g} s"
        raise InvalidValueError("duration and hold_time", got, f"at most {MOST_STEPS:,} steps")
    steps = int(count)
    time: Array = timestep * np.arange(steps + 1, dtype=float)
    position, velocity, acceleration = trajectory(np.minimum(time, trajectory.duration))
    rest = int(np.searchsorted(time, trajectory.duration, side="right"))
    velocity[rest:], acceleration[rest:] = 0.0, 0.0
    return Reference(position, velocity, acceleration)
