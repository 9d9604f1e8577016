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
        time: Of each sample [s], shape (k,).
        value: What the sensor said, shape (k, ...).
        truth: What an ideal sensor would have said, shape (k, ...).
        unit: Unit of both.
        frame: The frame that they are expressed in or measured from; empty for values per joint.
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
