"""A moving body as Python floats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.symbolic.vectors import Matrix, Vector


@dataclass(frozen=True)
class Inertia:
    """Mass distribution of a body about the origin of its frame.

    Attributes:
        mass: m [kg].
        first: h = sum(m x), three values [kg m].
        second: Sigma = sum(m x x^T), three rows [kg m^2]; the inertia tensor is tr(Sigma) 1 - Sigma.
    """

    mass: float
    first: Vector
    second: Matrix


@dataclass(frozen=True)
class SymbolicBody:
    """A moving body.

    Attributes:
        parent: Index of its parent in the tree, -1 for the world.
        slides: Whether its joint is prismatic; both kinds act along the body's z axis.
        rotation: Constant rotation of the frame at q = 0 to the parent's.
        translation: Origin in the parent's frame at q = 0 [m].
        inertia: Mass distribution.
    """

    parent: int
    slides: bool
    rotation: Matrix
    translation: Vector
    inertia: Inertia


def numbers(array: NDArray[np.float64]) -> tuple[Any, ...]:
    """Return an array of any shape as nested tuples of Python floats."""
    return tuple(numbers(row) if np.ndim(row) else float(row) for row in array)


def clean(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an array of any shape with entries that are only rounding errors set to zero."""
    size = np.abs(array).max() if array.size else 0.0
    return np.where(np.abs(array) <= 1e-15 * size, 0.0, array)
