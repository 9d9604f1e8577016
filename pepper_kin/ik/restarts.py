"""Where to start again: points that fill the joint box evenly, near ones first, then promising ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pepper_kin.ik.problem import Problem
from pepper_kin.ik.tasks.task import Array

# How far from q0 the first restarts lie, as a fraction of the way to a point of the box; the others go all
# the way.  Of these every second pair takes the best of so many points: a target beyond reach has many local
# minima, and a start near the target finds the least of them more often.  The pairs between take points as
# they come: the best points may all lie in the basin of one near miss.
REACH = (0.3, 0.6)
CANDIDATES = 16

# Standard deviations of the shifts that look for a way round an obstacle [rad or m].
SPREADS = (0.1, 0.2, 0.4)


def starts(problem: Problem, seed: int, count: int) -> Iterator[Array]:
    """Yield q0 and then `count` further starts within the bounds, each of shape (n,) [rad or m].

    The points x_k = frac(x_0 + k alpha) of Roberts (The unreasonable effectiveness of quasirandom sequences,
    2018), with alpha_i = phi^-i and phi the real root of phi^(m+1) = phi + 1, are even in all m dimensions;
    the seed draws x_0.  Every other start keeps the joints that carry much (hip and knee) at q0, where
    gravity is easiest to bear.

    Args:
        problem: Gives q0, bounds and the joints that move; a joint without bounds starts within pi of q0.
        seed: Any non-negative integer.
        count: Number of restarts.
    """
    yield problem.q0
    index = np.flatnonzero(problem.movable)
    alpha = _generalised_golden_ratio(index.size) ** -(1.0 + np.arange(index.size))
    point = np.random.default_rng(seed).random(index.size)
    q0 = problem.q0[index]
    low = np.maximum(problem.lower[index], q0 - np.pi)
    high = np.minimum(problem.upper[index], q0 + np.pi)
    heavy = problem.scale[index] > 1.5
    for k in range(count):
        near = k < len(REACH)
        candidates = []
        for _ in range(CANDIDATES if is_chosen(k) else 1):
            point = (point + alpha) % 1.0
            way = (REACH[k] if near else 1.0) * (low + point * (high - low) - q0)
            q = problem.q0.copy()
            q[index] = q0 + (np.where(heavy, 0.0, way) if k % 2 else way)
            candidates.append(problem.clip(q))
        yield min(candidates, key=lambda q: problem.task_cost(problem.residuals(q)))


def is_chosen(number: int) -> bool:
    """Whether a restart, counted from 0, is the best of several points."""
    return number >= len(REACH) and number % 4 < 2


def nearby(problem: Problem, q: Array, generator: np.random.Generator, attempt: int) -> Array:
    """Return q with every movable joint shifted at random, within the bounds, shape (n,) [rad or m].

    Args:
        problem: Gives bounds and the joints that move.
        q: Where to start from, shape (n,).
        generator: Draws the shift.
        attempt: Counts the calls; the spread goes through `SPREADS` in turn.
    """
    shift = SPREADS[attempt % len(SPREADS)] * generator.standard_normal(q.size)
    return problem.clip(q + np.where(problem.movable, shift, 0.0))


def _generalised_golden_ratio(dimension: int) -> float:
    ratio = 2.0
    for _ in range(60):
        ratio = (1.0 + ratio) ** (1.0 / (dimension + 1))
    return ratio
