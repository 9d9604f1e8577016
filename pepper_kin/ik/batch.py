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

# Rows that a thread takes at a time.
CHUNK = 512

Arrays: TypeAlias = tuple[Array, np.ndarray, Array, np.ndarray, np.ndarray]

CODES = tuple(IKStatus)
"""The status of each code in `BatchResult.codes`."""

_REASONS = {
    IKStatus.CLOSEST_UNREACHABLE: "no posture was found that reaches it, even without joint limits",
    IKStatus.CLOSEST_LIMITS: "only postures beyond the joint limits were found that reach it",
    IKStatus.CLOSEST_COLLISION: "only postures that touch something were found that reach it",
    IKStatus.TIMED_OUT: "time ran out",
}


@dataclass(frozen=True, eq=False)
class BatchResult(FrozenArrays):
    """The configurations found for N sets of targets; arrays are read-only.

    Attributes:
        q: Joint positions within all limits [rad or m], shape (N, n).
        codes: How each search ended, as a place in `ik.batch.CODES`; 0 is solved, shape (N,).
        errors: Error of each task [m or rad], groups taken apart, shape (N, tasks).
        iterations: Steps over all starts, shape (N,).
        restarts: Starts used after the first, shape (N,).
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
        """Whether every hard task is met, shape (N,); True everywhere where none is hard."""
        hard = [k for k, task in enumerate(self._tasks) if task.hard]
        limits = np.array([self._tasks[k].tolerance for k in hard])
        return np.asarray(np.all(self.errors[:, hard] <= limits, axis=1))

    @cached_property
    def shortfalls(self) -> Array:
        """By how much each task is missed at least, whatever the posture within the limits [m].

        Proven, see `pepper_kin.ik.reach_bound`: 0 within the convex hull of what a frame reaches, and for all
        tasks but those on positions.  Shape (N, tasks).
        """
        return read_only(shortfalls(self._pepper, self._tasks, self._starts, self._movable))

    def reason(self, row: int) -> str:
        """Return in a clause why a row was not solved; empty where it was."""
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
        """Return how the search of one row ended."""
        return CODES[int(self.codes[row])]

    def result(self, row: int) -> IKResult:
        """Return one row as `solve` would, with a certificate computed from q; `time` is the whole call's.

        Of a row that fails it looks for the reason first: a tenth of a second or so.
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
        """Return how many rows ended how, in plain words."""
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
    """Do for N sets of targets what `solve` does for one.

    Tasks take N targets in place of one: `HandPosition("left", points)` with points of shape (N, 3).  Every
    row is searched as `solve` would with the same seed, so results depend neither on the other rows nor on
    the number of threads.

    A row that cannot be solved takes `solve` a hundred times as long as others, nearly all of it in search of
    the closest configuration.  For data sets, which need the reason only, `closest=False` leaves that out:
    rows whose target is beyond reach by proof (`BatchResult.shortfalls`) end after one descent, and those
    that are met only in collision after one round among obstacles of twelve and from postures that have the
    hand near its target.  Solutions that need no more are the same; of the others nearly all are found.

    Args:
        pepper: The robot.
        tasks: The tasks; those with a single target have the same one in every row.
        start: Where to begin and what to stay near [rad or m], shape (n,) or (N, n); None for
            `pepper.neutral()`.
        solver: "fast", "placo" or "proxsuite"; "robot" as its `solvers` say, which are "fast" by default.
        scene: What stands around the robot, which keeps clear of itself in any case; None for nothing.
        collisions: Whether collisions are examined; False leaves them out, and the result says so.
        margin: Distance to the scene that is kept [m].
        balance: As of `solve`.
        payload: As of `solve` [kg].
        seed: Draws the restarts.
        joints: Joints that may move, by names of joints and groups; None for all.
        max_iterations: Steps from each start.
        restarts: Further starts.
        threads: Threads that share the rows; the other solvers than "fast" use one.
        progress: Called with the number of rows done and N, from the calling thread.
        closest: Whether rows that are not solved end as close to their targets as `solve` comes; False for
            any place clear of collisions, which may be the start.  For "fast" only.

    Returns:
        Arrays of what `solve` returns.

    Raises:
        InvalidValueError: as `solve`, and where the numbers of targets differ or no task has several.
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
    if not budget.closest and not is_ordered(tasks):  # what is met of tasks in order still counts
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
    """Solve rows that are met only in collision so far from postures that have the frame near its target.

    Arguments as of `_solve_fast`; what is found is written into the answers.
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
    """Search on in one row, as `solve` does; writes what is found into the answers."""
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
    """Solve rows again whose solution the robot does not keep at rest, as `solve` does.

    Arguments as of `_solve_fast`; what is found is written into the answers.
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
    """Return N, on which all that come in numbers agree; start has shape (n,) or (N, n) [rad or m]."""
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
            # Without this the pool would first finish all rows, however many are left.
            pool.shutdown(cancel_futures=True)
            raise
