"""The one call: tasks in, the best configuration and its certificate out."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from functools import lru_cache
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.certificate import Evidence
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.descenders import ALL_SOLVERS, make_descender
from pepper_kin.ik.obstruction import find_status, what_would_help
from pepper_kin.ik.precedence import Means, balanced, is_ordered, put_first
from pepper_kin.ik.problem import Problem, flatten_tasks, make_problem, movable_joints
from pepper_kin.ik.reach_bound import why_beyond_reach
from pepper_kin.ik.result import Found, IKResult, Status
from pepper_kin.ik.search import Budget, search
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

# With a timeout, the search that is not interrupted is used only if there is this much time [s] and at most
# so many steps to make, of some microseconds each.
LEAST_TIME = 0.05
MOST_STEPS = 10_000

_neutrals: WeakKeyDictionary[PepperModel, Array] = WeakKeyDictionary()


def solve(
    pepper: PepperModel,
    tasks: Task | TaskGroup | Iterable[Task | TaskGroup],
    q0: ArrayLike | None = None,
    *,
    solver: str = "fast",
    scene: Scene | None = None,
    seed: int = 0,
    joints: str | Sequence[str] | None = None,
    max_iterations: int = 150,
    restarts: int = 32,
    timeout: float | None = None,
) -> IKResult:
    """Find joint positions that fulfil tasks, or come closest.

    Minimises sum_i s_i^2 |r_i(q)|^2 within the joint limits by damped Gauss-Newton steps, each the solution
    of a quadratic programme, first from q0 and then from further starts; see `Problem`.  Of several solutions
    it prefers one that touches nothing (with a scene), that the motors can hold, and that is near q0.
    Where not all tasks can be met, hard ones come first, then positions before their orientations; see
    `precedence`.  The same arguments give the same result, unless a timeout cuts in.

    Args:
        pepper: The robot.
        tasks: What to fulfil, such as `HandPosition` and `LookAt`.
        q0: Where to start and what to stay near [rad or m], shape (n,); `pepper.neutral()` if None.
        solver: "fast", "placo" or "proxsuite".
        scene: What to keep clear of, itself included; `Scene()` for itself alone; None for nothing.
        seed: Draws the restarts.
        joints: A joint group's name, or names of the joints that may move; the others keep q0. None for all.
        max_iterations: Steps from each start.
        restarts: Further starts, used only as long as there is something to gain.  With a scene, "fast" may
            look through more of them for a solution that touches nothing.
        timeout: Time after which to stop [s]; None for none.

    Returns:
        The result; `result.status` says whether the tasks are met and, if not, what is in the way.

    Raises:
        InvalidValueError: for no task, an unknown solver, or numbers that are none, NaN or infinite.
        UnknownNameError: for a frame, joint or group that the robot lacks.
        LimitError: for a q0 outside the joint limits.
    """
    check_choice("solver", solver, ALL_SOLVERS)
    if solver == "fast":
        _fast()  # compiled once on a machine: that is no time of the search, nor counts against a timeout
    begin = time.perf_counter()
    parts = tuple(flatten_tasks(pepper, tasks))
    start = checked_start(pepper, q0)
    movable = None if joints is None else movable_joints(pepper, joints)
    check_scene(scene)
    budget = _checked_budget(seed, restarts, max_iterations, timeout, begin)
    request = Request(pepper, balanced(parts), start, movable, scene, budget)
    found = _find_at_once(request) if solver == "fast" else None
    if found is None:
        found = _find(request, solver)
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
        evidence=Evidence(pepper, parts, start, movable, scene, found.q).certificate,
        hint=hint,
    )


class Request(NamedTuple):
    """What `solve` was asked for, checked.

    Attributes:
        pepper: The robot.
        tasks: The tasks, groups taken apart, their weights balanced.
        q0: The start, within the limits, shape (n,).
        movable: Joints that may move, shape (n,); None for all.
        scene: The scene, or None.
        budget: How much the search may spend.
    """

    pepper: PepperModel
    tasks: tuple[Task, ...]
    q0: Array
    movable: np.ndarray | None
    scene: Scene | None
    budget: Budget

    def problem(self, *, whole: bool = False) -> Problem:
        """Return the problem; with `whole` every joint may move."""
        movable = self.movable
        if whole or movable is None:
            movable = np.ones(self.pepper.n, dtype=bool)
        return make_problem(self.pepper, self.tasks, self.q0, movable, keep_idle=whole or self.scene is None)


def _find_at_once(request: Request) -> Found | None:
    """Search in machine code from end to end; None where collisions or the clock ask for the other search."""
    fast = _fast()
    pepper, budget = request.pepper, request.budget
    prepared = fast.prepare(pepper, fast.structures_of(request.tasks))
    if budget.deadline < math.inf and (
        budget.deadline - time.perf_counter() < LEAST_TIME
        or budget.max_iterations * (budget.restarts + 1) > MOST_STEPS
    ):
        return None
    answer = fast.solve_one(
        prepared, request.tasks, request.q0, request.movable, budget.seed, budget.restarts,
        budget.max_iterations,
    )  # fmt: skip
    if request.scene is None:
        return answer
    collisions = Collisions(pepper, request.scene)
    if collisions.free(answer.q):
        return answer
    if answer.status is Status.SOLVED:
        from pepper_kin.ik.clear import find_clear

        clear = find_clear(request.tasks, request.q0, request.movable, collisions, budget)
        if clear is not None:
            q, spent = clear
            return Found(read_only(q), Status.SOLVED, answer.iterations, answer.restarts + spent)
    return None


@lru_cache(maxsize=1)
def _fast() -> ModuleType:
    """Return the room of the fast solver, loaded when first used: its code may have to be compiled."""
    return import_module("pepper_kin.ik.fast")


def _find(request: Request, solver: str) -> Found:
    """Search start by start, with an eye on collisions and the clock."""
    problem, budget = request.problem(), request.budget
    collisions = Collisions(request.pepper, request.scene)
    found = search(problem, make_descender(solver, problem), collisions, budget)
    status = find_status(problem, found, solver, budget)
    return Found(read_only(found.best.q), status, found.iterations, found.restarts)


def _in_order(request: Request, solver: str, found: Found) -> Found:
    """Meet better what comes first."""
    problem, collisions = request.problem(), Collisions(request.pepper, request.scene)
    q = put_first(problem, Means(solver, collisions, request.budget), found.q)
    met = problem.is_met(problem.residuals(q)) and collisions.free(q)
    return found._replace(q=read_only(q), status=Status.SOLVED if met else found.status)


def _hint(status: Status, request: Request, solver: str) -> str:
    if status is Status.TIMED_OUT:
        return why_beyond_reach(request.problem())
    freed = request.movable is None or request.movable.all()
    if freed or status not in (Status.CLOSEST_LIMITS, Status.CLOSEST_UNREACHABLE):
        return ""
    joints = what_would_help(request.problem(), request.problem(whole=True), solver, request.budget)
    return f"with {joints} free it would be reached" if joints else ""


def _checked_budget(
    seed: int, restarts: int, max_iterations: int, timeout: float | None, begin: float
) -> Budget:
    return Budget(
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


def check_scene(scene: object) -> None:
    """Refuse what is no scene.

    Raises:
        InvalidValueError: unless it is a Scene or None.
    """
    if scene is None:
        return
    from pepper_kin.collision import Scene

    if not isinstance(scene, Scene):
        raise InvalidValueError("scene", repr(scene)[:80], "a Scene, or None to leave collisions out")


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
