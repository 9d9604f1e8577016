"""The joints that a motion moves, among all joints of the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Moving:
    """Some joints of a robot, the others standing still.

    Attributes:
        pepper: The robot.
        joints: Places of the joints that move, rising, shape (k,).
        rest: A whole configuration, whose other joints hold, shape (n,) [rad or m].
    """

    pepper: PepperModel
    joints: NDArray[np.int64]
    rest: Array

    def positions(self, x: Array) -> Array:
        """Return whole configurations, shape (m, n), of the moving joints' positions, shape (m, k)."""
        q = np.tile(self.rest, (len(x), 1))
        q[:, self.joints] = x
        return q

    def rates(self, x: Array) -> Array:
        """Return whole velocities or accelerations, shape (m, n), of the moving joints' ones."""
        v = np.zeros((len(x), self.pepper.n))
        v[:, self.joints] = x
        return v
