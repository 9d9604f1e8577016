"""Planning of a collision-free path from a start to a goal in a scene."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError, MissingDependencyError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.motion.checks import Checks, checks_for
from pepper_kin.motion.constrained_plan import plan_constrained
from pepper_kin.motion.costed_plan import plan_costed
from pepper_kin.motion.driving import moves_base, plan_drive, refuse_what_cannot_drive
from pepper_kin.motion.goals import ends_of, goal_with_loads, load_code_for
from pepper_kin.motion.margins import checked_least, falling_problems, narrowest, relaxation_sentence
from pepper_kin.motion.obstruction import why_no_path
from pepper_kin.motion.path_costs import PathCost
from pepper_kin.motion.pipeline import Pipeline, compared, way_along
from pepper_kin.motion.plan_result import Ending, Plan, PlanStatus
from pepper_kin.motion.problem import COARSE, RESOLUTION, PathProblem, checked_start
from pepper_kin.motion.smoothed_plan import refuse_costs, smoothed
from pepper_kin.motion.static_limits import static_limits
from pepper_kin.motion.waypoints import Way
from pepper_kin.planners.vectors import seed_number

PLANNERS = ("rrt_connect", "aorrtc")

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
    least_margin: float = 0.0,
    seed: int = 0,
    timeout: float = 5.0,
    gap: float | None = None,
    balance: float | None = None,
    payload: Mapping[str, float] | None = None,
    smooth: bool = False,
) -> Plan:
    """Plan a collision-free path.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration, shape (n,), several, shape (m, n), or a list of IK tasks, which are solved
            from several starts; of the free solutions the one with the shortest path is taken.
        scene: The world around the robot, with what it holds; attached objects count with their mass.
        planner: "rrt_connect"; "aorrtc", which improves its path until `gap` or `timeout`; or a name of
            `planners.available_ompl_planners()`.  Short-cutting and smoothing follow.
        joints: Joints that may move, by joints and groups; None: those in which start and goals differ.
        constraints: IK tasks that stay met along the whole path; `plan_constrained` then plans.
        costs: Soft costs that are made small together with the length; `plan_costed` then plans.
        margin: Distance requested to all things [m]; less where start or goal are nearer than that, or where
            no path keeps it: then it is relaxed, and the message says to what.
        least_margin: Distance that the whole curve is proven to keep from the scene [m], from 0 to `margin`.
        seed: Seed of all random choices.
        timeout: Time budget [s]; where the search took all of it, a twentieth more for the short-cuts.
        gap: Of "aorrtc": it stops where the path is at most ``1 + gap`` times the straight line to the
            nearest goal; None: at the straight line itself, or when the time is used up.
        balance: Distance that the center of mass keeps from the edges of the wheels' triangle [m], as in
            `retime`; None lets the base be held from below.
        payload: Point masses held at "left", "right" or a frame by name [kg], besides attached objects, as in
            `retime`: the joints can hold them all along the path, and they count for balance.
        smooth: Whether to make the motion to execute, too: `optimize` changes path and timing together,
            within the limits of velocity, acceleration and torque.  Where that gains nothing over `retime`,
            the retimed plan stays, and the message says so.

    Returns:
        The plan, with `smooth` its trajectory; without a path, its status and message say why, and what was
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
        margin=margin, least_margin=least_margin, seed=seed, timeout=timeout, gap=gap, balance=balance,
        payload=payload,
    )  # fmt: skip
    if not smooth:
        return found
    return smoothed(
        pepper, found, scene, constraints, margins=(margin, least_margin), timeout=timeout, balance=balance,
        payload=payload,
    )  # fmt: skip


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
    least_margin: float,
    seed: int,
    timeout: float,
    gap: float | None,
    balance: float | None,
    payload: Mapping[str, float] | None,
) -> Plan:
    """Return a plan without its timing, from a start [rad or m], shape (n,), to a goal; see `plan`."""
    if not isinstance(pepper, PepperModel):
        raise InvalidValueError("pepper", repr(pepper), "a robot, such as load_pepper() returns")
    guided = constraints is not None or costs is not None
    check_planner(planner, guided)
    refuse_what_cannot_drive(pepper, joints, planner, guided)
    _check_gap(planner, gap)
    seed = seed_number(seed)
    margins = margin, checked_least(margin, least_margin)
    common: dict[str, Any] = {"joints": joints, "margin": margin, "least_margin": least_margin, "seed": seed}
    common |= {"timeout": timeout, "balance": balance, "payload": payload}
    if constraints is not None:
        return plan_constrained(pepper, start, goal, scene, constraints, costs=costs, **common)
    if costs is not None:
        return plan_costed(pepper, start, goal, scene, costs, **common)
    statics = static_limits(pepper, balance, payload, scene)
    goal = goal_with_loads(pepper, goal, statics.carrying)
    q_start = checked_start(pepper, start, margin, timeout)
    return _unguided(
        checks_for(pepper, scene, statics), q_start, goal, joints, margins, (planner, gap, seed, timeout)
    )


