"""Planners of the Open Motion Planning Library (OMPL), with the problem and result of this package."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from pepper_kin.exceptions import InvalidValueError, MissingDependencyError

from .deadline import Deadline
from .motion_validator import MotionValidator
from .path import Path
from .problem import Problem
from .result import Result, Status
from .vectors import FloatArray, seed_number

OMPL_PLANNERS = (
    "AnytimePathShortening", "SBL", "EST", "LBKPIECE", "BKPIECE", "KPIECE", "RRT", "RRTConnect", "RRTstar",
    "TRRT", "PRM", "PRMstar", "FMT", "BFMT", "PDST", "STRIDE", "BiTRRT", "LBTRRT", "BiEST", "ProjEST",
    "LazyPRM", "LazyPRMstar", "SPARS", "SPARStwo",
)  # fmt: skip
"""Names of planners in MoveIt's configuration of OMPL."""

IMPROVING = ("RRTstar", "PRMstar", "PRM")
"""Planners that improve their path until the time budget is used up."""

TWO_THREADS = ("PRM", "PRMstar", "SPARS", "SPARStwo")
"""Planners that look for solutions in a second thread.  That thread would check further goals and wait
forever for Python, which the first thread holds: such planners get one goal at a time."""

MANY_THREADS = ("AnytimePathShortening",)
"""Planners that check validity in several threads, which would wait forever for Python."""


class _OmplModules(NamedTuple):
    base: ModuleType
    geometric: ModuleType
    util: ModuleType


def available_ompl_planners() -> tuple[str, ...]:
    """Return the `OMPL_PLANNERS` that the installed `ompl` has; empty if it is not installed."""
    try:
        library = _library()
    except MissingDependencyError:
        return ()
    return tuple(
        name for name in OMPL_PLANNERS if name not in MANY_THREADS and _class_of(library, name) is not None
    )


def ompl_plan(
    problem: Problem, planner: str = "RRTConnect", *, seed: int = 0, timeout: float = 5.0
) -> Result:
    """Search a path with a planner of OMPL.

    Coordinates are scaled by the metric's weights, so that OMPL's distances are the problem's.  OMPL checks
    one state at a time, with one call of a Python checker each.  The path is not shortened: pass it to
    `shortcut`.  Planners that look for solutions in a second thread (`TWO_THREADS`) try one goal after
    another, the nearest first, with the remaining time divided equally.

    I. A. Sucan, M. Moll and L. E. Kavraki, The Open Motion Planning Library, IEEE Robotics & Automation
    Magazine 19 (2012).

    Args:
        problem: The problem; its goals must be states, not a sampler.
        planner: A name of `OMPL_PLANNERS` that the installed library has.
        seed: Seed of OMPL's generator.  OMPL has one for the whole process and takes a seed before its first
            use only: the same seed gives the same result in a new process, for the first call.
        timeout: Time budget [s].  Planners that improve their path use all of it.

    Returns:
        The result; `iterations` is 0, since OMPL's planners count different things.

    Raises:
        MissingDependencyError: `ompl` is not installed.
        InvalidValueError: for an unknown planner, or a problem with a sampler of goals.
    """
    library = _library()
    if planner in MANY_THREADS:
        raise InvalidValueError(
            "planner",
            f"{planner!r} (asks for validity in several threads, which wait for Python for ever)",
            f"one of {', '.join(available_ompl_planners())}",
        )
    make = _class_of(library, planner) if planner in OMPL_PLANNERS else None
    if make is None:
        known = "" if planner not in OMPL_PLANNERS else " (the installed ompl lacks it)"
        raise InvalidValueError(
            "planner", f"{planner!r}{known}", f"one of {', '.join(available_ompl_planners())}"
        )
    if len(problem.goals) == 0:
        raise InvalidValueError("goals", "a sampler", "goal states: OMPL's planners take these only")
    deadline = Deadline(timeout)
    validator = problem.validator(deadline)
    alone = planner in TWO_THREADS
    status, points, goal = _OmplProblem(library, problem, validator).run(
        make, seed_number(seed), deadline, alone
    )
    path = None if points is None else Path(points, problem.weights)
    return Result(
        status=status, path=path, goal_index=goal, cost=math.inf if path is None else path.length,
        iterations=0, states_checked=validator.states, validity_calls=validator.calls, time=deadline.elapsed,
        seed=seed,
    )  # fmt: skip


