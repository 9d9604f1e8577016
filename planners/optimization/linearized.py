"""A term in whose place its tangent stands."""

from __future__ import annotations

import numpy as np

from ..vectors import FloatArray
from .rows import Rows, Term


class Linearized:
    """value(q0) + d value/dq (q - q0) at each sample, of a term of positions only.

    Distances to the nearest of many things have kinks where another becomes the nearest, and no slope inside
    of one; general solvers stumble over both.

    Args:
        term: The term.
        q: Positions at its samples where the tangents touch, shape (K, n).
    """

    def __init__(self, term: Term, q: FloatArray) -> None:
        self.per_interval, self.barrier_bound = term.per_interval, term.barrier_bound
        still = np.zeros_like(q)
        self._q, self._rows = q, term.rows(q, still, still)

    def values(self, q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        """Return the values, shape (K, R), at positions, shape (K, n)."""
        change = np.einsum("krn,kn->kr", self._rows.by_position, q - self._q)
        return np.asarray(self._rows.value + change)

    def rows(self, q: FloatArray, v: FloatArray, a: FloatArray) -> Rows:
        """Return the values and their derivatives."""
        return Rows(self.values(q, v, a), self._rows.by_position)
