"""Inverse kinematics for many targets at once."""

from __future__ import annotations

import math
import operator
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.collision.loads import loads_of
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.support_polygon import checked_balance
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.certificate import CertificateInputs
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast.search import BatchSearch, solutions_from
from pepper_kin.ik.nearby import nearby, resting_of
from pepper_kin.ik.priorities import balanced, equally_weighted, is_ordered
from pepper_kin.ik.problem import SearchBudget, flatten_tasks, movable_joints
from pepper_kin.ik.reach_bound import shortfalls
from pepper_kin.ik.result import NOT_EXAMINED, IKResult, IKStatus, SearchResult
from pepper_kin.ik.solve import (
    DONE,
    Request,
    at_rest,
    checked_scene,
    load_search,
    reasons,
    search_on,
    solve,
    turns_left_out,
)
from pepper_kin.ik.solvers import chosen_solver
from pepper_kin.ik.standing import rests
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.frame_position import FramePosition
from pepper_kin.ik.tasks.structure import known_structures
from pepper_kin.ik.tasks.task import Task, TaskGroup, words_for_length
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_joint_vectors,
    check_seed,
    check_whole,
    check_within_limits,
)
from pepper_kin.model.requirements import Balance

if TYPE_CHECKING:
    from pepper_kin.collision import Scene

# Number of rows that a thread solves at a time.
CHUNK = 512

Arrays: TypeAlias = tuple[Array, np.ndarray, Array, np.ndarray, np.ndarray]

CODES = tuple(IKStatus)
"""Status of each code in `BatchResult.codes`."""

_REASONS = {
    IKStatus.CLOSEST_UNREACHABLE: "no posture was found that reaches it, even without joint limits",
    IKStatus.CLOSEST_LIMITS: "only postures beyond the joint limits were found that reach it",
    IKStatus.CLOSEST_COLLISION: "only postures that touch something were found that reach it",
    IKStatus.TIMED_OUT: "time ran out",
}


@dataclass(frozen=True, eq=False)
class BatchResult(FrozenArrays):
    """Configurations found for N sets of targets; arrays are read-only.

    Attributes:
        q: Joint positions within all limits [rad or m], shape (N, n).
        codes: Status of each row, as an index of `ik.batch.CODES`; 0 is solved, shape (N,).
        errors: Error of each task [m or rad], groups split into their parts, shape (N, tasks).
        iterations: Number of steps over all starts, shape (N,).
        restarts: Number of starts used after the first, shape (N,).
        time: Wall-clock time of the call [s].
        solver: Name of the solver.
        seed: Seed of the restarts.
    """

    q: Array
    codes: np.ndarray
    errors: Array
    iterations: np.ndarray
    restarts: np.ndarray
    time: float
    solver: str
    seed: int
    _pepper: PepperModel = field(repr=False)
    _tasks: tuple[Task, ...] = field(repr=False)
    _starts: Array = field(repr=False)
    _movable: np.ndarray | None = field(repr=False)
    _scene: Scene | None = field(repr=False)
    _margin: float = field(repr=False)
    _budget: SearchBudget = field(repr=False)
    _balance: float | None = field(repr=False)
    _loads: Loads = field(repr=False)

    def __len__(self) -> int:
        """Return N."""
        return len(self.q)

    @property
    def success(self) -> np.ndarray:
        """Whether every task is met, shape (N,)."""
        return self.codes == CODES.index(IKStatus.SOLVED)

    @property
    def hard_met(self) -> np.ndarray:
        """Whether every hard task is met, shape (N,); True without hard tasks."""
        hard = [k for k, task in enumerate(self._tasks) if task.hard]
        limits = np.array([self._tasks[k].tolerance for k in hard])
        return np.asarray(np.all(self.errors[:, hard] <= limits, axis=1))

    @cached_property
    def shortfalls(self) -> Array:
        """Lower bound of each task's error over all postures within the limits [m], shape (N, tasks).

        The bound is proven, see `pepper_kin.ik.reach_bound`. It is 0 for targets within the convex hull of
        the points that a frame reaches, and for all tasks that are not on positions.
        """
        return read_only(shortfalls(self._pepper, self._tasks, self._starts, self._movable))

    def reason(self, row: int) -> str:
        """Return the reason why a row is not solved, as a clause; empty for a solved row."""
        status = self.status(row)
        if status is IKStatus.SOLVED:
            return ""
        beyond = self.shortfalls[row] - [task.tolerance for task in self._tasks]
        worst = int(np.argmax(beyond))
        if beyond[worst] > 0:
            missing = words_for_length(self.shortfalls[row, worst])
            return f"{self._tasks[worst].label} is out of reach by {missing} at least"
        return _REASONS[status]

    def status(self, row: int) -> IKStatus:
        """Return the status of one row."""
        return CODES[int(self.codes[row])]

    def result(self, row: int) -> IKResult:
        """Return one row as an `IKResult`, with a certificate computed from q; `time` is the whole call's.

        For a row that is not solved, the reason is searched first, in about a tenth of a second.
        """
        tasks = tuple(task.at(row) for task in self._tasks)
        q, status, start = read_only(self.q[row]), self.status(row), self._starts[row]
        world = Collisions(self._pepper, self._scene, self._margin, self._loads)
        request = Request(self._pepper, balanced(tasks), start, self._movable, world, self._budget)
        conflict, hint = reasons(status, request, self.solver)
        return IKResult(
            status=status,
            q=q,
            iterations=int(self.iterations[row]),
            restarts=int(self.restarts[row]),
            time=self.time,
            solver=self.solver,
            seed=self.seed,
            evidence=CertificateInputs(
                self._pepper, tasks, start, self._movable, self._scene, q, self._balance, self._loads
            ).certificate,
            hint=hint,
            conflict=conflict,
        )

    def report(self) -> str:
        """Return the number of rows per status, as text."""
        counts = {status: int(np.sum(self.codes == k)) for k, status in enumerate(CODES)}
        ends = ", ".join(f"{count} {status.value}" for status, count in counts.items() if count)
        proven = int(np.sum(_out_of_reach(self.shortfalls, self._tasks)))
        if proven:
            ends += f" ({proven} of them proven out of reach)"
        if any(task.hard for task in self._tasks):
            ends += f"; hard tasks met in {int(self.hard_met.sum())}"
        if self._scene is None:
            ends += f"; {NOT_EXAMINED}"
        rate = len(self) / self.time if self.time > 0 else math.inf
        return f"{len(self)} targets: {ends}; {self.time:.2f} s, {rate:.0f} a second ({self.solver})"


