"""Quantities of joints and of the whole robot, and their units."""

from __future__ import annotations

from pepper_kin.exceptions import UnknownNameError

# quantity -> unit for a joint in radians, unit for a joint in meters
UNITS = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s^2", "m/s^2"),
    "jerk": ("rad/s^3", "m/s^3"),
    "torque": ("N m", "N"),
    "reference": ("rad", "m"),
    "reference_velocity": ("rad/s", "m/s"),
    **{f"external_force_{axis}": ("N", "N") for axis in "xyz"},
    **{f"external_moment_{axis}": ("N m", "N m") for axis in "xyz"},
    "external_known": ("1", "1"),
}


def unit_of(quantity: str, joint_unit: str = "rad") -> str:
    """Return the unit of a quantity of a joint whose position is in "rad" or "m".

    Raises:
        UnknownNameError: listing the quantities.
    """
    if quantity not in UNITS:
        raise UnknownNameError("quantity", quantity, UNITS)
    return UNITS[quantity][joint_unit == "m"]
