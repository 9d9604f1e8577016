"""From start, goal and scene to a collision-free path."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.collision import CollisionChecker, Scene, checker_for
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import IKResult, solve
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_joint_vectors,
    check_choice,
    check_positive,
    check_within_limits,
)
from pepper_kin.model.shapes import read_only
from pepper_kin.motion.metric import joint_reaches
from pepper_kin.motion.validity import holds, validity
from pepper_kin.motion.waypoints import waypoints_of
from pepper_kin.trajectory.path import as_cubic_path

PLANNERS = ("rrt_connect",)
RESOLUTION = 0.01  # [m], in the metric of `joint_reaches`
UNBOUNDED_RANGE = {"rad": np.pi, "m": 2.0}  # sampled around start and goal where a joint has no limits


class PlanStatus(Enum):
    """How planning ended; `advice` says what to try."""

    SOLVED = "solved"
    START_IN_COLLISION = "start_in_collision"
    START_TOO_HEAVY = "start_too_heavy"
    GOAL_IN_COLLISION = "goal_in_collision"
    GOAL_TOO_HEAVY = "goal_too_heavy"
    NO_IK = "no_ik"
    NO_PATH_IN_TIME = "no_path_in_time"

    @property
    def advice(self) -> str:
        """One sentence: what to try."""
        return _ADVICE[self]


_ADVICE = {
    PlanStatus.SOLVED: "Time the path with retime().",
    PlanStatus.START_IN_COLLISION: "Move the robot or the obstacle apart before planning.",
    PlanStatus.START_TOO_HEAVY: "Start from a posture that the joints can hold, such as Stand.",
    PlanStatus.GOAL_IN_COLLISION: "Give another goal, or IK tasks: free goals are then sought.",
    PlanStatus.GOAL_TOO_HEAVY: "Give a goal that the joints can hold against gravity.",
    PlanStatus.NO_IK: "Move the target, or allow more joints or restarts.",
    PlanStatus.NO_PATH_IN_TIME: "Raise the timeout, try another seed, or free more joints.",
}


@dataclass(frozen=True, eq=False)
class Plan:
    """The outcome of planning.

    Attributes:
        status: How it ended.
        message: What happened, in a sentence with names and numbers.
        joint_names: Order of the joints.
        path: Way-points, shape (k, n), read-only [rad or m]; None unless solved.  The spline that `retime`
            draws through them has been checked against the scene, not only the way-points.
        goal: The configuration reached, shape (n,); None unless solved.
        ik: Result of inverse kinematics where the goal was given as tasks.
        length: Length of the path in joint space [rad and m mixed]; nan unless solved.
        clearance: Smallest distance along the path, recomputed by coal [m]; nan unless solved.
        states_checked: Number of configurations asked about.
        time: Wall time [s].
        seed: Seed: the same problem and seed give the same plan.
    """

    status: PlanStatus
    message: str
    joint_names: tuple[str, ...]
    path: NDArray[np.float64] | None = None
    goal: NDArray[np.float64] | None = None
    ik: IKResult | None = None
    length: float = float("nan")
    clearance: float = float("nan")
    states_checked: int = 0
    time: float = 0.0
    seed: int = 0
    planner: str = field(default="rrt_connect")

    @property
    def success(self) -> bool:
        """Whether a path was found."""
        return self.status is PlanStatus.SOLVED

    def report(self) -> str:
        """Say in plain words what was found, or why nothing was and what to try."""
        return f"{self.message} {self.status.advice}"


def plan(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike | Sequence[Any],
    scene: Scene | None = None,
    *,
    planner: str = "rrt_connect",
    joints: str | Sequence[str] | None = None,
    margin: float = 0.005,
    seed: int = 0,
    timeout: float = 5.0,
) -> Plan:
    """Plan a collision-free path.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration, shape (n,), several, shape (m, n), or a list of IK tasks, which are solved
            from several starts: any solution that is free and can be held will do.
        scene: The world around the robot.
        planner: "rrt_connect": bidirectional RRT, then short-cutting and smoothing.
        joints: Joints that may move: a group name or joint names.  None: those in which start and goals
            differ.
        margin: Distance that is kept to the scene [m]; less where start or goal are nearer than that.
        seed: Seed of all random choices.
        timeout: Time budget of IK and search [s]; short-cutting and smoothing get a fifth of it more.

    Returns:
        The plan; without a path, its status and message tell why.

    Raises:
        InvalidValueError: for a wrong shape, NaN, or an unknown planner.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint or group.
    """
    begin = time.perf_counter()
    check_choice("planner", planner, PLANNERS)
    check_positive("timeout", timeout, "[s]")
    q_start = as_joint_vectors(pepper, start, "start")
    if q_start.ndim != 1:
        raise InvalidValueError("start", f"shape {q_start.shape}", f"shape ({pepper.n},)")
    check_within_limits(pepper, q_start, "start")
    ended = _Ending(pepper, begin, seed, planner)
    checker = checker_for(pepper, scene)
    fault = _fault(checker, q_start, "start")
    if fault is not None:
        return ended(*fault)
    goals, ik, fault = _goals(pepper, q_start, goal, checker, joints, seed, timeout)
    if fault is not None:
        return ended(*fault, ik=ik)
    free = _free_joints(pepper, joints, q_start, goals)
    if free.size == 0:
        message = "Start and goal are the same."
        return ended(PlanStatus.SOLVED, message, ik=ik, **_path_figures(checker, q_start[None]))
    kept = _margin(checker, q_start, goals, margin)
    problem = _problem(checker_for(pepper, scene, kept), q_start, goals, free)
    relaxed = _problem(checker_for(pepper, scene, kept / 2), q_start, goals, free)
    left = max(timeout - (time.perf_counter() - begin), 1e-3)
    result = planners.rrt_connect(problem, seed=seed, timeout=left)
    if result.path is None:
        message = f"No path: {result.states_checked} configurations were checked in {result.time:.2f} s."
        return ended(PlanStatus.NO_PATH_IN_TIME, message, ik=ik, states_checked=result.states_checked)

    def embed(states: NDArray[np.float64]) -> NDArray[np.float64]:
        q = np.tile(q_start, (len(states), 1))
        q[:, free] = np.clip(states, problem.lower, problem.upper)
        return q

    path = waypoints_of(pepper, problem, relaxed, result.path, embed, seed=seed, timeout=0.2 * timeout)
    figures = _path_figures(checker, path)
    message = (
        f"Path of {len(path)} way-points, {figures['length']:.3f} rad long, "
        f"clearance {figures['clearance'] * 1000:.1f} mm."
    )
    return ended(PlanStatus.SOLVED, message, ik=ik, states_checked=result.states_checked, **figures)


class _Ending:
    """Makes the plan that is returned, with what is the same for all endings filled in."""

    def __init__(self, pepper: PepperModel, begin: float, seed: int, planner: str) -> None:
        self.joint_names, self.begin, self.seed, self.planner = pepper.joint_names, begin, seed, planner

    def __call__(self, status: PlanStatus, message: str, **more: Any) -> Plan:
        elapsed = time.perf_counter() - self.begin
        return Plan(
            status, message, self.joint_names, time=elapsed, seed=self.seed, planner=self.planner, **more
        )


def _path_figures(checker: CollisionChecker, path: NDArray[np.float64]) -> dict[str, Any]:
    """Return what a plan says of its path: way-points, goal, length and clearance of the spline."""
    dense = path
    if len(path) > 1:
        spline = as_cubic_path(checker.pepper, path)
        pieces = np.arange(len(spline.breaks) - 1)
        thirds = [spline.at(pieces, x * np.diff(spline.breaks)) for x in (0.0, 0.25, 0.5, 0.75)]
        dense = np.concatenate([*thirds, path[-1:]])
    return {
        "path": read_only(path),
        "goal": read_only(path[-1]),
        "length": float(np.sum(np.linalg.norm(np.diff(path, axis=0), axis=1))),
        "clearance": float(checker.clearance(dense).min()),
    }


def _fault(checker: CollisionChecker, q: NDArray[np.float64], what: str) -> tuple[PlanStatus, str] | None:
    """Return why a configuration cannot be an end of the path, or None."""
    pepper, start = checker.pepper, what == "start"
    if checker.in_collision(q):
        pair = checker.closest_pair(q)
        names = checker.contacts(q)
        depth = f", {-pair.distance * 1000:.1f} mm deep" if pair is not None and pair.distance < 0 else ""
        status = PlanStatus.START_IN_COLLISION if start else PlanStatus.GOAL_IN_COLLISION
        return status, f"The {what} is in collision: {' and '.join(names[0])} overlap{depth}."
    if not holds(pepper, q[None])[0]:
        from pepper_kin.dynamics import gravity_torque

        tau = gravity_torque(pepper, q)
        joint = int(np.argmax(np.abs(tau) / pepper.effort_limits))
        status = PlanStatus.START_TOO_HEAVY if start else PlanStatus.GOAL_TOO_HEAVY
        limit = f"{pepper.effort_limits[joint]:.2f} N m it has"
        name = pepper.joint_names[joint]
        return status, f"The {what} takes {abs(tau[joint]):.2f} N m at {name}, near or over the {limit}."
    return None


def _goals(
    pepper: PepperModel,
    start: NDArray[np.float64],
    goal: ArrayLike | Sequence[Any],
    checker: CollisionChecker,
    joints: str | Sequence[str] | None,
    seed: int,
    timeout: float,
) -> tuple[NDArray[np.float64], IKResult | None, tuple[PlanStatus, str] | None]:
    """Return the goals that can be ends of a path, shape (m, n); or the reason why there is none."""
    if _are_tasks(goal):
        ik = solve(pepper, goal, q0=start, scene=checker.scene, seed=seed, joints=joints, timeout=timeout / 2)
        if not ik.success:
            return np.empty((0, pepper.n)), ik, (PlanStatus.NO_IK, ik.report())
        candidates, result = ik.q[None], ik
    else:
        candidates, result = np.atleast_2d(as_joint_vectors(pepper, goal, "goal")), None
        if candidates.ndim != 2:
            raise InvalidValueError(
                "goal", f"shape {candidates.shape}", f"shape ({pepper.n},) or (m, {pepper.n})"
            )
        check_within_limits(pepper, candidates, "goal")
    faults = [_fault(checker, q, "goal") for q in candidates]
    good = [k for k, fault in enumerate(faults) if fault is None]
    return candidates[good], result, (None if good else faults[0])


def _are_tasks(goal: object) -> bool:
    return isinstance(goal, Sequence) and len(goal) > 0 and hasattr(goal[0], "residual")


def _free_joints(
    pepper: PepperModel,
    joints: str | Sequence[str] | None,
    start: NDArray[np.float64],
    goals: NDArray[np.float64],
) -> NDArray[np.int64]:
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


def _margin(
    checker: CollisionChecker, start: NDArray[np.float64], goals: NDArray[np.float64], margin: float
) -> float:
    """Return the margin kept to the scene [m]: the wanted one, or as much as both ends allow."""
    wanted = float(margin)
    if not (np.isfinite(wanted) and wanted >= 0):
        raise InvalidValueError("margin", margin, "a finite distance of 0 or more [m]")
    while wanted > 1e-4:
        padded = checker_for(checker.pepper, checker.scene, wanted)
        if not padded.in_collision(start) and not padded.in_collision(goals).all():
            return wanted
        wanted /= 2
    return 0.0


def _problem(
    checker: CollisionChecker,
    start: NDArray[np.float64],
    goals: NDArray[np.float64],
    free: NDArray[np.int64],
) -> planners.Problem:
    pepper = checker.pepper
    ends = np.vstack([start, goals])
    spare = np.array([UNBOUNDED_RANGE[unit] for unit in pepper.joint_units])
    lower = np.where(np.isfinite(pepper.lower_limits), pepper.lower_limits, ends.min(axis=0) - spare)
    upper = np.where(np.isfinite(pepper.upper_limits), pepper.upper_limits, ends.max(axis=0) + spare)
    return planners.Problem(
        lower=lower[free],
        upper=upper[free],
        start=np.clip(start, lower, upper)[free],
        goals=np.clip(goals, lower, upper)[:, free],
        oracle=validity(checker, start, free),
        weights=joint_reaches(pepper)[free],
        resolution=RESOLUTION,
        labels=tuple(pepper.joint_names[j] for j in free),
    )
