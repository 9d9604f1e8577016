"""Inverse kinematics of one problem: from tasks to the best configuration and its certificate."""

from __future__ import annotations

import math
import operator
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, read_only
from pepper_kin.collision.checked_world import checked_world
from pepper_kin.collision.loads import loads_of
from pepper_kin.core.collision.layout import WIDEST
from pepper_kin.core.inverse_kinematics.multi_start import solve_rows
from pepper_kin.dynamics.support_polygon import checked_balance
from pepper_kin.exceptions import InvalidValueError, suspect_millimeters
from pepper_kin.ik.certificate import CertificateInputs
from pepper_kin.ik.closest import closest
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast.compiled_tasks import compiled_tasks
from pepper_kin.ik.fast.search import search_compiled
from pepper_kin.ik.obstruction import (
    what_contradicts,
    what_is_in_the_way,
    what_would_help,
)
from pepper_kin.ik.priorities import (
    SolverContext,
    balanced,
    equally_weighted,
    has_priorities,
    is_ordered,
    solve_with_priorities,
)
from pepper_kin.ik.problem import (
    OUT_OF_THE_WAY,
    SearchBudget,
    TaskProblem,
    flatten_tasks,
    joints_used,
    make_problem,
    movable_joints,
)
from pepper_kin.ik.reach_bound import why_beyond_reach
from pepper_kin.ik.result import IKResult, IKStatus, SearchResult
from pepper_kin.ik.solvers import chosen_solver, make_solver
from pepper_kin.ik.standing import holds, rests, stands, tasks_at_rest
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.expression import Expression
from pepper_kin.ik.tasks.holding_torque import HoldingTorque
from pepper_kin.ik.tasks.joint_posture import JointPosture
from pepper_kin.ik.tasks.task import PointTask, Task, TaskGroup
from pepper_kin.kernels.working_time import not_counted, working_time
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_joint_vector,
    check_positive,
    check_seed,
    check_whole,
    check_within_limits,
    full_turns,
)
from pepper_kin.model.requirements import Balance

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

STARTS_AT_REST = 8
"""Maximum number of further starts for a posture that the robot can hold at rest: of 122 among 1,000 random
solutions that it cannot hold, 71 are replaced with 8 starts, 72 with 32 in twice the time."""

_neutrals: WeakKeyDictionary[PepperModel, Array] = WeakKeyDictionary()


