"""Planning with soft costs: paths whose length and costs together are small."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model import PepperModel
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.motion.goals import ends_of
from pepper_kin.motion.margins import falling_problems, narrowest, relaxation_sentence
from pepper_kin.motion.obstruction import why_no_path
from pepper_kin.motion.path_costs import PathCost, PathCosts, PathFigures
from pepper_kin.motion.path_search import PathSearch
from pepper_kin.motion.plan_request import PlanOptions, PlanRequest, refuse_what_cannot_drive
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.problem import PathProblem
from pepper_kin.motion.waypoints import way_through
from pepper_kin.trajectory.path import as_cubic_path

PLANNER = "rrt_connect"
SEARCHES = 2
"""Number of paths of each of two kinds of search from which the cost is lowered."""

MOST_ITERATIONS = 20_000
"""Maximum number of iterations of a further search."""

FIRST_STEPS = 45
"""Number of steps of the descent from each path; the cheapest path then continues."""

_PIECES = (6, 12, 24, 48, 96, 192)  # numbers of pieces of a spline through a path, tried in turn
_LITTLE = 0.01  # minimum remaining time for a further search [s]
_CLOSE = 1.01  # maximum cost of a spline, relative to its polyline
NO_SPLINE = "A path was found, but no spline through waypoints of it is free of collision."


def plan_costed(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike | Sequence[Any],
    scene: Scene | None = None,
    costs: Sequence[PathCost | Task | TaskGroup] = (),
    *,
    joints: str | Sequence[str] | None = None,
    margin: float = 0.01,
    least_margin: float = 0.0,
    seed: int = 0,
    timeout: float = 5.0,
    balance: Balance = "robot",
    torque_scale: TorqueScale = "robot",
    payload: Mapping[str, float] | None = None,
) -> Plan:
    """Plan a collision-free path whose length and soft costs together are small.

    The integral of 1 + sum of the prices over the length of the path in the planners' metric (see `PathCost`)
    is reduced by searches with and without the cost (`planners.transition_rrt`, `rrt_connect`), shortcuts
    that count the cost, and gradient descent (`planners.descend_cost`).  The result is not proven to be the
    minimum.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration [rad or m], shape (n,), several, shape (m, n), or a list of IK tasks.
        scene: The world around the robot.
        costs: Expressions (`PathCost`), and tasks with a finite tolerance, whose price is the square of the
            error in tolerances.
        joints: Joints that may move, by names of joints and groups; None: joints in which start and goals
            differ.  Name further joints if they can lower the cost.
        margin: Requested distance to all bodies [m]; it is relaxed if necessary, as by `plan`.
        least_margin: Distance that the whole curve is proven to keep from the scene [m], from 0 to `margin`.
        seed: Seed of all random choices.
        timeout: Time budget [s].
        balance: Distance that the center of mass keeps from the edges of the wheels' triangle [m]; "robot"
            for the robot's requirement; None to leave balance out.
        torque_scale: Fraction of the effort limits for holding torques; "robot" for the robot's requirement.
        payload: Point masses held at "left", "right" or a frame by name [kg], in addition to attached
            objects.

    Returns:
        The plan.  `costs` holds the integrals along its curve, and along the curve of the plan without costs.

    Raises:
        InvalidValueError: for a wrong shape, NaN, no cost, or a cost of another type.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint, frame or group.
    """
    if costs is None:
        raise InvalidValueError("costs", None, "a list of PathCost and tasks")
    options = PlanOptions(
        costs=costs, joints=joints, margin=margin, least_margin=least_margin, seed=seed, timeout=timeout,
        balance=balance, torque_scale=torque_scale, payload=payload,
    )  # fmt: skip
    refuse_what_cannot_drive(pepper, joints, PLANNER, True)
    return costed_path(PlanRequest(pepper, start, goal, scene, options))


def costed_path(asked: PlanRequest) -> Plan:
    """Return the plan of a request with soft costs; see `plan_costed`."""
    request, options = asked.checked(), asked.options
    checks, ended, costs = request.checks, request.ended, request.costs
    assert costs is not None
    ends = ends_of(request)
    if isinstance(ends, Plan):
        return ends
    states = 0
    for problem, share in falling_problems(checks, ends, options.margins):
        deadlines = ended.begin + share * options.timeout, request.deadline
        search = _CheapSearch(problem, costs, request.seed, deadlines)
        states += search.states_checked
        if search.first is not None:
            break
    more: dict[str, Any] = {"ik": ends.ik, "states_checked": states}
    if search.first is None:
        whole = replace(search.result, states_checked=states, time=working_time() - ended.begin)
        return ended(*why_no_path(problem, whole, request.seed), search=whole, **more)
    path, figures, before = search.cheapest()
    if path is None or figures is None:
        return ended(PlanStatus.NO_PATH_IN_TIME, NO_SPLINE + narrowest(problem, search.first), **more)
    more["costs"] = costs.along(figures, before)
    curve = as_cubic_path(asked.pepper, path)
    message = words(path, figures, before) + relaxation_sentence(problem, curve, options.margin)
    return ended.solved(checks.exact, path, message, curve, **more)


def words(path: Array, found: PathFigures, before: PathFigures | None) -> str:
    """Return a sentence on a path's costs, and on costs and length of the path planned without costs."""
    text = f"Path of {len(path)} waypoints; its costs are {found.integrals.sum():.3g} m"
    if before is None:
        return f"{text}."
    shorter = 100 * (1 - before.length / found.length)
    return f"{text}, without regard to them {before.integrals.sum():.3g} m on a way {shorter:.0f} % shorter."


