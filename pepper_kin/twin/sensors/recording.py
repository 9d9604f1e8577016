"""Readings over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import FrozenArrays, read_only


@dataclass(frozen=True, eq=False)
class ReadingSeries(FrozenArrays):
    """The samples of one sensor, in order; arrays are read-only.

    Attributes:
        time: Time of each sample [s], shape (k,).
        value: Readings of the sensor, shape (k, ...).
        truth: Readings of an ideal sensor, shape (k, ...).
        unit: Unit of value and truth.
        frame: Frame that the values are expressed in or measured from; empty for values per joint.
    """

    time: NDArray[np.float64]
    value: NDArray[Any]
    truth: NDArray[Any]
    unit: str
    frame: str

    def __post_init__(self) -> None:
        for name in ("time", "value", "truth"):
            value = np.asarray(getattr(self, name))
            object.__setattr__(self, name, read_only(value, value.dtype))

    def __len__(self) -> int:
        return len(self.time)
