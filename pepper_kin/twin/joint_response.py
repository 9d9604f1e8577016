"""Response of joints to targets of `setAngles`: measured on a robot, assumed, or ideal."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.core.simulation.target_following import Following
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite, check_choice

RESPONSE_QUANTITIES = ("speed_share", "latency", "lag", "backlash", "compliance")
RESPONSES = ("measured", "ideal")
ASSUMED = "assumed: the median of the joints that were measured"

_IDEAL = {"speed_share": 1.0, "latency": 0.0, "lag": 0.0, "backlash": 0.0, "compliance": 0.0}


@dataclass(frozen=True, eq=False)
class JointResponse(FrozenArrays):
    """Response of joints to targets; see `pepper_kin.core.simulation.target_following` for the model.

    Gravity displaces a joint from the model's position by -compliance x (holding torque).

    Attributes:
        joint_names: Names of the n joints.
        speed_share: Maximum speed of the interpolation over (speed fraction given with the target) x
            (velocity limit of the joint), shape (n,), above 0.
        latency: Time from a call to the first motion of the interpolation [s], shape (n,).
        lag: Time constant with which the joint follows the interpolation [s], shape (n,).
        backlash: Half the play between interpolation and joint [rad or m], shape (n,).
        compliance: 1 / stiffness of the servo [rad/(N m) or m/N], shape (n,); 0 for none.
        intervals: Quantity -> 95 % interval, shape (n, 2); NaN if not measured.
        sources: Source of each joint's values, or "assumed: ...".
    """

    joint_names: tuple[str, ...]
    speed_share: Array
    latency: Array
    lag: Array
    backlash: Array
    compliance: Array
    intervals: Mapping[str, Array]
    sources: tuple[str, ...]

    def __post_init__(self) -> None:
        """Copy and check the fields.

        Raises:
            InvalidValueError: naming quantity and joint, for NaN, or a value that is not allowed.
        """
        n = len(self.joint_names)
        for quantity in RESPONSE_QUANTITIES:
            values = as_finite(getattr(self, quantity), quantity, (n,))
            wrong = values <= 0 if quantity == "speed_share" else values < 0
            if wrong.any() and quantity != "latency":
                j = int(np.argmax(wrong))
                allowed = "a number above 0" if quantity == "speed_share" else "a number of at least 0"
                raise InvalidValueError(f"{quantity} of {self.joint_names[j]}", values[j], allowed)
            object.__setattr__(self, quantity, read_only(values))
        intervals = {}
        for quantity in RESPONSE_QUANTITIES:
            interval = np.asarray(self.intervals.get(quantity, np.full((n, 2), np.nan)), dtype=float)
            if interval.shape != (n, 2):
                raise InvalidValueError(f"interval of {quantity}", f"shape {interval.shape}", f"({n}, 2)")
            intervals[quantity] = read_only(interval)
        object.__setattr__(self, "intervals", intervals)

    def changed(self, **quantities: ArrayLike | Mapping[str, float]) -> JointResponse:
        """Return a copy with other values.

        Args:
            **quantities: Any of `RESPONSE_QUANTITIES`: one number for all joints, shape (n,), or numbers by
                joint name; other joints keep their value.

        Raises:
            UnknownNameError: for a quantity or a joint that is not known.
            InvalidValueError: for a value that is not allowed.
        """
        new: dict[str, Any] = {}
        for quantity, value in quantities.items():
            if quantity not in RESPONSE_QUANTITIES:
                raise UnknownNameError("quantity of a response", quantity, RESPONSE_QUANTITIES)
            values = np.array(getattr(self, quantity))
            if isinstance(value, Mapping):
                for joint, one in value.items():
                    values[self.index(joint)] = one
            else:
                values[:] = value
            new[quantity] = values
        return replace(self, **new)

    def index(self, joint: str) -> int:
        """Return the index of a joint.

        Raises:
            UnknownNameError: for an unknown joint.
        """
        if joint not in self.joint_names:
            raise UnknownNameError("joint", joint, self.joint_names)
        return self.joint_names.index(joint)

    def following(self, pepper: PepperModel, joint: str, share: float, cycle: float) -> Following:
        """Return the parameters with which one joint follows targets.

        Args:
            pepper: The robot, for its velocity and acceleration limits.
            joint: Name of the joint.
            share: Fraction of the maximum speed that is given with the targets.
            cycle: Cycle time of the interpolation [s].
        """
        j, k = self.index(joint), pepper.joint_index(joint)
        return Following(
            cycle,
            share * float(self.speed_share[j]) * float(pepper.velocity_limits[k]),
            float(pepper.acceleration_limits[k]),
            float(self.lag[j]),
            float(self.backlash[j]),
        )


def joint_response(pepper: PepperModel, kind: str = "measured") -> JointResponse:
    """Return the response of a robot's joints to targets of `setAngles`.

    The values for Pepper are read from `data/joint_responses.json`, each with its interval and source.
    Joints that were not measured get the median of the others, and neither backlash nor compliance.  The
    base, and every joint of another robot, follows without delay.

    Args:
        pepper: The robot.
        kind: "measured", or "ideal": at the full speed, without latency, lag, backlash and compliance.

    Raises:
        InvalidValueError: for another kind.
    """
    check_choice("kind", kind, RESPONSES)
    known: dict[str, Any] = _read() if kind == "measured" and pepper.name.lower().startswith("pepper") else {}
    rows: dict[str, dict[str, list[float]]] = known.get("joints", {})
    usual = {q: _median([row[q][0] for row in rows.values() if q in row]) for q in _IDEAL}
    values = {quantity: np.full(pepper.n, _IDEAL[quantity]) for quantity in RESPONSE_QUANTITIES}
    intervals = {quantity: np.full((pepper.n, 2), np.nan) for quantity in RESPONSE_QUANTITIES}
    sources = ["ideal"] * pepper.n
    for j, joint in enumerate(pepper.joint_names):
        if not rows or joint.startswith("Base"):
            continue
        sources[j] = known["source"] if joint in rows else ASSUMED
        for quantity in RESPONSE_QUANTITIES:
            if quantity in rows.get(joint, ()):
                value, low, high = rows[joint][quantity]
                values[quantity][j], intervals[quantity][j] = value, (low, high)
            elif joint not in rows and quantity not in ("backlash", "compliance"):
                values[quantity][j] = usual[quantity]
    return JointResponse(pepper.joint_names, **values, intervals=intervals, sources=tuple(sources))


def _median(values: list[float]) -> float:
    return float(np.median(values)) if values else 0.0


@cache
def _read() -> dict[str, Any]:
    text = (files("pepper_kin.twin") / "data" / "joint_responses.json").read_text(encoding="utf-8")
    return dict(json.loads(text))
