"""Random states in machine code: in a box, and where a path through them is short enough."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from pepper_kin.core.random_numbers import FIRST, GAMMA, SECOND, mixed
from pepper_kin.kernels.compiled_function import compiled

from .search_space import SearchSpace
from .vectors import FloatArray

_WORD = 2**64 - 1


@compiled("float64(uint64, int64)", lean=True)
def uniform(key: np.uint64, number: int) -> float:
    """Return the random number in [0, 1) at an index of the stream of a key."""
    z = mixed(key + np.uint64(number + 1) * GAMMA)
    return np.int64(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@lru_cache(maxsize=1024)
@lru_cache(maxsize=256)
def stream_key(seed: int, stream: int) -> np.uint64:
    """Return the key of one of several streams of a seed, so that neighboring seeds share no numbers."""
    value = _mixed(stream + 1)
    while True:  # a seed may have any number of 64-bit words
        value = _mixed(value + (seed & _WORD))
        seed >>= 64
        if not seed:
            return np.uint64(value)


def _mixed(value: int) -> int:
    """Spread every bit of a number over all 64 bits of another."""
    value = (value + int(GAMMA)) & _WORD
    value = (value ^ (value >> 30)) * int(FIRST) & _WORD
    value = (value ^ (value >> 27)) * int(SECOND) & _WORD
    return value ^ (value >> 31)


def luby(k: int) -> int:
    """Return the k-th number, from 1, of the sequence 1, 1, 2, 1, 1, 2, 4, ..."""
    while (k + 1) & k:
        k -= (1 << (k.bit_length() - 1)) - 1
    return (k + 1) >> 1


@compiled(lean=True)
def normal_number(key: np.uint64, place: int) -> float:
    """Return a normally distributed number, made of two numbers of the stream.

    Source: G. E. P. Box and M. E. Muller, A note on the generation of random normal deviates, 1958.
    """
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(key, place)))
    return radius * math.cos(2.0 * math.pi * uniform(key, place + 1))


@compiled(lean=True)
def random_state(space: SearchSpace, key: np.uint64, place: int, sample: FloatArray) -> int:
    """Write a uniform sample of the box, shape (n,); return how many numbers were drawn."""
    for i in range(sample.size):
        sample[i] = space.lower[i] + uniform(key, place + i) * space.extent[i]
    return sample.size


@compiled(lean=True)
def within_ellipsoid(
    space: SearchSpace,
    key: np.uint64,
    place: int,
    start: FloatArray,
    goal: FloatArray,
    length: float,
    axis: FloatArray,
    sample: FloatArray,
) -> bool:
    """Write a uniform sample of the states on paths from start to goal that are no longer than a length.

    The states form an ellipsoid whose foci are start and goal.  A sample of the unit ball is stretched along
    the first axis, which a Householder reflection then maps to the direction of the goal.  2 n + 1 numbers
    are drawn; `axis` is scratch space, shape (n,).

    Source: J. D. Gammell, S. S. Srinivasa and T. D. Barfoot, Informed RRT*, IROS 2014.

    Returns:
        Whether the sample is inside the box.
    """
    n, weights, lower = sample.size, space.weights, space.lower
    apart = square = 0.0
    for i in range(n):
        axis[i] = (goal[i] - start[i]) * weights[i]
        apart += axis[i] * axis[i]
        sample[i] = normal_number(key, place + 2 * i)
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
        inside = inside and lower[i] <= sample[i] <= lower[i] + space.extent[i]
    return inside
