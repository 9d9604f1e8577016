"""From start, goal, scene and constraints to a path that keeps the constraints all the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin import planners
from pepper_kin.collision import CollisionChecker, Scene, checker_for
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.ik.tasks.task import words_for_angle, words_for_length
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_joint_vectors, check_positive, check_within_limits
from pepper_kin.model.shapes import read_only
from pepper_kin.motion.constrained_waypoints import constrained_waypoints, largest_errors
from pepper_kin.motion.constraints import as_constraints, hardened, manifold_of
from pepper_kin.motion.ends import fault_of, free_joints, goals_of
from pepper_kin.motion.metric import joint_reaches
from pepper_kin.motion.plan_result import Ending, Plan, PlanStatus
from pepper_kin.motion.validity import validity
from pepper_kin.trajectory.path import as_cubic_path

Array = NDArray[np.float64]

PLANNER = "constrained_connect"
RESOLUTION = 0.01  # [m], in the metric of `joint_reaches`
UNBOUNDED_RANGE = {"rad": np.pi, "m": 2.0}  # sampled around start and goal where a joint has no limits
SHORTCUTS = 60


def plan_constrained(
    pepper: PepperModel,
    start: ArrayLike,
    goal: ArrayLike | Sequence[Any],
    scene: Scene | None = None,
    constraints: Sequence[Task | TaskGroup] = (),
    *,
    joints: str | Sequence[str] | None = None,
    margin: float = 0.01,
    seed: int = 0,
    timeout: float = 10.0,
) -> Plan:
    """Plan a collision-free path along which IK tasks stay met.

    A tray that stays level is `AxisAlignment`, a box between two hands `RelativePose`, a gaze that stays on a
    point `LookAt`, a hand at a height `FrameInPlane`.  Each task's tolerance is what may be used of it on the
    way: half a degree is an equation to the planner, ten degrees an inequality.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,), which meets the constraints.
        goal: Goal configuration, shape (n,), several, shape (m, n), or a list of IK tasks, which are solved
            together with the constraints.
        scene: The world around the robot.
        constraints: Tasks with one target and a finite tolerance each.
        joints: Joints that may move: a group name or joint names.  None: those in which start and goals
            differ; give more where the constraints leave them no freedom.
        margin: Distance that is kept to the scene and to the robot itself [m]; less where start or goal are
            nearer than that.
        seed: Seed of all random choices.
        timeout: Time budget of IK and search [s]; short-cutting and rounding may take half of it each.

    Returns:
        The plan.  Its `constraint_errors` are the largest errors along the spline that `retime` draws.

    Raises:
        InvalidValueError: for a wrong shape, NaN, no constraint, or one of infinite tolerance.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint, frame or group.
    """
    begin = time.perf_counter()
    tasks = as_constraints(pepper, constraints)
    q_start = _checked_start(pepper, start, margin, timeout)
    ended = Ending(pepper, begin, seed, PLANNER)
    checker = checker_for(pepper, scene)
    fault = _off(pepper, tasks, q_start, "start") or fault_of(checker, q_start, "start")
    if fault is not None:
        return ended(*fault)
    goals, ik, fault = goals_of(checker, q_start, _with(goal, tasks), joints, margin, seed, timeout)
    faults = [_off(pepper, tasks, q, "goal") for q in goals]
    goals = goals[[k for k, off in enumerate(faults) if off is None]]
    if not len(goals):
        return ended(*(fault or next(off for off in faults if off is not None)), ik=ik)
    free = free_joints(pepper, joints, q_start, goals)
    if free.size == 0:
        figures = _figures(checker, tasks, q_start[None])
        return ended(PlanStatus.SOLVED, "Start and goal are the same.", ik=ik, **figures)
    room = _Room.of(checker, tasks, q_start, goals, free, margin)
    left = max(timeout - (time.perf_counter() - begin), 1e-3)
    result = planners.constrained_connect(room.problem, room.manifold, seed=seed, timeout=left)
    said = {"ik": ik, "states_checked": result.states_checked}
    if result.path is None:
        message = f"No path: {result.states_checked} configurations were checked in {result.time:.2f} s."
        return ended(PlanStatus.NO_PATH_IN_TIME, message, **said)
    path = room.waypoints(pepper, result.path, seed, timeout / 2)
    figures = {} if path is None else _figures(checker, tasks, path)
    if path is None or not _keeps(tasks, figures["constraint_errors"]):
        message = "A path was found, but no spline through way-points of it keeps constraints and margin."
        return ended(PlanStatus.NO_PATH_IN_TIME, message, **said)
    return ended(PlanStatus.SOLVED, _words(tasks, figures), **said, **figures)


class _Room(NamedTuple):
    """Where the path is sought.

    Attributes:
        problem: The joints that move, with the margin kept.
        relaxed: The same with half the margin, which a rounded path needs beside it.
        manifold: The constraints.
        embed: From states of the moving joints to whole configurations.
    """

    problem: planners.Problem
    relaxed: planners.Problem
    manifold: planners.Manifold
    embed: Callable[[Array], Array]

    @classmethod
    def of(
        cls,
        checker: CollisionChecker,
        tasks: Sequence[Task],
        start: Array,
        goals: Array,
        free: NDArray[np.int64],
        margin: float,
    ) -> _Room:
        pepper, scene = checker.pepper, checker.scene
        kept, kept_self = _margins(checker, start, goals, margin)
        problem = _problem(checker_for(pepper, scene, kept, kept_self), start, goals, free)
        relaxed = _problem(checker_for(pepper, scene, kept / 2, kept_self / 2), start, goals, free)

        def embed(states: Array) -> Array:
            q = np.tile(start, (len(states), 1))
            q[:, free] = np.clip(states, problem.lower, problem.upper)
            return q

        return cls(problem, relaxed, manifold_of(pepper, tasks, start, free), embed)

    def waypoints(self, pepper: PepperModel, path: planners.Path, seed: int, timeout: float) -> Array | None:
        """Shorten and round a path; return way-points whose spline is valid, or None."""
        short = planners.constrained_shortcut(
            self.problem, self.manifold, path, seed=seed, iterations=SHORTCUTS, timeout=timeout
        )
        round_ = planners.constrained_smooth(self.relaxed, self.manifold, short, timeout=timeout)
        candidates = (round_, short, path)
        return constrained_waypoints(pepper, self.relaxed, self.manifold, candidates, self.embed)


def _checked_start(pepper: PepperModel, start: ArrayLike, margin: float, timeout: float) -> Array:
    check_positive("timeout", timeout, "[s]")
    if not (np.isfinite(margin) and margin >= 0):
        raise InvalidValueError("margin", margin, "a finite distance of 0 or more [m]")
    q_start = as_joint_vectors(pepper, start, "start")
    if q_start.ndim != 1:
        raise InvalidValueError("start", f"shape {q_start.shape}", f"shape ({pepper.n},)")
    check_within_limits(pepper, q_start, "start")
    return np.clip(q_start, pepper.lower_limits, pepper.upper_limits)


def _with(goal: ArrayLike | Sequence[Any], constraints: Sequence[Task]) -> Any:
    """Return the goal; if it is made of tasks, together with the constraints as hard ones."""
    if not isinstance(goal, Sequence) or not goal or not isinstance(goal[0], (Task, TaskGroup)):
        return goal
    parts: list[Any] = []
    for item in goal:
        parts += item.parts if isinstance(item, TaskGroup) else [item]
    return [*parts, *(hardened(task) for task in constraints)]


def _off(pepper: PepperModel, tasks: Sequence[Task], q: Array, what: str) -> tuple[PlanStatus, str] | None:
    """Return which constraint a configuration does not meet, or None."""
    for task in tasks:
        if task.error(pepper, q) > task.tolerance * (1.0 + 1e-9):
            status = PlanStatus.START_OFF_CONSTRAINT if what == "start" else PlanStatus.GOAL_OFF_CONSTRAINT
            words = words_for_angle if task.unit_on(pepper) == "rad" else words_for_length
            allowed = f"its tolerance is {words(task.tolerance)}"
            return status, f"The {what} does not meet a constraint: {task.shortfall(pepper, q)}; {allowed}."
    return None


def _margins(checker: CollisionChecker, start: Array, goals: Array, margin: float) -> tuple[float, float]:
    """Return the margins kept to the scene and to the robot itself [m]: as wanted, or what the ends allow."""
    alone = checker_for(checker.pepper)
    room = min(float(alone.clearance(start)), float(alone.clearance(goals).max()))
    kept, kept_self = margin, min(margin, max(room, 0.0) / 2)
    while kept > 1e-4:
        for own in (kept_self, 0.0):
            padded = checker_for(checker.pepper, checker.scene, kept, own)
            if not padded.in_collision(start) and not padded.in_collision(goals).all():
                return kept, own
        kept /= 2
    return 0.0, 0.0


def _problem(
    checker: CollisionChecker, start: Array, goals: Array, free: NDArray[np.int64]
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


def _figures(checker: CollisionChecker, tasks: Sequence[Task], path: Array) -> dict[str, Any]:
    """Return what a plan says of its path, recomputed on its spline."""
    dense = path
    if len(path) > 1:
        spline = as_cubic_path(checker.pepper, path)
        pieces = np.arange(len(spline.breaks) - 1)
        parts = [spline.at(pieces, x * np.diff(spline.breaks)) for x in (0.0, 0.25, 0.5, 0.75)]
        dense = np.concatenate([*parts, path[-1:]])
    return {
        "path": read_only(path),
        "goal": read_only(path[-1]),
        "length": float(np.sum(np.linalg.norm(np.diff(path, axis=0), axis=1))),
        "clearance": float(checker.clearance(dense).min()),
        "constraint_errors": largest_errors(checker.pepper, path, tasks),
    }


def _keeps(tasks: Sequence[Task], errors: Sequence[float]) -> bool:
    return all(error <= task.tolerance * (1.0 + 1e-9) for task, error in zip(tasks, errors, strict=True))


def _words(tasks: Sequence[Task], figures: dict[str, Any]) -> str:
    errors = figures["constraint_errors"]
    worst = max(range(len(tasks)), key=lambda k: errors[k] / tasks[k].tolerance)
    return (
        f"Path of {len(figures['path'])} way-points with a clearance of "
        f"{figures['clearance'] * 1000:.1f} mm; "
        f"{tasks[worst].name} uses {100 * errors[worst] / tasks[worst].tolerance:.0f} % of its tolerance."
    )
