"""From start, goal and scene to a collision-free path."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_choice, check_positive, check_within_limits
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.ends import fault_of, free_joints, goals_of
from pepper_kin.motion.metric import joint_reaches
from pepper_kin.motion.plan_result import Ending, Plan, PlanStatus
from pepper_kin.motion.search import find_path
from pepper_kin.motion.waypoints import waypoints_of

PLANNERS = ("rrt_connect", "rrt_star")
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
    compiled: bool = True,
) -> Plan:
    """Plan a collision-free path.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration, shape (n,), several, shape (m, n), or a list of IK tasks, which are solved
            from several starts; of the solutions that are free and can be held the one with the shortest
            path is taken.
        scene: The world around the robot.
        planner: "rrt_connect": bidirectional RRT; "rrt_star": keeps improving until its time is up; or a name
            of `planners.available_ompl_planners()`.  Short-cutting and smoothing follow.
        joints: Joints that may move: a group name or joint names.  None: those in which start and goals
            differ.
        margin: Distance that is kept to the scene and to the robot itself [m]; less where start or goal are
            nearer than that.
        seed: Seed of all random choices.
        timeout: Time budget of IK and search [s].  Short-cutting stops after a number of attempts, so that
            the same seed gives the same path, or after as much time again.
        compiled: Whether checks and search run as machine code, which the first use on a machine compiles for
            about a minute.  False: coal and interpreted code, hundreds of times slower; the goal's tasks are
            then solved by placo, one solution only.

    Returns:
        The plan; without a path, its status and message tell why.

    Raises:
        InvalidValueError: for a wrong shape, NaN, or an unknown planner.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint or group.
    """
    q_start = _checked_start(pepper, start, planner, margin, timeout)
    checks = Checks(pepper, scene, bool(compiled))
    begin = time.perf_counter()  # code is loaded by now, and perhaps compiled: that is not planning
    ended = Ending(pepper, begin, seed, planner)
    fault = fault_of(checks.exact, q_start, "start")
    if fault is not None:
        return ended(*fault)
    goals, ik, fault = goals_of(checks, q_start, goal, joints, margin, seed, timeout)
    if fault is not None:
        return ended(*fault, ik=ik)
    free = free_joints(pepper, joints, q_start, goals)
    if free.size == 0:
        return ended.solved(checks.exact, q_start[None], "Start and goal are the same.", ik=ik)
    kept, kept_self = checks.margins(q_start, goals, margin)
    problem = _problem(checks, q_start, goals, free, (kept, kept_self))
    half = checks.oracle(q_start, free, (kept / 2, kept_self / 2), for_edges=False)
    relaxed = replace(problem, oracle=half)
    left = max(timeout - (time.perf_counter() - begin), 1e-3)
    result = find_path(problem, planner, seed=seed, timeout=left, compare=ik is not None)
    if result.path is None:
        message = f"No path: {result.states_checked} configurations were checked in {result.time:.2f} s."
        return ended(PlanStatus.NO_PATH_IN_TIME, message, ik=ik, states_checked=result.states_checked)
    embed = _embedding(q_start, free, problem)
    path = waypoints_of(pepper, problem, relaxed, result.path, embed, seed=seed, timeout=timeout)
    message = f"Path of {len(path)} way-points."
    return ended.solved(checks.exact, path, message, ik=ik, states_checked=result.states_checked)


def _checked_start(
    pepper: PepperModel, start: ArrayLike, planner: str, margin: float, timeout: float
) -> NDArray[np.float64]:
    """Check what was asked for; return the start, shape (n,)."""
    check_choice("planner", planner, PLANNERS + planners.available_ompl_planners())
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


def _problem(
    checks: Checks,
    start: NDArray[np.float64],
    goals: NDArray[np.float64],
    free: NDArray[np.int64],
    margins: tuple[float, float],
) -> planners.Problem:
    pepper = checks.pepper
    held = tuple((item.frame, item.extent) for item in checks.exact.scene.attached.values())
    ends = np.vstack([start, goals])
    spare = np.array([UNBOUNDED_RANGE[unit] for unit in pepper.joint_units])
    lower = np.where(np.isfinite(pepper.lower_limits), pepper.lower_limits, ends.min(axis=0) - spare)
    upper = np.where(np.isfinite(pepper.upper_limits), pepper.upper_limits, ends.max(axis=0) + spare)
    return planners.Problem(
        lower=lower[free],
        upper=upper[free],
        start=np.clip(start, lower, upper)[free],
        goals=np.clip(goals, lower, upper)[:, free],
        oracle=checks.oracle(start, free, margins, for_edges=True),
        weights=joint_reaches(pepper, held)[free],
        resolution=RESOLUTION,
        labels=tuple(pepper.joint_names[j] for j in free),
    )
