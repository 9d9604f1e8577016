"""Velocity commands of the base, followed within its limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_batch, as_finite, check_positive, check_rows, check_whole
from pepper_kin.twin.base.odometry import arc_moved
from pepper_kin.twin.base.omni_base import OmniBase


class BaseController:
    """Controller that ramps the base's twist towards the last command, and to rest when commands cease.

    A command beyond the velocity limits is scaled down (`OmniBase.limited`).  The twist then moves straight
    towards it, as fast as both acceleration limits allow.  Twists within the velocity limits form a convex
    set, so that every twist on the way is within them too.

    Args:
        base: The wheels and their limits.
        command_timeout: Time for which a command holds [s]; then the base brakes.
        count: Number of bases, N, whose poses and twists have shape (N, 3); one of shape (3,) if omitted.

    Raises:
        InvalidValueError: for a command_timeout that is not above 0, or a count below 1.
    """

    def __init__(self, base: OmniBase, command_timeout: float = 0.5, count: int | None = None) -> None:
        self.base = base
        self.command_timeout = (
            float("inf")
            if command_timeout == float("inf")
            else check_positive("command_timeout", command_timeout, "s")
        )
        self._many = () if count is None else (check_whole("count", count, 1),)
        self._pose, self._twist, self._target = (np.zeros((*self._many, 3)) for _ in range(3))
        self._age = np.full(self._many, np.inf)

    def reset(self, pose: ArrayLike = (0.0, 0.0, 0.0), *, rows: ArrayLike | None = None) -> None:
        """Reset the base to rest, without a command.

        Args:
            pose: Pose x, y [m], yaw [rad], shape (3,), or one for each of k bases, shape (k, 3).
            rows: Indices of bases, shape (k,), or a mask, shape (N,); all if omitted.

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity, or rows that do not exist.
        """
        if not self._many:
            if rows is not None:
                raise InvalidValueError("rows", rows, "none, of a single base")
            self._pose = as_finite(pose, "pose", (3,))
            self._twist, self._target, self._age = np.zeros(3), np.zeros(3), np.full((), np.inf)
            return
        which = np.arange(*self._many) if rows is None else check_rows(rows, *self._many)
        place = as_batch(pose, "pose", (3,))
        if place.shape not in ((3,), (len(which), 3)):
            raise InvalidValueError("pose", f"shape {place.shape}", f"shape (3,) or ({len(which)}, 3)")
        self._pose, self._twist, self._target = self._pose.copy(), self._twist.copy(), self._target.copy()
        self._pose[which], self._twist[which], self._target[which] = place, 0.0, 0.0
        self._age[which] = np.inf

    @property
    def twist(self) -> Array:
        """The present twist (v_x, v_y, omega) [m/s, m/s, rad/s], shape (..., 3)."""
        return read_only(self._twist)

    @property
    def pose(self) -> Array:
        """The present pose, integrated from the twists: x, y [m], yaw [rad], shape (..., 3)."""
        return read_only(self._pose)

    @property
    def stands(self) -> bool:
        """Whether all bases are at rest, and commanded to be."""
        commanded = self._holds() & self._target.any(axis=-1)
        return not commanded.any() and not self._twist.any()

    @property
    def wheel_speeds(self) -> Array:
        """Speeds of the wheels at the present twist [rad/s], shape (..., k)."""
        return self.base.wheel_speeds(self._twist)

    def command(self, twist: ArrayLike) -> Array:
        """Set the target twist for the next `command_timeout`; return it within the limits.

        Args:
            twist: Twist (v_x, v_y, omega) in the base's axes [m/s, m/s, rad/s], shape (..., 3).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        self._target = self.base.limited(as_finite(twist, "twist", (*self._many, 3)))
        self._age = np.zeros(self._many)
        return read_only(self._target)

    def step(self, timestep: float) -> Array:
        """Advance by a timestep; return the new twist, shape (..., 3).

        The pose moves along the arc of the mean of old and new twist.

        Args:
            timestep: Time step [s], above 0.

        Raises:
            InvalidValueError: for a timestep that is not above 0.
        """
        duration = check_positive("timestep", timestep, "s")
        target = np.where(self._holds()[..., np.newaxis], self._target, 0.0)
        self._age = self._age + duration
        before = self._twist
        self._twist = ramped(self.base, before, target, duration)
        self._pose = arc_moved(self._pose, duration * (before + self._twist) / 2.0)
        return self.twist

    def braking_distance(self) -> Array:
        """Return the braking distance from the present twist, along the arc [m], shape (...,).

        The twist decreases linearly to zero, so the distance is half the speed times the braking time.
        """
        speed, limits = np.hypot(self._twist[..., 0], self._twist[..., 1]), self.base.geometry
        turning = np.abs(self._twist[..., 2])
        duration = np.maximum(speed / limits.linear_acceleration, turning / limits.angular_acceleration)
        return np.asarray(speed * duration / 2.0)

    def _holds(self) -> NDArray[np.bool_]:
        return np.asarray(self._age < self.command_timeout - 1e-9)


def ramped(base: OmniBase, twist: Array, target: Array, duration: float) -> Array:
    """Return twists after some time on the straight way to targets, as fast as acceleration limits allow.

    Args:
        base: The wheels and their limits.
        twist: Present twists (v_x, v_y, omega) [m/s, m/s, rad/s], shape (..., 3).
        target: Target twists within the velocity limits [m/s, m/s, rad/s], shape (..., 3).
        duration: Time [s].
    """
    change, limits = target - twist, base.geometry
    need = np.maximum(
        np.hypot(change[..., 0], change[..., 1]) / limits.linear_acceleration,
        np.abs(change[..., 2]) / limits.angular_acceleration,
    )[..., np.newaxis]
    return np.where(need <= duration, target, twist + change * (duration / np.maximum(need, duration)))


def world_velocity(twist: ArrayLike, yaw: float) -> Array:
    """Return the velocities of the joints BaseX, BaseY, BaseYaw for a twist in the base's axes.

    Args:
        twist: (v_x, v_y, omega) [m/s, m/s, rad/s], shape (..., 3).
        yaw: Yaw of the base [rad].

    Returns:
        (v_x, v_y) in the world [m/s] and omega [rad/s], shape (..., 3).

    Raises:
        InvalidValueError: for a wrong shape, NaN or infinity.
    """
    checked, angle = as_batch(twist, "twist", (3,)), as_finite(yaw, "yaw", ())
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, turning = checked[..., 0], checked[..., 1], checked[..., 2]
    return np.stack([cos * x - sin * y, sin * x + cos * y, turning], axis=-1)
