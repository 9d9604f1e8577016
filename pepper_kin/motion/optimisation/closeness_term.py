"""A cost of being near to things."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.motion.optimisation.clearance_term import INFLUENCE, ClearanceTerm
from pepper_kin.planners.optimisation import Rows, Wall

Array = NDArray[np.float64]

CLEARANCE_WISH = INFLUENCE
"""Distance at which things no longer cost [m]."""


class ClosenessTerm:
    """max(1 - distance / CLEARANCE_WISH, 0) of the nearest pairs at each sample.

    Args:
        clearance: Measures distances with no margin.
    """

    def __init__(self, clearance: ClearanceTerm) -> None:
        self.per_interval, self.wall = clearance.per_interval, Wall.ABOVE_ZERO
        self._clearance = clearance

    def values(self, q: Array, v: Array, a: Array) -> Array:
        """Return the values, shape (K, MOST_PAIRS), at states of the moving joints."""
        return 1.0 - self._clearance.values(q, v, a)

    def rows(self, q: Array, v: Array, a: Array) -> Rows:
        """Return the values and their derivatives."""
        rows = self._clearance.rows(q, v, a)
        return Rows(1.0 - rows.value, -rows.by_position)
