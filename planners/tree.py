"""A tree of states with vectorised nearest-neighbour search, grown in place."""

from __future__ import annotations

import numpy as np

from .metric import Metric
from .vectors import FloatArray

_FIRST_CAPACITY = 512


class Tree:
    """A forest of states: each node but the roots has a parent that was added before it.

    Distances are compared as ``|w x|^2 / 2 - (w x) . (w q)``, which orders nodes x like ``d(x, q)`` at the
    price of one matrix-vector product.  Coordinates are taken from the first root, which keeps the rounding
    small.

    Attributes:
        size: Number of nodes.
    """

    def __init__(self, roots: FloatArray, metric: Metric) -> None:
        """Plant the roots.

        Args:
            roots: Shape (k, n), k >= 1.
            metric: The metric of the nearest-neighbour search.
        """
        n = roots.shape[1]
        self.size = 0
        self._weights = metric.weights
        self._origin = roots[0].copy()
        self._states = np.empty((_FIRST_CAPACITY, n))
        self._scaled = np.empty((_FIRST_CAPACITY, n))
        self._half_norms = np.empty(_FIRST_CAPACITY)
        self._parents = np.empty(_FIRST_CAPACITY, dtype=np.int64)
        self._append(roots, np.full(len(roots), -1))

    def state(self, index: int) -> FloatArray:
        """Return the state of a node, shape (n,)."""
        return self._states[index]

    def nearest(self, query: FloatArray) -> int:
        """Return the index of the node nearest to a state of shape (n,)."""
        scaled = (query - self._origin) * self._weights
        return int(np.argmin(self._half_norms[: self.size] - self._scaled[: self.size] @ scaled))

    def add_chain(self, parent: int, states: FloatArray) -> int:
        """Add states one after the other, the first below the parent; return the index of the last.

        Args:
            parent: Index of an existing node.
            states: Shape (m, n), m >= 1.
        """
        parents = np.arange(self.size - 1, self.size - 1 + len(states))
        parents[0] = parent
        self._append(states, parents)
        return self.size - 1

    def add_roots(self, roots: FloatArray) -> None:
        """Plant further roots, shape (k, n)."""
        self._append(roots, np.full(len(roots), -1))

    def branch(self, index: int) -> list[int]:
        """Return the indices of the nodes from a root to a node, both included."""
        nodes = [index]
        while (index := int(self._parents[index])) >= 0:
            nodes.append(index)
        return nodes[::-1]

    def states(self, indices: list[int]) -> FloatArray:
        """Return the states of some nodes, shape (m, n)."""
        return self._states[indices]

    def _append(self, states: FloatArray, parents: np.ndarray) -> None:
        size = self.size + len(states)
        if size > len(self._states):
            self._reserve(max(size, 2 * len(self._states)))
        new = slice(self.size, size)
        scaled = (states - self._origin) * self._weights
        self._states[new], self._scaled[new], self._parents[new] = states, scaled, parents
        self._half_norms[new] = 0.5 * np.einsum("ij,ij->i", scaled, scaled)
        self.size = size

    def _reserve(self, capacity: int) -> None:
        for name in ("_states", "_scaled", "_half_norms", "_parents"):
            old = getattr(self, name)
            grown = np.empty((capacity, *old.shape[1:]), dtype=old.dtype)
            grown[: self.size] = old[: self.size]
            setattr(self, name, grown)
