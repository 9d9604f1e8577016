"""What stops motions that lead away from states: the first invalid states along random edges."""

from __future__ import annotations

import numpy as np

from .problem import Problem
from .vectors import FloatArray, whole_number

_STREAM = 0x5407


def first_invalid_states(problem: Problem, states: FloatArray, count: int, *, seed: int = 0) -> FloatArray:
    """Return where random straight motions away from valid states become invalid.

    Each leads from one of the states to an even sample of the box, and is looked at in steps of the problem's
    resolution.

    Args:
        problem: Box, metric, resolution and validity.
        states: Valid states, shape (k, n).
        count: Number of motions.
        seed: Seed of the choices.

    Returns:
        Shape (m, n), m <= count: of each motion that is stopped the first state that is not valid.

    Raises:
        InvalidValueError: The seed is not allowed, or the checker answers in a wrong shape.
    """
    rng, validator = np.random.default_rng((_STREAM, whole_number("seed", seed))), problem.validator()
    origins = states[rng.integers(len(states), size=count)]
    targets = rng.uniform(problem.lower, problem.upper, (count, problem.n))
    found = []
    for origin, target in zip(origins, targets, strict=True):
        steps = max(1, int(np.ceil(problem.metric.distance(origin, target) / problem.spacing)))
        edge = origin + np.arange(1, steps + 1)[:, None] / steps * (target - origin)
        valid = validator.states_valid(edge)
        if not valid.all():
            found.append(edge[int(np.argmin(valid))])
    return np.array(found).reshape(-1, problem.n)
