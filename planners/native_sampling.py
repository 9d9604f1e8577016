"""Random states in machine code: in a box, near an edge, and where a path through them is short enough."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from .native import uniform
from .vectors import FloatArray

_LARGEST, _HALVINGS = 0.5, 10.0  # of the shifts off a path: from half its length down to a two-thousandth


@njit(nogil=True, cache=True, error_model="numpy")
def _normal(key: np.uint64, place: int) -> float:
    """Return a normally distributed number made of two of the stream.

    Source: G. E. P. Box and M. E. Muller, A note on the generation of random normal deviates, 1958.
    """
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(key, place)))
    return radius * math.cos(2.0 * math.pi * uniform(key, place + 1))


@njit(nogil=True, cache=True, error_model="numpy")
def random_state(
    key: np.uint64, place: int, lower: FloatArray, extent: FloatArray, sample: FloatArray
) -> int:
    """Write an even sample of a box; return how many numbers were drawn."""
    for i in range(sample.size):
        sample[i] = lower[i] + uniform(key, place + i) * extent[i]
    return sample.size


@njit(nogil=True, cache=True, error_model="numpy")
def near_path(
    key: np.uint64,
    place: int,
    a: FloatArray,
    b: FloatArray,
    length: float,
    lower: FloatArray,
    extent: FloatArray,
    weights: FloatArray,
    sample: FloatArray,
) -> int:
    """Write a sample near an edge from a to b, at a distance of any order of magnitude; return numbers drawn.

    It is clipped to the box.
    """
    n = sample.size
    fraction = uniform(key, place)
    shift = length * _LARGEST * 2.0 ** (-_HALVINGS * uniform(key, place + 1)) / math.sqrt(n)
    for i in range(n):
        value = a[i] + fraction * (b[i] - a[i]) + shift * _normal(key, place + 2 + 2 * i) / weights[i]
        sample[i] = min(max(value, lower[i]), lower[i] + extent[i])
    return 2 * n + 2


@njit(nogil=True, cache=True, error_model="numpy")
def within_ellipsoid(
    key: np.uint64,
    place: int,
    start: FloatArray,
    goal: FloatArray,
    length: float,
    lower: FloatArray,
    extent: FloatArray,
    weights: FloatArray,
    axis: FloatArray,
    sample: FloatArray,
) -> bool:
    """Write an even sample of the states through which a path from start to goal is no longer than a length.

    They form an ellipsoid whose foci are start and goal.  A sample of the unit ball is stretched along the
    first axis, which a Householder reflection then turns into the direction of the goal.  2 n + 1 numbers are
    drawn; `axis` is room, shape (n,).

    Source: J. D. Gammell, S. S. Srinivasa and T. D. Barfoot, Informed RRT*, IROS 2014.

    Returns:
        Whether the sample is inside the box.
    """
    n = sample.size
    apart = square = 0.0
    for i in range(n):
        axis[i] = (goal[i] - start[i]) * weights[i]
        apart += axis[i] * axis[i]
        sample[i] = _normal(key, place + 2 * i)
        square += sample[i] * sample[i]
    apart = math.sqrt(apart)
    radius = uniform(key, place + 2 * n) ** (1.0 / n) / math.sqrt(square)
    across = 0.5 * math.sqrt(max(length * length - apart * apart, 0.0))
    for i in range(n):
        sample[i] *= radius * (0.5 * length if i == 0 else across)
        axis[i] = axis[i] / apart if apart > 0.0 else (1.0 if i == 0 else 0.0)
    axis[0] -= 1.0  # the normal of the mirror that takes the first axis to the direction
    normal = along = 0.0
    for i in range(n):
        normal += axis[i] * axis[i]
        along += axis[i] * sample[i]
    inside = True
    for i in range(n):
        mirrored = sample[i] - (2.0 * along / normal * axis[i] if normal > 0.0 else 0.0)
        sample[i] = 0.5 * (start[i] + goal[i]) + mirrored / weights[i]
        inside = inside and lower[i] <= sample[i] <= lower[i] + extent[i]
    return inside
