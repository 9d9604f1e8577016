"""First invalid states, or blocking constraints, along walks on a manifold."""

from __future__ import annotations

from collections import Counter

import numpy as np

from .cbirrt import Explorer
from .constraint_manifold import ConstraintManifold, extend
from .deadline import Deadline
from .frontier import motions_away
from .problem import Problem
from .vectors import FloatArray

_SECONDS = 0.2  # time budget of all walks [s]


def first_blocked_states(
    problem: Problem, manifold: ConstraintManifold, states: FloatArray, count: int, *, seed: int = 0
) -> tuple[FloatArray, Counter[str]]:
    """Return where random walks away from states on a manifold become invalid, and what constraints end them.

    Each walk leads from one of the states towards a uniform sample of the box, along the manifold.

    Args:
        problem: Box, metric, resolution and validity.
        manifold: The constraints.
        states: Valid states on the manifold, shape (k, n).
        count: Number of walks.
        seed: Seed of the choices.

    Returns:
        First invalid state of each walk that has one, shape (m, n); and by the name of each constraint, how
        many walks it keeps from coming nearer to their targets.
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
