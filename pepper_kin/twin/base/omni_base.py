"""Map between the velocity of the base and the speeds of its wheels."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.exceptions import InvalidValueError, ModelError
from pepper_kin.kinematics.base_geometry import BaseGeometry, pepper_base
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_batch


class OmniBase:
    """A base on omnidirectional wheels, which roll about their axles and slide freely along them.

    A twist is (v_x, v_y, omega): velocity of the base's origin in its own axes [m/s] and angular velocity
    [rad/s].  A wheel at c with axle a (unit vector in the plane) and radius r rolls along t = (a_y, -a_x).
    The floor does not slide against it along t when
        r w = t . (v + omega x c),
    which is one row of the map from twists to wheel speeds w.

    Args:
        base: Pepper, for its wheels, or the geometry of another base; Pepper's by default.

    Attributes:
        geometry: Geometry of the wheels.
        wheel_map: Map from twist to wheel speeds [rad/s], shape (k, 3), read-only.

    Raises:
        InvalidValueError: for another type of base.
        UnknownNameError: for a robot without Pepper's wheels.
        ModelError: for wheels that leave some motion of the base undetermined.
    """

    def __init__(self, base: PepperModel | BaseGeometry | None = None) -> None:
        if not (base is None or isinstance(base, PepperModel | BaseGeometry)):
            raise InvalidValueError("base", type(base).__name__, "a robot, a BaseGeometry or None")
        self.geometry = base if isinstance(base, BaseGeometry) else pepper_base()
        if isinstance(base, PepperModel):  # a robot without these wheels is not Pepper
            for name in self.geometry.wheel_names:
                base.frame_id(f"{name}_link")
        rows = self.geometry.wheel_map
        if np.linalg.matrix_rank(rows, tol=1e-9 * np.abs(rows).max()) < 3:
            raise ModelError(f"wheels {', '.join(self.geometry.wheel_names)} leave a motion undetermined")
        self.wheel_map = read_only(rows)
        self._inverse = np.linalg.pinv(rows)

    def wheel_speeds(self, twist: ArrayLike) -> Array:
        """Return the rolling speeds of the wheels [rad/s], shape (..., k).

        Args:
            twist: Twist (v_x, v_y, omega) [m/s, m/s, rad/s], shape (..., 3).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        return as_batch(twist, "twist", (3,)) @ self.wheel_map.T

    def body_twist(self, wheel_speeds: ArrayLike) -> Array:
        """Return the twist that fits the wheel speeds by least squares; with three wheels it fits exactly.

        Args:
            wheel_speeds: Wheel speeds [rad/s], or rotation angles [rad] for a displacement, shape (..., k).

        Returns:
            (v_x, v_y, omega) [m/s, m/s, rad/s], shape (..., 3).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        return as_batch(wheel_speeds, "wheel_speeds", (len(self.wheel_map),)) @ self._inverse.T

    def wheel_slip(self, twist: ArrayLike, wheel_speeds: ArrayLike) -> Array:
        """Return each wheel's sliding speed on the floor along its rolling direction [m/s], shape (..., k).

        Args:
            twist: Twist of the base [m/s, m/s, rad/s], shape (..., 3).
            wheel_speeds: Speeds of the wheels [rad/s], shape (..., k).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        turning = as_batch(wheel_speeds, "wheel_speeds", (len(self.wheel_map),))
        return self.geometry.wheel_radius * (self.wheel_speeds(twist) - turning)

    def limited(self, twist: ArrayLike) -> Array:
        """Return a twist scaled down to the limits of velocity, angular velocity and wheel speeds.

        The whole twist is scaled, so that the base follows the same arc.

        Args:
            twist: Twist (v_x, v_y, omega) [m/s, m/s, rad/s], shape (..., 3).

        Raises:
            InvalidValueError: for a wrong shape, NaN or infinity.
        """
        twists, limits = as_batch(twist, "twist", (3,)), self.geometry
        use = np.maximum(
            np.hypot(twists[..., 0], twists[..., 1]) / limits.linear_velocity,
            np.abs(twists[..., 2]) / limits.angular_velocity,
        )
        turning = np.abs(self.wheel_speeds(twists)).max(axis=-1) / limits.wheel_speed_limit
        return np.asarray(twists / np.maximum(np.maximum(use, turning), 1.0)[..., None])
