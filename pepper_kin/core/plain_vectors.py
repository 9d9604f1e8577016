"""Fast checks of the arguments of frequent calls: vectors of equal length within range."""

from __future__ import annotations

from pepper_kin.kernels import compiled
from pepper_kin.kernels.signatures import Floats1

MOST_SQUARED = 1e18
"""Square of the maximum position, velocity, acceleration or torque (`MOST` of `model/joint_vectors.py`)."""


@compiled(inline=True)
def in_range(n: int, x: Floats1) -> bool:
    """Return whether x has shape (n,) and a sum of squares of at most MOST_SQUARED; NaN fails."""
    if x.size != n:
        return False
    total = 0.0
    for i in range(n):
        total += x[i] * x[i]
    return total <= MOST_SQUARED


@compiled("boolean(int64, float64[::1])")
def is_plain(n: int, a: Floats1) -> bool:
    """Return whether a vector has shape (n,) and is within range."""
    return in_range(n, a)


@compiled("boolean(int64, float64[::1], float64[::1])")
def are_two_plain(n: int, a: Floats1, b: Floats1) -> bool:
    """Return whether two vectors have shape (n,) and are within range."""
    return in_range(n, a) and in_range(n, b)


@compiled("boolean(int64, float64[::1], float64[::1], float64[::1])")
def are_three_plain(n: int, a: Floats1, b: Floats1, c: Floats1) -> bool:
    """Return whether three vectors have shape (n,) and are within range."""
    return in_range(n, a) and in_range(n, b) and in_range(n, c)
