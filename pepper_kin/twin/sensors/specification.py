"""Specifications of the sensors: mounting, rate, bias and noise."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from types import MappingProxyType

from pepper_kin.exceptions import InvalidValueError


@dataclass(frozen=True)
class SensorSpecification:
    """Specification of a sensor; `dataclasses.replace` returns one with other values.

    Attributes:
        name: Name of the sensor in the suite.
        kind: Kind of the sensor: "joint_encoders", "joint_torques", "accelerometer", "gyroscope",
            "orientation", "sonar", "laser", "switch", "wheel_odometry", "color_camera" or "depth_camera".
        frame: Frame of the robot that it is mounted on; empty for values per joint.
        rate: Sampling rate [Hz].
        unit: Unit of its readings.
        source: Source of the numbers, or "assumed".
        noise: Standard deviation of each sample, in its unit (orientation: rad).
        bias: Standard deviation of the error drawn once per seed, in its unit (orientation: rad).
        resolution: Resolution of readings, in its unit; 0 for none.
        minimum: Minimum distance that is measured [m].
        maximum: Maximum distance or value that is measured, in its unit.
        field_of_view: Full angle of cone or fan [rad].
        beams: Number of beams of a laser.
        height: Height of a laser's beams above its frame [m].
        noise_growth: Additional noise of a depth camera per squared distance beyond the minimum [1/m].
        error_rate: Fraction of a switch's samples that are wrong.
        pad: Full lengths of the box that presses a switch, in its frame [m].
    """

    name: str
    kind: str
    frame: str
    rate: float
    unit: str
    source: str
    noise: float = 0.0
    bias: float = 0.0
    resolution: float = 0.0
    minimum: float = 0.0
    maximum: float = math.inf
    field_of_view: float = 0.0
    beams: int = 0
    height: float = 0.0
    noise_growth: float = 0.0
    error_rate: float = 0.0
    pad: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: for a value that is not allowed, naming sensor and quantity.
        """
        if not (math.isfinite(self.rate) and self.rate > 0):
            raise InvalidValueError(f"rate of {self.name}", self.rate, "a finite number above 0 [Hz]")
        for quantity in ("noise", "bias", "resolution", "minimum", "noise_growth"):
            value = getattr(self, quantity)
            if not (math.isfinite(value) and value >= 0):
                raise InvalidValueError(f"{quantity} of {self.name}", value, "a finite number of at least 0")
        if not self.maximum > self.minimum:
            raise InvalidValueError(f"maximum of {self.name}", self.maximum, f"more than {self.minimum}")
        if not 0 <= self.error_rate <= 1:
            raise InvalidValueError(f"error_rate of {self.name}", self.error_rate, "a share from 0 to 1")

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return 1.0 / self.rate


@cache
def sensor_specifications() -> Mapping[str, SensorSpecification]:
    """Return Pepper's sensors by name, read-only; the numbers are in `twin/data/sensors.json`."""
    text = (files("pepper_kin.twin") / "data" / "sensors.json").read_text(encoding="utf-8")
    found = {}
    for name, row in json.loads(text)["sensors"].items():
        if "pad" in row:
            row["pad"] = tuple(row["pad"])
        found[name] = SensorSpecification(name=name, **row)
    return MappingProxyType(found)
