"""From start, goal, scene and soft costs to a path on which length and costs together are small."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.collision import Scene
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.goals import STAYS, fault_of_start, free_joints, goals_of, is_there
from pepper_kin.motion.path_costs import Figures, PathCost, PathCosts
from pepper_kin.motion.plan_result import Ending, Plan, PlanStatus
from pepper_kin.motion.problem import PathProblem, checked_start, path_problem
from pepper_kin.motion.waypoints import _is_clear, waypoints_of
from pepper_kin.trajectory.path import as_cubic_path

Array = NDArray[np.float64]

PLANNER = "rrt_connect"
SEARCHES = 4
"""Paths that are searched and descended from; the cheapest is taken."""

MOST_ITERATIONS = 100_000_000
"""Of the first search, which ends when time is up."""

_LONGER = 5
_PIECES = (6, 12, 24, 48, 96, 192)  # of a spline through a path
_CLOSE = 1.01  # what a spline may cost more than the polyline that it follows
NO_SPLINE = "A path was found, but no spline through way-points of it is free of collision."


def plan_costed(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike | Sequence[Any],
    scene: Scene | None = None,
    costs: Sequence[PathCost | Task | TaskGroup] = (),
    *,
    joints: str | Sequence[str] | None = None,
    margin: float = 0.01,
    seed: int = 0,
    timeout: float = 5.0,
) -> Plan:
    """Plan a collision-free path on which its length and soft costs together are small.

    What is made small is the integral of 1 + sum of the prices over the length of the path in the planners'
    metric (see `PathCost`): by searches for paths of little cost, short-cuts that count the cost, and steps
    down its gradient (`planners.descend_cost`).  It is not proven to be the least.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration, shape (n,), several, shape (m, n), or a list of IK tasks.
        scene: The world around the robot.
        costs: Expressions (`PathCost`), and tasks with a finite tolerance, whose price is the square of the
            error in tolerances.
        joints: Joints that may move: a group name or joint names.  None: those in which start and goals
            differ; give more where others can lower the cost.
        margin: Distance that is kept to the scene and to the robot itself [m]; less where start or goal are
            nearer than that.
        seed: Seed of all random choices.
        timeout: Time budget [s].

    Returns:
        The plan.  Its `costs` tell the integrals along its curve, and along that of the plan without costs.

    Raises:
        InvalidValueError: for a wrong shape, NaN, no cost, or one that is none.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint, frame or group.
    """
    priced = PathCosts.of(pepper, costs)
    q_start = checked_start(pepper, start, margin, timeout)
    checks = Checks(pepper, scene)
    begin = time.perf_counter()
    ended = Ending(pepper, begin, seed, PLANNER)
    fault = fault_of_start(checks, q_start)
    if fault is not None:
        return ended(*fault)
    goals, ik, fault = goals_of(checks, q_start, goal, joints, margin, seed, timeout)
    if fault is not None:
        return ended(*fault, ik=ik)
    free = free_joints(pepper, joints, q_start, goals)
    if is_there(q_start, goals):
        return ended.solved(checks.exact, q_start[None], STAYS, ik=ik)
    room = path_problem(checks, q_start, goals, free, margin)
    found = _Search(room, priced, seed, begin + timeout)
    said: dict[str, Any] = {"ik": ik, "states_checked": found.states_checked}
    if found.first is None:
        elapsed = time.perf_counter() - begin
        message = f"No path: {found.states_checked} configurations were checked in {elapsed:.2f} s."
        return ended(PlanStatus.NO_PATH_IN_TIME, message, **said)
    path, figures, before = found.cheapest()
    if path is None or figures is None:
        return ended(PlanStatus.NO_PATH_IN_TIME, NO_SPLINE, **said)
    said["costs"] = priced.said(figures, before)
    return ended.solved(checks.exact, path, words(path, figures, before), **said)


def words(path: Array, found: Figures, before: Figures | None) -> str:
    """Say what a path costs, and what it costs more than one that is short only."""
    text = f"Path of {len(path)} way-points; its costs are {found.integrals.sum():.3g} m"
    if before is None:
        return f"{text}."
    longer = 100 * (found.length / before.length - 1)
    return f"{text}, without regard to them {before.integrals.sum():.3g} m on a way {longer:.0f} % shorter."


class _Search:
    """Paths of one problem, from the first that is found to the cheapest.

    Attributes:
        first: The path found without regard to costs; None where there is none.
        states_checked: Number of configurations asked about by searches.
    """

    def __init__(self, room: PathProblem, costs: PathCosts, seed: int, deadline: float) -> None:
        self._room, self._costs, self._seed, self._deadline = room, costs, seed, deadline
        self._price = costs.for_planner(room.start, room.free)
        self.states_checked, self._most = 0, MOST_ITERATIONS
        self.first = self._searched(0)

    def cheapest(self) -> tuple[Array | None, Figures | None, Figures | None]:
        """Return way-points, shape (m, n), their figures, and those of the way without regard to costs.

        The former two are None where no spline is clear.
        """
        room, first = self._room, self.first
        assert first is not None
        plain = waypoints_of(room, first, seed=self._seed, timeout=self._left)
        before = None if plain is None else self._figures(plain)
        found = [first]
        for number in range(1, SEARCHES):
            other = self._searched(number) if self._left > 0.01 else None
            # In the open all searches end with the same straight edge.
            if other is not None and not any(np.array_equal(other.points, one.points) for one in found):
                found.append(other)
        candidates = [self._descended(path) for path in found]
        for path in sorted(candidates, key=self._price.along):
            points = self._waypoints(path)
            if points is not None:
                figures = self._figures(points)
                if before is None or figures.total < before.total:
                    return points, figures, before
                break
        return plain, before, before

    @property
    def _left(self) -> float:
        return max(self._deadline - time.perf_counter(), 1e-3)

    def _searched(self, number: int) -> planners.Path | None:
        result = planners.rrt_connect(
            self._room.problem, seed=self._seed + number, timeout=self._left, max_iterations=self._most
        )
        self.states_checked += result.states_checked
        # Further searches may take longer than the first, but not all of the time.
        self._most = _LONGER * (result.iterations + 100) if number == 0 else self._most
        return result.path

    def _descended(self, path: planners.Path) -> planners.Path:
        return planners.descend_cost(
            self._room.problem, self._price, path, seed=self._seed, timeout=self._left
        )

    def _waypoints(self, path: planners.Path) -> Array | None:
        """Return the fewest way-points whose spline is clear and costs what the path does; None without."""
        allowed, best = _CLOSE * self._price.along(path), None
        for pieces in _PIECES:
            points = self._room.embed(path(np.linspace(0.0, path.length, pieces + 1)))
            if _is_clear(self._room, points, self._room.relaxed_margins):
                best = points
                if self._figures(points).total <= allowed:
                    break
        return best

    def _figures(self, points: Array) -> Figures:
        return figures_of(self._room, self._costs, points)


def figures_of(room: PathProblem, costs: PathCosts, points: Array) -> Figures:
    """Return length and costs of the spline through way-points, shape (m, n)."""
    weights = np.zeros(room.start.size)
    weights[room.free] = room.problem.metric.weights
    return costs.figures(as_cubic_path(room.checks.pepper, points), weights)
