"""Search of goal configurations that meet IK tasks, touch nothing and can be held.

Tasks are solved from many starts, and the solutions are examined together, in machine code; `TaskGoalSearch`
provides the arrays, which are reused by the next search, and draws starts farther away if no goal is near.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array, read_only
from pepper_kin.core.collision.curve_check import (
    MotionCheck,
    _check_states,
    _held,
    _least_moment,
    _write_loads,
    blocked,
    kept_margins,
)
from pepper_kin.core.collision.gjk import FREE
from pepper_kin.core.inverse_kinematics.local_solver import CollisionTests
from pepper_kin.core.inverse_kinematics.multi_start import solve_rows
from pepper_kin.core.inverse_kinematics.search import (
    CANDIDATES,
    EXTRA,
    ITERATIONS,
    RESTARTS,
    SOLVED,
    STATUS,
    STOP,
    SearchOptions,
    TaskTables,
)
from pepper_kin.ik import IKResult, IKStatus, Task, TaskGroup, solve
from pepper_kin.ik.certificate import CertificateInputs
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast.compiled_tasks import CompiledTasks, SearchBuffers, compiled_tasks
from pepper_kin.ik.fast.search import STATUSES, search_compiled
from pepper_kin.ik.priorities import equally_weighted, is_ordered
from pepper_kin.ik.problem import SearchBudget, flatten_tasks, movable_joints
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1
from pepper_kin.kernels.working_time import on_perf_counter, working_time
from pepper_kin.model import PepperModel
from pepper_kin.motion.checks import LEAST_MARGIN, Checks
from pepper_kin.planners.compiled import load_code, stream_key, uniform

GOALS = 4
"""Maximum number of solutions that are kept."""

NEARBY = 16
"""Number of starts at increasing distances from q0, besides q0 itself."""

BLOCK = 64
"""Number of rows that are solved, and of configurations that are checked, together."""

DRAWS = 4
"""Postures drawn for each start of a round; those in contact are left out if machine code can decide."""

APART = 0.1
"""Difference of every joint below which two solutions count as one [rad or m]."""

ROUNDS = (48, 160, 512)
"""Numbers of starts in successive rounds, if starts near q0 lead to no goal."""

ROUND_FOR_LESS = 0
"""First round in which a solution nearer to something than the margin suffices."""

ROUND_FOR_CARE = 2
"""Round before which IK with collision avoidance is tried, which is slow."""

CAREFUL_STARTS = 2
"""Number of further starts of IK with collision avoidance, which is slow."""

NEAR_RESTARTS, STEPS = 32, 150
"""Number of further starts of the search from q0, and maximum number of steps from each start."""

_STREAM = 17  # random stream of drawn postures

# Statuses of a call.
FOUND, NONE, START_AT_FAULT, UNSOLVED, STOPPED = range(5)

# Indices into `counts`.
GOAL_COUNT, SPARE_COUNT, SPENT, STEPS_TAKEN, RESTARTED = range(5)


class GoalSearch(NamedTuple):
    """Data of a search for compiled functions; n joints, t tasks.

    Attributes:
        tables: Tables of the robot and the tasks.
        bounds: Bounds of `tables.joints` and whether they move, see `solve_rows`.
        options: Options of the search from q0.
        further: Options of the search from each of the other starts.
        check: Check of configurations in which any joint may differ.
        margin: Preferred distance to the scene [m].
        least_margin: Margin below which it counts as zero [m].
        inputs: q0, weights and targets in the first row; memory for BLOCK rows, shape (BLOCK, ...).
        answers: Memory for the answers of `solve_rows`, shape (BLOCK, n + t + EXTRA).
        found: Memory for the solutions of a round, shape (m, n), m = 1 + maximum number of starts of a round.
        values: Memory for the squared distances of solutions from q0, shape (m,).
        order: Memory for the order of solutions by distance, shape (m,).
        sieve: Memory for configurations that are checked, shape (BLOCK, n).
        ends: The start, then the goals found, the best first, shape (1 + GOALS, n).
        spare: Solutions that touch nothing but are nearer than the margin, shape (GOALS, n).
        kept: Receives the margins that the ends keep, see `kept_margins`.
        counts: Counters, with the indices above.
    """

    tables: TaskTables
    bounds: Floats2
    options: SearchOptions
    further: SearchOptions
    check: MotionCheck
    margin: float
    least_margin: float
    inputs: Floats2
    answers: Floats2
    found: Floats2
    values: Floats1
    order: Ints1
    sieve: Floats2
    ends: Floats2
    spare: Floats2
    kept: Floats1
    counts: Ints1


@compiled
def _pick_held(check: MotionCheck, rows: Array, count: int) -> int:
    """Move configurations that can be held still to the front; return their number.

    Args:
        check: Check of states.
        rows: Configurations [rad or m], of which the first are tested, shape (>= count, n).
        count: Number of configurations to test.
    """
    found = 0
    for i in range(count):
        for j in range(rows.shape[1]):
            check.states[0, j] = rows[i, j]
        if _held(check, 1):
            for j in range(rows.shape[1]):
                rows[found, j] = rows[i, j]
            found += 1
    return found


@compiled
def _pick_free(check: MotionCheck, rows: Array, count: int, margin: float, self_margin: float) -> int:
    """Move configurations that keep margins to the front; return their number.

    Args:
        check: Check of states.
        rows: Configurations [rad or m], of which the first are tested, shape (>= count, n).
        count: Number of configurations to test, at most STATES_AT_ONCE.
        margin: Distance to the scene [m].
        self_margin: Distance of the robot to itself [m].
    """
    if count == 0 or blocked(check, margin, self_margin):
        return 0
    _check_states(check, rows, count, (margin, self_margin))
    found = 0
    for i in range(count):
        if check.answers[i] == FREE:
            for j in range(rows.shape[1]):
                rows[found, j] = rows[i, j]
            found += 1
    return found


@compiled
def _write_nearby(search: GoalSearch) -> None:
    """Write starts at increasing distances from q0, toward points that fill the joint box evenly.

    Joints that no task depends on, and joints that may not move, keep q0.
    """
    tables, bounds, inputs, start = search.tables, search.bounds, search.inputs, search.ends[0]
    for row in range(NEARBY - 1, -1, -1):
        for i in range(inputs.shape[1]):
            inputs[row, i] = inputs[0, i]
        for i in range(tables.task_joints):
            j = tables.joints[i]
            here = start[j]
            low, high = max(bounds[0, i], here - math.pi), min(bounds[1, i], here + math.pi)
            x = search.further.first[i] + (1.0 + CANDIDATES * row) * search.further.advance[i]
            point = low + (x - math.floor(x)) * (high - low)
            inputs[row, j] = here
            if bounds[2, i] != 0.0:
                inputs[row, j] += (row + 1.0) / NEARBY * (point - here)


@compiled
def _write_posture(search: GoalSearch, key: np.uint64, place: int, q: Array) -> None:
    """Write a random posture within the limits of all joints, at most half a turn from q0, into q.

    Joints that may not move keep q0.

    Args:
        search: The search.
        key: Key of the stream of random numbers.
        place: Index of the first of n numbers in the stream.
        q: Receives the joint positions [rad or m], shape (n,).
    """
    tables, bounds, start = search.tables, search.bounds, search.ends[0]
    for i in range(q.size):
        j = tables.joints[i]
        low, high = max(bounds[0, i], start[j] - math.pi), min(bounds[1, i], start[j] + math.pi)
        q[j] = start[j] if bounds[2, i] == 0.0 else low + uniform(key, place + i) * (high - low)


@compiled
def _solve(search: GoalSearch, count: int, size: int) -> int:
    """Solve the first rows of `inputs`, append solutions to `found`; return its size, or -1 to stop."""
    n, tables = search.ends.shape[1], search.tables
    none = CollisionTests(0, 0, 0, 0, 0, 0)
    solve_rows(tables, search.bounds, search.further, none, search.inputs, search.answers, 0, count)
    status = search.answers.shape[1] - EXTRA + STATUS
    for row in range(count):
        if search.answers[row, status] == STOP:
            return -1
        if search.answers[row, status] == SOLVED:
            total = 0.0
            for i in range(n):
                j = tables.joints[i]
                search.found[size, j] = search.answers[row, j]
                shift = search.answers[row, j] - search.ends[0, j]
                total += (tables.scale[i] if i < tables.task_joints else 1.0) * shift * shift
            search.values[size] = total
            size += 1
    search.counts[SPENT] += count
    return size


@compiled
def _sort(search: GoalSearch, first: int, size: int) -> None:
    """Write the order of `found`, the nearest first; rows before `first` stay first."""
    order, values = search.order, search.values
    for k in range(size):
        place = k
        while place > first and values[order[place - 1]] > values[k]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = k


@compiled
def _add_different(solutions: Array, count: int, kept: Array, size: int) -> int:
    """Append solutions that differ from all kept ones, while there is space.

    Args:
        solutions: Joint positions [rad or m], shape (m, n).
        count: Number of solutions to consider, from the first.
        kept: Kept solutions, shape (k, n); new ones are written after the first `size`.
        size: Number of kept solutions before.

    Returns:
        Number of kept solutions.
    """
    for k in range(count):
        new = size < kept.shape[0]
        for other in range(size if new else 0):
            farthest = 0.0
            for j in range(kept.shape[1]):
                farthest = max(farthest, abs(solutions[k, j] - kept[other, j]))
            new = new and farthest >= APART
        if new:
            for j in range(kept.shape[1]):
                kept[size, j] = solutions[k, j]
            size += 1
    return size


@compiled
def _load(search: GoalSearch, first: int, count: int) -> int:
    """Write the solutions that can be held, of `count` from `first` on, to the sieve; return their number."""
    for k in range(count):
        for j in range(search.sieve.shape[1]):
            search.sieve[k, j] = search.found[search.order[first + k], j]
    return int(_pick_held(search.check, search.sieve, count))


@compiled
def _examine(search: GoalSearch, size: int) -> None:
    """Add solutions that keep the margin and can be held to the goals; if there is none, store clear ones."""
    counts, check, goals = search.counts, search.check, search.ends[1:]
    for first in range(0, size, BLOCK):
        count = min(BLOCK, size - first)
        wide = _pick_free(check, search.sieve, _load(search, first, count), search.margin, 0.0)
        counts[GOAL_COUNT] = _add_different(search.sieve, wide, goals, counts[GOAL_COUNT])
    if counts[GOAL_COUNT] > 0 or search.margin == 0.0:
        return
    for first in range(0, size, BLOCK):
        count = min(BLOCK, size - first)
        clear = _pick_free(check, search.sieve, _load(search, first, count), 0.0, 0.0)
        counts[SPARE_COUNT] = _add_different(search.sieve, clear, search.spare, counts[SPARE_COUNT])


@compiled
def _sort_by_balance(search: GoalSearch, count: int) -> None:
    """Sort the goals by the distance of the center of mass inside the wheels, the farthest first.

    Motions to the first ones may decelerate more: the zero-moment point is farther from the edges.
    """
    check, goals, values = search.check, search.ends[1:], search.values
    for k in range(count):
        for j in range(goals.shape[1]):
            check.states[k, j] = goals[k, j]
    _write_loads(check, count)
    for k in range(count):
        values[k] = -_least_moment(check, k)
    _sort(search, 0, count)
    for k in range(count):
        for j in range(goals.shape[1]):
            goals[k, j] = check.states[search.order[k], j]


@compiled
def _ended(search: GoalSearch) -> int:
    """Write the margins that start and goals keep, if there are goals; return FOUND or NONE."""
    count = search.counts[GOAL_COUNT]
    if count == 0:
        return NONE
    if search.check.edges.shape[0] > 0:
        _sort_by_balance(search, count)
    kept_margins(search.check, search.ends[: 1 + count], search.margin, search.least_margin, search.kept)
    return FOUND


@compiled
def _is_sound(search: GoalSearch) -> bool:
    """Whether the start touches nothing and can be held."""
    for j in range(search.sieve.shape[1]):
        search.sieve[0, j] = search.ends[0, j]
    held = _pick_held(search.check, search.sieve, 1)
    return held == 1 and _pick_free(search.check, search.sieve, 1, 0.0, 0.0) == 1


@compiled("int64(GoalSearch, boolean)")
def search_nearby(search: GoalSearch, known: bool) -> int:
    """Search goals from q0 and from starts at increasing distances.

    Args:
        search: Data of the search; `ends` begins with q0.
        known: Whether `found` begins with a solution from q0.

    Returns:
        FOUND, with counts[GOAL_COUNT] goals; NONE; START_AT_FAULT; UNSOLVED if the search from q0 does not
        meet the tasks; or STOPPED if a signal has ended it.  The first row of `answers` holds the result from
        q0.
    """
    counts, inputs, answers, n = search.counts, search.inputs, search.answers, search.ends.shape[1]
    for k in range(counts.size):
        counts[k] = 0
    if not _is_sound(search):
        return START_AT_FAULT
    if not known:
        none, last = CollisionTests(0, 0, 0, 0, 0, 0), answers.shape[1] - EXTRA
        solve_rows(search.tables, search.bounds, search.options, none, inputs, answers, 0, 1)
        counts[STEPS_TAKEN] = int(answers[0, last + ITERATIONS])
        counts[RESTARTED] = int(answers[0, last + RESTARTS])
        if answers[0, last + STATUS] != SOLVED:
            return STOPPED if answers[0, last + STATUS] == STOP else UNSOLVED
        for j in range(n):
            search.found[0, j] = answers[0, j]
    _write_nearby(search)
    size = _solve(search, NEARBY, 1)
    if size < 0:
        return STOPPED
    _sort(search, 1, size)
    _examine(search, size)
    return _ended(search)


@compiled("int64(GoalSearch, uint64, int64, boolean)")
def search_anywhere(search: GoalSearch, key: np.uint64, starts: int, near: bool) -> int:
    """Search goals from random postures; postures in contact are left out if the check is quick.

    All joints are drawn: an arm without a task may be in the way of an arm with one.

    Args:
        search: Data of the search, after `search_nearby`.
        key: Key of the stream of random numbers.
        starts: Maximum number of starts, for which `found` has space.
        near: Whether solutions nearer to something than the margin suffice.

    Returns:
        Status, as `search_nearby` returns it.
    """
    n, check, size, place, taken = search.ends.shape[1], search.check, 0, 0, 0
    most = (DRAWS if check.quick else 1) * starts * n
    while taken < starts and place < most:
        count = 0
        while count < BLOCK and place < most:
            _write_posture(search, key, place, search.sieve[count])
            count, place = count + 1, place + n
        if check.quick:
            count = _pick_free(check, search.sieve, count, 0.0, 0.0)
        count = min(count, starts - taken)
        for row in range(count - 1, -1, -1):
            for i in range(n, search.inputs.shape[1]):
                search.inputs[row, i] = search.inputs[0, i]
            for i in range(n):
                search.inputs[row, i] = search.sieve[row, i]
        if count > 0:
            size = _solve(search, count, size)
        if size < 0:
            return STOPPED
        taken += count
    _sort(search, 0, size)
    _examine(search, size)
    if search.counts[GOAL_COUNT] == 0 and near:
        return take_spare(search)
    return _ended(search)


@compiled("int64(GoalSearch)")
def take_spare(search: GoalSearch) -> int:
    """Take solutions nearer to something than the margin as goals; return the status."""
    counts, goals = search.counts, search.ends[1:]
    counts[GOAL_COUNT] = _add_different(search.spare, counts[SPARE_COUNT], goals, counts[GOAL_COUNT])
    return _ended(search)


@compiled("int64(GoalSearch)")
def take_known(search: GoalSearch) -> int:
    """Take the first of `found` as goal, or else solutions nearer than the margin; return the status."""
    search.order[0] = 0
    _examine(search, 1)
    return _ended(search) if search.counts[GOAL_COUNT] > 0 else take_spare(search)


class TaskGoals(NamedTuple):
    """Configurations that meet tasks.

    Attributes:
        goals: Configurations [rad or m], shape (m, n), m from 1 to 4, the best first: with balance the
            farthest inside the wheels, else the nearest.
        ik: Result of inverse kinematics for the first goal.
        kept: Margins that start and goals keep to the scene and of the robot to itself [m].
    """

    goals: Array
    ik: IKResult
    kept: tuple[float, float]


_Kept: TypeAlias = tuple[SearchBuffers, tuple[NDArray[Any], ...]]
_spare: WeakKeyDictionary[CompiledTasks, list[_Kept]] = WeakKeyDictionary()
"""Compiled tasks -> arrays for reuse by the next search: buffers, and arrays of a `GoalSearch`."""


def _arrays_of(ready: CompiledTasks) -> _Kept:
    """Return unused arrays for a search; the caller appends them to `_spare` afterwards."""
    try:
        return _spare.setdefault(ready, []).pop()
    except IndexError:
        buffers, most = ready.buffers(), 1 + max(ROUNDS)
        n, size = ready.tables.effort.size, buffers.answers.shape[1]
        return buffers, (
            np.empty((BLOCK, ready.width)), np.empty((BLOCK, size)), np.empty((most, n)), np.empty(most),
            np.empty(most, np.int64), np.empty((BLOCK, n)), np.empty((1 + GOALS, n)), np.empty((GOALS, n)),
            np.empty(2), np.empty(5, np.int64),
        )  # fmt: skip


def load_tasks(pepper: PepperModel, tasks: Sequence[Task]) -> None:
    """Load or compile the code that `clear_goals` runs for tasks of the fast solver, with groups split."""
    compiled_tasks(pepper, equally_weighted(tuple(tasks)))
    load_code(search_nearby, search_anywhere, take_known, take_spare)


def clear_goals(
    checks: Checks,
    start: Array,
    tasks: Sequence[Task | TaskGroup],
    joints: str | Sequence[str] | None,
    margin: float,
    seed: int,
    timeout: float,
    *,
    nearby: bool = False,
) -> TaskGoals | None:
    """Return solutions of tasks that touch nothing and can be held; None if none was found.

    Solutions from starts at increasing distances are examined together.  Solutions that keep the margin to
    the scene are preferred to nearer ones that do not.

    Args:
        checks: The robot in its scene.
        start: Start configuration [rad or m], shape (n,).
        tasks: Tasks of classes that the fast solver has code for.
        joints: Joints that may move, by names of joints and groups; None for all.
        margin: Preferred distance to the scene [m].
        seed: Seed of the random starts.
        timeout: Time budget [s]; it is checked between rounds.
        nearby: Whether only starts near the start configuration are tried.

    Returns:
        The goals; None as well if the start touches something or cannot be held.
    """
    parts = tuple(flatten_tasks(checks.pepper, tasks))
    movable = None if joints is None else movable_joints(checks.pepper, joints)
    return TaskGoalSearch(checks, start, parts, movable, margin, seed, timeout).goals(nearby)


class TaskGoalSearch:
    """Solutions of tasks from many starts, examined together; see `clear_goals`.

    Args:
        checks: The robot in its scene.
        start: Start configuration [rad or m], shape (n,).
        parts: Tasks of classes that the fast solver has code for.
        movable: Whether each joint may move, shape (n,); None for all.
        margin: Preferred distance to the scene [m].
        seed: Seed of the random starts.
        timeout: Time budget [s].
    """

    def __init__(
        self,
        checks: Checks,
        start: Array,
        parts: tuple[Task, ...],
        movable: NDArray[np.bool_] | None,
        margin: float,
        seed: int,
        timeout: float,
    ) -> None:
        self._checks, self._start, self._parts, self._movable = checks, start, parts, movable
        self._tasks, self._margin, self._seed = equally_weighted(parts), margin, seed
        self._timeout = timeout

    def goals(self, nearby: bool = False) -> TaskGoals | None:
        """Return the goals, or None; see `clear_goals`."""
        ready = compiled_tasks(self._checks.pepper, self._tasks)
        kept = _arrays_of(ready)
        search = self._search(ready, *kept)
        status = self._checks.run(search_nearby, search, False)
        rounds = 0 if nearby else len(ROUNDS)
        if rounds and status == UNSOLVED and is_ordered(self._parts) and not self._timed_out(search):
            status = self._in_order(search)
        round_ = 0
        while status not in (FOUND, START_AT_FAULT, UNSOLVED, STOPPED) and round_ < rounds:
            if working_time() > self._deadline:
                break
            status = self._widened(search, round_)
            round_ += 1
        if status == STOPPED:
            ready.check(kept[0])
        result = self._result(search) if status == FOUND else None
        _spare[ready].append(kept)
        return result

    def _search(
        self, ready: CompiledTasks, buffers: SearchBuffers, arrays: tuple[NDArray[Any], ...]
    ) -> GoalSearch:
        """Return the data for compiled functions, with `arrays` from `inputs` on, and start the clock."""
        row, n = arrays[0][0], self._start.size
        row[:n] = self._start
        finite = ready.read(self._tasks, row, buffers.tolerance)
        further = buffers.options(
            SearchBudget(self._seed, 0, STEPS, np.inf, thorough=False), finite, ready.tables.task_joints
        )
        check, _ = self._checks.of_configurations(), search_nearby.native
        # Loading or compiling code does not count as search time.
        self._begin = working_time()
        self._deadline = self._begin + self._timeout
        first = SearchOptions(
            further.tolerance, further.first, further.advance, NEAR_RESTARTS, STEPS, False, True,
            finite, further.clock, on_perf_counter(self._deadline), further.signals,
        )  # fmt: skip
        bounds = ready.bounds if self._movable is None else ready.bounds_of(self._movable)
        search = GoalSearch(
            ready.tables, bounds, first, further, check, self._margin, LEAST_MARGIN, *arrays
        )  # fmt: skip
        search.ends[0] = self._start
        return search

    def _timed_out(self, search: GoalSearch) -> bool:
        status = search.answers[0, search.answers.shape[1] - EXTRA + STATUS]
        return STATUSES[int(status)] is IKStatus.TIMED_OUT

    def _in_order(self, search: GoalSearch) -> int:
        """Search near the solution of `solve`, which relaxes tasks in order; return the status."""
        checks, timeout = self._checks, max(self._deadline - working_time(), 1e-3)
        joints = None
        if self._movable is not None:
            joints = [checks.pepper.joint_names[k] for k in np.flatnonzero(self._movable)]
        found = solve(
            checks.pepper, self._parts, self._start, collisions=False, seed=self._seed, joints=joints,
            timeout=timeout, balance=checks.statics.balance,
        )  # fmt: skip
        if not found.success:
            return UNSOLVED
        search.found[0] = found.q
        return int(checks.run(search_nearby, search, True))

    def _widened(self, search: GoalSearch, number: int) -> int:
        """Run one round of random starts, before one round with IK avoiding collisions; return the status."""
        if number == ROUND_FOR_CARE:
            status = self._carefully(search)
            if status == FOUND:
                return status
        key, near = stream_key(self._seed, _STREAM + number), number >= ROUND_FOR_LESS
        return int(self._checks.run(search_anywhere, search, key, ROUNDS[number], near))

    def _carefully(self, search: GoalSearch) -> int:
        """Search a goal by IK that avoids collisions at every step; return the status."""
        pepper, checks = self._checks.pepper, self._checks
        budget = SearchBudget(self._seed, CAREFUL_STARTS, STEPS, self._deadline)
        collisions = Collisions(pepper, checks.exact.scene, loads=checks.statics.carrying)
        found = search_compiled(pepper, self._tasks, self._start, self._movable, budget, collisions)
        search.counts[SPENT] += found.restarts
        if found.status is not IKStatus.SOLVED:
            return int(checks.run(take_spare, search))
        search.found[0], search.order[0] = found.q, 0
        return int(checks.run(take_known, search))

    def _result(self, search: GoalSearch) -> TaskGoals:
        """Return the goals that were found."""
        count, checks, counts = int(search.counts[GOAL_COUNT]), self._checks, search.counts.tolist()
        goals = search.ends[1 : 1 + count].copy()
        q = read_only(goals[0].copy())
        inputs = CertificateInputs(
            checks.pepper, self._parts, self._start, self._movable, checks.exact.scene, q,
            loads=checks.statics.carrying,
        )  # fmt: skip
        ik = IKResult(
            IKStatus.SOLVED, q, counts[STEPS_TAKEN], counts[RESTARTED] + counts[SPENT],
            working_time() - self._begin, "fast", seed=self._seed, evidence=inputs.certificate,
        )  # fmt: skip
        return TaskGoals(goals, ik, (float(search.kept[0]), float(search.kept[1])))
