"""The one call: tasks in, the best configuration and its certificate out."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.certificate import certify
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.obstruction import find_status, would_all_joints_help
from pepper_kin.ik.problem import Problem, flatten_tasks, make_problem, movable_joints
from pepper_kin.ik.result import IKResult, Status
from pepper_kin.ik.search import Budget, search
from pepper_kin.ik.solvers import SOLVERS, make_solver
from pepper_kin.ik.tasks.task import Array, Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_joint_vectors,
    check_choice,
    check_positive,
    check_within_limits,
)
from pepper_kin.model.shapes import read_only

if TYPE_CHECKING:
    from pepper_kin.collision import Scene


def solve(
    pepper: PepperModel,
    tasks: Task | TaskGroup | Iterable[Task | TaskGroup],
    q0: ArrayLike | None = None,
    *,
    solver: str = "placo",
    scene: Scene | None = None,
    seed: int = 0,
    joints: str | Sequence[str] | None = None,
    max_iterations: int = 150,
    restarts: int = 32,
    timeout: float | None = None,
) -> IKResult:
    """Find joint positions that fulfil tasks, or come closest.

    Minimises sum_i w_i^2 |r_i(q)|^2 within the joint limits by damped Gauss-Newton steps, each the solution
    of a quadratic programme, first from q0 and then from further starts; see `Problem`.  Of several solutions
    it prefers one that touches nothing (with a scene), that the motors can hold, and that is near q0.
    The same arguments give the same result, unless a timeout cuts in.

    Args:
        pepper: The robot.
        tasks: What to fulfil, such as `HandPosition` and `LookAt`.
        q0: Where to start and what to stay near [rad or m], shape (n,); `pepper.neutral()` if None.
        solver: "placo" or "proxsuite".
        scene: What to keep clear of, itself included; `Scene()` for itself alone; None for nothing.
        seed: Draws the restarts.
        joints: A joint group's name, or names of the joints that may move; the others keep q0. None for all.
        max_iterations: Steps from each start.
        restarts: Further starts, used only as long as there is something to gain.
        timeout: Time after which to stop [s]; None for none.

    Returns:
        The result; `result.status` says whether the tasks are met and, if not, what is in the way.

    Raises:
        InvalidValueError: for no task, an unknown solver, or numbers that are none, NaN or infinite.
        UnknownNameError: for a frame, joint or group that the robot lacks.
        LimitError: for a q0 outside the joint limits.
    """
    begin = time.perf_counter()
    check_choice("solver", solver, SOLVERS)
    parts = flatten_tasks(pepper, tasks)
    start = _checked_start(pepper, q0)
    movable = movable_joints(pepper, joints)
    _check_scene(scene)
    budget = _checked_budget(seed, restarts, max_iterations, timeout, begin)
    collisions = Collisions(pepper, scene)
    problem = make_problem(pepper, parts, start, movable, keep_idle=scene is None)
    found = search(problem, make_solver(solver, problem), collisions, budget)
    status = find_status(problem, found, solver, budget)
    hint = "" if movable.all() else _hint(status, problem, solver, budget)
    q = found.best.q
    certificate = certify(problem, collisions, q)
    return IKResult(
        status=status,
        q=read_only(q),
        iterations=found.iterations,
        restarts=found.restarts,
        time=time.perf_counter() - begin,
        solver=solver,
        seed=budget.seed,
        hint=hint,
        **vars(certificate),
    )


def _hint(status: Status, problem: Problem, solver: str, budget: Budget) -> str:
    if status not in (Status.CLOSEST_LIMITS, Status.CLOSEST_UNREACHABLE):
        return ""
    every = np.ones(problem.pepper.n, dtype=bool)
    whole = make_problem(problem.pepper, problem.tasks, problem.q0, every, keep_idle=True)
    if whole.movable.sum() > problem.movable.sum() and would_all_joints_help(whole, solver, budget):
        return "with all joints free it would be reached"
    return ""


def _checked_budget(
    seed: int, restarts: int, max_iterations: int, timeout: float | None, begin: float
) -> Budget:
    return Budget(
        seed=_whole("seed", seed, 0),
        restarts=_whole("restarts", restarts, 0),
        max_iterations=_whole("max_iterations", max_iterations, 1),
        deadline=math.inf if timeout is None else begin + check_positive("timeout", timeout, "s"),
    )


def _checked_start(pepper: PepperModel, q0: ArrayLike | None) -> Array:
    if q0 is None:
        return pepper.neutral()
    start = as_joint_vectors(pepper, q0, "q0")
    if start.ndim != 1:
        raise InvalidValueError("q0", f"shape {start.shape}", f"shape ({pepper.n},)")
    check_within_limits(pepper, start, "q0")
    return np.clip(start, pepper.lower_limits, pepper.upper_limits)


def _check_scene(scene: object) -> None:
    if scene is None:
        return
    from pepper_kin.collision import Scene

    if not isinstance(scene, Scene):
        raise InvalidValueError("scene", repr(scene)[:80], "a Scene, or None to leave collisions out")


def _whole(quantity: str, value: int, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise InvalidValueError(quantity, repr(value), f"a whole number of at least {least}")
    return int(value)
