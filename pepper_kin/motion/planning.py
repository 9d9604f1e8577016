"""From start, goal and scene to a collision-free path."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, MissingDependencyError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.constrained_plan import plan_constrained
from pepper_kin.motion.costed_plan import plan_costed
from pepper_kin.motion.driving import moves_base, plan_drive, refuse_what_cannot_drive
from pepper_kin.motion.goals import STAYS, fault_of_start, free_joints, goals_of, is_there
from pepper_kin.motion.obstruction import why_no_path
from pepper_kin.motion.path_costs import PathCost
from pepper_kin.motion.plan_result import Ending, Plan, PlanStatus
from pepper_kin.motion.problem import COARSE, RESOLUTION, PathProblem, checked_start, path_problem
from pepper_kin.motion.smoothed_plan import refuse_costs, smoothed
from pepper_kin.motion.waypoints import waypoints_of

PLANNERS = ("rrt_connect", "aorrtc")

SHORTCUTS_TO_COMPARE = 40
"""Short-cuts tried before other goals are."""

GAIN_TO_COMPARE = 0.02
"""Part of the length that each short-cut has to save."""

SHARE_OF_TIME = 0.02
"""Part of the time budget that they may take."""

BASE_JOINTS = frozenset(("BaseX", "BaseY"))
SAMPLES_OF_BASE, GAP_OF_BASE = 1000, 0.05
"""How long a shorter way is looked for where the base drives, since a detour costs seconds there."""

NO_SPLINE = "A path was found, but no spline through way-points of it is free of collision."


def plan(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike | Sequence[Any],
    scene: Scene | None = None,
    *,
    planner: str = "rrt_connect",
    joints: str | Sequence[str] | None = None,
    constraints: Sequence[Task | TaskGroup] | None = None,
    costs: Sequence[PathCost | Task | TaskGroup] | None = None,
    margin: float = 0.01,
    seed: int = 0,
    timeout: float = 5.0,
    gap: float | None = None,
    smooth: bool = False,
) -> Plan:
    """Plan a collision-free path.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration, shape (n,), several, shape (m, n), or a list of IK tasks, which are solved
            from several starts; of the free solutions the one with the shortest path is taken.
        scene: The world around the robot.
        planner: "rrt_connect"; "aorrtc", which improves its path until `gap` or `timeout`; or a name of
            `planners.available_ompl_planners()`.  Short-cutting and smoothing follow.
        joints: Joints that may move, a group or names; None: those in which start and goals differ.
        constraints: IK tasks that stay met along the whole path; `plan_constrained` then plans.
        costs: Soft costs that are made small together with the length; `plan_costed` then plans.
        margin: Distance kept to all things [m]; less where start or goal are nearer than that.
        seed: Seed of all random choices.
        timeout: Time budget [s]; where the search took all of it, a twentieth more for the short-cuts.
        gap: Of "aorrtc": it stops where the path is at most ``1 + gap`` times the straight line to the
            nearest goal; None: at the straight line itself, or when the time is used up.
        smooth: Whether to make the motion to execute, too: `optimise` changes path and timing together,
            within the limits of velocity, acceleration and torque.  Where that gains nothing over `retime`,
            the retimed plan stays, and the message says so.

    Returns:
        The plan, with `smooth` its trajectory; without a path, its status and message tell why, and what was
        most often in the way.

    Raises:
        InvalidValueError: for a wrong shape, NaN, an unknown planner, or one that takes no constraints or
            costs; for any of these that do not go with a differential base; for a gap that is below 0 or for
            another planner; for soft costs with `smooth`; there also for a joint without limit of
            acceleration.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint or group.
        MissingDependencyError: for a planner of OMPL's where that is not installed.
    """
    if smooth:
        refuse_costs(costs)
    found = _planned(
        pepper, start, goal, scene, planner=planner, joints=joints, constraints=constraints, costs=costs,
        margin=margin, seed=seed, timeout=timeout, gap=gap,
    )  # fmt: skip
    return smoothed(pepper, found, scene, constraints, margin=margin, timeout=timeout) if smooth else found


def _planned(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike | Sequence[Any],
    scene: Scene | None,
    *,
    planner: str,
    joints: str | Sequence[str] | None,
    constraints: Sequence[Task | TaskGroup] | None,
    costs: Sequence[PathCost | Task | TaskGroup] | None,
    margin: float,
    seed: int,
    timeout: float,
    gap: float | None,
) -> Plan:
    """Return a plan without its timing; see `plan`."""
    guided = constraints is not None or costs is not None
    check_planner(planner, guided)
    refuse_what_cannot_drive(pepper, joints, planner, guided)
    _check_gap(planner, gap)
    if constraints is not None:
        return plan_constrained(
            pepper, start, goal, scene, constraints, costs=costs, joints=joints, margin=margin, seed=seed,
            timeout=timeout,
        )  # fmt: skip
    if costs is not None:
        return plan_costed(
            pepper, start, goal, scene, costs, joints=joints, margin=margin, seed=seed, timeout=timeout
        )
    q_start = checked_start(pepper, start, margin, timeout)
    checks = Checks(pepper, scene)
    begin = time.perf_counter()  # code is loaded by now, and perhaps compiled: that is not planning
    ended = Ending(pepper, begin, seed, planner)
    fault = fault_of_start(checks, q_start)
    if fault is not None:
        return ended(*fault)
    goals, ik, fault = goals_of(checks, q_start, goal, joints, margin, seed, timeout)
    if fault is not None:
        return ended(*fault, ik=ik)
    free = free_joints(pepper, joints, q_start, goals)
    if is_there(q_start, goals):
        return ended.solved(checks.exact, q_start[None], STAYS, ik=ik)
    if moves_base(pepper, free):
        made = plan_drive(ended, checks, q_start, goals, free, margin, begin + timeout)
        return made if ik is None else replace(made, ik=ik)
    coarse = planner == PLANNERS[0]
    room = path_problem(checks, q_start, goals, free, margin, COARSE if coarse else RESOLUTION)
    result, path = _searched(room, planner, seed, begin, timeout, ik is not None, coarse, gap)
    said: dict[str, Any] = {"ik": ik, "states_checked": result.states_checked, "search": result}
    if result.path is None:
        return ended(*why_no_path(room, result, seed), **said)
    if path is None:
        return ended(PlanStatus.NO_PATH_IN_TIME, NO_SPLINE, **said)
    return ended.solved(checks.exact, path, f"Path of {len(path)} way-points.{_how_short(result)}", **said)


def _how_short(result: planners.Result) -> str:
    """Return what a planner that improves its path says of its length, as a sentence that may be empty."""
    if result.stop_reason is None:
        return ""
    return (
        f" Found with a length of {result.cost:.4g}, {100 * result.gap:.1f} % above the straight line's "
        f"{result.lower_bound:.4g} [m, in the metric of the search]; "
        f"it ended because {result.stop_reason.value}."
    )


def _searched(
    room: PathProblem,
    planner: str,
    seed: int,
    begin: float,
    timeout: float,
    compare: bool,
    coarse: bool,
    gap: float | None,
) -> tuple[planners.Result, NDArray[np.float64] | None]:
    """Return what a search found, and way-points of it, shape (m, n); None where no spline is clear.

    What was searched coarsely is searched again, closely, where its spline turns out to touch something.
    """
    left = _left(begin, timeout)
    result = find_path(room.problem, planner, seed=seed, timeout=left, compare=compare, gap=gap)
    if result.path is None:
        return result, None
    time_left = max(_left(begin, timeout), timeout / 20)
    path = waypoints_of(room, result.path, seed=seed, timeout=time_left)
    if path is None and coarse:
        return _searched(room.finer(), planner, seed, begin, timeout, compare, False, gap)
    return result, path


def _left(begin: float, timeout: float) -> float:
    """Return what is left of a time budget [s], above zero."""
    return max(timeout - (time.perf_counter() - begin), 1e-3)


def _check_gap(planner: str, gap: float | None) -> None:
    """Refuse a gap that no planner can use.

    Raises:
        InvalidValueError: It is below 0, or the planner is another than "aorrtc".
    """
    if gap is None:
        return
    if planner != "aorrtc":
        raise InvalidValueError("gap", gap, f"None with planner {planner!r}, or planner 'aorrtc'")
    if not (isinstance(gap, int | float) and 0.0 <= gap < float("inf")):
        raise InvalidValueError("gap", gap, "a finite number of 0 or more, or None")


def check_planner(planner: str, constrained: bool) -> None:
    """Refuse a planner that there is not, or that does not do what is asked of it.

    Raises:
        InvalidValueError: for an unknown planner, one that the installed OMPL lacks, and options that
            constraints leave no choice of.
        MissingDependencyError: for a planner of OMPL's where that is not installed.
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
) -> planners.Result:
    """Search a path.

    Args:
        problem: What to plan.
        planner: "rrt_connect", "aorrtc" or a name of OMPL's.
        seed: Seed of all random choices.
        timeout: Time budget [s].
        compare: Whether the path is shortened and ends at another goal where that is nearer from a way-point.
        gap: Of "aorrtc", see `plan`.
    """
    if planner == "aorrtc":
        return planners.aorrtc(problem, seed=seed, timeout=timeout, gap=gap)
    if planner != "rrt_connect":
        return planners.ompl_plan(problem, planner, seed=seed, timeout=timeout)
    begin = time.perf_counter()
    first = planners.rrt_connect(problem, seed=seed, timeout=timeout)
    if first.path is not None and BASE_JOINTS.intersection(problem.labels or ()):
        better = planners.aorrtc(
            problem, first.path, seed=seed, timeout=_left(begin, timeout), max_iterations=SAMPLES_OF_BASE,
            gap=GAP_OF_BASE,
        )  # fmt: skip
        goal = first.goal_index if better.goal_index is None else better.goal_index
        return replace(first, path=better.path, cost=better.cost, goal_index=goal)
    if first.path is None or not compare or len(problem.goals) == 1:
        return first
    shortest = _shortened(problem, first.path, seed, timeout)
    path, goal = planners.rejoin(problem, shortest, int(first.goal_index or 0))
    return replace(first, path=path, cost=path.length, goal_index=goal)


def _shortened(problem: planners.Problem, path: planners.Path, seed: int, timeout: float) -> planners.Path:
    """Return a path after a few short-cuts, checked as closely as the search itself checks."""
    return planners.shortcut(
        problem, path, seed=seed, iterations=SHORTCUTS_TO_COMPARE, resolution=problem.spacing,
        least_gain=GAIN_TO_COMPARE, timeout=SHARE_OF_TIME * timeout,
    )  # fmt: skip
