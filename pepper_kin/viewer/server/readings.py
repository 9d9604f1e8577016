"""Values of the plots while the robot moves: torque, clearance and balance."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene, clearance, closest_pair, load_wrench, loads_of
from pepper_kin.collision.checked_shapes import PairsTo
from pepper_kin.collision.loads import center_of_mass_with, inverse_dynamics_with
from pepper_kin.dynamics import base_wrench
from pepper_kin.dynamics.load import Loads
from pepper_kin.model import PepperModel
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.balance import balance_margin, support_polygon
from pepper_kin.viewer.joint_motion import ExecutedMotion, JointMotion, Playable

KEPT = 300
"""Number of samples that are kept for pages that open later."""
CLEARANCES: dict[str, PairsTo] = {"obstacles": "obstacles", "itself": "self"}
"""Plot of clearance -> the pairs that count in it."""
MOST_POINTS = 240
"""Maximum number of points of a motion's curves: the pixels of a small plot."""


def torque_use(pepper: PepperModel, torque: Array) -> Array:
    """Return torques [N m or N], shape (..., n), as fractions of the limits; 0 for joints without a limit."""
    return _shares(torque, pepper.effort_limits)


def speed_use(pepper: PepperModel, v: Array) -> Array:
    """Return velocities [rad/s or m/s], shape (..., n), as fractions of the limits; 0 without a limit."""
    return _shares(v, pepper.velocity_limits)


def _shares(values: Array, limits: Array) -> Array:
    """Return |values|, shape (..., n), as fractions of the limits, shape (n,), in the same units."""
    limited = np.isfinite(limits) & (limits > 0)
    return np.where(limited, np.abs(values) / np.where(limited, limits, 1.0), 0.0)


