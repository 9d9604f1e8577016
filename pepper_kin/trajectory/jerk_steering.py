"""The fastest way between two states in motion within limits of velocity, acceleration and jerk."""

from __future__ import annotations

from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InfeasibleError, optional
from pepper_kin.trajectory.sampling import State

_SAME_TIME = 1e-12  # [s]


def load_ruckig() -> Any:
    """Return the package `ruckig`.

    Raises:
        MissingDependencyError: where it is not installed.
    """
    return optional("ruckig", command="pip install 'ruckig>=0.14'", need="online motion")


def steer_with_jerk(now: State, target: State, limits: tuple[Array, ...]) -> tuple[Array, Array]:
    """Return the motion from one state to another in which all joints arrive together.

    Each joint by itself as fast as it can, and slowed to the slowest (Berscheid and Kroeger, Jerk-limited
    real-time trajectory generation with arbitrary target states, RSS 2021; by the package `ruckig`, in this
    process).  Where a joint begins beyond a limit, that is left first.

    Args:
        now: State to start from, shape (n,) each.
        target: State to arrive in, shape (n,) each.
        limits: Of velocity, acceleration and jerk, finite, shape (n,) each.

    Returns:
        Breaks [s], shape (m + 1,), and cubics, constant term first, shape (m, 4, n), between the instants at
        which any joint changes its jerk; m = 0 where the states are the same.

    Raises:
        InfeasibleError: for a target that cannot be reached within the limits.
    """
    ruckig, n = load_ruckig(), now.position.size
    asked = ruckig.InputParameter(n)
    asked.current_position, asked.current_velocity, asked.current_acceleration = map(np.ndarray.tolist, now)
    asked.target_position, asked.target_velocity, asked.target_acceleration = map(np.ndarray.tolist, target)
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = map(np.ndarray.tolist, limits)
    asked.synchronization = ruckig.Synchronization.Time
    found = ruckig.Trajectory(n)
    try:
        result = ruckig.Ruckig(n).calculate(asked, found)
    except Exception as error:  # the package's own exception class is not always raised
        raise InfeasibleError("motion", str(error), "choose another target") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise InfeasibleError("motion", f"ruckig says {result}", "choose another target")
    return _cubics(found, now, limits[2])


def _cubics(found: Any, now: State, most: Array) -> tuple[Array, Array]:
    """Return ruckig's motion as `steer_with_jerk` does: its accelerations, integrated from the start."""
    changes = [0.0, float(found.duration)]
    for profile in found.profiles[0]:
        brake = [0.0, *np.cumsum(profile.brake.t)] if hasattr(profile, "brake") else [0.0]
        changes += brake
        changes += list(brake[-1] + np.cumsum(profile.t))
    if found.duration <= _SAME_TIME:
        return np.zeros(1), np.empty((0, 4, now.position.size))
    # Both ends stay: a brake before the motion may last 1e-16 s.
    inside = np.unique(changes)
    inside = inside[(inside > _SAME_TIME) & (inside < found.duration - _SAME_TIME)]
    inside = inside[np.diff(inside, prepend=0.0) > _SAME_TIME]
    times = np.concatenate([[0.0], inside, [found.duration]])
    h = np.diff(times)[:, None]
    a = np.array([found.at_time(time)[2] for time in times[1:].tolist()])
    a = np.concatenate([now.acceleration[None], a])
    jerk, a = np.clip(np.diff(a, axis=0) / h, -most, most), a[:-1]  # above it only by rounding
    v = now.velocity + np.cumsum(h * (a + h * jerk / 2), axis=0)
    v = np.concatenate([now.velocity[None], v[:-1]])
    q = now.position + np.cumsum(h * (v + h * (a / 2 + h * jerk / 6)), axis=0)
    q = np.concatenate([now.position[None], q[:-1]])
    return times, np.stack([q, v, a / 2, jerk / 6], axis=1)
