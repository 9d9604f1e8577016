"""Actuator parameters of a robot: Pepper's from a data file, generic ones for any other joint."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pepper_kin import dynamics
from pepper_kin.dynamics.friction import friction_coefficients
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_choice
from pepper_kin.model.servos import actuator_data, known_actuators, servo_gains
from pepper_kin.twin.actuators import ActuatorParameters

DETAILS = ("servo", "motor", "measured")

_STOP_RATIO = 200.0  # stiffness of a joint stop over the servo's
_STOP_TIME = 0.002  # damping of a joint stop over its stiffness [s]
_MOTOR = (
    "rotor_inertia",
    "viscous_friction",
    "coulomb_friction",
    "stall_torque",
    "no_load_speed",
    "encoder_resolution",
    "backlash",
    "continuous_torque",
    "thermal_time",
)


def actuator_parameters(pepper: PepperModel, detail: str = "servo") -> ActuatorParameters:
    """Return the actuators of a robot.

    Parameters of Pepper's actuators are read from `model/data/actuators.json`, each with its source or
    "assumed".  Any other joint gets a generic actuator: full torque at 5 mrad (5 mm) of error, or a natural
    frequency of 50 rad/s if the torque is unlimited, and critical damping for the joint's own inertia in the
    neutral posture.

    Args:
        pepper: The robot.
        detail: "servo": only gains, torque limits and stops; "motor": also the friction of the description
            and, if the data file has them, rotor inertia, friction, torque-speed line, encoder and latency;
            "measured": as "motor", with measured stiffness where available, from a robot's sag under gravity:
            a quarter to a half of the assumed stiffness.

    Returns:
        The parameters; torque limits are the URDF's effort limits.

    Raises:
        InvalidValueError: for another detail.
    """
    check_choice("detail", detail, DETAILS)
    gains = servo_gains(pepper, np.diag(dynamics.mass_matrix(pepper, pepper.neutral())))
    stop = _STOP_RATIO * gains.stiffness
    servo = ActuatorParameters(
        pepper.joint_names, gains.stiffness, gains.damping, gains.torque_limit, stop, stop * _STOP_TIME,
        gains.sources,
    )  # fmt: skip
    if detail == "servo":
        return servo
    damping, coulomb = friction_coefficients(pepper)
    motors = servo.changed(viscous_friction=damping, coulomb_friction=coulomb)
    known = known_actuators(pepper)
    if not known:
        return motors
    motors = _with_motors(motors, known)
    return motors if detail == "motor" else _with_measured_stiffness(motors)


def _with_motors(servo: ActuatorParameters, known: dict[str, dict[str, Any]]) -> ActuatorParameters:
    values = {
        quantity: {
            name: known[name][quantity]
            for name in servo.joint_names
            if name in known and quantity in known[name]
        }
        for quantity in _MOTOR
    }
    return servo.changed(latency=actuator_data()["latency"], **values)


def _with_measured_stiffness(motors: ActuatorParameters) -> ActuatorParameters:
    """Return actuators with the measured stiffness of a robot and an unchanged damping ratio."""
    measured = actuator_data()["measured"]
    stiffness, damping, sources = {}, {}, list(motors.sources)
    for name, (value, _, _, source) in measured["joints"].items():
        if name in motors.joint_names:
            j = motors.joint_names.index(name)
            stiffness[name] = value
            damping[name] = float(motors.damping[j] * np.sqrt(value / motors.stiffness[j]))
            sources[j] = f"stiffness: {measured[source]}; damping ratio assumed"
    return replace(motors.changed(stiffness=stiffness, damping=damping), sources=tuple(sources))


def measured_ranges(pepper: PepperModel) -> dict[str, dict[str, tuple[float, float]]]:
    """Return measured ranges of a real Pepper's actuators, relative to `actuator_parameters(pepper)`.

    Args:
        pepper: The robot.

    Returns:
        "stiffness" -> joint -> minimum and maximum factor, for measured joints; "latency" -> "" -> minimum
        and maximum time [s], from the twin's default to the latency of commands on a robot.
    """
    usual, found = actuator_parameters(pepper), {}
    for name, (_, low, high, _) in actuator_data()["measured"]["joints"].items():
        if name in pepper.joint_names:
            assumed = float(usual.stiffness[pepper.joint_index(name)])
            found[name] = (low / assumed, high / assumed)
    return {"stiffness": found, "latency": {"": (0.0, actuator_data()["latency"])}}