def solve_batch(
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
    threads: int = 1,
    progress: Callable[[int, int], None] | None = None,
    closest: bool = True,
) -> BatchResult:
    """Find joint positions for N sets of targets, each row as `solve` does.

    Tasks take N targets in place of one: `HandPosition("left", points)` with points of shape (N, 3).  Every
    row is searched as by `solve` with the same seed, so a result depends neither on other rows nor on the
    number of threads.

    A row that cannot be solved takes a hundred times as long as others, nearly all of it for the closest
    configuration. For datasets, which need the reason only, `closest=False` omits that search: rows whose
    target is proven out of reach (`BatchResult.shortfalls`) end after one descent, and rows that are met only
    in collision end after one round among obstacles instead of twelve, and a search from postures with the
    hand near its target. Solutions that need no longer search are the same; nearly all others are found.

    Args:
        pepper: The robot.
        tasks: Tasks with N targets, or with one target for all rows.
        start: Joint positions where searches begin and to which solutions are near [rad or m], shape (n,) or
            (N, n); None for `pepper.neutral()`.
        solver: "fast", "placo" or "proxsuite"; "robot" for the robot's `solvers`, "fast" by default.
        scene: Obstacles around the robot; None for none. Self-collision is checked with or without a scene.
        collisions: Whether collisions are checked; the result says if they are not.
        margin: Minimum distance to the scene [m].
        balance: Minimum distance of the center of mass from the edges of the wheels' triangle [m], see
            `solve`.
        payload: Point masses at "left", "right" or a frame by name [kg], see `solve`.
        seed: Seed of the restarts.
        joints: Joints that may move, by names of joints and groups; None for all.
        max_iterations: Maximum number of steps from each start.
        restarts: Maximum number of further starts.
        threads: Number of threads that share the rows; solvers other than "fast" use one.
        progress: Function that is called with the number of finished rows and N, from the calling thread.
        closest: Whether rows that are not solved end as close to their targets as by `solve`; False for any
            configuration clear of collisions, which may be the start. For "fast" only.

    Returns:
        Results of all rows, as arrays.

    Raises:
        InvalidValueError: for no task, an unknown solver, numbers that are malformed, NaN or infinite,
            different numbers of targets, or no task with several targets.
        UnknownNameError: for a frame, joint or group that the robot lacks.
        LimitError: for a start outside the joint limits.
        MissingDependencyError: for "proxsuite" where its library cannot be loaded.
    """
    solver = chosen_solver(pepper, solver)
    around, apart = checked_scene(scene, collisions, margin)
    world = Collisions(pepper, around, apart, loads_of(pepper, around, payload))
    parts = tuple(with_loads(flatten_tasks(pepper, tasks, batch=True), world.loads))
    q0 = pepper.neutral() if start is None else as_joint_vectors(pepper, start, "start")
    check_within_limits(pepper, q0, "start")
    count = _count(parts, q0)
    starts = np.broadcast_to(np.clip(q0, pepper.lower_limits, pepper.upper_limits), (count, pepper.n))
    turns = turns_left_out(pepper, parts, starts)
    starts = starts - turns
    movable = None if joints is None else movable_joints(pepper, joints)
    kept = checked_balance(pepper, balance)
    check_seed(seed)
    check_whole("restarts", restarts, 0)
    check_whole("max_iterations", max_iterations, 1)
    check_whole("threads", threads, 1)
    options: dict[str, Any] = {"seed": seed, "restarts": restarts, "max_iterations": max_iterations}
    budget = SearchBudget(deadline=math.inf, closest=bool(closest), **options)
    compiled = solver == "fast" and known_structures(parts) is not None
    if compiled:
        load_search(pepper, balanced(parts), world)
    begin = time.perf_counter()
    if compiled:
        arrays = _solve_fast(world, parts, starts, movable, budget, threads, progress)
        _rest(world, balanced(parts), starts, movable, budget, arrays, kept)
    else:
        options |= {
            "solver": solver,
            "joints": joints,
            "scene": scene,
            "collisions": collisions,
            "margin": margin,
            "balance": balance,
            "payload": payload,
        }
        arrays = _solve_each(pepper, parts, starts, options, progress)
    arrays = (arrays[0] + turns, *arrays[1:])
    for array in arrays:
        array.setflags(write=False)
    duration = time.perf_counter() - begin
    return BatchResult(
        *arrays,
        duration,
        solver,
        seed,
        pepper,
        parts,
        starts + turns,
        movable,
        world.scene,
        world.margin,
        budget,
        kept,
        world.loads,
    )


