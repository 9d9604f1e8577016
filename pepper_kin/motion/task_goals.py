"""Goals that are given as tasks: solved, checked and chosen in machine code, whose arrays are kept."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.inverse_kinematics.search import EXTRA, STATUS, SearchOptions
from pepper_kin.frozen_arrays import read_only
from pepper_kin.ik import IKResult, IKStatus, Task, TaskGroup, solve
from pepper_kin.ik.certificate import CertificateInputs
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.fast.compiled_tasks import CompiledTasks, SearchBuffers, compiled_tasks
from pepper_kin.ik.fast.search import STATUSES, search_compiled
from pepper_kin.ik.priorities import equally_weighted, is_ordered
from pepper_kin.ik.problem import SearchBudget, flatten_tasks, movable_joints
from pepper_kin.model import PepperModel
from pepper_kin.motion.checks import LEAST_MARGIN, Checks
from pepper_kin.motion.goal_search import (
    BLOCK,
    FOUND,
    GOAL_COUNT,
    GOALS,
    RESTARTED,
    SPENT,
    START_AT_FAULT,
    STEPS_TAKEN,
    STOPPED,
    UNSOLVED,
    GoalSearch,
    search_anywhere,
    search_nearby,
    take_known,
    take_spare,
)
from pepper_kin.planners.deadline import load_code
from pepper_kin.planners.sampling import stream_key

ROUNDS = (48, 160, 512)
"""Starts of one round after the other, where starts near q0 lead to no goal."""

ROUND_FOR_LESS = 0
"""From this round on a solution nearer to something than the margin will do."""

ROUND_FOR_CARE = 2
"""Before this round a way clear of collisions is looked for, which is slow."""

CAREFUL_STARTS = 2
"""Further starts of a search that keeps clear all the way, which is slow."""

RESTARTS, STEPS = 32, 150
"""Further starts of the search from q0, and steps from each start."""

_STREAM = 17  # of the numbers that postures are drawn from


class TaskGoals(NamedTuple):
    """Configurations that meet tasks.

    Attributes:
        goals: The best first, shape (m, n), m of 1 to 4.
        ik: The result of inverse kinematics for the first.
        kept: What `Checks.margins` returns for them and the start [m].
    """

    goals: Array
    ik: IKResult
    kept: tuple[float, float]


class _Arrays(NamedTuple):
    """What one search at a time writes to, kept for the next one of the same tasks."""

    buffers: SearchBuffers
    inputs: Array
    answers: Array
    found: Array
    values: Array
    order: NDArray[np.int64]
    sieve: Array
    ends: Array
    spare: Array
    kept: Array
    counts: NDArray[np.int64]


_spare: WeakKeyDictionary[CompiledTasks, list[_Arrays]] = WeakKeyDictionary()


def _arrays_of(ready: CompiledTasks) -> _Arrays:
    """Return arrays to use; append them to `_spare` afterwards."""
    try:
        return _spare.setdefault(ready, []).pop()
    except IndexError:
        buffers, most = ready.buffers(), 1 + max(ROUNDS)
        n, size = ready.tables.effort.size, buffers.answer.size
        return _Arrays(
            buffers, np.empty((BLOCK, ready.width)), np.empty((BLOCK, size)), np.empty((most, n)),
            np.empty(most), np.empty(most, np.int64), np.empty((BLOCK, n)), np.empty((1 + GOALS, n)),
            np.empty((GOALS, n)), np.empty(2), np.empty(5, np.int64),
        )  # fmt: skip


def load_tasks(pepper: PepperModel, tasks: Sequence[Task]) -> None:
    """Load, or compile, what `clear_goals` runs for tasks of the fast solver, groups taken apart."""
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
) -> TaskGoals | None:
    """Return solutions of tasks that touch nothing and can be held; None where none was found this way.

    Solutions from starts ever farther away are examined together.  Those with the margin to the scene are
    preferred to nearer ones without.

    Args:
        checks: The robot in its scene.
        start: Where the motion starts, shape (n,).
        tasks: Tasks of classes that the fast solver has code for.
        joints: Joints that may move: joints and groups; None for all.
        margin: Distance to the scene that is preferred [m].
        seed: Draws the starts.
        timeout: Time budget [s]; it is looked at between rounds.

    Returns:
        The goals; None as well where the start touches something or cannot be held.
    """
    parts = tuple(flatten_tasks(checks.pepper, tasks))
    movable = None if joints is None else movable_joints(checks.pepper, joints)
    return _Search(checks, start, parts, movable, margin, seed, timeout).goals()


class _Search:
    """Solutions of tasks from many starts, examined together; see `clear_goals`.

    Args:
        checks: The robot in its scene.
        start: Where the motion starts [rad or m], shape (n,).
        parts: Tasks of classes that the fast solver has code for.
        movable: Which joints may move, shape (n,); None for all.
        margin: Distance to the scene that is preferred [m].
        seed: Draws the starts.
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

    def goals(self) -> TaskGoals | None:
        """Return the goals, if there are some."""
        ready = compiled_tasks(self._checks.pepper, self._tasks)
        arrays = _arrays_of(ready)
        search = self._search(ready, arrays)
        status = self._checks.run(search_nearby, search, False)
        if status == UNSOLVED and is_ordered(self._parts) and not self._timed_out(search):
            status = self._in_order(search)
        round_ = 0
        while status not in (FOUND, START_AT_FAULT, UNSOLVED, STOPPED) and round_ < len(ROUNDS):
            if time.perf_counter() > self._deadline:
                break
            status = self._widened(search, round_)
            round_ += 1
        if status == STOPPED:
            ready.check(arrays.buffers)
        result = self._result(search) if status == FOUND else None
        _spare[ready].append(arrays)
        return result

    def _search(self, ready: CompiledTasks, arrays: _Arrays) -> GoalSearch:
        """Return what compiled functions take."""
        buffers, row, n = arrays.buffers, arrays.inputs[0], self._start.size
        row[:n] = arrays.ends[0] = self._start
        finite = ready.read(self._tasks, row, buffers.tolerance)
        further = buffers.options(
            SearchBudget(self._seed, 0, STEPS, np.inf, thorough=False), finite, ready.tables.task_joints
        )
        check, _ = self._checks.of_configurations(), search_nearby.native
        # Code is loaded by now, and perhaps compiled: that is not searching.
        self._begin = time.perf_counter()
        self._deadline = self._begin + self._timeout
        first = SearchOptions(
            further.tolerance, further.first, further.advance, RESTARTS, STEPS, False, finite, further.clock,
            self._deadline, further.signals,
        )  # fmt: skip
        bounds = ready.bounds if self._movable is None else ready.bounds_of(self._movable)
        return GoalSearch(
            ready.tables, bounds, first, further, check, self._margin,
            LEAST_MARGIN, *arrays[1:],
        )  # fmt: skip

    def _timed_out(self, search: GoalSearch) -> bool:
        status = search.answers[0, search.answers.shape[1] - EXTRA + STATUS]
        return STATUSES[int(status)] is IKStatus.TIMED_OUT

    def _in_order(self, search: GoalSearch) -> int:
        """Go on from what `solve` finds where tasks yield to others; return as `search_nearby`."""
        checks, timeout = self._checks, max(self._deadline - time.perf_counter(), 1e-3)
        joints = None
        if self._movable is not None:
            joints = [checks.pepper.joint_names[k] for k in np.flatnonzero(self._movable)]
        found = solve(
            checks.pepper, self._parts, self._start, collisions=False, seed=self._seed, joints=joints,
            timeout=timeout,
        )  # fmt: skip
        if not found.success:
            return UNSOLVED
        search.found[0] = found.q
        return int(checks.run(search_nearby, search, True))

    def _widened(self, search: GoalSearch, number: int) -> int:
        """Look farther away, in one of the rounds; return as `search_nearby`."""
        if number == ROUND_FOR_CARE:
            status = self._carefully(search)
            if status == FOUND:
                return status
        key, near = stream_key(self._seed, _STREAM + number), number >= ROUND_FOR_LESS
        return int(self._checks.run(search_anywhere, search, key, ROUNDS[number], near))

    def _carefully(self, search: GoalSearch) -> int:
        """Look for a goal that is come to along a way clear of collisions."""
        pepper, checks = self._checks.pepper, self._checks
        budget = SearchBudget(self._seed, CAREFUL_STARTS, STEPS, self._deadline)
        collisions = Collisions(pepper, checks.exact.scene)
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
            checks.pepper, self._parts, self._start, self._movable, checks.exact.scene, q
        )
        ik = IKResult(
            IKStatus.SOLVED, q, counts[STEPS_TAKEN], counts[RESTARTED] + counts[SPENT],
            time.perf_counter() - self._begin, "fast", seed=self._seed, evidence=inputs.certificate,
        )  # fmt: skip
        return TaskGoals(goals, ik, (float(search.kept[0]), float(search.kept[1])))
