"""Short-cutting in machine code, seen from Python."""

from __future__ import annotations

import numpy as np

from . import native_shortcut as native
from .compiled_validity import CompiledValidity
from .compiled_world import world_of
from .deadline import Deadline
from .native import CLOCK, stream_key
from .problem import Problem
from .shortcut import FLAT
from .vectors import FloatArray

_STREAM = 1
_SPARE = 32


def shorten_compiled(
    problem: Problem,
    oracle: CompiledValidity,
    points: FloatArray,
    deadline: Deadline,
    seed: int,
    iterations: int,
    resolution: float,
    least_gain: float,
) -> FloatArray:
    """Return a shorter polyline; see `shortcut` for the method and the arguments."""
    world, n = world_of(problem, oracle, resolution), problem.n
    key, counters = stream_key(seed, _STREAM), np.zeros(native.COUNTERS, dtype=np.int64)
    points = np.array(points)
    flat = FLAT * problem.metric.arc_lengths(points)[-1]
    counters[native.SIZE] = native.drop_flat(points, len(points), world.weights, flat)
    ended, rows = native.FULL, np.empty((2, n))
    while ended == native.FULL or (ended == native.TIME_UP and not deadline.expired):
        if ended == native.FULL:
            size = int(counters[native.SIZE])
            room = np.empty((size + max(size, _SPARE), n))
            room[:size] = points[:size]
            points = room
        ended = native.shorten(
            world, CLOCK, deadline.piece, least_gain, FLAT, key, iterations, points, np.empty_like(points),
            np.empty((2, len(points))), rows, counters,
        )  # fmt: skip
    return points[: counters[native.SIZE]].copy()