def _solve_fast(
    world: Collisions,
    tasks: tuple[Task, ...],
    starts: Array,
    movable: np.ndarray | None,
    budget: SearchBudget,
    threads: int,
    progress: Callable[[int, int], None] | None,
) -> Arrays:
    """Solve all rows in machine code, from starts [rad or m], shape (N, n); `movable` has shape (n,)."""
    tasks, pepper, hopeless = balanced(tasks), world.pepper, np.zeros(len(starts), dtype=bool)
    if not budget.closest and not is_ordered(tasks):  # with priorities, tasks that are met still count
        hopeless = _out_of_reach(shortfalls(pepper, tasks, starts, movable), tasks)
    rows = BatchSearch(pepper, tasks, starts, movable, budget, around=world, hopeless=hopeless)
    _share_out(rows.solve, len(starts), threads, progress)
    q, numbers, errors, iterations, restarts = rows.answers()
    codes = np.array([CODES.index(status) for status in rows.statuses], dtype=np.int8)[numbers]
    answers = q, codes, errors, iterations, restarts
    if not budget.closest:
        _try_nearby(world, tasks, starts, movable, budget, answers)
    if is_ordered(tasks) or not all(map(operator.is_, equally_weighted(tasks), tasks)):
        for row in np.flatnonzero(~np.isin(codes, [CODES.index(status) for status in DONE]) & ~hopeless):
            ones = tuple(task.at(int(row)) for task in tasks)
            _search_on(Request(world.pepper, ones, starts[row], movable, world, budget), int(row), answers)
    return answers


def _out_of_reach(missing: Array, tasks: Sequence[Task]) -> np.ndarray:
    """Whether lower bounds of errors, shape (N, tasks), prove that rows are not solved, shape (N,)."""
    proven: np.ndarray = np.any(missing > np.array([task.tolerance for task in tasks]), axis=1)
    return proven


def _try_nearby(
    world: Collisions,
    tasks: tuple[Task, ...],
    starts: Array,
    movable: np.ndarray | None,
    budget: SearchBudget,
    answers: Arrays,
) -> None:
    """Solve rows that are met only in collision from postures that have the frame near its target.

    Solutions are written into `answers`; the other arguments are as in `_solve_fast`.
    """
    q, codes, errors, _, restarts = answers
    rows = np.flatnonzero(codes == CODES.index(IKStatus.CLOSEST_COLLISION))
    place = next((k for k, task in enumerate(tasks) if isinstance(task, FramePosition)), None)
    if not rows.size or place is None:
        return
    pepper, frame, rest = world.pepper, tasks[place].frame, resting_of(world.pepper, starts, movable)
    if rest is None or frame is None:
        return
    near = nearby(pepper, frame, *rest)
    for row in rows:
        ones = tuple(task.at(int(row)) for task in tasks)
        tried = near.starts(ones[place].target)  # type: ignore[attr-defined]
        found = solutions_from(
            pepper,
            ones,
            starts[row],
            movable,
            tried,
            budget.max_iterations,
            around=world,
        )
        restarts[row] += len(tried)
        if found:
            q[row], codes[row] = found[0], CODES.index(IKStatus.SOLVED)
            errors[row] = [task.error(pepper, found[0]) for task in ones]


