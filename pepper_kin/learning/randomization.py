"""Domain randomization: ranges of uncertain quantities of robots, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_finite
from pepper_kin.twin import actuator_parameters
from pepper_kin.twin.actuator_data import measured_ranges
from pepper_kin.twin.actuators import QUANTITIES

Range: TypeAlias = tuple[float, float]
OTHERS = ("mass", "latency")


class Randomization:
    """Ranges from which the quantities of each robot of a batch are drawn uniformly.

    Quantities of `ActuatorParameters`, such as "stiffness", are factors, one for each joint; "mass" is a
    factor for the links that move with each joint; "latency" is the delay of commands [s].

    Args:
        ranges: Quantity -> (low, high), or quantity -> {joint: (low, high)} for some joints.  If omitted, the
            measured intervals of a real Pepper: the stiffness of ten joints, and the latency.

    Raises:
        UnknownNameError: for an unknown quantity.
        InvalidValueError: for an invalid range, or factors that are not above 0.
    """

    def __init__(self, ranges: Mapping[str, Range | Mapping[str, Range]] | None = None) -> None:
        self._measured = ranges is None
        self._ranges: dict[str, dict[str, Range]] = {}
        for name, value in (ranges or {}).items():
            if name not in (*QUANTITIES, *OTHERS):
                raise UnknownNameError("quantity to randomize", name, (*QUANTITIES, *OTHERS))
            by_joint = value if isinstance(value, Mapping) and name != "latency" else {"": value}
            self._ranges[name] = {joint: _checked(name, each) for joint, each in by_joint.items()}

    def drawn(self, pepper: PepperModel, count: int, seed: int) -> dict[str, Any]:
        """Return the options of `TwinBatch` by which N robots differ.

        Args:
            pepper: The robot.
            count: Number N of robots.
            seed: Seed of the quantities.

        Raises:
            UnknownNameError: for a joint that the robot lacks.
        """
        generator, usual = np.random.default_rng(seed), actuator_parameters(pepper)
        vary: dict[str, Any] = {}
        options: dict[str, Any] = {"vary": vary}
        ranges = measured_ranges(pepper) if self._measured else self._ranges
        for quantity, by_joint in ranges.items():
            if quantity == "latency":
                vary[quantity] = generator.uniform(*by_joint[""], count)
                continue
            factors = np.ones((count, pepper.n))
            for joint, (low, high) in by_joint.items():
                places = slice(None) if joint == "" else [pepper.joint_index(joint)]
                factors[:, places] = generator.uniform(low, high, factors[:, places].shape)
            if quantity == "mass":
                options["mass_scale"] = {name: factors[:, j] for j, name in enumerate(pepper.joint_names)}
            else:
                vary[quantity] = np.asarray(getattr(usual, quantity)) * factors
        return options


def _checked(name: str, value: Any) -> Range:
    """Return a range, or refuse it."""
    ends: Array = as_finite(value, f"range of {name}", (2,))
    low, high = ends.tolist()
    least_is_good = low >= 0.0 if name == "latency" else low > 0.0
    if not (least_is_good and low <= high):
        allowed = "low and high, low at most high, and " + (
            "at least 0 s" if name == "latency" else "above 0"
        )
        raise InvalidValueError(f"range of {name}", (low, high), allowed)
    return low, high
