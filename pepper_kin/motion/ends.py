"""The ends of a path: can it start here, and which goals can it end at?"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision import CollisionChecker
from pepper_kin.dynamics import gravity_torque
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import IKResult, Task, TaskGroup, solutions, solve
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_within_limits
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.plan_result import PlanStatus
from pepper_kin.motion.validity import holds

OTHER_SOLVER = "placo"
"""Where nothing shall be compiled, and for tasks that the fast solver does not know."""

FURTHER = 3
"""Solutions of a goal's tasks besides the first."""


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
    machine code, further solutions are looked for.
    """
    pepper, checker = checks.pepper, checks.exact
    if _are_tasks(goal):
        tasks = cast("Sequence[Task]", goal)
        fast = checks.compiled and _are_known_to_fast(tasks)
        solver = "fast" if fast else OTHER_SOLVER
        for scene in (checker.scene.padded(margin), checker.scene):
            ik = solve(
                pepper, tasks, q0=start, solver=solver, scene=scene, seed=seed, joints=joints,
                timeout=timeout / 3,
            )  # fmt: skip
            if ik.success and fault_of(checker, ik.q, "goal") is None:
                break
        if not ik.success:
            return np.empty((0, pepper.n)), ik, (PlanStatus.NO_IK, ik.report())
        candidates, result = ik.q[None], ik
        if fast:
            more = solutions(pepper, tasks, start, count=FURTHER, scene=scene, seed=seed, joints=joints)
            candidates = np.concatenate([candidates, more])
    else:
        candidates, result = np.atleast_2d(as_joint_vectors(pepper, goal, "goal")), None
        if candidates.ndim != 2:
            raise InvalidValueError(
                "goal", f"shape {candidates.shape}", f"shape ({pepper.n},) or (m, {pepper.n})"
            )
        check_within_limits(pepper, candidates, "goal")
    faults = [fault_of(checker, q, "goal") for q in candidates]
    good = [k for k, fault in enumerate(faults) if fault is None]
    return candidates[good], result, (None if good else faults[0])


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
    moved = np.flatnonzero(np.any(np.abs(goals - start) > 1e-9, axis=0))
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
