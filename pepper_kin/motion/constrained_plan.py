"""Planning with constraints that hold along the whole path and the spline through its waypoints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, LimitError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.ik.tasks.task import words_for
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model import PepperModel
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.motion.constraints import manifold_of
from pepper_kin.motion.costed_plan import FIRST_STEPS, MOST_ITERATIONS, figures_of
from pepper_kin.motion.goals import STAYS, fault_of_start, free_joints, goals_of, is_there
from pepper_kin.motion.margins import falling_problems, narrowest, relaxation_sentence
from pepper_kin.motion.obstruction import why_no_path
from pepper_kin.motion.path_costs import PathCost, PathCosts, PathFigures
from pepper_kin.motion.plan_request import CheckedRequest, PlanOptions, PlanRequest
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.problem import Ends, PathProblem
from pepper_kin.trajectory.path import CubicPath, as_cubic_path

PLANNER = "cbirrt"
SHORTCUTS = 60
SEARCHES = 3
"""Number of paths from which the cost is lowered."""

STEPS = 200
"""Maximum number of steps of the descent from the cheapest path."""

_LITTLE = 0.01  # minimum remaining time for a further search [s]
NO_SPLINE = "A path was found, but no spline through waypoints of it keeps constraints and margin."
FEWEST_PIECES = 8
MOST_PIECES = 1024
SLACK = 0.98
"""Fraction of a tolerance that samples of the spline may use while waypoints are chosen."""

_BATCH = 256

SAMPLES = 6
"""Number of samples of each piece of the spline in the final examination."""


def plan_constrained(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike | Sequence[Any],
    scene: Scene | None = None,
    constraints: Sequence[Task | TaskGroup] = (),
    *,
    costs: Sequence[PathCost | Task | TaskGroup] | None = None,
    joints: str | Sequence[str] | None = None,
    margin: float = 0.01,
    least_margin: float = 0.0,
    seed: int = 0,
    timeout: float = 10.0,
    balance: Balance = "robot",
    torque_scale: TorqueScale = "robot",
    payload: Mapping[str, float] | None = None,
) -> Plan:
    """Plan a collision-free path along which IK tasks stay met.

    A tray that stays level is `AxisAlignment`, a box between two hands `RelativePose`, a gaze that stays on a
    point `LookAt`, a hand at a height `FrameInPlane`.  Each task's tolerance is what may be used of it on the
    way: half a degree acts as an equation for the planner, ten degrees as an inequality.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,), which meets the constraints.
        goal: Goal configuration [rad or m], shape (n,), several, shape (m, n), or a list of IK tasks, which
            are solved together with the constraints.
        scene: The world around the robot.
        constraints: Tasks with one target and a finite tolerance each.
        costs: Soft costs that are minimized together with the length, see `plan_costed`.
        joints: Joints that may move, by names of joints and groups; None: joints in which start and goals
            differ.
        margin: Requested distance to all bodies [m]; it is relaxed if necessary, as by `plan`.
        least_margin: Distance that the whole curve is proven to keep from the scene [m], from 0 to `margin`.
        seed: Seed of all random choices.
        timeout: Time budget of IK and search [s]; shortcutting and rounding may take half of it each.
        balance: Distance that the center of mass keeps from the edges of the wheels' triangle [m]; "robot"
            for the robot's requirement; None to leave balance out.
        torque_scale: Fraction of the effort limits for holding torques; "robot" for the robot's requirement.
        payload: Point masses held at "left", "right" or a frame by name [kg], in addition to attached
            objects.

    Returns:
        The plan.  `constraint_errors` holds the largest error of each constraint along the spline that
        `retime` follows.

    Raises:
        InvalidValueError: for a wrong shape, NaN, no constraint or cost, or an infinite tolerance.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint, frame or group.
    """
    if constraints is None:
        raise InvalidValueError("constraints", None, "a list of tasks")
    options = PlanOptions(
        constraints=constraints, costs=costs, joints=joints, margin=margin, least_margin=least_margin,
        seed=seed, timeout=timeout, balance=balance, torque_scale=torque_scale, payload=payload,
    )  # fmt: skip
    return constrained_path(PlanRequest(pepper, start, goal, scene, options))


def constrained_path(asked: PlanRequest) -> Plan:
    """Return the plan of a request with constraints; see `plan_constrained`."""
    pepper, options = asked.pepper, asked.options
    request = asked.checked(PLANNER)
    checks, ended, tasks, q_start = request.checks, request.ended, request.constraints, request.start
    fault = _off(pepper, tasks, q_start, "start")
    fault = fault or fault_of_start(checks, q_start, options.least_margin)
    if fault is not None:
        return ended(*fault)
    goals, ik, fault = goals_of(request)
    faults = [_off(pepper, tasks, q, "goal") for q in goals]
    goals = goals[[k for k, off in enumerate(faults) if off is None]]
    if not len(goals):
        return ended(*(fault or next(off for off in faults if off is not None)), ik=ik)
    free = free_joints(pepper, options.joints, q_start, goals)
    if is_there(q_start, goals):
        errors = largest_errors(pepper, q_start[None], tasks)
        return ended.solved(checks.exact, q_start[None], STAYS, ik=ik, constraint_errors=errors)
    manifold, states = manifold_of(pepper, tasks, q_start, free), 0
    for problem, share in falling_problems(checks, Ends(q_start, goals, free), options.margins):
        left = request.left(share)
        result = planners.cbirrt(problem.search_problem, manifold, seed=request.seed, timeout=left)
        states += result.states_checked
        if result.path is not None:
            break
    more: dict[str, Any] = {"ik": ik, "states_checked": states}
    if result.path is None:
        whole = replace(result, states_checked=states, time=working_time() - ended.begin)
        return ended(*why_no_path(problem, whole, request.seed, manifold), search=whole, **more)
    along = _Along(request, problem, manifold)
    path = along.shortest(result.path)
    if request.costs is not None:
        path, figures, before = along.cheapest(result.path, request.costs, path)
        more["costs"] = () if figures is None else request.costs.along(figures, before)
    return along.ended(path, more, result.path)


class _Along:
    """Post-processing of a path on a constraint manifold, up to the plan."""

    def __init__(
        self, request: CheckedRequest, problem: PathProblem, manifold: planners.ConstraintManifold
    ) -> None:
        self._request, self._problem, self._manifold = request, problem, manifold
        self._seed, self._timeout = request.seed, request.options.timeout / 2

    def shortest(self, path: planners.Path) -> Array | None:
        """Shorten and smooth a path; return waypoints whose spline is valid, shape (m, n), or None."""
        problem, manifold, timeout = self._problem, self._manifold, self._timeout
        short = planners.constrained_shortcut(
            problem.search_problem, manifold, path, seed=self._seed, iterations=SHORTCUTS, timeout=timeout
        )
        rounded = planners.constrained_smooth(problem.relaxed, manifold, short, timeout=timeout)
        return constrained_waypoints(problem, manifold, (rounded, short, path))

    def cheapest(
        self, path: planners.Path, costs: PathCosts, plain: Array | None
    ) -> tuple[Array | None, PathFigures | None, PathFigures | None]:
        """Return waypoints of a path of small cost, its figures, and the figures of the path without costs.

        Args:
            path: A path on the manifold.
            costs: Soft costs.
            plain: Waypoints of the path planned without costs [rad or m], shape (m, n).
        """
        problem = self._problem
        before = None if plain is None else figures_of(problem, costs, plain)
        price = costs.for_planner(problem.start, problem.free)
        end = working_time() + self._timeout

        def descended(one: planners.Path, steps: int) -> planners.Path:
            left = max(end - working_time(), 1e-3)
            return planners.descend_cost(
                problem.search_problem, price, one, manifold=self._manifold, seed=self._seed,
                iterations=steps, timeout=left,
            )  # fmt: skip

        others = [self._other(self._seed + k, end - working_time()) for k in range(1, SEARCHES)]
        lowered = [descended(one, FIRST_STEPS) for one in (path, *others) if one is not None]
        lowered.sort(key=price.along)
        cheapest = descended(lowered[0], STEPS)
        points = constrained_waypoints(problem, self._manifold, (cheapest, *lowered))
        figures = None if points is None else figures_of(problem, costs, points)
        if figures is None or (before is not None and before.total <= figures.total):
            return plain, before, before
        return points, figures, before

    def _other(self, seed: int, timeout: float) -> planners.Path | None:
        """Return the path of a further search, which may pass obstacles on another side, or None."""
        if timeout < _LITTLE:
            return None
        result = planners.cbirrt(
            self._problem.search_problem, self._manifold, seed=seed, timeout=timeout / SEARCHES,
            max_iterations=MOST_ITERATIONS,
        )  # fmt: skip
        return result.path

    def ended(self, path: Array | None, more: dict[str, Any], found: planners.Path) -> Plan:
        """Return the plan of waypoints, which fails if there are none or their spline violates constraints.

        Args:
            path: Waypoints [rad or m], shape (m, n); None for none.
            more: Other fields of the plan.
            found: Path of the search.
        """
        tasks, checks, ended = self._request.constraints, self._request.checks, self._request.ended
        errors = () if path is None else largest_errors(checks.pepper, path, tasks)
        uses = (error / task.tolerance for task, error in zip(tasks, errors, strict=True))
        if path is None or max(uses) > 1.0 + 1e-9:
            message = NO_SPLINE + narrowest(self._problem, found)
            return ended(PlanStatus.NO_PATH_IN_TIME, message, **{**more, "costs": ()})
        curve = as_cubic_path(checks.pepper, path)
        words = _words(tasks, path, errors)
        words += relaxation_sentence(self._problem, curve, self._request.options.margin)
        return ended.solved(checks.exact, path, words, curve, constraint_errors=errors, **more)


def _off(pepper: PepperModel, tasks: Sequence[Task], q: Array, what: str) -> tuple[PlanStatus, str] | None:
    """Return status and message if a configuration q [rad or m], (n,), violates a constraint, or None."""
    for task in tasks:
        if task.error(pepper, q) > task.tolerance * (1.0 + 1e-9):
            status = PlanStatus.START_OFF_CONSTRAINT if what == "start" else PlanStatus.GOAL_OFF_CONSTRAINT
            allowed = f"its tolerance is {words_for(task.tolerance, task.unit_on(pepper))}"
            return status, f"The {what} does not meet a constraint: {task.shortfall(pepper, q)}; {allowed}."
    return None


def _words(tasks: Sequence[Task], path: Array, errors: Sequence[float]) -> str:
    """Return a sentence on a path, shape (m, n), and how much of its tolerance the worst task uses."""
    worst = max(range(len(tasks)), key=lambda k: errors[k] / tasks[k].tolerance)
    used = 100 * errors[worst] / tasks[worst].tolerance
    return f"Path of {len(path)} waypoints; {tasks[worst].name} uses {used:.0f} % of its tolerance."


def constrained_waypoints(
    path_problem: PathProblem, manifold: planners.ConstraintManifold, candidates: Sequence[planners.Path]
) -> Array | None:
    """Return the fewest equidistant waypoints whose spline is valid and keeps the constraints.

    `retime` follows the cubic spline through waypoints.  Its deviation from the manifold falls with the
    fourth power of the waypoints' distance where the path is smooth, so their number is doubled until the
    spline keeps the tolerances everywhere.  The spline keeps half the margins at coarse samples, and is then
    examined closely.

    Args:
        path_problem: The planning problem of the joints that move.
        manifold: The constraints on these joints.
        candidates: Paths on the manifold, best first.

    Returns:
        Waypoints [rad or m], shape (m, n); None if not even the densest suffice.
    """
    pepper, problem, embed = path_problem.checks.pepper, path_problem.relaxed, path_problem.embed
    moving = np.flatnonzero(np.isnan(embed(np.full((1, problem.n), np.nan))[0]))
    for path in candidates:
        segments = FEWEST_PIECES
        while segments <= MOST_PIECES:
            states = np.clip(path(np.linspace(0.0, path.length, segments + 1)), problem.lower, problem.upper)
            states[1:-1] = planners.project(problem, manifold, states[1:-1])[0]
            points = embed(states)
            try:
                spline = as_cubic_path(pepper, points)
            except (InvalidValueError, LimitError):
                segments *= 2
                continue
            if _spline_holds(problem, manifold, spline, moving) and path_problem.is_clear(spline, (0.0, 0.0)):
                return points
            segments *= 2
    return None


def _spline_holds(
    problem: planners.Problem,
    manifold: planners.ConstraintManifold,
    spline: CubicPath,
    moving: NDArray[np.int64],
) -> bool:
    """Return whether a spline keeps constraints and bounds and is valid at the problem's resolution.

    The spline is of whole configurations; `moving` are the indices of the joints that move, shape (k,).
    """
    spans = np.diff(spline.breaks)
    ends = spline.at(np.arange(spans.size), spans)
    lengths = problem.metric.distance(spline.coefficients[:, 0][:, moving], ends[:, moving])
    counts = np.maximum(4, np.ceil(1.5 * lengths / problem.spacing).astype(int))
    rows = [spline.at(np.full(k, i), np.arange(k) / k * spans[i]) for i, k in enumerate(counts)]
    states = np.ascontiguousarray(np.concatenate([*rows, ends[-1:]])[:, moving])
    # The ends are given, so the tolerance may be used up as far as the ends do.
    errors = manifold.errors(states) / manifold.tolerances
    at_ends = np.maximum(errors[[0, -1]].max(), SLACK)
    if errors.max() > min(at_ends, 1.0 + 1e-9):
        return False
    validator = problem.validator()
    batches = (states[k : k + _BATCH] for k in range(0, len(states), _BATCH))
    return all(bool(validator.states_valid(batch).all()) for batch in batches)


def largest_errors(pepper: PepperModel, path: Array, tasks: Sequence[Task]) -> tuple[float, ...]:
    """Return the largest error of each task along the spline through waypoints, by Pinocchio.

    No code is shared with the machine code that found the path.

    Args:
        pepper: The robot.
        path: Waypoints, shape (k, n) [rad or m].
        tasks: The constraints.

    Returns:
        One error for each task [m or rad].
    """
    dense = path
    if len(path) > 1:
        spline = as_cubic_path(pepper, path)
        segments = np.repeat(np.arange(len(spline.breaks) - 1), SAMPLES)
        local = np.tile(np.arange(SAMPLES) / SAMPLES, len(spline.breaks) - 1)
        dense = np.concatenate([spline.at(segments, local * np.diff(spline.breaks)[segments]), path[-1:]])
    return tuple(max(task.error(pepper, q) for q in dense) for task in tasks)
