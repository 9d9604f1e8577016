"""A roadmap of one world, for many queries."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError

from .deadline import Deadline
from .path import Path
from .problem import Problem
from .result import Result, Status
from .vectors import FloatArray, finite_points, finite_vector, require_inside, whole_number

_FIRST_NODES = 128
_GROWTH = 1.5


class Roadmap:
    """A graph of valid states whose edges are checked when a query first needs them.

    Nodes are even samples of the box; each is joined to its nearest neighbours.  A query makes its ends nodes
    and searches the shortest path by A*, whose edges are checked when they come up; what was found out about
    an edge is kept.  While there is no path, nodes are added.  So the first query in a world costs about as
    much as a search by `rrt_connect`, and later ones less and less; and paths come near the shortest ones as
    the roadmap grows.

    A roadmap belongs to one world: once the oracle answers otherwise, make a new one.  It is not to be used
    by several threads at once.  The same queries in the same order give the same answers, unless time runs
    out.

    Source: L. E. Kavraki et al., Probabilistic roadmaps for path planning in high-dimensional configuration
    spaces, IEEE Trans. Robotics and Automation 12(4), 1996; R. Bohlin and L. E. Kavraki, Path planning using
    lazy PRM, ICRA 2000; number of neighbours: S. Karaman and E. Frazzoli, 2011.

    Attributes:
        problem: The world: box, metric and oracle; its start and goals are those of a query that names none.
        seed: Seed of the samples.
    """

    def __init__(self, problem: Problem, *, seed: int = 0, resolution: float | None = None) -> None:
        """Make an empty roadmap.

        Args:
            problem: The world.
            seed: Seed of the samples.
            resolution: Greatest distance between checked states of an edge [length unit of the metric]; the
                problem's if omitted.

        Raises:
            InvalidValueError: The seed or the resolution is not allowed.
        """
        from .compiled_roadmap import Chart  # loads machine code

        self.problem, self.seed = problem, whole_number("seed", seed)
        spacing = problem.counting_oracle(resolution=resolution).resolution
        self._chart = Chart(problem, self.seed, spacing)

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        from .native_roadmap import NODES

        return int(self._chart.counters[NODES])

    @property
    def edges(self) -> int:
        """Number of edges that are not known to be invalid."""
        from .native_roadmap import UNKNOWN, VALID

        return self._chart.edges(UNKNOWN) + self._chart.edges(VALID)

    @property
    def edges_checked(self) -> int:
        """Number of edges of which it is known whether they are valid."""
        from .native_roadmap import INVALID, VALID

        return self._chart.edges(INVALID) + self._chart.edges(VALID)

    def grow(self, nodes: int, *, timeout: float = 1.0) -> int:
        """Add nodes, for shorter paths or for quicker queries later.

        Args:
            nodes: How many.
            timeout: Time budget [s].

        Returns:
            How many were added before time ran out.

        Raises:
            InvalidValueError: An argument is not allowed.
        """
        deadline, before = Deadline(timeout), self.nodes
        self._chart.scatter(before + whole_number("nodes", nodes), deadline)
        return self.nodes - before

    def solve(
        self,
        start: ArrayLike | None = None,
        goals: ArrayLike | None = None,
        *,
        timeout: float = 1.0,
        max_nodes: int = 100_000,
    ) -> Result:
        """Find a path.

        Args:
            start: Start state, shape (n,); the problem's if omitted.
            goals: Goal states, shape (k, n) or (n,), any of which will do; the problem's if omitted.
            timeout: Time budget [s].
            max_nodes: Greatest number of nodes to which the roadmap may grow.

        Returns:
            The result, whose path is the shortest one on the roadmap; without a path its status tells why.

        Raises:
            InvalidValueError: A state has the wrong shape, is not finite or outside the box, or there is no
                goal.
        """
        from . import native_roadmap as native
        from .native_world import CALLS, STATES

        deadline, chart = Deadline(timeout), self._chart
        max_nodes = whole_number("max_nodes", max_nodes)
        begin, ends = self._start(start), self._goals(goals)
        before = chart.counters.copy()
        first = chart.valid(np.concatenate((begin[None, :], ends)))
        usable = np.flatnonzero(first[1:])
        status, path, goal = self._ends_status(first), None, None
        if status is None:
            places = np.full(1 + usable.size, -1, dtype=np.int64)
            status = self._search(begin.copy(), ends[usable], places, deadline, max_nodes)
            if status is Status.SOLVED:
                points, reached = chart.path()
                path = Path.trusted(points, self.problem.metric)
                goal = int(usable[int(np.argmax(places[1:] == reached))])
        spent = chart.counters - before
        return Result(
            status=status,
            path=path,
            goal_index=goal,
            cost=math.inf if path is None else path.length,
            iterations=int(spent[native.NODES]),
            states_checked=int(spent[STATES]),
            oracle_calls=int(spent[CALLS]),
            time=deadline.elapsed,
            seed=self.seed,
        )

    def _search(
        self, start: FloatArray, goals: FloatArray, ends: np.ndarray, deadline: Deadline, max_nodes: int
    ) -> Status:
        from . import native_roadmap as native

        while True:
            ended = self._chart.connect(start, goals, ends, deadline)
            if ended == native.DONE:
                return Status.SOLVED
            if ended == native.TIME_UP:
                return Status.NO_PATH_IN_TIME
            if self.nodes >= max_nodes:
                return Status.OUT_OF_ITERATIONS
            wanted = min(max(int(self.nodes * _GROWTH), self.nodes + _FIRST_NODES), max_nodes)
            if self._chart.scatter(wanted, deadline) == native.TIME_UP:
                return Status.NO_PATH_IN_TIME

    @staticmethod
    def _ends_status(valid: np.ndarray) -> Status | None:
        if not valid[0]:
            return Status.START_INVALID
        return None if valid[1:].any() else Status.GOAL_INVALID

    def _start(self, start: ArrayLike | None) -> FloatArray:
        problem = self.problem
        if start is None:
            return problem.start
        state = finite_vector("start", start, problem.n, problem.labels)
        require_inside("start", state, problem.lower, problem.upper, problem.labels)
        return state

    def _goals(self, goals: ArrayLike | None) -> FloatArray:
        problem = self.problem
        if goals is None:
            if len(problem.goals) == 0:
                raise InvalidValueError("goals", "a sampler", "goal states: a roadmap does not draw goals")
            return problem.goals
        states = finite_points(
            "goals", np.asarray(goals)[None, :] if np.ndim(goals) == 1 else goals, problem.n, problem.labels
        )
        for k, state in enumerate(states):
            require_inside(f"goals[{k}]", state, problem.lower, problem.upper, problem.labels)
        return states
