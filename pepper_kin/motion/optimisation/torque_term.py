"""Torques as shares of the joints' efforts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.batch import kernel
from pepper_kin.motion.optimisation.moving import Moving
from pepper_kin.planners.optimisation import Rows, Wall

Array = NDArray[np.float64]


class TorqueTerm:
    """tau / limit of all joints with a finite effort, with exact derivatives from `symbolic`.

    Args:
        moving: The joints that move; torques of the others count, too.
        limits: Torques that count as 1 [N m or N], shape (n,), inf for none.
        per_interval: Samples in each interval of the spline.
    """

    def __init__(self, moving: Moving, limits: Array, per_interval: int) -> None:
        self.per_interval, self.wall = per_interval, Wall.WITHIN_ONE
        self._moving = moving
        self._rows = np.flatnonzero(np.isfinite(limits))
        self._scale = 1.0 / limits[self._rows]
        self._torque = kernel(moving.pepper, "inverse_dynamics")
        self._derivatives = kernel(moving.pepper, "inverse_dynamics_derivatives")

    def values(self, q: Array, v: Array, a: Array) -> Array:
        """Return the shares, shape (K, R), at states of the moving joints."""
        return self._shares(*self._whole(q, v, a))

    def rows(self, q: Array, v: Array, a: Array) -> Rows:
        """Return the shares and their derivatives."""
        state = self._whole(q, v, a)
        place = np.ix_(np.arange(len(q)), self._rows, self._moving.joints)
        scale = self._scale[:, None]
        return Rows(self._shares(*state), *(part[place] * scale for part in self._derivatives(*state)))

    def _whole(self, q: Array, v: Array, a: Array) -> tuple[Array, Array, Array]:
        return self._moving.positions(q), self._moving.rates(v), self._moving.rates(a)

    def _shares(self, q: Array, v: Array, a: Array) -> Array:
        return np.asarray(self._torque(q, v, a))[:, self._rows] * self._scale
