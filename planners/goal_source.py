"""Goals that are given, or drawn one at a time while a planner runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from .vectors import FloatArray, finite_vector, require_inside

if TYPE_CHECKING:
    from .problem import Problem

BETWEEN_DRAWS = 32
"""Iterations between the first two draws of a goal; the pause doubles with each draw."""

_STREAM = 0x60A1


class GoalSampler(Protocol):
    """What a user supplies instead of goals: a callable that draws a goal, or says that it has none now.

    It is called between pieces of the search: until the first valid goal is there, and now and then
    afterwards.  A state that it returns lies inside the box; whether it is valid is the oracle's business.
    """

    def __call__(self, rng: np.random.Generator, /) -> ArrayLike | None:
        """Return a goal state, shape (n,), or None."""
        ...


class GoalSource:
    """The goals of one run of a planner: those of the problem, then those that its sampler draws.

    Attributes:
        problem: The problem.
        count: Number of goals so far.
    """

    def __init__(self, problem: Problem, seed: int) -> None:
        """Begin a run.

        Args:
            problem: The problem.
            seed: Seed of the generator that the sampler is given.
        """
        self.problem = problem
        self.count = len(problem.goals)
        self._rng = np.random.default_rng((_STREAM, seed)) if self.endless else None

    @property
    def endless(self) -> bool:
        """Whether more goals can be drawn."""
        return self.problem.goal_sampler is not None

    def draw(self) -> FloatArray | None:
        """Return another goal, shape (1, n); None if the sampler has none now.

        Raises:
            InvalidValueError: The sampler returned something else than a finite state inside the box.
        """
        problem = self.problem
        if problem.goal_sampler is None or self._rng is None:
            return None
        drawn = problem.goal_sampler(self._rng)
        if drawn is None:
            return None
        goal = finite_vector("goal drawn", drawn, problem.n, problem.labels)
        require_inside("goal drawn", goal, problem.lower, problem.upper, problem.labels)
        self.count += 1
        return goal[None, :]