def solve(
    pepper: PepperModel,
    tasks: Task | TaskGroup | Iterable[Task | TaskGroup],
    start: ArrayLike | None = None,
    *,
    solver: str = "robot",
    scene: Scene | None = None,
    collisions: bool = True,
    margin: float = 0.0,
    balance: Balance = "robot",
    payload: Mapping[str, float] | None = None,
    seed: int = 0,
    joints: str | Sequence[str] | None = None,
    max_iterations: int = 150,
    restarts: int = 32,
    timeout: float | None = None,
) -> IKResult:
    """Find joint positions that fulfill tasks, or come closest.

    Minimizes sum_i s_i^2 |r_i(q)|^2 within the joint limits by damped Gauss-Newton steps, each the solution
    of a quadratic program, first from `start` and then from further starts; see `TaskProblem`. Among several
    solutions it prefers one that is free of collisions, that the motors can hold, in which the robot is in
    balance, and that is near the start. If not all tasks can be met, hard ones have priority, then positions
    over their orientations; see `priorities`. Only ratios of weights matter: they say which task counts more
    where tasks compete, and do not decide whether all can be met. The same arguments give the same result,
    unless the timeout is reached.

    Args:
        pepper: The robot.
        tasks: Tasks to fulfill, such as `HandPosition` and `LookAt`.
        start: Joint positions where the search begins and to which the solution is near [rad or m], shape
            (n,); `pepper.neutral()` if None.
        solver: "fast", "placo" or "proxsuite"; "robot" for the robot's `solvers`, "fast" by default.
        scene: Obstacles around the robot; None for none. Self-collision is checked with or without a scene.
            The masses of attached objects count for holding torques and the center of mass.
        collisions: Whether collisions are checked; the result says if they are not.
        margin: Minimum distance to the scene [m]; between the robot's links none is kept.
        balance: Minimum distance of the center of mass from the edges of the wheels' triangle [m], to which
            `ROOM_TO_MOVE` is added, as in `plan`; "robot" for the balance of `pepper.requirements`; None for
            no balance constraint. If no such posture is found, another is returned, and the report says so.
        payload: Point masses at "left", "right" or a frame by name [kg], in addition to attached objects.
        seed: Seed of the restarts.
        joints: Joints that may move, by names of joints and groups, such as `["right_arm", "head"]`; the
            others keep their positions. None for all.
        max_iterations: Maximum number of steps from each start.
        restarts: Maximum number of further starts, which are used only while they can improve the result.
            "fast" may use more of them for a collision-free solution.
        timeout: Maximum duration of the search [s]; None for no limit.

    Returns:
        The result; `result.status` says whether the tasks are met and, if not, why.

    Raises:
        InvalidValueError: for no task, an unknown solver, or numbers that are malformed, NaN or infinite.
        UnknownNameError: for a frame, joint or group that the robot lacks.
        LimitError: for a start outside the joint limits.
        MissingDependencyError: for "proxsuite" where its library cannot be loaded.
    """
    solver = chosen_solver(pepper, solver)
    world, apart = checked_scene(scene, collisions, margin)
    around = Collisions(pepper, world, apart, loads_of(pepper, world, payload))
    parts = tuple(with_loads(flatten_tasks(pepper, tasks), around.loads))
    q0, kept = checked_start(pepper, start), checked_balance(pepper, balance)
    turns = turns_left_out(pepper, parts, q0)
    q0 = q0 - turns
    tasks_to_solve = balanced(parts)
    if solver == "fast":
        load_search(pepper, tasks_to_solve, around)  # loading or compiling does not count as solving time
    begin = working_time()
    movable = None if joints is None else movable_joints(pepper, joints)
    budget = _checked_budget(seed, restarts, max_iterations, timeout, begin)
    request = Request(pepper, tasks_to_solve, q0, movable, around, budget)
    found = _search(request, solver)
    conflict: tuple[str, ...] = ()
    hint = ""
    if found.status is not IKStatus.SOLVED:
        found = search_on(request, solver, found)
        conflict, hint = reasons(found.status, request, solver)
    if found.status is IKStatus.SOLVED:
        found = found if world is None else with_idle_at_rest(request, solver, found)
        if not rests(pepper, found.q, kept, around.loads):
            found = at_rest(request, solver, found, kept)
    return IKResult(
        status=found.status,
        q=read_only(found.q + turns),
        iterations=found.iterations,
        restarts=found.restarts,
        time=working_time() - begin,
        solver=solver,
        seed=budget.seed,
        evidence=CertificateInputs(
            pepper, parts, q0 + turns, movable, world, found.q + turns, kept, around.loads
        ).certificate,
        hint=hint,
        conflict=conflict,
    )


def load_search(pepper: PepperModel, parts: Sequence[Task], around: Collisions) -> None:
    """Load or compile the fast solver's code and prepare the scene, before the search is timed."""
    ready = compiled_tasks(pepper, parts)
    if ready.spare:  # an earlier search has loaded all code
        return
    buffers = ready.buffers()
    around.tests(buffers.signals)
    _ = solve_rows.native
    ready.spare.append(buffers)


def _with_idle_held(request: Request, solver: str) -> Request:
    """Return the request with joints that none of its tasks depends on fixed."""
    if solver == "fast":
        used = np.zeros(request.pepper.n, bool)
        used[compiled_tasks(request.pepper, request.tasks).index] = True
    else:
        used = joints_used(request.pepper, request.tasks)
    movable = used if request.movable is None else used & request.movable
    return request._replace(movable=movable, budget=request.budget._replace(closest=False))


def with_idle_at_rest(request: Request, solver: str, found: SearchResult) -> SearchResult:
    """Return a solution with idle joints fixed, if the given one moves them far and another is found."""
    held = _with_idle_held(request, solver)
    if not ((np.abs(found.q - request.q0) > OUT_OF_THE_WAY) & ~held.movable).any():  # type: ignore[operator]
        return found
    return _after(found, _search(held, solver))


def _after(found: SearchResult, other: SearchResult) -> SearchResult:
    """Return the other result if it is solved, else the first, with the steps of both."""
    met = other if other.status is IKStatus.SOLVED else found
    return met._replace(
        iterations=found.iterations + other.iterations, restarts=found.restarts + other.restarts
    )


