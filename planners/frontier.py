"""First invalid states along random edges away from given states."""

from __future__ import annotations

import numpy as np

from pepper_kin.exceptions import InvalidValueError

from .problem import Problem
from .vectors import FloatArray, finite_points, read_only, seed_number, whole_number

FRONTIER = 64
"""Maximum number of nodes of a stuck tree that planners return."""

_STREAM = 0x5407
_FAR = 1000.0  # maximum distance of states from the box, in diagonals
_MOST = 1_000_000  # maximum number of motions, limited by memory


def spread(states: FloatArray) -> FloatArray:
    """Return some of the nodes of a tree, shape (m, n), from the first to the last, read-only."""
    return read_only(states[np.linspace(0, len(states) - 1, min(len(states), FRONTIER)).astype(int)])


def motions_away(
    problem: Problem, states: FloatArray, count: int, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Return starts and ends of random motions away from states, shape (k, n); (count, n) each."""
    rng = np.random.default_rng((_STREAM, seed_number(seed)))
    states, count = finite_points("states", states, problem.n), whole_number("count", count, 0, _MOST)
    beyond = np.abs(states - np.clip(states, problem.lower, problem.upper)).max()
    if beyond > _FAR * problem.diagonal:  # states may lie full turns outside the box, but steps must be few
        raise InvalidValueError("states", states[np.abs(states).argmax() // problem.n], "states near the box")
    origins = states[rng.integers(len(states), size=count)]
    return origins, rng.uniform(problem.lower, problem.upper, (count, problem.n))


def first_invalid_states(problem: Problem, states: FloatArray, count: int, *, seed: int = 0) -> FloatArray:
    """Return where random straight motions away from valid states become invalid.

    Each motion leads from one of the states to a uniform sample of the box, and is checked in steps of the
    problem's resolution.

    Args:
        problem: Box, metric, resolution and validity.
        states: Valid states, shape (k, n).
        count: Number of motions.
        seed: Seed of the choices.

    Returns:
        First invalid state of each motion that has one, shape (m, n), m <= count.

    Raises:
        InvalidValueError: The states are not points near the problem's box, the count or the seed is not
            allowed, or the checker answers in a wrong shape.
    """
    validator, found = problem.validator(), []
    for origin, target in zip(*motions_away(problem, states, count, seed), strict=True):
        steps = max(1, int(np.ceil(problem.metric.distance(origin, target) / problem.spacing)))
        edge = origin + np.arange(1, steps + 1)[:, None] / steps * (target - origin)
        valid = validator.states_valid(edge)
        if not valid.all():
            found.append(edge[int(np.argmin(valid))])
    return np.array(found).reshape(-1, problem.n)
