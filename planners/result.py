"""What a planner returns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from .path import Path


class Status(Enum):
    """How a run of a planner ended; `advice` says what to do about it."""

    SOLVED = "solved"
    START_INVALID = "start_invalid"
    GOAL_INVALID = "goal_invalid"
    START_OFF_MANIFOLD = "start_off_manifold"
    GOAL_OFF_MANIFOLD = "goal_off_manifold"
    NO_GOAL = "no_goal"
    NO_PATH_IN_TIME = "no_path_in_time"
    OUT_OF_ITERATIONS = "out_of_iterations"

    @property
    def advice(self) -> str:
        """One sentence: what the status means and what to try."""
        return _ADVICE[self]


_ADVICE = {
    Status.SOLVED: (
        "A path was found; shorten it with shortcut() or informed_rrt_star(), "
        "and round its corners with smooth()."
    ),
    Status.START_INVALID: "The start state is not valid; begin at a valid state or reduce the margin.",
    Status.GOAL_INVALID: "No goal state is valid; give other goals or reduce the margin.",
    Status.START_OFF_MANIFOLD: (
        "The start does not meet the constraints; begin at a state that does, or raise the tolerance."
    ),
    Status.GOAL_OFF_MANIFOLD: (
        "No goal meets the constraints; project one onto the manifold, or raise the tolerance."
    ),
    Status.NO_GOAL: (
        "The sampler of goals drew none that is valid; raise the timeout, reduce the margin, "
        "or check that the sampler can succeed."
    ),
    Status.NO_PATH_IN_TIME: (
        "No path was found within the time budget; raise the timeout, try another seed, "
        "or check that the goal can be reached at all."
    ),
    Status.OUT_OF_ITERATIONS: (
        "No path was found within the allowed iterations; raise max_iterations, try another seed, "
        "or check that the goal can be reached at all."
    ),
}


class Improvement(NamedTuple):
    """A moment at which a planner had a better path.

    Attributes:
        time: Since the planner was called [s].
        cost: Length of the path [length unit of the metric].
        iteration: Number of samples drawn until then.
    """

    time: float
    cost: float
    iteration: int


@dataclass(frozen=True, eq=False)
class Result:
    """The outcome of one run of a planner.

    Attributes:
        status: How it ended.
        path: The path from the start to one of the goals; None unless solved.
        goal_index: Which of the goals was reached, of those drawn if they are drawn; None unless solved.
        cost: Length of the path [length unit of the metric]; infinite unless solved.
        iterations: Number of samples drawn.
        states_checked: Number of states whose validity was asked for; of machine code, those up to the first
            invalid one of each call.
        validity_calls: Number of batches, or of pieces of edges, in which it was asked for.
        time: Wall time [s].
        seed: Seed of the run: the same problem and seed give the same result, if time does not run out.
        history: Falling costs, of planners that improve a path; the first entry is the path they began with.
        residual: Largest error as a multiple of its tolerance, of planners on a manifold: of the path's
            way-points, or of the start or the nearest goal if that is off the manifold; nan otherwise.
    """

    status: Status
    path: Path | None
    goal_index: int | None
    cost: float
    iterations: int
    states_checked: int
    validity_calls: int
    time: float
    seed: int
    history: tuple[Improvement, ...] = ()
    residual: float = math.nan

    @property
    def success(self) -> bool:
        """Whether a path was found."""
        return self.status is Status.SOLVED

    def __str__(self) -> str:
        """Summarise the run in a line."""
        return (
            f"{self.status.value}: cost {self.cost:.6g}, {self.iterations} iterations, "
            f"{self.states_checked} states checked, {self.time:.3g} s, seed {self.seed}. {self.status.advice}"
        )