def at_rest(request: Request, solver: str, found: SearchResult, balance: float | None) -> SearchResult:
    """Return a solution that the robot can hold at rest instead of one that it cannot, if one is found.

    If none is both held by the motors and in balance, one in balance is returned if found.

    Args:
        request: The checked request.
        solver: Name of the solver.
        found: The solution found so far.
        balance: Distance to keep from the edges of the wheels' triangle [m]; None for none.
    """
    pepper, loads = request.pepper, request.collisions.loads
    wanted = tasks_at_rest(pepper, balance, loads)
    upright = [task for task in wanted if not isinstance(task, HoldingTorque)]
    choices = []
    if len(wanted) > len(upright) and holds(pepper, request.q0, loads):  # else maybe no posture can be held
        choices.append(wanted)
    if upright and not stands(pepper, found.q, float(balance or 0.0), loads):
        choices.append(upright)
    for more in choices:
        tasks = equally_weighted((*request.tasks, *flatten_tasks(pepper, more)))
        if solver == "fast":
            with not_counted():
                load_search(pepper, tasks, request.collisions)
        budget = request.budget
        budget = budget._replace(closest=False, restarts=min(STARTS_AT_REST, budget.restarts))
        for one in (_with_idle_held(request, solver), request):
            other = _search(one._replace(tasks=tasks, budget=budget), solver)
            found = _after(found, other)
            if other.status is IKStatus.SOLVED:
                return found
    return found


class Request(NamedTuple):
    """Checked arguments of `solve`.

    Attributes:
        pepper: The robot.
        tasks: The tasks, groups split into their parts, with balanced weights.
        q0: Start within the limits, shape (n,) [rad or m].
        movable: Joints that may move, shape (n,); None for all.
        collisions: Collision checks.
        budget: Limits of the search.
    """

    pepper: PepperModel
    tasks: tuple[Task, ...]
    q0: Array
    movable: np.ndarray | None
    collisions: Collisions
    budget: SearchBudget

    def problem(self, *, whole: bool = False) -> TaskProblem:
        """Return the problem; with `whole` every joint may move."""
        movable = self.movable
        if whole or movable is None:
            movable = np.ones(self.pepper.n, dtype=bool)
        return make_problem(
            self.pepper, self.tasks, self.q0, movable, keep_idle=whole or self.collisions.scene is None
        )


def _search(request: Request, solver: str) -> SearchResult:
    """Search from the start and further starts."""
    pepper, collisions, budget = request.pepper, request.collisions, request.budget
    if solver == "fast":
        return search_compiled(pepper, request.tasks, request.q0, request.movable, budget, collisions)
    return make_solver(solver, request.problem()).search(collisions, budget)


DONE = (IKStatus.SOLVED, IKStatus.TIMED_OUT)
"""Statuses that end the search."""

PROOFS = (IKStatus.SOLVED, IKStatus.CLOSEST_COLLISION, IKStatus.CLOSEST_LIMITS)
"""Statuses shown by a configuration, in order of preference."""


def search_on(request: Request, solver: str, found: SearchResult) -> SearchResult:
    """Return the result of a continued search after one that has not met the tasks.

    First, tasks of priority are met better. Then the search is repeated with equal weights, since whether
    tasks can be met together does not depend on weights. If they are still not met, the result with the given
    weights is kept, and improved from further starts.
    """
    if found.status in DONE:
        return found
    ordered = is_ordered(request.tasks)
    if ordered:
        found = _in_order(request, solver, found)
    equal = equally_weighted(request.tasks)
    if found.status in DONE or all(map(operator.is_, equal, request.tasks)):
        return found
    equally = request._replace(tasks=equal)
    other = _search(equally, solver)
    if ordered and other.status not in DONE:
        other = _in_order(equally, solver, other)
    if other.status not in DONE and solver == "fast" and not has_priorities(request.tasks):
        found = _closer(request, found)
        if found.status is IKStatus.SOLVED:
            return found
    kept = other if other.status is IKStatus.SOLVED else found
    statuses = (found.status, other.status)
    status = next((s for s in PROOFS if s in statuses), other.status)
    return SearchResult(
        kept.q, status, found.iterations + other.iterations, found.restarts + other.restarts + 1
    )


def _closer(request: Request, found: SearchResult) -> SearchResult:
    """Return a closer configuration for tasks of different weights, from further starts."""
    finite = {task.weight for task in request.tasks if math.isfinite(task.tolerance)}
    if len(finite) < 2 or not request.budget.closest:
        return found
    return _moved(request, found, closest(request.problem(), request.collisions, request.budget, found.q))


def _in_order(request: Request, solver: str, found: SearchResult) -> SearchResult:
    """Return a result that meets the tasks of priority better."""
    context = SolverContext(solver, request.collisions, request.budget)
    return _moved(request, found, solve_with_priorities(request.problem(), context, found.q))


def _moved(request: Request, found: SearchResult, q: Array) -> SearchResult:
    """Return a result with another configuration q [rad or m], shape (n,)."""
    problem = request.problem()
    met = problem.is_met(problem.residuals(q)) and request.collisions.free(q)
    return found._replace(q=read_only(q), status=IKStatus.SOLVED if met else found.status)


