"""Inequalities on the next velocity, each with a name to report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array

# An excess smaller than this is rounding [m/s].
NOTICEABLE = 1e-6


@dataclass(frozen=True, eq=False)
class VelocityRows:
    """C v >= least.

    Attributes:
        matrix: C, shape (k, n).
        least: Shape (k,).
        names: What each keeps, in words.
    """

    matrix: Array
    least: Array
    names: tuple[str, ...]

    def within(self, low: Array, high: Array) -> VelocityRows:
        """Return only those that some velocity within a box would break.

        Args:
            low: Lowest velocities [rad/s or m/s], shape (n,).
            high: Highest velocities [rad/s or m/s], shape (n,).
        """
        slowest = np.minimum(self.matrix * low, self.matrix * high).sum(axis=1)
        kept = (slowest < self.least).nonzero()[0]
        return VelocityRows(self.matrix[kept], self.least[kept], tuple(self.names[i] for i in kept))

    def admitting(self, v: Array) -> VelocityRows:
        """Return rows relaxed so far that a velocity [rad/s or m/s], shape (n,), keeps them."""
        if not self.names:
            return self
        return VelocityRows(self.matrix, np.minimum(self.least, self.matrix @ v), self.names)

    def attainable(self, low: Array, high: Array) -> VelocityRows:
        """Return rows relaxed so far that each of them can be kept by some velocity within a box.

        Args:
            low: Lowest velocities [rad/s or m/s], shape (n,).
            high: Highest velocities [rad/s or m/s], shape (n,).
        """
        if not self.names:
            return self
        best = np.maximum(self.matrix * low, self.matrix * high).sum(axis=1)
        return VelocityRows(self.matrix, np.minimum(self.least, best), self.names)

    def share(self, start: Array, end: Array) -> float:
        """Return how far v may go from one velocity to another before it breaks a row, 0 to 1.

        Args:
            start: The first velocity [rad/s or m/s], shape (n,).
            end: The other [rad/s or m/s], shape (n,).
        """
        if not self.names:
            return 1.0
        slack, change = self.matrix @ start - self.least, self.matrix @ (end - start)
        falling = change < 0.0
        return float(np.clip((slack[falling] / -change[falling]).min(initial=1.0), 0.0, 1.0))

    def broken(self, v: Array) -> tuple[str, ...]:
        """Return the names of those that v [rad/s or m/s], shape (n,), breaks, each once."""
        return self._named(self.least - self.matrix @ v > NOTICEABLE) if self.names else ()

    def active(self, v: Array) -> tuple[str, ...]:
        """Return the names of those that v [rad/s or m/s], shape (n,), touches, each once."""
        return self._named(self.matrix @ v - self.least < NOTICEABLE) if self.names else ()

    def _named(self, which: NDArray[np.bool_]) -> tuple[str, ...]:
        """Return the names of those where `which`, shape (k,), is true, each once."""
        return tuple(dict.fromkeys([self.names[i] for i in which.nonzero()[0].tolist()]))


def stacked(parts: Sequence[VelocityRows], n: int) -> VelocityRows:
    """Return several sets of rows as one."""
    parts = [part for part in parts if part.names]
    if not parts:
        return VelocityRows(np.empty((0, n)), np.empty(0), ())
    if len(parts) == 1:
        return parts[0]
    return VelocityRows(
        np.concatenate([part.matrix for part in parts]),
        np.concatenate([part.least for part in parts]),
        tuple(name for part in parts for name in part.names),
    )
