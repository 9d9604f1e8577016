"""The one call: tasks in, the best configuration and its certificate out."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.certificate import CertificateInputs
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast.compiled_tasks import compiled_tasks
from pepper_kin.ik.fast.search import search_compiled
from pepper_kin.ik.obstruction import what_is_in_the_way, what_would_help, why_beyond_reach
from pepper_kin.ik.priorities import SolverContext, balanced, is_ordered, solve_with_priorities
from pepper_kin.ik.problem import Problem, SearchBudget, flatten_tasks, make_problem, movable_joints
from pepper_kin.ik.result import IKResult, SearchResult, Status
from pepper_kin.ik.solvers import ALL_SOLVERS, make_solver
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

_neutrals: WeakKeyDictionary[PepperModel, Array] = WeakKeyDictionary()


def solve(
    pepper: PepperModel,
    tasks: Task | TaskGroup | Iterable[Task | TaskGroup],
    q0: ArrayLike | None = None,
    *,
    solver: str = "fast",
    scene: Scene | None = None,
    margin: float = 0.0,
    seed: int = 0,
    joints: str | Sequence[str] | None = None,
    max_iterations: int = 150,
    restarts: int = 32,
    timeout: float | None = None,
) -> IKResult:
    """Find joint positions that fulfill tasks, or come closest.

    Minimizes sum_i s_i^2 |r_i(q)|^2 within the joint limits by damped Gauss-Newton steps, each the solution
    of a quadratic program, first from q0 and then from further starts; see `Problem`.  Of several solutions
    it prefers one that touches nothing (with a scene), that the motors can hold, and that is near q0.
    Where not all tasks can be met, hard ones come first, then positions before their orientations; see
    `priorities`.  The same arguments give the same result, unless a timeout cuts in.

    Args:
        pepper: The robot.
        tasks: What to fulfill, such as `HandPosition` and `LookAt`.
        q0: Where to start and what to stay near [rad or m], shape (n,); `pepper.neutral()` if None.
        solver: "fast", "placo" or "proxsuite".
        scene: What to keep clear of, itself included; `Scene()` for itself alone; None for nothing.
        margin: Distance to the scene that is kept [m]; of its own parts the robot only keeps clear.
        seed: Draws the restarts.
        joints: Joints that may move, by names of joints and groups, such as `["right_arm", "head"]`; the
            others keep q0. None for all.
        max_iterations: Steps from each start.
        restarts: Further starts, used only as long as there is something to gain.  With a scene, "fast" may
            use more of them for a solution that touches nothing.
        timeout: Time after which to stop [s]; None for none.

    Returns:
        The result; `result.status` says whether the tasks are met and, if not, what is in the way.

    Raises:
        InvalidValueError: for no task, an unknown solver, or numbers that are none, NaN or infinite.
        UnknownNameError: for a frame, joint or group that the robot lacks.
        LimitError: for a q0 outside the joint limits.
    """
    check_choice("solver", solver, ALL_SOLVERS)
    parts = tuple(flatten_tasks(pepper, tasks))
    if timeout is not None and solver == "fast":
        compiled_tasks(pepper, parts)  # made once on a machine: that does not count against a timeout
    begin = time.perf_counter()
    start = checked_start(pepper, q0)
    movable = None if joints is None else movable_joints(pepper, joints)
    apart = checked_margin(scene, margin)
    budget = _checked_budget(seed, restarts, max_iterations, timeout, begin)
    request = Request(pepper, balanced(parts), start, movable, Collisions(pepper, scene, apart), budget)
    found = _search(request, solver)
    if found.status not in (Status.SOLVED, Status.TIMED_OUT) and is_ordered(parts):
        found = _in_order(request, solver, found)
    hint = _hint(found.status, request, solver)
    return IKResult(
        status=found.status,
        q=found.q,
        iterations=found.iterations,
        restarts=found.restarts,
        time=time.perf_counter() - begin,
        solver=solver,
        seed=budget.seed,
        evidence=CertificateInputs(pepper, parts, start, movable, scene, found.q).certificate,
        hint=hint,
    )


class Request(NamedTuple):
    """What `solve` was asked for, checked.

    Attributes:
        pepper: The robot.
        tasks: The tasks, groups taken apart, their weights balanced.
        q0: The start, within the limits, shape (n,).
        movable: Joints that may move, shape (n,); None for all.
        collisions: What may not touch.
        budget: How much the search may spend.
    """

    pepper: PepperModel
    tasks: tuple[Task, ...]
    q0: Array
    movable: np.ndarray | None
    collisions: Collisions
    budget: SearchBudget

    def problem(self, *, whole: bool = False) -> Problem:
        """Return the problem; with `whole` every joint may move."""
        movable = self.movable
        if whole or movable is None:
            movable = np.ones(self.pepper.n, dtype=bool)
        return make_problem(
            self.pepper, self.tasks, self.q0, movable, keep_idle=whole or self.collisions.scene is None
        )


def _search(request: Request, solver: str) -> SearchResult:
    """Search from the start and further ones."""
    pepper, collisions, budget = request.pepper, request.collisions, request.budget
    if solver == "fast":
        return search_compiled(pepper, request.tasks, request.q0, request.movable, budget, collisions)
    return make_solver(solver, request.problem()).search(collisions, budget)


def _in_order(request: Request, solver: str, found: SearchResult) -> SearchResult:
    """Meet better what comes first."""
    problem, collisions = request.problem(), request.collisions
    q = solve_with_priorities(problem, SolverContext(solver, collisions, request.budget), found.q)
    met = problem.is_met(problem.residuals(q)) and collisions.free(q)
    return found._replace(q=read_only(q), status=Status.SOLVED if met else found.status)


def _hint(status: Status, request: Request, solver: str) -> str:
    if status is Status.TIMED_OUT:
        return why_beyond_reach(request.problem())
    if status is Status.CLOSEST_COLLISION:
        return what_is_in_the_way(request.problem(), request.collisions, request.budget)
    freed = request.movable is None or request.movable.all()
    if freed or status not in (Status.CLOSEST_LIMITS, Status.CLOSEST_UNREACHABLE):
        return ""
    joints = what_would_help(request.problem(), request.problem(whole=True), solver, request.budget)
    return f"with {joints} free it would be reached" if joints else ""


def _checked_budget(
    seed: int, restarts: int, max_iterations: int, timeout: float | None, begin: float
) -> SearchBudget:
    return SearchBudget(
        seed=whole_number("seed", seed, 0),
        restarts=whole_number("restarts", restarts, 0),
        max_iterations=whole_number("max_iterations", max_iterations, 1),
        deadline=math.inf if timeout is None else begin + check_positive("timeout", timeout, "s"),
    )


def checked_start(pepper: PepperModel, q0: ArrayLike | None) -> Array:
    """Return where to start, within the limits, shape (n,).

    Raises:
        InvalidValueError: for a q0 of wrong shape, or with NaN or infinity.
        LimitError: for a q0 outside the joint limits.
    """
    if q0 is None:
        return _neutral(pepper)
    if isinstance(q0, np.ndarray) and q0.dtype == np.float64 and q0.shape == (pepper.n,):
        plain: Array = q0
        if bool(((pepper.lower_limits <= plain) & (plain <= pepper.upper_limits)).all()):
            return plain.copy()
    start = as_joint_vectors(pepper, q0, "q0")
    if start.ndim != 1:
        raise InvalidValueError("q0", f"shape {start.shape}", f"shape ({pepper.n},)")
    check_within_limits(pepper, start, "q0")
    return np.clip(start, pepper.lower_limits, pepper.upper_limits)


def _neutral(pepper: PepperModel) -> Array:
    """Return the neutral posture, looked up once for each robot."""
    found = _neutrals.get(pepper)
    if found is None:
        found = _neutrals[pepper] = read_only(pepper.neutral())
    return found


def checked_margin(scene: object, margin: float) -> float:
    """Return the distance to keep from a scene [m].

    Raises:
        InvalidValueError: unless the scene is a Scene or None and the margin a finite number of 0 or more, 0
            where there is no scene.
    """
    if scene is None:
        if margin != 0:
            raise InvalidValueError("margin", margin, "0 where there is no scene to keep it from")
        return 0.0
    from pepper_kin.collision import Scene

    if not isinstance(scene, Scene):
        raise InvalidValueError("scene", repr(scene)[:80], "a Scene, or None to leave collisions out")
    return 0.0 if margin == 0 else check_positive("margin", margin, "m")


def whole_number(quantity: str, value: int, least: int) -> int:
    """Return a whole number.

    Raises:
        InvalidValueError: unless it is one of at least `least`.
    """
    if type(value) is int and value >= least:
        return value
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise InvalidValueError(quantity, repr(value), f"a whole number of at least {least}")
    return int(value)