def _unguided(
    checks: Checks,
    q_start: NDArray[np.float64],
    goal: ArrayLike | Sequence[Any],
    joints: str | Sequence[str] | None,
    margins: tuple[float, float],
    how: tuple[str, float | None, int, float],
) -> Plan:
    """Return what `plan` does, without constraints and costs.

    Args:
        checks: The robot, the scene and what a state has to keep.
        q_start: Joint positions at the start [rad or m], shape (n,).
        goal: One configuration, shape (n,), or several, shape (m, n) [rad or m], or IK tasks.
        joints: Joints that may move, by joints and groups; None for all.
        margins: Distances to the scene [m]: the first is preferred, the second has to be kept.
        how: Planner, gap, seed and timeout [s].
    """
    planner, gap, seed, timeout = how
    load_code_for(checks, goal, planner)
    begin = time.perf_counter()  # code is loaded by now, and perhaps compiled: that is not planning
    ended = Ending(checks.pepper, begin, seed, planner, margins[0])
    ends = ends_of(ended, checks, q_start, goal, joints, margins, begin + timeout)
    if isinstance(ends, Plan):
        return ends
    ik, goals, free = ends.ik, ends.goals, ends.free
    if moves_base(checks.pepper, free):
        made = plan_drive(ended, checks, q_start, goals, free, margins, begin + timeout)
        return made if ik is None else replace(made, ik=ik)
    coarse = planner == PLANNERS[0]
    spacing, states = COARSE if coarse else RESOLUTION, 0
    for problem, share in falling_problems(checks, q_start, goals, free, margins, spacing, ends.kept):
        end = share if planner in PLANNERS else 1.0  # OMPL's planners take all of the time
        search = _Search(planner, gap, seed, begin, end * timeout, timeout)
        result, way = search(problem, ik is not None, coarse)
        states += result.states_checked
        if way is not None or end == 1.0:
            break
    said: dict[str, Any] = {"ik": ik, "states_checked": states, "search": result}
    if result.path is None:
        whole = replace(result, states_checked=states, time=time.perf_counter() - begin)
        return ended(*why_no_path(problem, whole, seed), **said)
    if way is None:
        return ended(PlanStatus.NO_PATH_IN_TIME, NO_SPLINE + narrowest(problem, result.path), **said)
    message = f"Path of {len(way.points)} way-points.{_how_short(result)}"
    message += relaxation_sentence(problem, way.curve, margins[0])
    return ended.solved(checks.exact, way.points, message, way.curve, **said)


def _how_short(result: planners.Result) -> str:
    """Return what a planner that improves its path says of its length, as a sentence that may be empty."""
    if result.stop_reason is None:
        return ""
    return (
        f" Found with a length of {result.cost:.4g}, {100 * result.gap:.1f} % above the straight line's "
        f"{result.lower_bound:.4g} [m, in the metric of the search]; "
        f"it ended because {result.stop_reason.value}."
    )


class _Search(NamedTuple):
    """How a path is sought at one margin.

    Attributes:
        planner: See `plan`.
        gap: See there.
        seed: See there.
        begin: When planning began, on the clock of `time.perf_counter` [s].
        first: Time after that in which a first path has to be found [s].
        timeout: Time after that in which it may be improved [s].
    """

    planner: str
    gap: float | None
    seed: int
    begin: float
    first: float
    timeout: float

    def __call__(
        self, problem: PathProblem, compare: bool, coarse: bool
    ) -> tuple[planners.Result, Way | None]:
        """Return what a search found, and the way along it; None where no spline is clear.

        What was searched coarsely is searched again, closely, where its spline turns out to touch something.
        """
        left = _left(self.begin, self.first)
        if self.planner == PLANNERS[0] and problem.checks.compiled and not _drives(problem):
            result, way = Pipeline(problem, self.seed, left).searched(compare)
        else:
            result = find_path(
                problem.search_problem, self.planner, seed=self.seed, timeout=left, compare=compare,
                gap=self.gap, total=_left(self.begin, self.timeout),
            )  # fmt: skip
            time_left = max(_left(self.begin, self.timeout), self.timeout / 20)
            path = result.path
            way = None if path is None else way_along(problem, path, seed=self.seed, timeout=time_left)
        if way is None and result.path is not None and coarse:
            return self(problem.finer(), compare, False)
        return result, way


def _drives(problem: PathProblem) -> bool:
    names = problem.checks.pepper.joint_names
    return any(names[j] in BASE_JOINTS for j in problem.free.tolist())


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
    total: float | None = None,
) -> planners.Result:
    """Search a path.

    Args:
        problem: What to plan.
        planner: "rrt_connect", "aorrtc" or a name of OMPL's.
        seed: Seed of all random choices.
        timeout: Time budget [s] in which a path has to be found.
        compare: Whether the path is shortened and ends at another goal where that is nearer from a way-point.
        gap: Of "aorrtc", see `plan`.
        total: Time budget of "aorrtc", the first path included [s]; None: `timeout`.
    """
    begin = time.perf_counter()
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
        better = planners.aorrtc(
            problem, first.path, seed=seed, timeout=_left(begin, timeout), max_iterations=SAMPLES_OF_BASE,
            gap=GAP_OF_BASE,
        )  # fmt: skip
        goal = _to_a_goal(better, first).goal_index
        return replace(first, path=better.path, cost=better.cost, goal_index=goal)
    return compared(problem, first, seed, timeout) if compare else first


def _to_a_goal(better: planners.Result, first: planners.Result) -> planners.Result:
    """Return a result that names the goal of the path that it began with where that is still its end."""
    return replace(better, goal_index=first.goal_index) if better.goal_index is None else better