class _CheapSearch:
    """Paths of one problem, from the first that is found to the cheapest.

    Attributes:
        result: Result of the first search, without costs.
        first: Path of the first search; None if none was found.
        states_checked: Number of configurations checked by searches.
    """

    def __init__(
        self, problem: PathProblem, costs: PathCosts, seed: int, deadlines: tuple[float, float]
    ) -> None:
        """Search a first path.

        Args:
            problem: The planning problem.
            costs: Soft costs.
            seed: Seed of all random choices.
            deadlines: Deadlines of the first path and of the whole search, on the clock of `working_time`
                [s].
        """
        self._problem, self._costs, self._seed, self._deadline = problem, costs, seed, deadlines[0]
        self._price = costs.for_planner(problem.start, problem.free)
        self.states_checked = 0
        self.result = planners.rrt_connect(problem.search_problem, seed=seed, timeout=self._left)
        self.first = next(iter(self._path(self.result)), None)
        self._deadline = deadlines[1]

    def cheapest(self) -> tuple[Array | None, PathFigures | None, PathFigures | None]:
        """Return waypoints, shape (m, n), their figures, and the figures of the path planned without costs.

        Waypoints and their figures are None if no spline is clear.
        """
        problem, first = self._problem, self.first
        assert first is not None
        way = PathSearch(problem, self._seed, self._left).along(first)
        plain = None if way is None else way.points
        before = None if plain is None else figures_of(problem, self._costs, plain)
        lowered = [self._descended(path, FIRST_STEPS) for path in self._paths(first)]
        candidates = sorted(lowered, key=self._price.along)
        candidates[0] = self._descended(candidates[0])
        for path in candidates:
            points = self._waypoints(path)
            if points is not None:
                figures = figures_of(problem, self._costs, points)
                if before is None or figures.total < before.total:
                    return points, figures, before
                break
        return plain, before, before

    @property
    def _left(self) -> float:
        return max(self._deadline - working_time(), 1e-3)

    def _paths(self, first: planners.Path) -> list[planners.Path]:
        """Return the first path and paths of further searches, with and without the price."""
        problem, found = self._problem.search_problem, [first]
        for seed in range(self._seed, self._seed + SEARCHES):
            options: dict[str, Any] = {"seed": seed, "max_iterations": MOST_ITERATIONS}
            if self._left > _LITTLE:
                found += self._path(
                    planners.transition_rrt(problem, self._price, timeout=self._left, **options)
                )
            if self._left > _LITTLE and seed > self._seed:
                others = self._path(planners.rrt_connect(problem, timeout=self._left, **options))
                # Without obstacles all searches end with the same straight edge.
                found += [one for one in others if not np.array_equal(one.points, first.points)]
        return found

    def _path(self, result: planners.Result) -> list[planners.Path]:
        self.states_checked += result.states_checked
        return [] if result.path is None else [result.path]

    def _descended(self, path: planners.Path, iterations: int = 200) -> planners.Path:
        return planners.descend_cost(
            self._problem.search_problem, self._price, path, seed=self._seed, iterations=iterations,
            timeout=self._left,
        )  # fmt: skip

    def _waypoints(self, path: planners.Path) -> Array | None:
        """Return the fewest waypoints whose spline is clear and costs little more than the path, or None."""
        allowed, best = _CLOSE * self._price.along(path), None
        for segments in _PIECES:
            points = self._problem.embed(path(np.linspace(0.0, path.length, segments + 1)))
            if way_through(self._problem, points, self._problem.relaxed_margins) is not None:
                best = points
                if figures_of(self._problem, self._costs, points).total <= allowed:
                    break
        return best


def figures_of(problem: PathProblem, costs: PathCosts, points: Array) -> PathFigures:
    """Return length and costs of the spline through waypoints [rad or m], shape (m, n)."""
    weights = np.zeros(problem.start.size)
    weights[problem.free] = problem.metric.weights
    return costs.figures(as_cubic_path(problem.checks.pepper, points), weights)
