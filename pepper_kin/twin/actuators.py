"""Parameters of the joints' actuators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model.joint_vectors import as_finite

POSITION, VELOCITY, TORQUE = "position", "velocity", "torque"
MODES = (POSITION, VELOCITY, TORQUE)

_GIVEN = ("stiffness", "damping", "stop_stiffness", "stop_damping")
_ZERO = ("rotor_inertia", "viscous_friction", "coulomb_friction", "encoder_resolution", "backlash")
_UNBOUNDED = ("torque_limit", "stall_torque", "no_load_speed", "continuous_torque", "thermal_time")
QUANTITIES = (*_GIVEN, *_ZERO, *_UNBOUNDED, "strength")


@dataclass(frozen=True, eq=False)
class ActuatorParameters(FrozenArrays):
    """Actuators of all joints; see `pepper_kin.core.simulation.actuator_model` for their torque.

    The demand u of an actuator depends on its mode:

    * "position": u = stiffness (q_ref - q) + damping (v_ref - v) + feed-forward
    * "velocity": u = damping (v_ref - v) + feed-forward
    * "torque":   u = effort, as commanded; no feed-forward

    and the torque is tau = strength clip(u, the motor's torque range at its speed).

    Attributes:
        joint_names: Names of the joints.
        stiffness: Gain Kp [N m/rad or N/m], shape (n,), not below zero.
        damping: Gain Kd [N m s/rad or N s/m], shape (n,), not below zero.
        torque_limit: Torque limits [N m or N], shape (n,), above zero, inf for none.
        stop_stiffness: Stiffness of the joint stops at the position limits [N m/rad or N/m], shape (n,).
        stop_damping: Damping of the joint stops [N m s/rad or N s/m], shape (n,).
        sources: Source of each joint's stiffness and damping, or "assumed".
        mode: "position", "velocity" or "torque" for each joint; "position" if omitted.
        strength: Fraction of its torque that the motor applies, 0 to 1, which NAOqi calls stiffness, shape
            (n,); 1 if omitted.
        rotor_inertia: Inertia of the motor's rotor, reflected through its gear [kg m^2 or kg], shape (n,); 0
            if omitted.
        viscous_friction: Viscous friction [N m s/rad or N s/m], shape (n,); 0 if omitted.
        coulomb_friction: Coulomb friction [N m or N], shape (n,); 0 if omitted.
        stall_torque: Torque of the motor at rest without the torque limit [N m or N], shape (n,); inf if
            omitted.
        no_load_speed: Speed at which the motor's torque is zero [rad/s or m/s], shape (n,); inf if omitted.
        encoder_resolution: Resolution of the positions that the servo reads [rad or m], shape (n,); 0 (exact)
            if omitted.
        backlash: Half the play of the gear between the reference position and the position that a servo in
            position mode holds [rad or m], shape (n,); 0 if omitted.
        continuous_torque: Torque that the motor can apply permanently without overheating; the torque limit
            falls to it as the motor gets hot [N m or N], shape (n,); inf, always cold, if omitted.
        thermal_time: Time constant of the heating, many timesteps [s], shape (n,); inf if omitted.
        latency: Delay of commands [s], rounded to timesteps of the twin.
    """

    joint_names: tuple[str, ...]
    stiffness: Array
    damping: Array
    torque_limit: Array
    stop_stiffness: Array
    stop_damping: Array
    sources: tuple[str, ...]
    mode: tuple[str, ...] = ()
    strength: Array = None  # type: ignore[assignment]
    rotor_inertia: Array = None  # type: ignore[assignment]
    viscous_friction: Array = None  # type: ignore[assignment]
    coulomb_friction: Array = None  # type: ignore[assignment]
    stall_torque: Array = None  # type: ignore[assignment]
    no_load_speed: Array = None  # type: ignore[assignment]
    encoder_resolution: Array = None  # type: ignore[assignment]
    backlash: Array = None  # type: ignore[assignment]
    continuous_torque: Array = None  # type: ignore[assignment]
    thermal_time: Array = None  # type: ignore[assignment]
    latency: float = 0.0

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: naming joint and quantity, for NaN, infinity, or a value that is not allowed.
        """
        n = len(self.joint_names)
        missing = {"strength": 1.0, **dict.fromkeys(_ZERO, 0.0), **dict.fromkeys(_UNBOUNDED, np.inf)}
        for quantity, usual in missing.items():
            if getattr(self, quantity) is None:
                object.__setattr__(self, quantity, np.full(n, usual))
        for quantity in (*_GIVEN, *_ZERO, "strength"):
            array = as_finite(getattr(self, quantity), quantity, (n,))
            self._refuse(quantity, array, array < 0, "a number of at least 0")
            object.__setattr__(self, quantity, read_only(array))
        self._refuse("strength", self.strength, self.strength > 1, "a number from 0 to 1")
        for quantity in _UNBOUNDED:
            limit = np.asarray(getattr(self, quantity), dtype=float)
            if limit.shape != (n,):
                raise InvalidValueError(quantity, f"shape {limit.shape}", f"shape ({n},)")
            self._refuse(quantity, limit, ~(limit > 0), "a number above 0, or infinity for none")
            object.__setattr__(self, quantity, read_only(limit))
        for given, needed in (("no_load_speed", "stall_torque"), ("continuous_torque", "thermal_time")):
            endless = np.isfinite(getattr(self, given)) & ~np.isfinite(getattr(self, needed))
            self._refuse(needed, getattr(self, needed), endless, f"a number, as there is a {given}")
        if not (np.isfinite(self.latency) and self.latency >= 0):
            raise InvalidValueError("latency", self.latency, "a finite time of at least 0 s")
        self._check_modes()

    def _check_modes(self) -> None:
        names = self.joint_names
        mode = tuple(self.mode) or (POSITION,) * len(names)
        if len(mode) != len(names):
            raise InvalidValueError("mode", f"{len(mode)} modes", f"one for each of {len(names)} joints")
        for name, chosen in zip(names, mode, strict=True):
            if chosen not in MODES:
                allowed = "one of " + ", ".join(repr(m) for m in MODES)
                raise InvalidValueError(f"mode of {name}", repr(chosen), allowed)
        object.__setattr__(self, "mode", mode)

    def _refuse(self, quantity: str, array: Array, wrong: NDArray[np.bool_], allowed: str) -> None:
        """Refuse values of the joints, shape (n,), if any is marked as wrong, shape (n,).

        Raises:
            InvalidValueError: for a wrong value, naming the first such joint.
        """
        if wrong.any():
            j = int(np.argmax(wrong))
            raise InvalidValueError(f"{quantity} of {self.joint_names[j]}", array[j], allowed)

    def in_mode(self, mode: str) -> NDArray[np.bool_]:
        """Return which joints are in a mode, shape (n,)."""
        return np.array([chosen == mode for chosen in self.mode], dtype=bool)

    def changed(
        self,
        *,
        mode: str | Mapping[str, str] | tuple[str, ...] | None = None,
        latency: float | None = None,
        **quantities: ArrayLike | Mapping[str, float],
    ) -> ActuatorParameters:
        """Return a copy with other values.

        Args:
            mode: One mode for all joints, one for each joint, or modes by joint name.
            latency: Delay of commands [s].
            **quantities: Any attribute with one number for each joint, such as `stiffness` or `torque_limit`:
                one number for all joints, shape (n,), or numbers by joint name; other joints keep their
                value.

        Raises:
            InvalidValueError: naming joint and quantity, for a value that is not allowed.
            UnknownNameError: for a quantity or a joint that is not known.
        """
        new: dict[str, Any] = {} if latency is None else {"latency": latency}
        for quantity, value in quantities.items():
            if quantity not in QUANTITIES:
                raise UnknownNameError("quantity of an actuator", quantity, (*QUANTITIES, "mode", "latency"))
            new[quantity] = self._filled(quantity, value)
        if mode is not None:
            every = isinstance(mode, str)
            new["mode"] = (mode,) * len(self.joint_names) if every else self._filled("mode", mode)
        return replace(self, **new)

    def _filled(self, quantity: str, value: Any) -> Any:
        """Return one value for each joint."""
        n = len(self.joint_names)
        if isinstance(value, Mapping):
            result = list(getattr(self, quantity))
            for name, one in value.items():
                if name not in self.joint_names:
                    raise UnknownNameError("joint", name, self.joint_names)
                result[self.joint_names.index(name)] = one
            return tuple(result) if quantity == "mode" else np.array(result, dtype=float)
        if quantity == "mode":
            return tuple(value)
        array = np.asarray(value, dtype=float)
        if array.shape not in ((), (n,)):
            raise InvalidValueError(quantity, f"shape {array.shape}", f"one number or shape ({n},)")
        return np.broadcast_to(array, (n,))
