"""Geometry of the wheels, and limits of the base's velocity and acceleration."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model.joint_vectors import as_finite


@dataclass(frozen=True, eq=False)
class BaseGeometry(FrozenArrays):
    """Omnidirectional wheels in the frame of the base (x forward, y left, origin on the floor).

    Attributes:
        wheel_names: Names of the k wheels, three or more.
        contacts: Contact points with the floor, shape (k, 2) [m].
        axles: Unit vectors of the axles, about which positive speeds rotate, shape (k, 2).
        wheel_radius: Radius of the wheels [m].
        wheel_speed_limit: Maximum speed of the wheels [rad/s], inf for none.
        linear_velocity: Maximum speed of the base's origin [m/s].
        angular_velocity: Maximum angular speed of the base [rad/s].
        linear_acceleration: Maximum linear acceleration [m/s^2].
        angular_acceleration: Maximum angular acceleration [rad/s^2].
    """

    wheel_names: tuple[str, ...]
    contacts: Array
    axles: Array
    wheel_radius: float
    wheel_speed_limit: float = math.inf
    linear_velocity: float = math.inf
    angular_velocity: float = math.inf
    linear_acceleration: float = math.inf
    angular_acceleration: float = math.inf

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: naming the quantity.
        """
        count = len(self.wheel_names)
        if count < 3:
            raise InvalidValueError("wheels", count, "three or more")
        object.__setattr__(self, "contacts", read_only(as_finite(self.contacts, "contacts", (count, 2))))
        axles = as_finite(self.axles, "axles", (count, 2))
        lengths = np.linalg.norm(axles, axis=1, keepdims=True)
        if not (lengths > 0).all():
            raise InvalidValueError("axles", axles.tolist(), "vectors of a length above 0")
        object.__setattr__(self, "axles", read_only(axles / lengths))
        if not (math.isfinite(self.wheel_radius) and self.wheel_radius > 0):
            raise InvalidValueError("wheel_radius", self.wheel_radius, "a finite length above 0 [m]")
        for quantity in (
            "wheel_speed_limit",
            "linear_velocity",
            "angular_velocity",
            "linear_acceleration",
            "angular_acceleration",
        ):
            if not getattr(self, quantity) > 0:
                raise InvalidValueError(quantity, getattr(self, quantity), "a number above 0")

    @property
    def wheel_map(self) -> Array:
        """Matrix from twists to wheel speeds without slip, shape (k, 3) [rad/m, rad/m, 1].

        A twist is (v_x, v_y, omega): velocity of the base's origin in its own axes and angular velocity.  A
        wheel at c with axle a and radius r rolls along t = (a_y, -a_x), and r w = t . (v + omega x c).
        """
        (x, y), (ax, ay) = self.contacts.T, self.axles.T
        return np.asarray(np.column_stack([ay, -ax, -y * ay - x * ax]) / self.wheel_radius)


@cache
def pepper_base(*, fastest: bool = False) -> BaseGeometry:
    """Return Pepper's base; the numbers and their sources are in `kinematics/data/base.json`.

    Args:
        fastest: Whether to use the maximum velocities and accelerations that the maker allows to command,
            instead of its defaults.
    """
    text = (files("pepper_kin.kinematics") / "data" / "base.json").read_text(encoding="utf-8")
    data: dict[str, Any] = json.loads(text)
    wheels = data["wheels"]
    which = "maximum" if fastest else "default"
    return BaseGeometry(
        tuple(wheels),
        np.array([wheel["contact"] for wheel in wheels.values()]),
        np.array([wheel["axle"] for wheel in wheels.values()]),
        data["wheel_radius"],
        data["wheel_speed_limit"],
        **{quantity: limit[which] for quantity, limit in data["limits"].items()},
    )