def reasons(status: IKStatus, request: Request, solver: str) -> tuple[tuple[str, ...], str]:
    """Return the conflicting tasks and the hint that explain a failure; both may be empty."""
    return _conflict(status, request, solver), _hint(status, request, solver)


def _conflict(status: IKStatus, request: Request, solver: str) -> tuple[str, ...]:
    """Return the names of tasks that contradict each other, if that is the reason of the failure."""
    if status not in (IKStatus.CLOSEST_LIMITS, IKStatus.CLOSEST_UNREACHABLE) or len(request.tasks) < 2:
        return ()
    return what_contradicts(request.problem(), solver, request.budget)


def _hint(status: IKStatus, request: Request, solver: str) -> str:
    """Return a clause that explains a failure; may be empty."""
    if status is IKStatus.TIMED_OUT:
        return why_beyond_reach(request.problem())
    if status is IKStatus.CLOSEST_COLLISION:
        return what_is_in_the_way(request.problem(), request.collisions, request.budget)
    targets = [task.target for task in request.tasks if isinstance(task, PointTask)]
    if question := suspect_millimeters(max((np.abs(target).max() for target in targets), default=0.0)):
        return question
    freed = request.movable is None or request.movable.all()
    if freed or status not in (IKStatus.CLOSEST_LIMITS, IKStatus.CLOSEST_UNREACHABLE):
        return ""
    joints = what_would_help(request.problem(), request.problem(whole=True), solver, request.budget)
    return f"with {joints} free it would be reached" if joints else ""


def _checked_budget(
    seed: int, restarts: int, max_iterations: int, timeout: float | None, begin: float
) -> SearchBudget:
    """Return the limits of a search from checked arguments; `begin` is its start time [s]."""
    return SearchBudget(
        seed=check_seed(seed),
        restarts=check_whole("restarts", restarts, 0),
        max_iterations=check_whole("max_iterations", max_iterations, 1),
        deadline=math.inf if timeout is None else begin + check_positive("timeout", timeout, "s"),
    )


def checked_start(pepper: PepperModel, start: ArrayLike | None) -> Array:
    """Return the start of a search, within the limits, shape (n,) [rad or m].

    Args:
        pepper: The robot.
        start: Joint positions [rad or m], shape (n,); None for `pepper.neutral()`.

    Raises:
        InvalidValueError: for a start of wrong shape, or with NaN or infinity.
        LimitError: for a start outside the joint limits.
    """
    if start is None:
        return _neutral(pepper)
    if isinstance(start, np.ndarray) and start.dtype == np.float64 and start.shape == (pepper.n,):
        plain: Array = start
        if bool(((pepper.lower_limits <= plain) & (plain <= pepper.upper_limits)).all()):
            return plain.copy()
    q0 = as_joint_vector(pepper, start, "start")
    check_within_limits(pepper, q0, "start")
    return np.clip(q0, pepper.lower_limits, pepper.upper_limits)


def turns_left_out(pepper: PepperModel, parts: Sequence[Task], q0: Array) -> Array:
    """Return the full turns of joints without limits to subtract from starts [rad], shape of q0.

    The collision check is precise for some turns only, since it uses single precision. Turns count for tasks
    on joint positions: joints of posture tasks keep their turns, and so do all joints if a task is an
    expression.

    Args:
        pepper: The robot.
        parts: The tasks, groups split into their parts.
        q0: Starts, shape (..., n) [rad or m].
    """
    if np.abs(q0).max(initial=0.0) <= WIDEST / 2 or any(isinstance(task, Expression) for task in parts):
        return np.zeros_like(q0)
    turns = full_turns(pepper, q0)
    turns[np.abs(q0) <= WIDEST / 2] = 0.0
    for task in parts:
        if isinstance(task, JointPosture):
            turns[..., task.indices(pepper)] = 0.0
    return turns


def _neutral(pepper: PepperModel) -> Array:
    """Return the neutral posture [rad or m], shape (n,), cached for each robot."""
    found = _neutrals.get(pepper)
    if found is None:
        found = _neutrals[pepper] = read_only(pepper.neutral())
    return found


def checked_scene(scene: Scene | None, collisions: bool, margin: float) -> tuple[Scene | None, float]:
    """Return the scene of the collision checks, None without checks, and the margin [m].

    Raises:
        InvalidValueError: for anything but a scene, as in `checked_world`, or a margin that is not a finite
            number of 0 or more, 0 without collision checks.
    """
    world = checked_world(scene, collisions)
    if margin == 0:
        return world, 0.0
    if world is None:
        raise InvalidValueError("margin", margin, "0 where collisions are left out")
    return world, check_positive("margin", margin, "m")
