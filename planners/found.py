"""What a search hands to the planner that began it."""

from __future__ import annotations

from typing import NamedTuple

from .result import Status
from .vectors import FloatArray


class Found(NamedTuple):
    """The end of a search.

    Attributes:
        status: How it ended.
        points: Way-points, shape (k, n); None unless solved.
        goal_index: Which goal was reached; None unless solved.
        iterations: Samples drawn.
        states: States that the oracle was asked about.
        calls: Calls of the oracle.
    """

    status: Status
    points: FloatArray | None = None
    goal_index: int | None = None
    iterations: int = 0
    states: int = 0
    calls: int = 0
