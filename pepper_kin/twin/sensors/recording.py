"""Readings over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class ReadingSeries:
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
            copy = np.array(getattr(self, name))
            copy.setflags(write=False)
            object.__setattr__(self, name, copy)

    def __len__(self) -> int:
        return len(self.time)