class Readings:
    """Samples of a moving robot, the newest last.

    Args:
        pepper: Model of the robot.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self._pepper = pepper
        self._samples: deque[dict[str, Any]] = deque(maxlen=KEPT)

    @property
    def history(self) -> list[dict[str, Any]]:
        """All kept samples, oldest first."""
        return list(self._samples)

    def take(self, time: float, q: Array, v: Array, a: Array, scene: Scene) -> dict[str, Any]:
        """Take a sample at joint positions, velocities and accelerations.

        Args:
            time: Time of the sample [s].
            q: Joint positions [rad or m], shape (n,).
            v: Joint velocities [rad/s or m/s], shape (n,).
            a: Joint accelerations [rad/s^2 or m/s^2], shape (n,).
            scene: Scene around the robot, with attached objects.
        """
        loads = loads_of(self._pepper, scene)
        balance = balance_of(self._pepper, q[None], v[None], a[None], loads)
        torque = inverse_dynamics_with(self._pepper, loads, q, v, a)
        sample = {
            "time": round(time, 3),
            "torque": np.round(torque_use(self._pepper, torque), 4).tolist(),
            "speed": np.round(speed_use(self._pepper, v), 4).tolist(),
            "balance": _finite(balance)[0] if len(balance) else None,
            "pairs": {},
        }
        for name, to in CLEARANCES.items():
            pair = closest_pair(self._pepper, q, scene, to=to)
            sample[name] = None if pair is None else round(float(pair.distance), 5)
            sample["pairs"][name] = [] if pair is None else list(pair.names)
        self._samples.append(sample)
        return sample


def balance_points(
    pepper: PepperModel, q: Array, v: Array, a: Array, loads: Loads = ()
) -> tuple[Array, Array]:
    """Return the center of mass and the zero-moment point on the floor, shape (3,) each [m].

    If the floor would have to pull, there is no such point; the point below the center of mass is returned.

    Args:
        pepper: Model of the robot.
        q: Joint positions [rad or m], shape (n,).
        v: Joint velocities [rad/s or m/s], shape (n,).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (n,).
        loads: Loads that the robot carries.
    """
    mass = center_of_mass_with(pepper, loads, q)
    wrench = base_wrench(pepper, q, v, a) + load_wrench(pepper, loads, q, v, a)
    point = np.array([-wrench[4], wrench[3]]) / wrench[2] if wrench[2] > 0.0 else mass[:2]
    return mass, np.array([*point, 0.004])


def balance_of(pepper: PepperModel, q: Array, v: Array, a: Array, loads: Loads = ()) -> Array:
    """Return the distance of the zero-moment point inside the wheels, shape (k,) [m]; empty without wheels.

    If the floor would have to pull, there is no such point, and the distance is minus infinity.

    Args:
        pepper: Model of the robot.
        q: Joint positions [rad or m], shape (k, n).
        v: Joint velocities [rad/s or m/s], shape (k, n).
        a: Joint accelerations [rad/s^2 or m/s^2], shape (k, n).
        loads: Loads that the robot carries.
    """
    polygon = support_polygon(pepper)
    return np.zeros(0) if polygon is None else balance_margin(pepper, polygon, q, v, a, loads)


def _finite(lengths: Array) -> list[float | None]:
    """Convert lengths [m], shape (k,), to JSON; None for infinite ones."""
    return [round(float(length), 5) if np.isfinite(length) else None for length in lengths]


@dataclass(frozen=True)
class Curves:
    """Curves of a motion for the plots.

    Attributes:
        times: Times of the points, shape (k,) [s].
        torque: Fraction of each joint's torque limit, shape (k, n).
        speed: Fraction of each joint's velocity limit, shape (k, n).
        clearance: Name of a plot of `CLEARANCES` -> smallest distances, shape (k,) [m].
        balance: Distance of the zero-moment point inside the wheels, shape (k,) [m]; empty for a robot
            without wheels for balance.
    """

    times: Array
    torque: Array
    speed: Array
    clearance: dict[str, Array]
    balance: Array

    def as_dict(self) -> dict[str, Any]:
        """Return the curves as values for JSON."""
        return {
            "times": np.round(self.times, 4).tolist(),
            "torque": np.round(self.torque, 4).tolist(),
            "speed": np.round(self.speed, 4).tolist(),
            **{name: _finite(distances) for name, distances in self.clearance.items()},
            "balance": _finite(self.balance),
        }


def curves_of(pepper: PepperModel, source: Playable, motion: JointMotion, scene: Scene) -> Curves:
    """Compute the curves of a motion, with its own torques, or those of inverse dynamics.

    Args:
        pepper: Model of the robot.
        source: Source of the motion; a run has its own torques and loads.
        motion: The motion as joint positions over time.
        scene: Scene around the robot, with attached objects.
    """
    count = min(motion.times.size, MOST_POINTS)
    kept = np.unique(np.linspace(0, motion.times.size - 1, count).round().astype(int))
    times, q = motion.times[kept], motion.positions[kept]
    if isinstance(source, Trajectory):
        state = source(times)
        v, a = state[1], state[2]
    else:
        v, a = (values[kept] for values in rates(motion))
    if isinstance(source, Trajectory | JointMotion | np.ndarray | list | tuple):
        loads = loads_of(pepper, scene)
        torque = inverse_dynamics_with(pepper, loads, q, v, a)
    else:
        executed: ExecutedMotion = source  # type: ignore[assignment]
        loads = getattr(executed, "loads", ())
        torque = np.asarray(executed.torque, dtype=float)[kept]
    return Curves(
        times, torque_use(pepper, torque), speed_use(pepper, v),
        {name: np.atleast_1d(clearance(pepper, q, scene, to=to)) for name, to in CLEARANCES.items()},
        balance_of(pepper, q, v, a, loads),
    )  # fmt: skip


def rates(motion: JointMotion) -> tuple[Array, Array]:
    """Return velocities and accelerations of a motion by finite differences, shape (T, n) each."""
    if motion.times.size < 3:
        return np.zeros_like(motion.positions), np.zeros_like(motion.positions)
    v = np.gradient(motion.positions, motion.times, axis=0)
    return v, np.gradient(v, motion.times, axis=0)
