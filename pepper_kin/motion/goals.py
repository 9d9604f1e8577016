"""Ends of a path: validity of the start, and valid goals.

Goals that are tasks are solved from many starts in machine code, and the clear solutions are kept.  If
several lists of tasks are given, such as the grasps of one object, any of them suffices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, NamedTuple, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import CollisionChecker
from pepper_kin.collision.own_contacts import advice_on_own_links
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import IKResult, Task, TaskGroup, solve
from pepper_kin.ik.problem import flatten_tasks
from pepper_kin.kernels.working_time import not_counted, working_time
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import as_joint_vectors, full_turns
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.goal_search import TaskGoals, clear_goals, load_tasks
from pepper_kin.motion.plan_request import CheckedRequest, PlanRequest, are_known_to_fast, are_tasks
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.problem import Ends, check_examined
from pepper_kin.motion.static_limits import StaticLimits

_Fault: TypeAlias = tuple[PlanStatus, str]
_Goals: TypeAlias = tuple[Array, IKResult | None, _Fault | None]
"""Goals [rad or m], shape (m, n); the IK result for tasks; status and reason if there is no goal."""

OTHER_SOLVER = "proxsuite"
"""Solver for tasks of classes that the fast solver has no code for."""
STAYS = "Start and goal are the same."
_SAME = 1e-9  # [rad or m]
_THERE = 1e-7  # distance of start and goal up to which nothing has to move [rad or m]
TOGETHER = 2
"""Maximum number of alternative goals of one search."""

_SOON, _LEAST_TIME = 1e-3, 2e-3  # [s]

Alternatives: TypeAlias = Sequence[Sequence[Task | TaskGroup]]


def fault_of(
    checker: CollisionChecker, q: Array, what: str, statics: StaticLimits | None = None
) -> _Fault | None:
    """Return status and reason if a configuration cannot be an end of the path, or None.

    Args:
        checker: Collision checker by coal, without margins.
        q: The configuration [rad or m], shape (n,).
        what: Name of the configuration, such as "start".
        statics: Static limits to keep; None: the joints must hold the robot's own weight.
    """
    pepper, start = checker.pepper, what == "start"
    if checker.in_collision(q):
        pair = checker.closest_pair(q)
        names = checker.contacts(q)
        depth = f", {-pair.distance * 1000:.1f} mm deep" if pair is not None and pair.distance < 0 else ""
        status = PlanStatus.START_IN_COLLISION if start else PlanStatus.GOAL_IN_COLLISION
        advice = advice_on_own_links(pepper, names[0])
        said = f"; {advice}" if advice else ""
        return status, f"The {what} is in collision: {' and '.join(names[0])} overlap{depth}{said}."
    statics = StaticLimits(pepper) if statics is None else statics
    heavy, sentence = statics.weakest(q) is not None, statics.violation(q, what)
    if not sentence:
        return None
    if heavy:
        return PlanStatus.START_TORQUE_LIMIT if start else PlanStatus.GOAL_TORQUE_LIMIT, sentence
    return PlanStatus.START_TIPS_OVER if start else PlanStatus.GOAL_TIPS_OVER, sentence


def ends_of(request: CheckedRequest) -> Ends | Plan:
    """Return the ends of a path; the final plan if there can be no path, or if the start is a goal."""
    checks, start, goal, ended = request.checks, request.start, request.goal, request.ended
    least = request.options.least_margin
    tasks = are_tasks(goal)
    fast = tasks and are_known_to_fast(checks.pepper, goal)
    sound = None if least > 0.0 or tasks else _sound(request)
    if sound is not None:
        return sound
    found = _clear_goals(request, goal) if fast else None  # which checks the start as well
    if found is None or least > 0.0:
        fault = fault_of_start(checks, start, least)
        if fault is not None:
            return ended(*fault)
    if found is None:
        goals, ik, fault = goals_of(request, tried=fast)
    else:
        goals, ik, fault = _far_enough(checks, found.goals, found.ik, None, least)
    if fault is not None:
        return ended(*fault, ik=ik)
    free = free_joints(checks.pepper, request.options.joints, start, goals)
    if is_there(start, goals):
        return ended.solved(checks.exact, start[None], STAYS, ik=ik)
    return Ends(start, goals, free, ik, None if found is None or least > 0.0 else found.kept)


def _sound(request: CheckedRequest) -> Ends | None:
    """Return the ends of a path to configurations if one compiled call finds all of them valid, else None."""
    checks, start = request.checks, request.start
    goals = candidates_of(checks.pepper, start, request.goal)
    try:
        free = free_joints(checks.pepper, request.options.joints, start, goals)
    except InvalidValueError:  # an invalid goal may have caused it
        return None
    if is_there(start, goals):
        return None
    kept = checks.sound_ends(start, goals, free, request.options.margin)
    return None if kept is None else Ends(start, goals, free, kept=kept)


def _clear_goals(request: CheckedRequest, tasks: Sequence[Task]) -> TaskGoals | None:
    """Search clear goals of tasks in a third of the remaining time; see `clear_goals`."""
    options = request.options
    return clear_goals(
        request.checks, request.start, tasks, options.joints, options.margin, request.seed, request.left() / 3
    )


def candidates_of(pepper: PepperModel, start: Array, goal: Any) -> Array:
    """Return the given goal configurations, shape (m, n), with full turns chosen nearest to a start.

    For a revolute joint without limits, positions that differ by full turns are the same goal; the position
    within half a turn of the start is returned.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: One configuration [rad or m], shape (n,), or several, shape (m, n).

    Raises:
        InvalidValueError: for a wrong shape, NaN, or no configuration.
        LimitError: for a goal outside the position limits.
    """
    candidates = as_joint_vectors(pepper, goal, "goal")
    if candidates.ndim > 2:
        raise InvalidValueError(
            "goal", f"shape {candidates.shape}", f"shape ({pepper.n},) or (m, {pepper.n})"
        )
    if not len(candidates):
        raise InvalidValueError("goal", "no configuration", f"one or more, shape (m, {pepper.n}), m >= 1")
    candidates = candidates + full_turns(pepper, start - candidates)
    check_examined(pepper, candidates, "goal")
    return candidates.reshape(-1, pepper.n)


def goals_of(request: CheckedRequest, *, tried: bool = False) -> _Goals:
    """Return the goals that can be ends of a path, or the reason why there is none.

    Tasks are solved with the margin to the scene first, and without it if that fails; several solutions are
    searched at once.  Without a goal there is no path to search, so that the whole time budget may be used.

    Args:
        request: The checked request.
        tried: Whether `clear_goals` has been called and has found no goal.
    """
    checks, least = request.checks, request.options.least_margin
    if are_tasks(request.goal):
        return _far_enough(checks, *_goals_of_tasks(request, tried), least)
    candidates = candidates_of(checks.pepper, request.start, request.goal)
    return _far_enough(checks, *_good_ones(checks, candidates, None), least)


def _far_enough(
    checks: Checks, goals: Array, ik: IKResult | None, fault: _Fault | None, least: float
) -> _Goals:
    """Return the goals, shape (m, n), that keep a minimum margin [m], or the fault of the first one."""
    near = [checks.too_near(q, "goal", least) for q in goals] if least > 0.0 and fault is None else []
    far = goals[[not sentence for sentence in near]] if near else goals
    if len(far) or not near:
        return far, ik, fault
    return far, ik, (PlanStatus.GOAL_TOO_NEAR, near[0])


def _goals_of_tasks(request: CheckedRequest, tried: bool) -> _Goals:
    """Return the goals that meet tasks, or the reason why there is none; see `goals_of`."""
    tasks, checks, scene = request.goal, request.checks, request.checks.exact.scene
    more, fast = checks.statics.tasks(), are_known_to_fast(checks.pepper, request.goal)
    for sought in ([] if tried or not fast else [tasks]) + ([(*tasks, *more)] if more and fast else []):
        with not_counted():
            load_tasks(checks.pepper, flatten_tasks(checks.pepper, sought))
        clear = _clear_goals(request, sought)
        if clear is not None:
            return clear.goals, clear.ik, None
    solver = OTHER_SOLVER if checks.pepper.solvers == "fast" and not fast else "robot"
    scenes = (scene,) if fast else (scene.padded(request.options.margin), scene)
    for scene in scenes:
        ik = solve(
            checks.pepper, tasks, start=request.start, solver=solver, scene=scene,
            seed=request.seed, joints=request.options.joints, balance=checks.statics.balance,
            payload=request.options.payload,
            timeout=request.left() / (1 if scene is scenes[-1] else 3),
        )  # fmt: skip
        if ik.success and fault_of(checks.exact, ik.q, "goal", checks.statics) is None:
            break
    if not ik.success:
        return np.empty((0, checks.pepper.n)), ik, (PlanStatus.NO_IK, ik.report())
    return _good_ones(checks, ik.q[None], ik)


def _good_ones(checks: Checks, candidates: Array, ik: IKResult | None) -> _Goals:
    """Return the candidates, shape (m, n), that can be ends of a path, or the fault of the first one."""
    good = candidates[checks.holds(candidates) & checks.free(candidates)]
    if len(good):
        return good, ik, None
    fault = fault_of(checks.exact, candidates[0], "goal", checks.statics)
    return candidates[: int(fault is None)], ik, fault


def fault_of_start(checks: Checks, q: Array, least: float = 0.0) -> _Fault | None:
    """Return why a path that keeps a minimum margin [m] cannot start at q, shape (n,), or None."""
    if checks.holds(q[None])[0] and checks.free(q):
        near = checks.too_near(q, "start", least)
        return (PlanStatus.START_TOO_NEAR, near) if near else None
    return fault_of(checks.exact, q, "start", checks.statics)


def is_there(start: Array, goals: Array) -> bool:
    """Whether one of the goals, shape (m, n), is the start, shape (n,), so that nothing has to move."""
    apart = np.abs(goals - start) > _THERE
    return not (np.count_nonzero(apart) if len(apart) == 1 else apart.any(axis=1).all())


def free_joints(
    pepper: PepperModel,
    joints: str | Sequence[str] | None,
    start: Array,
    goals: Array,
) -> NDArray[np.int64]:
    """Return the indices of the joints that the planner moves, increasing, shape (k,).

    Args:
        pepper: The robot.
        joints: Names of joints and groups, or None for the joints in which start and goals differ.
        start: Start configuration [rad or m], shape (n,).
        goals: Goal configurations [rad or m], shape (m, n).

    Raises:
        InvalidValueError: if a goal differs from the start in a joint that may not move.
        UnknownNameError: for an unknown joint or group.
    """
    apart = np.abs(goals - start) > _SAME
    differ: NDArray[np.bool_] = apart[0] if len(apart) == 1 else np.asarray(apart.any(axis=0))
    moved = differ.nonzero()[0]
    if joints is None:
        return moved
    listed = tuple(joints) if isinstance(joints, Iterable) and not isinstance(joints, str) else joints
    allowed = _places_of(pepper, listed)
    differ[allowed] = False
    if np.count_nonzero(differ):
        locked = [pepper.joint_names[j] for j in np.flatnonzero(differ)]
        raise InvalidValueError(
            "goal", f"other values of {', '.join(locked)}", "the start's, since they may not move"
        )
    return allowed if moved.size else moved


@kept_for_robot(most=64)
def _places_of(pepper: PepperModel, joints: str | tuple[str, ...]) -> NDArray[np.int64]:
    places = np.array(sorted(map(pepper.joint_index, pepper.resolve_joints(joints))), dtype=np.int64)
    places.setflags(write=False)
    return places


class _Goal(NamedTuple):
    """Index of an alternative, and configurations that meet it, shape (m, n)."""

    number: int
    configurations: Array
    ik: IKResult | None


def are_alternatives(goal: object) -> TypeGuard[Alternatives]:
    """Return whether a goal is a sequence of lists of IK tasks, any of which suffices."""
    return isinstance(goal, Sequence) and len(goal) > 0 and all(are_tasks(one) for one in goal)


def plan_to_any(asked: PlanRequest, search: Callable[[PlanRequest], Plan]) -> Plan:
    """Plan to the first alternative to which a path is found.

    The alternatives are tried in the order of their errors at the start, each for a millisecond, since an
    alternative that cannot be met takes a hundred.  As soon as two of them are met, or all were tried, a path
    to any of the configurations is searched.  If there is none, the remaining alternatives are tried for
    longer.

    Args:
        asked: The request, whose goal is several lists of IK tasks, each a goal by itself.
        search: Function that plans to configurations.

    Returns:
        The plan, with the index of its alternative; without a path, the last plan that failed, preferably one
        whose tasks were met.
    """
    still, alternatives, timeout = asked.with_options(start_velocity=None), asked.goal, asked.options.timeout
    requests = [replace(still, goal=list(tasks)).checked() for tasks in alternatives]
    order = np.argsort([_farness(request) for request in requests], kind="stable").tolist()
    begin, failed, hard = requests[0].ended.begin, list[Plan](), list[int]()

    def left() -> float:
        return begin + timeout - working_time()

    def soon() -> Iterator[_Goal]:
        for number in order:
            found = _at_once(requests[number])
            if found is None:
                hard.append(number)
            else:
                yield _Goal(number, found.goals, found.ik)

    def later() -> Iterator[_Goal]:
        for count, number in enumerate(hard):
            if left() <= _LEAST_TIME:
                return
            share = still.with_options(timeout=left() / (2 * (len(hard) - count)))
            ends = ends_of(replace(share, goal=list(alternatives[number])).checked())
            if not isinstance(ends, Plan):
                yield _Goal(number, ends.goals, ends.ik)
            elif ends.success:  # the start is this goal
                yield _Goal(number, requests[number].start[None], ends.ik)
            else:
                failed.append(ends)

    for goals in chain(_together(soon()), _together(later())):
        rows = np.concatenate([goal.configurations for goal in goals])
        found = search(replace(asked.with_options(timeout=max(left(), _LEAST_TIME)), goal=rows))
        if found.success:
            return _named(replace(found, time=working_time() - begin), goals, len(alternatives))
        failed.append(found)
    if not failed:  # the time was up before any alternative was tried completely
        failed.append(requests[0].ended(PlanStatus.NO_PATH_IN_TIME, "The time was up."))
    last = ([plan for plan in failed if plan.status is not PlanStatus.NO_IK] or failed)[-1]
    message = f"None of {len(alternatives)} goals; of the last: {last.message}"
    return replace(last, message=message, time=working_time() - begin)


def _farness(request: CheckedRequest) -> float:
    """Return the norm of an alternative's task errors at the start, in the tasks' units."""
    parts = flatten_tasks(request.checks.pepper, request.goal)
    errors = [part.residual(request.checks.pepper, request.start) for part in parts]
    return float(np.linalg.norm(np.concatenate(errors)))


def _at_once(request: CheckedRequest) -> TaskGoals | None:
    """Return goals that meet an alternative if they are found within a millisecond or so, else None."""
    options = request.options
    if options.least_margin > 0.0 or not are_known_to_fast(request.checks.pepper, request.goal):
        return None
    return clear_goals(
        request.checks, request.start, request.goal, options.joints, options.margin, request.seed, _SOON,
        nearby=True,
    )  # fmt: skip


def _together(goals: Iterator[_Goal]) -> Iterator[list[_Goal]]:
    """Yield goals in groups of `TOGETHER`, the last group possibly smaller."""
    some: list[_Goal] = []
    for goal in goals:
        some.append(goal)
        if len(some) == TOGETHER:
            yield some
            some = []
    if some:
        yield some


def _named(plan: Plan, goals: list[_Goal], count: int) -> Plan:
    """Return a plan with the index of the alternative that it ends at."""
    assert plan.goal is not None
    end = plan.goal
    reached = min(goals, key=lambda goal: float(np.abs(goal.configurations - end).max(axis=1).min()))
    message = f"{plan.message.rstrip()} It ends at goal {reached.number} of {count}, counted from 0."
    return replace(plan, message=message, ik=reached.ik, alternative=reached.number)
