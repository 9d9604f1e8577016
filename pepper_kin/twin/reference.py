"""References of the twin for every timestep, given by a caller or sampled from a trajectory."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import dynamics
from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_real, shown
from pepper_kin.trajectory.samples import refuse_other_joints
from pepper_kin.trajectory.trajectory import Trajectory, checked_trajectory
from pepper_kin.twin.command import Command

MOST_STEPS = 10_000_000
"""Maximum number of steps of one run."""


_ZERO = read_only(np.zeros(()))


class References(NamedTuple):
    """References at the end of a step, or of T steps, shape (n,), (T, n) or (N, T, n).

    Attributes:
        position: Reference positions [rad or m].
        velocity: Reference velocities [rad/s or m/s].
        acceleration: Reference accelerations for the feed-forward "inverse_dynamics" [rad/s^2 or m/s^2].
        effort: Torques of joints in torque mode [N m or N].
        load: External torques on the joints [N m or N].
    """

    position: Array
    velocity: Array
    acceleration: Array
    effort: Array = _ZERO
    load: Array = _ZERO

    @classmethod
    def checked(
        cls, check: Callable[[ArrayLike, str], Array], zero: Array, *values: ArrayLike | None
    ) -> References:
        """Return references from a caller's values, in the order of the fields.

        Args:
            check: Function of value and name that returns the value as an array, or refuses it.
            zero: Array in place of None.
            *values: Values, one for each field.
        """
        pairs = zip(cls._fields, values, strict=True)
        return cls(*(zero if value is None else check(value, name) for name, value in pairs))

    def command(
        self, pepper: PepperModel, feedforward: str, torque_mode: NDArray[np.bool_] | None
    ) -> Command:
        """Return the commands of the actuators.

        Args:
            pepper: The robot.
            feedforward: Kind of feed-forward, one of `FEEDFORWARDS` of the twin.
            torque_mode: Whether each joint is in torque mode, shape (n,); None if none is.
        """
        q, v, a, effort, _ = self
        inverse = feedforward == "inverse_dynamics"
        forward: Array = dynamics.inverse_dynamics(pepper, q, v, a) if inverse else np.zeros(q.shape)
        return Command(q, v, forward if torque_mode is None else np.where(torque_mode, effort, forward))


def sampled(pepper: PepperModel, trajectory: Trajectory, hold_time: float, timestep: float) -> References:
    """Sample a trajectory at every step from 0 on, and its end, at rest, for the hold time.

    Args:
        pepper: The robot.
        trajectory: The trajectory.
        hold_time: Time to hold the end afterwards [s].
        timestep: Timestep of the twin [s].

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
    return References(position, velocity, acceleration)