class _OmplProblem:
    """A problem for OMPL: the coordinates that can change, scaled by the metric's weights."""

    def __init__(self, library: _OmplModules, problem: Problem, validator: MotionValidator) -> None:
        self._library, self._problem, self._validator = library, problem, validator
        self._free = np.flatnonzero(problem.upper > problem.lower)
        self._weights = problem.metric.weights[self._free]
        self._state = np.array(problem.start)

    def run(
        self, make: Callable[[Any], Any], seed: int, deadline: Deadline, alone: bool
    ) -> tuple[Status, FloatArray | None, int | None]:
        """Return the status of a search, and the waypoints and the goal's index if there is a path.

        Args:
            make: Class of the planner.
            seed: Seed of OMPL's generator.
            deadline: Time budget.
            alone: Whether goals are tried one after another.
        """
        problem, util = self._problem, self._library.util
        if not self._validator.states_valid(problem.start[None])[0]:
            return Status.START_INVALID, None, None
        valid = [k for k, goal in enumerate(problem.goals) if self._validator.states_valid(goal[None])[0]]
        if not valid:
            return Status.GOAL_INVALID, None, None
        util.setLogLevel(util.LOG_NONE)
        if seed:
            util.RNG.setSeed(seed)
        groups = [valid]
        if alone:
            apart = problem.metric.distance(problem.start, problem.goals[valid])
            groups = [[valid[k]] for k in np.argsort(apart, kind="stable").tolist()]
        for number, goals in enumerate(groups):
            points = self._path_to(goals, make, deadline.left / (len(groups) - number))
            if points is not None:
                ends = problem.metric.distance(points[-1], problem.goals[goals])
                goal = goals[int(np.argmin(ends))]
                points[0], points[-1] = problem.start, problem.goals[goal]
                return Status.SOLVED, points, goal
        return Status.NO_PATH_IN_TIME, None, None

    def _path_to(self, goals: list[int], make: Callable[[Any], Any], seconds: float) -> FloatArray | None:
        """Return waypoints to one of some goals, shape (m, n), found within a time [s], or None."""
        base, geometric, _ = self._library
        problem = self._problem
        space = base.RealVectorStateSpace(self._free.size)
        bounds = base.RealVectorBounds(self._free.size)
        for i, (low, high) in enumerate(zip(*self._scaled(problem.lower, problem.upper), strict=True)):
            bounds.setLow(i, low)
            bounds.setHigh(i, high)
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(self._is_valid)
        information = setup.getSpaceInformation()
        information.setStateValidityCheckingResolution(min(problem.spacing / space.getMaximumExtent(), 1.0))
        setup.setStartState(self._to_ompl(space, problem.start))
        ends = base.GoalStates(information)
        for k in goals:
            ends.addState(self._to_ompl(space, problem.goals[k]))
        setup.setGoal(ends)
        setup.setPlanner(make(information))
        setup.solve(max(seconds, 1e-3))
        if not setup.haveExactSolutionPath():
            return None
        return np.array([self._from_ompl(state) for state in setup.getSolutionPath().getStates()])

    def _scaled(self, *states: FloatArray) -> list[list[float]]:
        return [(state[self._free] * self._weights).tolist() for state in states]

    def _to_ompl(self, space: Any, state: FloatArray) -> Any:
        made = space.allocState()
        for i, value in enumerate(self._scaled(state)[0]):
            made[i] = value
        return made

    def _from_ompl(self, state: Any) -> FloatArray:
        values = np.array([state[i] for i in range(self._free.size)]) / self._weights
        found = self._state.copy()
        found[self._free] = np.clip(values, self._problem.lower[self._free], self._problem.upper[self._free])
        return found

    def _is_valid(self, state: Any) -> bool:
        return bool(self._validator.states_valid(self._from_ompl(state)[None])[0])


def _library() -> _OmplModules:
    """Return OMPL's modules; raise MissingDependencyError if `ompl` is not installed."""
    try:
        from ompl import base, geometric, util
    except ImportError as error:
        raise MissingDependencyError("ompl", "pip install 'pepper_kin[ompl]'", "ompl_plan") from error
    return _OmplModules(base, geometric, util)


def _class_of(library: _OmplModules, name: str) -> Callable[[Any], Any] | None:
    """Return the class of a planner, None if unknown; MoveIt omits the 1 of KPIECE1."""
    return getattr(library.geometric, name, None) or getattr(library.geometric, f"{name}1", None)
