"""Readings over time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.twin.sensors.reading import Reading


@dataclass(frozen=True, eq=False)
class ReadingSeries:
    """The samples of one sensor, in order; arrays are read-only.

    Attributes:
        time: Of each sample [s], shape (k,).
        value: What the sensor said, shape (k, ...).
        truth: What an ideal sensor would have said, shape (k, ...).
        unit: Unit of both.
        frame: The frame that they are expressed in or seen from; empty for values per joint.
    """

    time: NDArray[np.float64]
    value: NDArray[Any]
    truth: NDArray[Any]
    unit: str
    frame: str

    def __post_init__(self) -> None:
        for name in ("time", "value", "truth"):
            copy = np.array(getattr(self, name))
            copy.setflags(write=False)
            object.__setattr__(self, name, copy)

    def __len__(self) -> int:
        return len(self.time)

    @classmethod
    def of(cls, readings: Iterable[Reading], start: float = 0.0) -> ReadingSeries:
        """Join readings of one sensor, one or more.

        Args:
            readings: In the order of time.
            start: Time that becomes 0 [s].
        """
        rows = list(readings)
        return cls(
            np.array([row.time for row in rows]) - start,
            np.stack([row.value for row in rows]),
            np.stack([row.truth for row in rows]),
            rows[0].unit,
            rows[0].frame,
        )
