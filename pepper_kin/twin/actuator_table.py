"""Parameters of actuators in the form of the compiled actuator model."""

from __future__ import annotations

import numpy as np

from pepper_kin.core.simulation.actuator_model import ActuatorTable
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.twin.actuators import POSITION, QUANTITIES, TORQUE, ActuatorParameters

_SAME = tuple(name for name in ActuatorTable._fields if name in QUANTITIES and name != "strength")
"""Names of rows that are copied unchanged from the parameters."""
_FAR = 1e12  # substitute for infinite position limits, so that 0 times it is 0 [rad or m]


def actuator_table(pepper: PepperModel, actuators: ActuatorParameters) -> ActuatorTable:
    """Return the parameters of a robot's joints, each of shape (n,).

    Args:
        pepper: The robot.
        actuators: Actuators of its joints; parameters of k robots, one after the other, give the shape (k
            n,).
    """
    strength = np.array(actuators.strength)
    robots = strength.size // pepper.n
    servo = np.where(actuators.in_mode(TORQUE), 0.0, strength)
    with np.errstate(invalid="ignore"):
        stall = np.where(strength > 0, strength * actuators.stall_torque, 0.0)
        limit = np.where(strength > 0, strength * actuators.torque_limit, 0.0)
        line = np.where(np.isfinite(actuators.no_load_speed), stall / actuators.no_load_speed, 0.0)
    return ActuatorTable(
        kp=np.where(actuators.in_mode(POSITION), strength * actuators.stiffness, 0.0),
        kd=servo * actuators.damping,
        strength=strength,
        feedforward=servo,
        limit=limit,
        stall=stall,
        line=line,
        viscous=np.array(actuators.viscous_friction),
        coulomb=np.array(actuators.coulomb_friction),
        rotor=np.array(actuators.rotor_inertia),
        upper=np.tile(np.minimum(pepper.upper_limits, _FAR), robots),
        lower=np.tile(np.maximum(pepper.lower_limits, -_FAR), robots),
        resolution=np.array(actuators.encoder_resolution),
        play=np.where(actuators.in_mode(POSITION), actuators.backlash, 0.0),
        **{name: np.array(getattr(actuators, name)) for name in _SAME},
    )


def check_joints(pepper: PepperModel, actuators: ActuatorParameters) -> None:
    """Refuse actuators of other joints than the robot's.

    Raises:
        InvalidValueError: for such actuators, naming their joints and the robot's.
    """
    if actuators.joint_names != pepper.joint_names:
        raise InvalidValueError(
            "joints of the actuators", ", ".join(actuators.joint_names), ", ".join(pepper.joint_names)
        )
