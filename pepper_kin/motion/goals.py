"""The ends of a path: can it start here, and which goals can it end at?

Goals that are tasks are solved from many starts in machine code; of the solutions those that are clear stay.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import CollisionChecker
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import IKResult, Task, TaskGroup, solve
from pepper_kin.ik.problem import flatten_tasks
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.structure import known_structures
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import as_joint_vectors
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.plan_result import Ending, Plan, PlanStatus
from pepper_kin.motion.planners_code import load_code_of
from pepper_kin.motion.problem import check_examined
from pepper_kin.motion.static_limits import StaticLimits
from pepper_kin.motion.task_goals import clear_goals, load_tasks

OTHER_SOLVER = "placo"
"""For tasks of classes that the fast solver has no code for."""
STAYS = "Start and goal are the same."
_SAME = 1e-9  # [rad or m]
_THERE = 1e-7  # [rad or m]: way-points of a path of a few nanometers are all the same


def fault_of(
    checker: CollisionChecker, q: NDArray[np.float64], what: str, statics: StaticLimits | None = None
) -> tuple[PlanStatus, str] | None:
    """Return why a configuration cannot be an end of the path, or None.

    Args:
        checker: Coal's, without margins.
        q: The configuration, shape (n,).
        what: Its name, such as "start".
        statics: What can be held; None: the robot's own weight by its joints.
    """
    pepper, start = checker.pepper, what == "start"
    if checker.in_collision(q):
        pair = checker.closest_pair(q)
        names = checker.contacts(q)
        depth = f", {-pair.distance * 1000:.1f} mm deep" if pair is not None and pair.distance < 0 else ""
        status = PlanStatus.START_IN_COLLISION if start else PlanStatus.GOAL_IN_COLLISION
        return status, f"The {what} is in collision: {' and '.join(names[0])} overlap{depth}."
    statics = StaticLimits(pepper) if statics is None else statics
    heavy, said = statics.weakest(q) is not None, statics.said(q, what)
    if not said:
        return None
    if heavy:
        return PlanStatus.START_TORQUE_LIMIT if start else PlanStatus.GOAL_TORQUE_LIMIT, said
    return PlanStatus.START_TIPS_OVER if start else PlanStatus.GOAL_TIPS_OVER, said


class Ends(NamedTuple):
    """Between what a path leads.

    Attributes:
        goals: Goals that it can end at, shape (m, n).
        free: Places of the joints that move, rising, shape (k,).
        ik: The result of inverse kinematics where the goal was given as tasks.
        kept: What `Checks.margins` returns for them; None where that is not known yet.
    """

    goals: Array
    free: NDArray[np.int64]
    ik: IKResult | None
    kept: tuple[float, float] | None = None


def load_code_for(checks: Checks, goal: ArrayLike | Sequence[Any], planner: str) -> None:
    """Load, or compile, what a goal that is tasks and a planner need, before any clock starts.

    Args:
        checks: The robot in its scene.
        goal: Joint positions [rad or m], shape (n,) or (m, n), or tasks; see `plan`.
        planner: See `load_code_of`.

    Raises:
        InvalidValueError: for tasks and other things mixed.
    """
    load_code_of(planner)
    if not are_tasks(goal):
        return
    tasks = flatten_tasks(checks.pepper, cast("Sequence[Task]", goal))
    if _are_known_to_fast(tasks):
        load_tasks(checks.pepper, tasks)
        if checks.statics.balance is not None:
            load_tasks(checks.pepper, [*tasks, *checks.statics.tasks()])


def goal_with_loads(pepper: PepperModel, goal: ArrayLike | Sequence[Any], loads: Loads) -> Any:
    """Return a goal, shape (n,) or (m, n) or tasks; those on the center of mass count what is carried."""
    if not (loads and are_tasks(goal)):
        return goal
    return with_loads(flatten_tasks(pepper, cast("Sequence[Task]", goal)), loads)


def ends_of(
    ended: Ending,
    checks: Checks,
    start: Array,
    goal: ArrayLike | Sequence[Any],
    joints: str | Sequence[str] | None,
    margins: tuple[float, float],
    deadline: float,
) -> Ends | Plan:
    """Return the ends of a path; a plan where there can be none, or the start is a goal.

    Args:
        ended: Makes the plan.
        checks: The robot in its scene.
        start: Start configuration within the limits, shape (n,).
        goal: See `plan`.
        joints: Joints that may move, see `plan`.
        margins: What is kept where the ends allow it, and what they have to keep [m].
        deadline: When planning has to end, on the clock of `time.perf_counter` [s].
    """
    tasks = are_tasks(goal)
    fast = tasks and _are_known_to_fast(cast("Sequence[Any]", goal))
    sound = None if margins[1] > 0.0 or tasks else _sound(checks, start, goal, joints, margins[0])
    if sound is not None:
        return sound
    found = None
    if fast:  # which looks at the start as well
        sought = cast("Sequence[Task]", goal)
        found = clear_goals(checks, start, sought, joints, margins[0], ended.seed, _left(deadline) / 3)
    if found is None or margins[1] > 0.0:
        fault = fault_of_start(checks, start, margins[1])
        if fault is not None:
            return ended(*fault)
    if found is None:
        goals, ik, fault = goals_of(checks, start, goal, joints, margins, ended.seed, deadline, tried=fast)
    else:
        goals, ik, fault = _far_enough(checks, found.goals, found.ik, None, margins[1])
    if fault is not None:
        return ended(*fault, ik=ik)
    free = free_joints(checks.pepper, joints, start, goals)
    if is_there(start, goals):
        return ended.solved(checks.exact, start[None], STAYS, ik=ik)
    return Ends(goals, free, ik, None if found is None or margins[1] > 0.0 else found.kept)


def _sound(
    checks: Checks, start: Array, goal: Any, joints: str | Sequence[str] | None, margin: float
) -> Ends | None:
    """Return the ends of a path where a look at all of them at once says that none is at fault, else None.

    Args:
        checks: The robot in its scene.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configurations [rad or m], shape (n,) or (m, n).
        joints: Joints that may move, by joints and groups; None: those in which start and goals differ.
        margin: Distance requested to all things [m].
    """
    goals = _candidates(checks.pepper, goal)
    try:
        free = free_joints(checks.pepper, joints, start, goals)
    except InvalidValueError:  # which a goal at fault may have caused
        return None
    if is_there(start, goals):
        return None
    kept = checks.sound_ends(start, goals, free, margin)
    return None if kept is None else Ends(goals, free, None, kept)


def _candidates(pepper: PepperModel, goal: Any) -> Array:
    """Return configurations that are given as goals, shape (m, n)."""
    candidates = as_joint_vectors(pepper, goal, "goal")
    if candidates.ndim > 2:
        raise InvalidValueError(
            "goal", f"shape {candidates.shape}", f"shape ({pepper.n},) or (m, {pepper.n})"
        )
    if not len(candidates):
        raise InvalidValueError("goal", "no configuration", f"one or more, shape (m, {pepper.n}), m >= 1")
    check_examined(pepper, candidates, "goal")
    return candidates.reshape(-1, pepper.n)


def goals_of(
    checks: Checks,
    start: NDArray[np.float64],
    goal: ArrayLike | Sequence[Any],
    joints: str | Sequence[str] | None,
    margins: tuple[float, float],
    seed: int,
    deadline: float,
    *,
    tried: bool = False,
) -> tuple[NDArray[np.float64], IKResult | None, tuple[PlanStatus, str] | None]:
    """Return the goals that can be ends of a path, or the reason why there is none.

    Tasks are solved with the margin to the scene first, and without it where that fails; several solutions
    are looked for at once.  Without a goal there is no path to search: all of the time is used for finding
    one.

    Args:
        checks: The robot, the scene and what a state has to keep.
        start: Joint positions at the start [rad or m], shape (n,).
        goal: One configuration, shape (n,), or several, shape (m, n) [rad or m], or IK tasks.
        joints: Joints that tasks may move, by joints and groups; None for all.
        margins: Distances to the scene [m]: the first is preferred, the second has to be kept.
        seed: Of the restarts.
        deadline: When to stop, on the clock of `time.perf_counter` [s].
        tried: Whether `clear_goals` has been called and has found none.

    Returns:
        The goals, shape (m, n) [rad or m]; the IK result where there were tasks; status and reason where
        there is no goal.
    """
    if are_tasks(goal):
        tasks = cast("Sequence[Task]", goal)
        found = _goals_of_tasks(checks, start, tasks, joints, margins[0], seed, deadline, tried)
        return _far_enough(checks, *found, margins[1])
    candidates = _candidates(checks.pepper, goal)
    return _far_enough(checks, *_good_ones(checks, candidates, None), margins[1])


def _far_enough(
    checks: Checks, goals: Array, ik: IKResult | None, fault: tuple[PlanStatus, str] | None, least: float
) -> tuple[Array, IKResult | None, tuple[PlanStatus, str] | None]:
    """Return the goals, of shape (m, n), that keep a least margin [m], or what the first is too near to."""
    said = [checks.too_near(q, "goal", least) for q in goals] if least > 0.0 and fault is None else []
    far = goals[[not near for near in said]] if said else goals
    if len(far) or not said:
        return far, ik, fault
    return far, ik, (PlanStatus.GOAL_TOO_NEAR, said[0])


def _goals_of_tasks(
    checks: Checks,
    start: NDArray[np.float64],
    tasks: Sequence[Task],
    joints: str | Sequence[str] | None,
    margin: float,
    seed: int,
    deadline: float,
    tried: bool,
) -> tuple[NDArray[np.float64], IKResult | None, tuple[PlanStatus, str] | None]:
    """Return what `goals_of` does, for a goal that is tasks, from a start [rad or m], shape (n,)."""
    pepper, checker, more = checks.pepper, checks.exact, checks.statics.tasks()
    fast = _are_known_to_fast(tasks)
    for sought in ([] if tried or not fast else [tasks]) + ([(*tasks, *more)] if more and fast else []):
        clear = clear_goals(checks, start, sought, joints, margin, seed, _left(deadline) / 3)
        if clear is not None:
            return clear.goals, clear.ik, None
    scenes = (checker.scene,) if fast else (checker.scene.padded(margin), checker.scene)
    for scene in scenes:
        ik = solve(
            pepper, tasks, start=start, solver="fast" if fast else OTHER_SOLVER, scene=scene, seed=seed,
            joints=joints, timeout=_left(deadline) / (1 if scene is scenes[-1] else 3),
        )  # fmt: skip
        if ik.success and fault_of(checker, ik.q, "goal", checks.statics) is None:
            break
    if not ik.success:
        return np.empty((0, pepper.n)), ik, (PlanStatus.NO_IK, ik.report())
    return _good_ones(checks, ik.q[None], ik)


def _left(deadline: float) -> float:
    """Return the time that is left [s], above zero."""
    return max(deadline - time.perf_counter(), 1e-3)


def _good_ones(
    checks: Checks, candidates: NDArray[np.float64], ik: IKResult | None
) -> tuple[NDArray[np.float64], IKResult | None, tuple[PlanStatus, str] | None]:
    """Return the candidates, of shape (m, n), that can be ends of a path, or what is wrong with the first."""
    good = candidates[checks.holds(candidates) & checks.free(candidates)]
    if len(good):
        return good, ik, None
    fault = fault_of(checks.exact, candidates[0], "goal", checks.statics)
    return candidates[: int(fault is None)], ik, fault


def fault_of_start(
    checks: Checks, q: NDArray[np.float64], least: float = 0.0
) -> tuple[PlanStatus, str] | None:
    """Return why a path that keeps a least margin [m] cannot start at q, shape (n,), or None."""
    if checks.holds(q[None])[0] and checks.free(q):
        near = checks.too_near(q, "start", least)
        return (PlanStatus.START_TOO_NEAR, near) if near else None
    return fault_of(checks.exact, q, "start", checks.statics)


def _are_known_to_fast(tasks: Sequence[Any]) -> bool:
    parts = [part for task in tasks for part in (task.parts if isinstance(task, TaskGroup) else [task])]
    return known_structures(parts) is not None


def are_tasks(goal: object) -> bool:
    """Return whether a goal is IK tasks, not configurations."""
    return isinstance(goal, Sequence) and len(goal) > 0 and isinstance(goal[0], (Task, TaskGroup))


def is_there(start: NDArray[np.float64], goals: NDArray[np.float64]) -> bool:
    """Whether one of the goals, shape (m, n), is the start, shape (n,): then nothing need move."""
    return bool((np.abs(goals - start) <= _THERE).all(axis=1).any())


def free_joints(
    pepper: PepperModel,
    joints: str | Sequence[str] | None,
    start: NDArray[np.float64],
    goals: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Return the indices of the joints that the planner moves, rising, shape (k,).

    Args:
        pepper: The robot.
        joints: Joints and groups, or None for those in which start and goals differ.
        start: Start configuration, shape (n,).
        goals: Goal configurations, shape (m, n).

    Raises:
        InvalidValueError: where a goal differs from the start in a joint that may not move.
        UnknownNameError: for an unknown joint or group.
    """
    differ = np.any(np.abs(goals - start) > _SAME, axis=0)
    moved = np.flatnonzero(differ)
    if joints is None:
        return moved
    listed = tuple(joints) if isinstance(joints, Iterable) and not isinstance(joints, str) else joints
    allowed = _places_of(pepper, listed)
    differ[allowed] = False
    if differ.any():
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
