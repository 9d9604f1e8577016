"""Result of a planner."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple, Self

from pepper_kin.kernels.signatures import Ints1
from pepper_kin.status import ResultStatus

from .deadline import Deadline
from .path import Path
from .search_space import ITERATIONS
from .vectors import FloatArray


class Status(ResultStatus):
    """How a run of a planner ended; `advice` says what to do about it."""

    SOLVED = (
        "solved",
        "A path was found; shorten it with shortcut() or aorrtc(), and round its corners with smooth().",
    )
    START_INVALID = (
        "start_invalid",
        "The start state is not valid; begin at a valid state or reduce the margin.",
    )
    GOAL_INVALID = "goal_invalid", "No goal state is valid; give other goals or reduce the margin."
    START_OFF_MANIFOLD = (
        "start_off_manifold",
        "The start does not meet the constraints; begin at a state that does, or raise the tolerance.",
    )
    GOAL_OFF_MANIFOLD = (
        "goal_off_manifold",
        "No goal meets the constraints; project one onto the manifold, or raise the tolerance.",
    )
    NO_GOAL = (
        "no_goal",
        "The sampler of goals drew none that is valid; raise the timeout, reduce the margin, or check"
        " that the sampler can succeed.",
    )
    START_SHUT_IN = (
        "start_shut_in",
        "Hardly any motion leads away from the start; move away what surrounds it, or reduce the margin.",
    )
    GOAL_SHUT_IN = (
        "goal_shut_in",
        "Hardly any motion leads up to a goal; move away what surrounds it, reduce the margin, or "
        "give other goals.",
    )
    NO_PATH_IN_TIME = (
        "no_path_in_time",
        "No path was found within the time budget; raise the timeout, try another seed, or check that"
        " the goal can be reached at all.",
    )
    OUT_OF_ITERATIONS = (
        "out_of_iterations",
        "No path was found within the allowed iterations; raise max_iterations, try another seed, or "
        "check that the goal can be reached at all.",
    )


class StopReason(Enum):
    """Why a planner that improves a path stopped."""

    GAP_REACHED = "the path is as short as asked for"
    TIME_UP = "the time budget is used up"
    ITERATIONS_USED = "the allowed iterations are used up"


class Improvement(NamedTuple):
    """Time and cost at which a planner had a better path.

    Attributes:
        time: Time since the planner was called [s].
        cost: Length of the path [length unit of the metric].
        iteration: Number of samples drawn until then.
    """

    time: float
    cost: float
    iteration: int


@dataclass(frozen=True, eq=False)
class Result:
    """Result of one run of a planner.

    Attributes:
        status: Status of the run.
        path: The path from the start to one of the goals; None unless solved.
        goal_index: Index of the goal that was reached, among the goals drawn if they are drawn; None unless
            solved.
        cost: Length of the path [length unit of the metric]; infinite unless solved.
        iterations: Number of samples drawn.
        states_checked: Number of states whose validity was checked; for machine code, the states up to the
            first invalid one of each call.
        validity_calls: Number of calls of the validity checker, for batches of states or parts of edges.
        time: Wall time [s].
        seed: Seed of the run: the same problem and seed give the same result, if time does not run out.
        history: Falling costs, for planners that improve a path; the first entry is the initial path.
        lower_bound: Lower bound on the length, the straight line to the nearest valid goal, for planners that
            improve a path [length unit of the metric]; 0 otherwise.
        stop_reason: Why a planner that improves a path stopped; None otherwise.
        tree_sizes: Numbers of nodes of the trees of the start and of the goals, for planners with two trees
            that found no path; None otherwise.
        frontier: Some nodes of the tree that is shut in, or of the smaller one, shape (m, n), for planners
            with two trees that found no path; None otherwise.  `first_invalid_states` finds invalid states
            around the nodes.
        residual: Maximum error as a multiple of its tolerance, for planners on a manifold: of the path's
            waypoints, or of the start or the nearest goal if it is off the manifold; nan otherwise.
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
    lower_bound: float = 0.0
    stop_reason: StopReason | None = None
    tree_sizes: tuple[int, int] | None = None
    frontier: FloatArray | None = None
    residual: float = math.nan

    @classmethod
    def of_run(
        cls,
        status: Status,
        counters: Ints1,
        deadline: Deadline,
        seed: int,
        path: Path | None = None,
        goal: int | None = None,
        **more: Any,
    ) -> Self:
        """Return the result of a run that is over.

        Args:
            status: Status of the run.
            counters: Counters of the planner, see `search_space.STATES`.
            deadline: Time budget of the run.
            seed: Seed of the run.
            path: The path; None unless solved.
            goal: Index of the goal that was reached.
            **more: Other fields, or other values of the fields above.
        """
        made = object.__new__(cls)
        states, calls, _, iterations = counters[: ITERATIONS + 1].tolist()
        made.__dict__.update(
            status=status, path=path, goal_index=goal, iterations=iterations, states_checked=states,
            validity_calls=calls, time=deadline.elapsed, seed=seed,
        )  # fmt: skip
        made.__dict__.update(more)
        if "cost" not in more:
            made.__dict__["cost"] = math.inf if path is None else path.length
        return made

    @property
    def success(self) -> bool:
        """Whether a path was found."""
        return self.status is Status.SOLVED

    @property
    def gap(self) -> float:
        """Relative excess of the length over the lower bound; infinite without a bound."""
        return self.cost / self.lower_bound - 1.0 if self.lower_bound > 0.0 else math.inf

    def __str__(self) -> str:
        """Summarize the run in a line."""
        return (
            f"{self.status.value}: cost {self.cost:.6g}, {self.iterations} iterations, "
            f"{self.states_checked} states checked, {self.time:.3g} s, seed {self.seed}. {self.status.advice}"
        )
