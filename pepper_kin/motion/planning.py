"""Planning of collision-free paths from start to goal, and to a new goal while the robot moves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin import planners
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.collision.checked_world import LEFT_EMPTY, checked_world, is_left_empty
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, MissingDependencyError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vector, check_within_limits
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.motion.constrained_plan import constrained_path
from pepper_kin.motion.costed_plan import costed_path
from pepper_kin.motion.driving import plan_drive
from pepper_kin.motion.goals import are_alternatives, ends_of, plan_to_any
from pepper_kin.motion.margins import falling_problems, narrowest, relaxation_sentence
from pepper_kin.motion.moving_plan import plan_in_motion, way_on
from pepper_kin.motion.obstruction import why_no_path
from pepper_kin.motion.path_costs import PathCost
from pepper_kin.motion.path_search import LEAST_GAIN, SHORTCUTS, PathSearch, compared
from pepper_kin.motion.plan_request import (
    CheckedRequest,
    PlanOptions,
    PlanRequest,
    moves_base,
    refuse_what_cannot_drive,
)
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.problem import COARSE, RESOLUTION, Ends, PathProblem
from pepper_kin.motion.smoothed_plan import refuse_costs, smoothed
from pepper_kin.motion.waypoints import Way
from pepper_kin.planners.compiled import PausedClock, Slices, checked_gap, whole
from pepper_kin.trajectory import Splice, Trajectory
from pepper_kin.trajectory.limits import JerkLike
from pepper_kin.trajectory.splice import MovingStart

PLANNERS = ("rrt_connect", "aorrtc")

BASE_JOINTS = frozenset(("BaseX", "BaseY"))
SEARCHES_OF_BASE, DETOURS_OF_BASE, GAP_OF_BASE = 4, 400, 0.1
"""Numbers of searches and of shortcuts, and excess over the straight line to improve, if the base moves."""

NO_SPLINE = "A path was found, but no spline through waypoints of it is free of collision."


def plan(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike | Sequence[Any] | Task | TaskGroup,
    scene: Scene | None = None,
    *,
    planner: str = "rrt_connect",
    joints: str | Sequence[str] | None = None,
    constraints: Sequence[Task | TaskGroup] | None = None,
    costs: Sequence[PathCost | Task | TaskGroup] | None = None,
    margin: float = 0.01,
    least_margin: float = 0.0,
    seed: int = 0,
    timeout: float = 5.0,
    gap: float | None = None,
    balance: Balance = "robot",
    torque_scale: TorqueScale = "robot",
    payload: Mapping[str, float] | None = None,
    smooth: bool = False,
    start_velocity: ArrayLike | None = None,
) -> Plan:
    """Plan a collision-free path.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration [rad or m], shape (n,), several, shape (m, n), or IK tasks, or several lists
            of tasks of which any suffices, such as the grasps of one object.  For revolute joints without
            limits, full turns are ignored: the path ends within half a turn of the start.  Tasks are solved
            from several starts; of the nearby free solutions, the one with the center of mass farthest inside
            the wheels is chosen if a path to it is found at once, since motions there may decelerate more;
            else the one with the shortest path.
        scene: The world around the robot; attached objects count with their mass.
        planner: "rrt_connect"; "aorrtc", which improves its path until `gap` or `timeout`; or a name of
            `planners.available_ompl_planners()`.  Short-cutting and smoothing follow.
        joints: Joints that may move, by names of joints and groups; None: joints in which start and goals
            differ.
        constraints: IK tasks that stay met along the whole path; `plan_constrained` then plans.
        costs: Soft costs that are minimized together with the length; `plan_costed` then plans.
        margin: Requested distance to all bodies [m]; it is reduced if start or goal are nearer, or relaxed if
            no path keeps it, and the message states the new value.
        least_margin: Distance that the whole curve is proven to keep from the scene [m], from 0 to `margin`.
        seed: Seed of all random choices.
        timeout: Time budget [s]; if the search used all of it, shortcuts may take a twentieth more.
        gap: Relative gap at which "aorrtc" stops: the path is at most ``1 + gap`` times as long as the
            straight line to the nearest goal; None: it stops at the straight line itself, or when time is up.
        balance: Distance that the center of mass keeps from the edges of the wheels' triangle [m], which
            `retime` then keeps too; "robot" for the value of `pepper.requirements`, 10 mm for Pepper; None
            only if the base is held, because the robot may tip over.
        torque_scale: Fraction of the effort limits, which `retime` then keeps too; "robot" for the value of
            `pepper.requirements`, 0.9 for Pepper, so that servos can correct errors.
        payload: Point masses held at "left", "right" or a frame by name [kg], in addition to attached
            objects: the joints can hold them along the whole path, and they count for balance.
        smooth: Whether to compute the motion to execute, too: `optimize` changes path and timing together,
            within the limits of velocity, acceleration and torque.  If that gains nothing over `retime`, the
            retimed plan is returned, and the message says so.
        start_velocity: Initial velocity [rad/s or m/s], shape (n,): the plan is then a motion within the
            limits of velocity, acceleration and torque; see `plan_in_motion`.

    Returns:
        The plan, with a trajectory if `smooth` or `start_velocity` is given; without a path, its status and
        message tell the reason, and the most frequent obstruction.

    Raises:
        InvalidValueError: for a wrong shape, NaN, an unknown planner, or one that takes no constraints or
            costs; for options that a differential base does not allow; for a gap below 0 or with another
            planner; for soft costs with `smooth`; with `smooth` or `start_velocity`, for a joint without
            acceleration limit; for a `start_velocity` of joints that may not move, or together with a base
            that may move, constraints, costs, `smooth`, or moving obstacles.
        LimitError: for a start or goal outside the joint limits, or a velocity, naming the joint.
        UnknownNameError: for an unknown joint or group.
        MissingDependencyError: for a planner of OMPL's where that is not installed.
    """
    if smooth:
        refuse_costs(costs)
    guided = constraints is not None or costs is not None
    check_planner(planner, guided)
    refuse_what_cannot_drive(pepper, joints, planner, guided)
    _check_gap(planner, gap)
    options = PlanOptions(
        planner=planner, joints=joints, constraints=constraints, costs=costs, margin=margin,
        least_margin=least_margin, seed=seed, timeout=timeout, gap=gap, balance=balance,
        torque_scale=torque_scale, payload=payload, smooth=smooth, start_velocity=start_velocity,
    )  # fmt: skip
    if isinstance(goal, (Task, TaskGroup)):
        goal = [goal]
    request = PlanRequest(pepper, start, goal, scene, options)
    found = plan_to_any(request, _planned) if are_alternatives(goal) else _planned(request)
    return smoothed(pepper, found, scene, options) if smooth else found


def _planned(asked: PlanRequest) -> Plan:
    """Plan, and plan again with coal if machine code mistook a free end for one in contact; see `plan`."""
    way = WAYS[_kind_of(asked.options)]
    found = way(asked)
    ends = planners.Status.START_INVALID, planners.Status.GOAL_INVALID
    if found.success or found.search is None or found.search.status not in ends:
        return found
    return way(replace(asked, asks_coal=True))


def _kind_of(options: PlanOptions) -> str:
    """Return the kind of planning that options ask for, a key of `WAYS`."""
    if options.start_velocity is not None:
        return "velocity"
    if options.constraints is not None:
        return "constraints"
    return "nothing" if options.costs is None else "costs"


def _free_path(asked: PlanRequest) -> Plan:
    """Plan without constraints and costs; see `plan`."""
    request = asked.checked()
    checks, ended = request.checks, request.ended
    ends = ends_of(request)
    if isinstance(ends, Plan):
        return ends
    if moves_base(asked.pepper, ends.free):
        made = plan_drive(request, ends)
        return made if ends.ik is None else replace(made, ik=ends.ik)
    problem, result, way, states = whole(path_found(request, ends))
    more: dict[str, Any] = {"ik": ends.ik, "states_checked": states, "search": result}
    if result.path is None:
        searched = replace(result, states_checked=states, time=working_time() - ended.begin)
        return ended(*why_no_path(problem, searched, request.seed), **more)
    if way is None:
        return ended(PlanStatus.NO_PATH_IN_TIME, NO_SPLINE + narrowest(problem, result.path), **more)
    message = f"Path of {len(way.points)} waypoints.{_how_short(result)}"
    message += relaxation_sentence(problem, way.curve, asked.options.margin)
    if is_left_empty(asked.scene):
        message += f" {LEFT_EMPTY}"
    return ended.solved(checks.exact, way.points, message, way.curve, **more)


WAYS: dict[str, Callable[[PlanRequest], Plan]] = {
    "nothing": _free_path,
    "costs": costed_path,
    "constraints": constrained_path,
    "velocity": partial(plan_in_motion, search=_free_path),
}
"""Kind of planning -> function that plans."""


class PathFound(NamedTuple):
    """Result of the searches of a path.

    Attributes:
        problem: The last problem that was searched.
        result: Result of the last search.
        way: The examined way along its path; None if there is none.
        states: Number of configurations checked by all searches.
    """

    problem: PathProblem
    result: planners.Result
    way: Way | None
    states: int


def path_found(request: CheckedRequest, ends: Ends, clock: PausedClock | None = None) -> Slices[PathFound]:
    """Search at decreasing margins, with pauses by a clock if the planner is "rrt_connect".

    A coarse search is repeated at fine resolution if its spline turns out to touch something.

    Args:
        request: The checked request, without a moving differential base.
        ends: Ends of the path.
        clock: Clock of the request; None to search without pauses.
    """
    checks, options, planner = request.checks, request.options, request.options.planner
    own, coarse, compare, states = planner in PLANNERS, planner == PLANNERS[0], ends.ik is not None, 0
    drives = not BASE_JOINTS.isdisjoint(map(checks.pepper.joint_names.__getitem__, ends.free.tolist()))
    at_once = coarse and checks.compiled and not drives
    for problem, share in falling_problems(checks, ends, options.margins, COARSE if coarse else RESOLUTION):
        for closer in (False, True) if coarse else (False,):
            posed, left = problem.finer() if closer else problem, request.left(share if own else 1.0)
            if at_once:
                result, way = yield from PathSearch(posed, request.seed, left, clock).searching(compare)
            else:  # OMPL's planners take all of the time
                result, way = find_path(
                    posed.search_problem, planner, seed=request.seed, timeout=left, compare=compare,
                    gap=options.gap, total=request.left(),
                ), None  # fmt: skip
                if result.path is not None:
                    left = max(request.left(), options.timeout / 20)
                    way = PathSearch(posed, request.seed, left).along(result.path)
            if way is not None or result.path is None:
                break
        states += result.states_checked
        if way is not None or not own:
            break
    return PathFound(problem, result, way, states)


def _how_short(result: planners.Result) -> str:
    """Return a sentence on the path length of a planner that improves its path; empty for others."""
    if result.stop_reason is None:
        return ""
    return (
        f" Found with a length of {result.cost:.4g}, {100 * result.gap:.1f} % above the straight line's "
        f"{result.lower_bound:.4g} [m, in the metric of the search]; "
        f"it ended because {result.stop_reason.value}."
    )


def _check_gap(planner: str, gap: float | None) -> None:
    """Refuse a gap that the planner cannot use.

    Raises:
        InvalidValueError: for a gap below 0, or a planner other than "aorrtc".
    """
    if gap is not None and planner != "aorrtc":
        raise InvalidValueError("gap", gap, f"None with planner {planner!r}, or planner 'aorrtc'")
    if gap is not None:
        checked_gap(gap)


def check_planner(planner: str, constrained: bool) -> None:
    """Refuse a planner that does not exist, or that cannot plan with constraints or costs.

    Raises:
        InvalidValueError: for an unknown planner, one that the installed OMPL lacks, or another planner than
            the default with constraints or costs.
        MissingDependencyError: for a planner of OMPL if OMPL is not installed.
    """
    own = ", ".join(map(repr, PLANNERS))
    if planner not in PLANNERS:
        available = planners.available_ompl_planners()
        if planner in planners.OMPL_PLANNERS and not available:
            raise MissingDependencyError("ompl", "pip install 'pepper_kin[ompl]'", f"planner {planner!r}")
        if planner not in available:
            lacking = " (the installed ompl lacks it)" if planner in planners.OMPL_PLANNERS else ""
            allowed = ", ".join((own, *map(repr, available)))
            raise InvalidValueError("planner", f"{planner!r}{lacking}", f"one of {allowed}")
    if constrained and planner != PLANNERS[0]:
        raise InvalidValueError(
            "planner", repr(planner), f"{PLANNERS[0]!r} (the default) with constraints or costs"
        )


def find_path(
    problem: planners.Problem,
    planner: str,
    *,
    seed: int,
    timeout: float,
    compare: bool,
    gap: float | None = None,
    total: float | None = None,
) -> planners.Result:
    """Search a path.

    Args:
        problem: The planning problem.
        planner: "rrt_connect", "aorrtc" or the name of a planner of OMPL.
        seed: Seed of all random choices.
        timeout: Time budget in which a path has to be found [s].
        compare: Whether the path is shortened and ends at another goal if that is nearer from a waypoint.
        gap: Relative gap at which "aorrtc" stops, see `plan`.
        total: Time budget of "aorrtc", including the first path [s]; None for `timeout`.
    """
    begin = working_time()
    if planner == "aorrtc" and total in (None, timeout):
        return planners.aorrtc(problem, seed=seed, timeout=timeout, gap=gap)
    if planner == "aorrtc":
        found = planners.rrt_connect(problem, seed=seed, timeout=timeout)
        if found.path is None:
            return found
        left = _left(begin, float(total or timeout))
        return _to_a_goal(planners.aorrtc(problem, found.path, seed=seed, timeout=left, gap=gap), found)
    if planner != "rrt_connect":
        return planners.ompl_plan(problem, planner, seed=seed, timeout=timeout)
    first = planners.rrt_connect(problem, seed=seed, timeout=timeout)
    if first.path is not None and BASE_JOINTS.intersection(problem.labels or ()):
        return _shortest_of_base(problem, first, seed, planners.Deadline(_left(begin, timeout)))
    return compared(problem, first, seed, timeout) if compare else first


def _shortest_of_base(
    problem: planners.Problem, first: planners.Result, seed: int, deadline: planners.Deadline
) -> planners.Result:
    """Return the shortest of several paths, with detours removed: detours of the base cost most.

    Searches end as soon as a shortened path is hardly longer than the straight line to its goal.
    """

    def straight(result: planners.Result) -> float:
        goal = problem.goals[int(result.goal_index or 0)]
        return float(problem.metric.distance(problem.start, goal[None])[0])

    def shortened(result: planners.Result, iterations: int, **options: Any) -> planners.Result:
        assert result.path is not None
        path = planners.shortcut(
            problem, result.path, seed=seed, iterations=iterations, resolution=problem.spacing,
            timeout=max(deadline.left, 1e-3), **options,
        )  # fmt: skip
        return replace(result, path=path, cost=path.length)

    best = shortened(first, SHORTCUTS, least_gain=LEAST_GAIN)
    for k in range(1, SEARCHES_OF_BASE):
        if best.cost <= straight(best) * (1.0 + GAP_OF_BASE) or deadline.expired:
            break
        other = planners.rrt_connect(problem, seed=seed + (k << 64), timeout=max(deadline.left, 1e-3))
        if other.path is not None:
            best = min(best, shortened(other, SHORTCUTS, least_gain=LEAST_GAIN), key=lambda found: found.cost)
    if best.cost > straight(best) * (1.0 + GAP_OF_BASE / 2):
        best = shortened(best, DETOURS_OF_BASE, least_gain=LEAST_GAIN / 2, detours=True)
    return best


def _left(begin: float, timeout: float) -> float:
    """Return the remaining time of a time budget [s], above zero."""
    return max(timeout - (working_time() - begin), 1e-3)


def _to_a_goal(better: planners.Result, first: planners.Result) -> planners.Result:
    """Return an improved result with the goal index of the first one, if it has none of its own."""
    return replace(better, goal_index=first.goal_index) if better.goal_index is None else better


def replan(
    pepper: PepperModel,
    trajectory: Trajectory,
    at: float,
    goal: ArrayLike,
    scene: Scene | None = None,
    *,
    torque: bool = True,
    torque_scale: TorqueScale = "robot",
    balance: Balance = "robot",
    margin: float = 0.01,
    seed: int = 0,
    timeout: float = 1.0,
    jerk: JerkLike | None = None,
) -> Splice:
    """Return a motion with a new goal from an instant on, along a planned path if necessary.

    The motion goes straight to the goal, as by `Trajectory.replaced`, if that keeps all limits and touches
    nothing.  Else a path is planned from where the motion can stop, or from the current position if the stop
    is obstructed; timed from rest to rest; and joined in motion, as by `Trajectory.replaced`.  If it cannot
    be joined, a straight motion with lower accelerations is tried; else the robot stops first, and
    `Splice.how` says so.

    Args:
        pepper: The robot, which gives the limits.
        trajectory: The motion.
        at: Time of the instant [s].
        goal: Joint positions [rad or m], shape (n,).
        scene: The world around the robot, with attached objects; None for the robot alone.
        torque: Whether to keep within the effort limits.
        torque_scale: Fraction of the effort limits to use, in (0, 1]; "robot" for the robot's requirement.
        balance: Distance that the zero-moment point keeps from the edges of the wheels' triangle [m]; "robot"
            for the robot's requirement; None to leave balance out.
        margin: Requested distance of the planned path to all bodies [m]; it is relaxed if necessary, as by
            `plan`.
        seed: Seed of the search.
        timeout: Time budget of the search [s].
        jerk: Jerk limits as `retime` takes them, for continuous accelerations; None for no jerk limits.

    Raises:
        InvalidValueError: for an argument that `Trajectory.replaced` or `plan` refuses.
        LimitError: for a goal outside the position limits.
        InfeasibleError: if no path was found, or none that the robot can join, with the reason.
    """
    world = checked_world(scene)
    goal = np.array(as_joint_vector(pepper, goal, "goal"))
    check_within_limits(pepper, goal, "goal", 1e-9)
    reserve: dict[str, Any] = {"torque_scale": torque_scale, "balance": balance}
    limits = {"torque": torque, "jerk": jerk, **reserve}
    moving = MovingStart(pepper, trajectory, at, world, **limits)

    def search(begin: Array) -> Plan:
        return plan(pepper, begin, goal, world, margin=margin, seed=seed, timeout=timeout, **reserve)

    found, way = way_on(moving, goal[None], search, **limits)
    if found is None and way is not None and not way.success:
        raise InfeasibleError("splice", way.message, way.advice)
    if found is None:
        reason = "something is in the way of a stop, and no way past it was found"
        raise InfeasibleError("splice", reason, "an earlier instant, or stop(how='joints')")
    return found
