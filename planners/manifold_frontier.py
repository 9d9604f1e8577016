"""First invalid states, or constraints, along walks on a manifold."""

from __future__ import annotations

from collections import Counter

import numpy as np

from .cbirrt import Explorer
from .constraint_manifold import ConstraintManifold, extend
from .deadline import Deadline
from .frontier import motions_away
from .problem import Problem
from .vectors import FloatArray

_SECONDS = 0.2  # for all walks


def first_blocked_states(
    problem: Problem, manifold: ConstraintManifold, states: FloatArray, count: int, *, seed: int = 0
) -> tuple[FloatArray, Counter[str]]:
    """Return where random walks away from states on a manifold become invalid, and what else ends them.

    Each leads from one of the states towards an even sample of the box, along the manifold.

    Args:
        problem: Box, metric, resolution and validity.
        manifold: The constraints.
        states: Valid states on it, shape (k, n).
        count: Number of walks.
        seed: Seed of the choices.

    Returns:
        Shape (m, n), of each walk that something stops the first state that is not valid; and how often each
        constraint, by its name, lets a walk lead no nearer to its aim.
    """
    invalid, ended = [], Counter[str]()
    with Explorer(problem, manifold, Deadline(_SECONDS)) as explorer:
        for origin, target in zip(*motions_away(problem, states, count, seed), strict=True):
            if explorer.stopped:
                break
            walked, _ = explorer.walk(origin, target, exact=False)
            last = walked[-1].copy() if len(walked) else origin.copy()
            following = np.empty((1, problem.n))
            got = extend(explorer.surface, last, target.copy(), explorer.resolution, False, following)
            if got not in (0, -1):
                if not explorer.valid(following[0]):
                    invalid.append(following[0].copy())
                continue
            distance = float(problem.metric.distance(last, target))
            step = last + min(1.0, explorer.resolution / max(distance, 1e-12)) * (target - last)
            use = manifold.errors(step[None])[0] / manifold.tolerances
            ended[(manifold.names or ())[int(np.argmax(use))]] += 1
    return np.array(invalid).reshape(-1, problem.n), ended