def _search_on(request: Request, row: int, answers: Arrays) -> None:
    """Continue the search of one row, as `solve` does, and write the result into `answers`."""
    q, codes, errors, iterations, restarts = answers
    before = SearchResult(q[row].copy(), CODES[int(codes[row])], int(iterations[row]), int(restarts[row]))
    found = search_on(request, "fast", before)
    q[row], codes[row] = found.q, CODES.index(found.status)
    iterations[row], restarts[row] = found.iterations, found.restarts
    errors[row] = [task.error(request.pepper, found.q) for task in request.tasks]


def _rest(
    world: Collisions,
    tasks: tuple[Task, ...],
    starts: Array,
    movable: np.ndarray | None,
    budget: SearchBudget,
    answers: Arrays,
    balance: float | None,
) -> None:
    """Solve rows again whose solution the robot cannot hold at rest, as `solve` does.

    Solutions are written into `answers`; the other arguments are as in `_solve_fast`.
    """
    q, codes, errors, iterations, restarts = answers
    solved = np.flatnonzero(codes == CODES.index(IKStatus.SOLVED))
    for row in solved[~rests(world.pepper, q[solved], balance, world.loads)]:
        ones = tuple(task.at(int(row)) for task in tasks)
        request = Request(world.pepper, ones, starts[row], movable, world, budget)
        before = SearchResult(q[row].copy(), IKStatus.SOLVED, int(iterations[row]), int(restarts[row]))
        found = at_rest(request, "fast", before, balance)
        q[row], iterations[row], restarts[row] = found.q, found.iterations, found.restarts
        errors[row] = [task.error(world.pepper, found.q) for task in ones]


def _solve_each(
    pepper: PepperModel,
    tasks: tuple[Task, ...],
    starts: Array,
    options: dict[str, Any],
    progress: Callable[[int, int], None] | None,
) -> Arrays:
    """Call `solve` for each row of starts [rad or m], shape (N, n)."""
    results = []
    for i, start in enumerate(starts):
        results.append(solve(pepper, [task.at(i) for task in tasks], start, **options))
        if progress is not None:
            progress(i + 1, len(starts))
    return (
        np.array([result.q for result in results]).reshape(len(starts), pepper.n),
        np.array([CODES.index(result.status) for result in results], dtype=np.int8),
        np.array([[e.value for e in result.errors] for result in results]).reshape(len(starts), len(tasks)),
        np.array([result.iterations for result in results], dtype=np.int64),
        np.array([result.restarts for result in results], dtype=np.int64),
    )


def _count(tasks: Sequence[Task], start: Array) -> int:
    """Return N, the common number of targets and starts; start has shape (n,) or (N, n) [rad or m]."""
    counts = {f"targets of {task.label}": task.count for task in tasks if task.count is not None}
    if start.ndim > 2:
        raise InvalidValueError(
            "start", f"shape {start.shape}", f"shape (n,) or (N, n), n = {start.shape[-1]}"
        )
    if start.ndim == 2:
        counts["start"] = len(start)
    if not counts:
        raise InvalidValueError("tasks", "one target each", "N targets, shape (N, ...); `solve` takes one")
    if len(set(counts.values())) > 1:
        found = ", ".join(f"{name}: {count}" for name, count in counts.items())
        raise InvalidValueError("number of targets", found, "the same number N everywhere")
    return next(iter(counts.values()))


def _share_out(
    work: Callable[[int, int], None],
    count: int,
    threads: int,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Call work(begin, end) for chunks of the rows, on several threads."""
    chunks = [(begin, min(begin + CHUNK, count)) for begin in range(0, count, CHUNK)]
    done = 0
    if threads == 1:
        for begin, end in chunks:
            work(begin, end)
            if progress is not None:
                progress(end, count)
        return
    with ThreadPoolExecutor(threads) as pool:
        futures = {pool.submit(work, *chunk): chunk for chunk in chunks}
        try:
            for future in as_completed(futures):
                future.result()
                begin, end = futures[future]
                done += end - begin
                if progress is not None:
                    progress(done, count)
        except BaseException:
            # Otherwise the pool would finish all remaining rows first.
            pool.shutdown(cancel_futures=True)
            raise
