"""The phase plane of a trajectory: its speed along the way, and the greatest that limits allow there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.collision.loads import inverse_dynamics_with, loads_of
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_whole
from pepper_kin.trajectory.samples import refuse_other_joints
from pepper_kin.trajectory.sampling import State

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.trajectory.trajectory import Trajectory


_HALVINGS = 50
MOST_POINTS = 10_000_000
_SLOW = 1e-3  # of the greatest speed: below it the direction of the way is lost in rounding


@dataclass(frozen=True, eq=False)
class PhasePlane(FrozenArrays):
    """Speed against way; arrays of shape (T,), read-only.

    Attributes:
        way: s, length of the way in joint space since the start [rad, or rad and m mixed].
        speed: ds/dt of the trajectory [1/s of that].
        velocity_limit: Greatest ds/dt that velocity limits allow in the direction of the way.
        force_limit: Greatest ds/dt for which some d2s/dt2 keeps acceleration and torque limits: the
            maximum-velocity curve; 0 where not even rest is possible.
    """

    way: Array
    speed: Array
    velocity_limit: Array
    force_limit: Array

    def __post_init__(self) -> None:
        for name in ("way", "speed", "velocity_limit", "force_limit"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def phase_plane(
    pepper: PepperModel,
    trajectory: Trajectory,
    points: int = 400,
    *,
    scene: Scene | None = None,
    payload: Mapping[str, float] | None = None,
) -> PhasePlane:
    """Return a trajectory's speed along its way in joint space, and the maximum-velocity curve of that way.

    With s the length of the way, q' = dq/ds a unit vector and q'' = d2q/ds2, the limits read
        |q' sd| <= v,   |q' sdd + q'' sd^2| <= a,   |A sdd + B sd^2 + g| <= tau,
        A = M q',  B = M q'' + C(q, q') q'.
    For each sd the rows bound sdd from both sides; the greatest sd for which the bounds leave something is
    the maximum-velocity curve (Bobrow, Dubowsky and Gibson, Int. J. Robotics Research 4, 1985).

    Args:
        pepper: The robot.
        trajectory: The trajectory; its joints must be the robot's.
        points: Number of instants looked at, at least 2; those almost at rest are left out.
        scene: The scene whose attached objects count with their mass; None for none.
        payload: Point masses held at "left", "right" or a frame by name [kg], besides attached objects.

    Returns:
        The curves.

    Raises:
        InvalidValueError: where the joints are not the robot's, for fewer than 2 points, or for a trajectory
            that does not move.
        UnknownNameError: for a frame that the robot lacks.
    """
    torque = partial(inverse_dynamics_with, pepper, loads_of(pepper, scene, payload))
    refuse_other_joints(pepper, trajectory.joint_names)
    time = np.linspace(0.0, trajectory.duration, check_whole("points", points, 2, MOST_POINTS))
    state = trajectory(time)
    speed = np.linalg.norm(state.velocity, axis=1)
    if speed.max() <= 0.0:
        raise InvalidValueError("trajectory", "one that does not move", "one that moves")
    way = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(time))])
    moving = speed > _SLOW * speed.max()
    q, v, a = (quantity[moving] for quantity in state)
    rate = speed[moving][:, None]
    direction = v / rate
    bend = (a - (a * direction).sum(axis=1)[:, None] * direction) / rate**2
    still = np.zeros_like(q)
    gravity = torque(q, still, still)
    push = torque(q, still, direction) - gravity
    swing = torque(q, direction, bend) - gravity
    bound = np.broadcast_to(pepper.acceleration_limits, q.shape)
    effort = np.broadcast_to(pepper.effort_limits, q.shape)
    rows = State(
        np.concatenate([direction, push], axis=1),
        np.concatenate([bend, swing], axis=1),
        np.concatenate([still, gravity], axis=1),
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        most = np.where(direction == 0, np.inf, pepper.velocity_limits / np.abs(direction))
    fastest = np.min(most, axis=1)
    force = _greatest(*rows, np.concatenate([bound, effort], axis=1), 4.0 * np.maximum(fastest, rate[:, 0]))
    return PhasePlane(way[moving], speed[moving], fastest, force)


def _greatest(a: Array, b: Array, c: Array, bound: Array, most: Array) -> Array:
    """Return the greatest sd <= most for which some sdd keeps |a sdd + b sd^2 + c| <= bound, shape (T,)."""

    def possible(speed: Array) -> NDArray[np.bool_]:
        """Return whether some sdd keeps the bounds at speeds sd, shape (T,) each."""
        middle = b * speed[:, None] ** 2 + c
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(-bound - middle) / a, (bound - middle) / a])
        tiny = np.abs(a) < 1e-12
        lower = np.where(tiny, -np.inf, ends.min(axis=0)).max(axis=1)
        upper = np.where(tiny, np.inf, ends.max(axis=0)).min(axis=1)
        return np.asarray((lower <= upper) & ~np.any(tiny & (np.abs(middle) > bound), axis=1))

    # The speeds that are possible, squared, form an interval (a slice of a convex set), here from rest on.
    low, high = np.zeros_like(most), most.copy()
    at_most = possible(most)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        fits = possible(middle)
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.where(at_most, most, low)
