"""The state of a robot with NAOqi, by the model's names and in the library's units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from pepper_kin.arrays import Array, FrozenArrays
from pepper_kin.exceptions import InvalidValueError, shortened
from pepper_kin.model import PepperModel
from pepper_kin.naoqi.device_keys import TOP
from pepper_kin.naoqi.joint_names import ACTUATED
from pepper_kin.naoqi.link import RobotLink
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.naoqi.tables import table
from pepper_kin.supervision import Clock, UnusableStateError
from pepper_kin.twin import Run, actuator_parameters

BASE = ("BaseX", "BaseY", "BaseYaw")

QUANTITIES = {
    "position": "Position/Sensor/Value",
    "command": "Position/Actuator/Value",
    "velocity": "Velocity/Sensor/Value",
    "torque": "Torque/Sensor/Value",
    "stiffness": "Hardness/Actuator/Value",
    "temperature": "Temperature/Sensor/Value",
}
"""Quantity -> end of its key in ALMemory."""

BATTERY = f"{TOP}Battery/Charge/Sensor/Value"


@dataclass(frozen=True, eq=False)
class RobotState(FrozenArrays):
    """Measured state of a robot; arrays are in the order of the model's joints, NaN for unknown.

    Attributes:
        joint_names: Joints of the model.
        time: Time of the request, on the clock of `time.monotonic` [s].
        q: Joint positions, of the base from odometry [rad, m or fraction of a hand's opening], shape (n,).
        command: Commanded positions [rad, m or fraction], shape (n,).
        velocity: Velocities, if the robot reports them, and of the base [rad/s, m/s or 1/s], shape (n,).
        torque: Torques, if the robot reports them, as the simulated one does [N m], shape (n,).
        stiffness: Stiffness of the motors, 0 to 1, shape (n,).
        temperature: Temperature of the motors [degrees Celsius], shape (n,).
        battery: Charge of the battery, 0 to 1.
        pressed: Bumper or touch sensor -> whether it is pressed, for reported sensors.
    """

    joint_names: tuple[str, ...]
    time: float
    q: Array
    command: Array
    velocity: Array
    torque: Array
    stiffness: Array
    temperature: Array
    battery: float
    pressed: Mapping[str, bool]

    def __post_init__(self) -> None:
        for name in ("q", "command", "velocity", "torque", "stiffness", "temperature"):
            getattr(self, name).setflags(write=False)

    @property
    def base_pose(self) -> Array:
        """Pose of the base in the odometry's frame: x, y [m], yaw [rad], shape (3,)."""
        return self.q[[self.joint_names.index(name) for name in BASE]]

    def of(self, names: Sequence[str]) -> Array:
        """Return the positions of joints [rad, m or fraction], shape (k,)."""
        return self.q[[self.joint_names.index(name) for name in names]]


class StateReader:
    """Reader of a robot's states, by three calls, or one for a model without a base.

    Args:
        link: The connection.
        pepper: Model with a planar base and hands of one joint each.
        clock: Clock of the states' times.

    Raises:
        InvalidValueError: for a model with joints that NAOqi does not know.
    """

    def __init__(self, link: RobotLink, pepper: PepperModel, clock: Clock | None = None) -> None:
        unknown = [name for name in pepper.joint_names if name not in (*ACTUATED, *BASE)]
        if unknown:
            allowed = "load_pepper(base='planar', hands='mimic') or a robot with some of its joints"
            raise InvalidValueError("joints of pepper", ", ".join(unknown), allowed)
        self._link, self.pepper, self._clock = link, pepper, Clock() if clock is None else clock
        self._joints = [name for name in pepper.joint_names if name in ACTUATED]
        self._places = np.array([pepper.joint_index(name) for name in self._joints], dtype=int)
        self._base = [pepper.joint_index(name) for name in BASE if name in pepper.joint_names]
        self._keys = [f"{TOP}{name}/{end}" for end in QUANTITIES.values() for name in self._joints]
        self._keys += [BATTERY, *(f"{TOP}{key}/Sensor/Value" for key in table("devices")["touches"])]

    def begin(self) -> RobotReading:
        """Request a state."""
        at = self._clock.now()
        asked = [self._link.start("ALMemory", "getListData", self._keys)]
        if self._base:
            asked.append(self._link.start("ALMotion", "getRobotPosition", True))
            asked.append(self._link.start("ALMotion", "getRobotVelocity"))
        return RobotReading(at, asked)

    def finish(self, reading: RobotReading) -> RobotState:
        """Return a requested state.

        Raises:
            RobotConnectionError: if no answer comes in time.
            UnusableStateError: for an answer of the wrong shape, or positions that are not finite.
        """
        values = self._link.value(reading.futures[0], "ALMemory.getListData")
        if not isinstance(values, list | tuple) or len(values) != len(self._keys):
            got = f"{len(values)} values" if isinstance(values, list | tuple) else type(values).__name__
            raise UnusableStateError(
                f"ALMemory.getListData answered {got}, expected {len(self._keys)} values"
            )
        count = len(self._joints)
        found = {}
        for k, quantity in enumerate(QUANTITIES):
            row = np.full(self.pepper.n, np.nan)
            row[self._places] = [_number(value) for value in values[k * count : (k + 1) * count]]
            found[quantity] = row
        if self._base:
            pose = self._link.value(reading.futures[1], "ALMotion.getRobotPosition")
            rate = self._link.value(reading.futures[2], "ALMotion.getRobotVelocity")
            found["position"][self._base] = found["command"][self._base] = _three("getRobotPosition", pose)
            found["velocity"][self._base] = _three("getRobotVelocity", rate)
        for name, place in zip(self._joints, self._places, strict=True):
            if not np.isfinite(found["position"][place]):
                raise UnusableStateError(
                    f"position of {name}: got {found['position'][place]}, expected a number"
                )
        rest = values[count * len(QUANTITIES) :]
        pressed = {
            name: bool(value)
            for name, value in zip(table("devices")["touches"].values(), rest[1:], strict=True)
            if value is not None
        }
        return RobotState(
            self.pepper.joint_names,
            reading.asked_at,
            found["position"],
            found["command"],
            found["velocity"],
            found["torque"],
            found["stiffness"],
            found["temperature"],
            _number(rest[0]),
            pressed,
        )

    def read(self) -> RobotState:
        """Return the present state."""
        return self.finish(self.begin())


class RobotReading(NamedTuple):
    """A requested state.

    Attributes:
        asked_at: Time of the request [s].
        futures: Futures of the calls.
    """

    asked_at: float
    futures: list[Any]

    @property
    def is_there(self) -> bool:
        """Whether all answers have arrived."""
        return all(future.isFinished() for future in self.futures)


def _number(value: Any) -> float:
    """Return a value of ALMemory as a number, or NaN."""
    return float(value) if isinstance(value, int | float) else float("nan")


def _three(method: str, value: Any) -> list[float]:
    """Return ALMotion's answer of three finite numbers."""
    numbers = [_number(x) for x in value] if isinstance(value, list | tuple) else []
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise UnusableStateError(
            f"ALMotion.{method} answered {shortened(repr(value))}, expected three numbers"
        )
    return numbers


def run_of_states(
    pepper: PepperModel, stamps: Array, states: Sequence[RobotState], wanted: Sequence[Array]
) -> Run:
    """Return states of a robot as a run in steps of 20 ms.

    Args:
        pepper: Model of the robot.
        stamps: Times of the states, from 0 and increasing [s], shape (k,).
        states: States of the robot.
        wanted: Commanded positions at each stamp [rad or m], shape (n,) each.
    """
    grid = np.arange(0.0, stamps[-1] + CYCLE / 2.0, CYCLE)

    def even(rows: Sequence[Array]) -> Array:
        return np.column_stack([np.interp(grid, stamps, column) for column in np.array(rows).T])

    position, reference = even([state.q for state in states]), even(wanted)
    velocity = even([state.velocity for state in states])
    velocity = np.where(np.isnan(velocity), np.gradient(position, CYCLE, axis=0), velocity)
    return Run(
        joint_names=pepper.joint_names,
        joint_units=pepper.joint_units,
        time=grid,
        position=position,
        velocity=velocity,
        torque=np.nan_to_num(even([state.torque for state in states])),
        reference_position=reference,
        reference_velocity=np.gradient(reference, CYCLE, axis=0),
        torque_limit=np.asarray(actuator_parameters(pepper, "motor").torque_limit),
    )
