"""The ends of a path: can it start here, and which goals can it end at?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision import CollisionChecker
from pepper_kin.dynamics import gravity_torque
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import IKResult, Task, TaskGroup, solve
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_within_limits
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.goals import clear_goals
from pepper_kin.motion.plan_result import PlanStatus
from pepper_kin.motion.validity import holds

OTHER_SOLVER = "placo"
"""Where nothing shall be compiled, and for tasks that the fast solver does not know."""
STAYS = "Start and goal are the same."
_SAME = 1e-9  # [rad or m]


def fault_of(checker: CollisionChecker, q: NDArray[np.float64], what: str) -> tuple[PlanStatus, str] | None:
    """Return why a configuration cannot be an end of the path, or None."""
    pepper, start = checker.pepper, what == "start"
    if checker.in_collision(q):
        pair = checker.closest_pair(q)
        names = checker.contacts(q)
        depth = f", {-pair.distance * 1000:.1f} mm deep" if pair is not None and pair.distance < 0 else ""
        status = PlanStatus.START_IN_COLLISION if start else PlanStatus.GOAL_IN_COLLISION
        return status, f"The {what} is in collision: {' and '.join(names[0])} overlap{depth}."
    if not holds(pepper, q[None])[0]:
        tau = gravity_torque(pepper, q)
        joint = int(np.argmax(np.abs(tau) / pepper.effort_limits))
        status = PlanStatus.START_TOO_HEAVY if start else PlanStatus.GOAL_TOO_HEAVY
        limit = f"{pepper.effort_limits[joint]:.2f} N m it has"
        name = pepper.joint_names[joint]
        return status, f"The {what} takes {abs(tau[joint]):.2f} N m at {name}, near or over the {limit}."
    return None


def goals_of(
    checks: Checks,
    start: NDArray[np.float64],
    goal: ArrayLike | Sequence[Any],
    joints: str | Sequence[str] | None,
    margin: float,
    seed: int,
    timeout: float,
) -> tuple[NDArray[np.float64], IKResult | None, tuple[PlanStatus, str] | None]:
    """Return the goals that can be ends of a path, shape (m, n); or the reason why there is none.

    Tasks are solved with the margin to the scene first, and without it where that fails; with
    machine code, several solutions are looked for at once.
    """
    if _are_tasks(goal):
        return _goals_of_tasks(checks, start, cast("Sequence[Task]", goal), joints, margin, seed, timeout)
    pepper = checks.pepper
    candidates = np.atleast_2d(as_joint_vectors(pepper, goal, "goal"))
    if candidates.ndim != 2:
        raise InvalidValueError(
            "goal", f"shape {candidates.shape}", f"shape ({pepper.n},) or (m, {pepper.n})"
        )
    check_within_limits(pepper, candidates, "goal")
    return _good_ones(checks, candidates, None)


def _goals_of_tasks(
    checks: Checks,
    start: NDArray[np.float64],
    tasks: Sequence[Task],
    joints: str | Sequence[str] | None,
    margin: float,
    seed: int,
    timeout: float,
) -> tuple[NDArray[np.float64], IKResult | None, tuple[PlanStatus, str] | None]:
    """Return what `goals_of` does, for a goal that is tasks."""
    pepper, checker = checks.pepper, checks.exact
    fast = checks.compiled and _are_known_to_fast(tasks)
    if fast:
        clear = clear_goals(checks, start, tasks, joints, margin, seed, timeout / 3)
        if clear is not None:
            return *clear, None
    for scene in (checker.scene,) if fast else (checker.scene.padded(margin), checker.scene):
        ik = solve(
            pepper, tasks, q0=start, solver="fast" if fast else OTHER_SOLVER, scene=scene, seed=seed,
            joints=joints, timeout=timeout / 3,
        )  # fmt: skip
        if ik.success and fault_of(checker, ik.q, "goal") is None:
            break
    if not ik.success:
        return np.empty((0, pepper.n)), ik, (PlanStatus.NO_IK, ik.report())
    return _good_ones(checks, ik.q[None], ik)


def _good_ones(
    checks: Checks, candidates: NDArray[np.float64], ik: IKResult | None
) -> tuple[NDArray[np.float64], IKResult | None, tuple[PlanStatus, str] | None]:
    """Return the candidates that can be ends of a path, or what is wrong with the first."""
    good = candidates[checks.holds(candidates) & checks.free(candidates)]
    if len(good):
        return good, ik, None
    fault = fault_of(checks.exact, candidates[0], "goal")
    return candidates[: int(fault is None)], ik, fault


def fault_of_start(checks: Checks, q: NDArray[np.float64]) -> tuple[PlanStatus, str] | None:
    """Return why a path cannot start at q, shape (n,), or None."""
    if checks.holds(q[None])[0] and checks.free(q):
        return None
    return fault_of(checks.exact, q, "start")


def _are_known_to_fast(tasks: Sequence[Any]) -> bool:
    from pepper_kin.ik.fast import structures_of

    parts = [part for task in tasks for part in (task.parts if isinstance(task, TaskGroup) else [task])]
    try:
        structures_of(parts)
    except InvalidValueError:
        return False
    return True


def _are_tasks(goal: object) -> bool:
    return isinstance(goal, Sequence) and len(goal) > 0 and isinstance(goal[0], (Task, TaskGroup))


def is_there(start: NDArray[np.float64], goals: NDArray[np.float64]) -> bool:
    """Whether one of the goals, shape (m, n), is the start, shape (n,): then nothing need move."""
    return bool((np.abs(goals - start) <= _SAME).all(axis=1).any())


def free_joints(
    pepper: PepperModel,
    joints: str | Sequence[str] | None,
    start: NDArray[np.float64],
    goals: NDArray[np.float64],
) -> NDArray[np.int64]:
    """Return the indices of the joints that the planner moves, rising, shape (k,).

    Args:
        pepper: The robot.
        joints: A group, names, or None for those in which start and goals differ.
        start: Start configuration, shape (n,).
        goals: Goal configurations, shape (m, n).

    Raises:
        InvalidValueError: where a goal differs from the start in a joint that may not move.
        UnknownNameError: for an unknown joint or group.
    """
    moved = np.flatnonzero(np.any(np.abs(goals - start) > _SAME, axis=0))
    if joints is None:
        return moved
    names = pepper.joint_group(joints) if isinstance(joints, str) else tuple(joints)
    allowed = np.array(sorted(pepper.joint_index(name) for name in names), dtype=np.int64)
    locked = [pepper.joint_names[j] for j in moved if j not in allowed]
    if locked:
        raise InvalidValueError(
            "goal", f"other values of {', '.join(locked)}", "the start's, since they may not move"
        )
    return allowed if moved.size else moved
