"""Parameters of many robots, one row of an array for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.collision.loads import load_parameters, loads_of
from pepper_kin.dynamics.load import Load
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.model.at_frames import HANDS
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.twin.actuators import QUANTITIES, ActuatorParameters

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

PerRobot = ArrayLike | Mapping[str, ArrayLike]
"""Values of N robots, shape (), (n,), (N, 1) or (N, n), or joint -> one number or shape (N,)."""


def actuators_of_all(
    count: int, actuators: ActuatorParameters, vary: Mapping[str, PerRobot]
) -> ActuatorParameters:
    """Return the actuators of N robots, one robot after the other, so that there are N n joints.

    Args:
        count: Number N of robots.
        actuators: Common actuators of the robots.
        vary: Quantity of `ActuatorParameters` -> individual values of the robots.

    Raises:
        UnknownNameError: for a quantity or a joint that is not known.
        InvalidValueError: naming robot, joint and quantity, for a wrong shape or a value that is not allowed.
    """
    for quantity in vary:
        if quantity not in QUANTITIES:
            raise UnknownNameError("quantity of an actuator", quantity, QUANTITIES)
    fields: dict[str, Any] = {
        quantity: _spread(count, actuators, quantity, vary.get(quantity)).ravel() for quantity in QUANTITIES
    }
    names = actuators.joint_names
    return ActuatorParameters(
        joint_names=tuple(f"{name} of robot {k}" for k in range(count) for name in names),
        sources=actuators.sources * count,
        mode=actuators.mode * count,
        latency=actuators.latency,
        **fields,
    )


def _spread(count: int, actuators: ActuatorParameters, quantity: str, value: PerRobot | None) -> Array:
    """Return one quantity of all robots, shape (N, n)."""
    usual = np.asarray(getattr(actuators, quantity), dtype=float)
    shape = (count, usual.size)
    if value is None:
        return np.broadcast_to(usual, shape)
    if not isinstance(value, Mapping):
        return broadcast(value, quantity, shape)
    result = np.broadcast_to(usual, shape).copy()
    for name, column in value.items():
        if name not in actuators.joint_names:
            raise UnknownNameError("joint", name, actuators.joint_names)
        result[:, actuators.joint_names.index(name)] = broadcast(column, f"{quantity} of {name}", (count,))
    return result


def broadcast(value: ArrayLike, quantity: str, shape: tuple[int, ...]) -> Array:
    """Return numbers broadcast to a shape, such as (N,) or (N, n)."""
    try:
        return np.broadcast_to(np.asarray(value, dtype=float), shape)
    except (TypeError, ValueError):
        allowed = f"numbers that broadcast to shape {shape}"
        raise InvalidValueError(quantity, f"shape {np.shape(value)}", allowed) from None


def mass_factors(pepper: PepperModel, count: int, scale: Mapping[str, ArrayLike] | None) -> Array | None:
    """Return factors of the mass that moves with each joint, shape (N, n); None if all are 1.

    Args:
        pepper: The robot.
        count: Number N of robots.
        scale: Joint, or group of joints -> factor above zero, one number or shape (N,).

    Raises:
        UnknownNameError: for a name that is neither a joint nor a group.
        InvalidValueError: naming the group, for a wrong shape or a factor that is not above zero.
    """
    if not scale:
        return None
    result = np.ones((count, pepper.n))
    for name, value in scale.items():
        factor = _positive(value, f"mass_scale of {name}", count, least=None)
        for joint in pepper.resolve_joints(name, allow_none=True):
            result[:, pepper.joint_index(joint)] *= factor
    return result


def loads_of_all(
    pepper: PepperModel, count: int, payload: Mapping[str, ArrayLike] | None, scene: Scene | None
) -> dict[str, Array]:
    """Return frame -> inertial parameters of the frame's load, shape (N, PARAMETERS).

    Args:
        pepper: The robot.
        count: Number N of robots.
        payload: "left", "right" or frame -> point mass at its origin [kg], one number or shape (N,).
        scene: The scene whose attached objects count, for all robots; None for none.

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        InvalidValueError: naming the frame, for a wrong shape or a mass below zero.
    """
    parts = [(load_parameters(pepper, loads_of(pepper, scene)), np.ones(count))]
    for name, value in (payload or {}).items():
        frame = HANDS.get(name, name)
        pepper.frame_id(frame)
        masses = _positive(value, f"payload of {name}", count, least=0.0)
        parts.append((load_parameters(pepper, (Load(frame, 1.0),)), masses))
    result: dict[str, Array] = {}
    for (frames, values), masses in parts:
        for frame, row in zip(frames, values, strict=True):
            result[frame] = result.get(frame, 0.0) + np.outer(masses, row)
    return dict(sorted(result.items()))


def _positive(value: ArrayLike, quantity: str, count: int, least: float | None) -> Array:
    """Return numbers for all robots, shape (N,), from one number or shape (N,), after checks.

    Args:
        value: The numbers, in the unit of the quantity.
        quantity: Name of the quantity in errors.
        count: Number N of robots.
        least: Minimum allowed value; None for any value above zero.
    """
    array = as_finite(broadcast(value, quantity, (count,)), quantity, (count,))
    wrong = array <= 0 if least is None else array < least
    if wrong.any():
        allowed = "numbers above 0" if least is None else f"numbers of at least {least:g}"
        raise InvalidValueError(quantity, f"{array[wrong][0]} of robot {int(np.argmax(wrong))}", allowed)
    return array
