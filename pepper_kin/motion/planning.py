"""From start, goal and scene to a collision-free path."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.collision import CollisionChecker, Scene, checker_for
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_choice, check_positive, check_within_limits
from pepper_kin.model.shapes import read_only
from pepper_kin.motion.ends import fault_of, free_joints, goals_of
from pepper_kin.motion.metric import joint_reaches
from pepper_kin.motion.plan_result import Ending, Plan, PlanStatus
from pepper_kin.motion.validity import validity
from pepper_kin.motion.waypoints import waypoints_of
from pepper_kin.trajectory.path import as_cubic_path

PLANNERS = ("rrt_connect",)
RESOLUTION = 0.01  # [m], in the metric of `joint_reaches`
UNBOUNDED_RANGE = {"rad": np.pi, "m": 2.0}  # sampled around start and goal where a joint has no limits


def plan(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike | Sequence[Any],
    scene: Scene | None = None,
    *,
    planner: str = "rrt_connect",
    joints: str | Sequence[str] | None = None,
    margin: float = 0.01,
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
        margin: Distance that is kept to the scene and to the robot itself [m]; less where start or goal are
            nearer than that.
        seed: Seed of all random choices.
        timeout: Time budget of IK and search [s].  Short-cutting stops after a number of attempts, so that
            the same seed gives the same path, or after as much time again.

    Returns:
        The plan; without a path, its status and message tell why.

    Raises:
        InvalidValueError: for a wrong shape, NaN, or an unknown planner.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint or group.
    """
    begin = time.perf_counter()
    q_start = _checked_start(pepper, start, planner, margin, timeout)
    ended = Ending(pepper, begin, seed, planner)
    checker = checker_for(pepper, scene)
    fault = fault_of(checker, q_start, "start")
    if fault is not None:
        return ended(*fault)
    goals, ik, fault = goals_of(checker, q_start, goal, joints, margin, seed, timeout)
    if fault is not None:
        return ended(*fault, ik=ik)
    free = free_joints(pepper, joints, q_start, goals)
    if free.size == 0:
        message = "Start and goal are the same."
        return ended(PlanStatus.SOLVED, message, ik=ik, **_path_figures(checker, q_start[None]))
    kept, kept_self = _margins(checker, q_start, goals, margin)
    problem = _problem(checker_for(pepper, scene, kept, kept_self), q_start, goals, free)
    relaxed = _problem(checker_for(pepper, scene, kept / 2, kept_self / 2), q_start, goals, free)
    left = max(timeout - (time.perf_counter() - begin), 1e-3)
    result = planners.rrt_connect(problem, seed=seed, timeout=left)
    if result.path is None:
        message = f"No path: {result.states_checked} configurations were checked in {result.time:.2f} s."
        return ended(PlanStatus.NO_PATH_IN_TIME, message, ik=ik, states_checked=result.states_checked)
    embed = _embedding(q_start, free, problem)
    path = waypoints_of(pepper, problem, relaxed, result.path, embed, seed=seed, timeout=timeout)
    figures = _path_figures(checker, path)
    message = f"Path of {len(path)} way-points with a clearance of {figures['clearance'] * 1000:.1f} mm."
    return ended(PlanStatus.SOLVED, message, ik=ik, states_checked=result.states_checked, **figures)


def _checked_start(
    pepper: PepperModel, start: ArrayLike, planner: str, margin: float, timeout: float
) -> NDArray[np.float64]:
    """Check what was asked for; return the start, shape (n,)."""
    check_choice("planner", planner, PLANNERS)
    check_positive("timeout", timeout, "[s]")
    if not (np.isfinite(margin) and margin >= 0):
        raise InvalidValueError("margin", margin, "a finite distance of 0 or more [m]")
    q_start = as_joint_vectors(pepper, start, "start")
    if q_start.ndim != 1:
        raise InvalidValueError("start", f"shape {q_start.shape}", f"shape ({pepper.n},)")
    check_within_limits(pepper, q_start, "start")
    return q_start


def _embedding(
    frozen: NDArray[np.float64], free: NDArray[np.int64], problem: planners.Problem
) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the map from states of the moving joints to whole configurations."""

    def embed(states: NDArray[np.float64]) -> NDArray[np.float64]:
        q = np.tile(frozen, (len(states), 1))
        q[:, free] = np.clip(states, problem.lower, problem.upper)
        return q

    return embed


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


def _margins(
    checker: CollisionChecker, start: NDArray[np.float64], goals: NDArray[np.float64], margin: float
) -> tuple[float, float]:
    """Return the margins kept to the scene and to the robot itself [m]: as wanted, or what the ends allow."""
    alone = checker_for(checker.pepper)
    room = min(float(alone.clearance(start)), float(alone.clearance(goals).max()))
    kept_self = min(margin, max(room, 0.0) / 2)
    if not _ends_are_free(checker, start, goals, 0.0, kept_self):
        kept_self = 0.0
    kept = margin
    while kept > 1e-4:
        if _ends_are_free(checker, start, goals, kept, kept_self):
            return kept, kept_self
        kept /= 2
    return 0.0, kept_self


def _ends_are_free(
    checker: CollisionChecker,
    start: NDArray[np.float64],
    goals: NDArray[np.float64],
    margin: float,
    self_margin: float,
) -> bool:
    padded = checker_for(checker.pepper, checker.scene, margin, self_margin)
    return not padded.in_collision(start) and not padded.in_collision(goals).all()


def _problem(
    checker: CollisionChecker,
    start: NDArray[np.float64],
    goals: NDArray[np.float64],
    free: NDArray[np.int64],
) -> planners.Problem:
    pepper = checker.pepper
    held = tuple((item.frame, item.extent) for item in checker.scene.attached.values())
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
        weights=joint_reaches(pepper, held)[free],
        resolution=RESOLUTION,
        labels=tuple(pepper.joint_names[j] for j in free),
    )
