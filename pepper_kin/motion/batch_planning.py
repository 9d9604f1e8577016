"""Many planning problems on all cores, with the same plans as sequential calls of `plan`."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import BriefRepr, FrozenArrays
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.motion.plan_request import PlanOptions
from pepper_kin.motion.plan_result import Plan
from pepper_kin.motion.planning import plan
from pepper_kin.motion.planning_process import UnansweredError, helpers

if TYPE_CHECKING:
    from pepper_kin.motion.planning_process import Helper

MOST_TOGETHER = 16
"""Maximum number of problems of one robot and scene that a process takes at once."""
_SHARES = 8  # number of chunks per process, so that a slow one leaves chunks to others
_PAUSE = 0.02  # time between polls whether a helper has started [s]

Outcome = tuple["Plan | None", "Exception | None"]


@dataclass(frozen=True, eq=False)
class PlanProblem(PlanOptions, FrozenArrays):
    """A planning problem as a value: the arguments of `plan`.

    Attributes:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration [rad or m], shape (n,), several, shape (m, n), or IK tasks.
        scene: The world around the robot; problems in one world should share one object.
    """

    pepper: PepperModel
    start: ArrayLike
    goal: ArrayLike | Sequence[Any]
    scene: Scene | None = None

    def __post_init__(self) -> None:
        """Copy arrays; `plan` checks them."""
        for name in ("start", "goal", "start_velocity"):
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                copy = value.copy()  # of any type and shape
                copy.setflags(write=False)
                object.__setattr__(self, name, copy)

    def solve(self) -> Plan:
        """Return the plan of the problem; raise the errors that `plan` raises."""
        return plan(self.pepper, self.start, self.goal, self.scene, **self.keywords())

    def outcome(self) -> Outcome:
        """Return the plan and None, or None and the error that `plan` raised."""
        try:
            return self.solve(), None
        except Exception as error:
            return None, error


@dataclass(frozen=True, eq=False)
class PlanBatch(BriefRepr):
    """The plans of many problems, in the problems' order.

    Attributes:
        plans: Plan of each problem; None if `plan` raised an error.
        errors: Error of each problem; None if `plan` returned.
        time: Wall time of all problems [s].
    """

    plans: tuple[Plan | None, ...]
    errors: tuple[Exception | None, ...]
    time: float

    @property
    def success(self) -> NDArray[np.bool_]:
        """Which problems have a path, shape (N,)."""
        return np.array([plan is not None and plan.success for plan in self.plans], dtype=bool)

    def report(self) -> str:
        """Return in plain words how many problems have a path, and why the others have none."""
        lines = [
            f"{int(self.success.sum())} of {len(self.plans)} problems have a path, in {self.time:.2f} s."
        ]
        for number, (found, error) in enumerate(zip(self.plans, self.errors, strict=True)):
            if error is not None:
                lines.append(f"Problem {number} was refused: {error}")
            elif found is not None and not found.success:
                lines.append(f"Problem {number}: {found.report()}")
        return "\n".join(lines)


def plan_batch(
    problems: Iterable[PlanProblem],
    *,
    processes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PlanBatch:
    """Plan many problems on all cores.

    Each plan is bit by bit the one that `plan` returns for that problem alone, except its `time`, unless a
    timeout is reached.  This process solves problems as well; helpers, which are separate processes, join as
    soon as they have started, after about a second, and are kept for the next call.  Problems that cannot be
    sent to helpers (with a task class of the main script, for example) are solved in this process.

    Args:
        problems: Robots, starts, goals and scenes.
        processes: Number of processes, including this one; None for one on each core.
        progress: Function called now and then in this thread with the numbers of solved and of all problems.

    Returns:
        Plans and errors in the problems' order: an error in one problem does not stop the others.

    Raises:
        InvalidValueError: for an item that is not a problem, or a number of processes below 1.
    """
    begin = time.perf_counter()
    requested = tuple(problems)
    for number, problem in enumerate(requested):
        if not isinstance(problem, PlanProblem):
            raise InvalidValueError(f"problems[{number}]", repr(problem), "a PlanProblem")
    count = os.cpu_count() or 1 if processes is None else processes
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise InvalidValueError("processes", repr(processes), "a whole number of at least 1, or None")
    run = _BatchRun(requested, _chunks(requested, count), progress)
    run.all(helpers(min(count, len(run.waiting)) - 1))
    plans, errors = zip(*run.outcomes, strict=True) if requested else ((), ())
    return PlanBatch(plans, errors, time.perf_counter() - begin)


def _chunks(problems: Sequence[PlanProblem], processes: int) -> list[list[int]]:
    """Return the problems' indices in chunks of one robot and one scene each."""
    groups: dict[tuple[int, int], list[int]] = {}
    for number, problem in enumerate(problems):
        groups.setdefault((id(problem.pepper), id(problem.scene)), []).append(number)
    size = min(MOST_TOGETHER, max(1, len(problems) // (_SHARES * processes)))
    return [group[k : k + size] for group in groups.values() for k in range(0, len(group), size)]


class _BatchRun:
    """One batch: this thread takes chunks from the front, a thread for each helper from the back."""

    def __init__(
        self,
        problems: Sequence[PlanProblem],
        chunks: list[list[int]],
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self.problems, self.progress = problems, progress
        self.waiting, self.left = deque(chunks), deque[list[int]]()
        self.outcomes: list[Outcome] = [(None, None)] * len(problems)
        self.done = self.reported = self.away = 0
        self.change = threading.Condition()

    def all(self, others: Sequence[Helper]) -> None:
        """Solve all problems."""
        threads = [threading.Thread(target=self._hand_out, args=(one,), daemon=True) for one in others]
        for thread in threads:
            thread.start()
        try:
            while (chunk := self._next()) is not None:
                for number in chunk:
                    self._record([number], [self.problems[number].outcome()])
                    self._tell()
        except BaseException:
            self.waiting.clear()
            for one in others:
                one.end()
            raise
        self._tell()

    def _next(self) -> list[int] | None:
        """Return a chunk for this process, after waiting for helpers if necessary; None when all is done."""
        while True:
            with self.change:
                for queue in (self.left, self.waiting):
                    if queue:
                        return queue.popleft()
                if not self.away:
                    return None
                self.change.wait(_PAUSE)
            self._tell()

    def _hand_out(self, helper: Helper) -> None:
        """Let a helper solve chunks until none is left; leave unanswered chunks to this process."""
        while True:
            while not helper.ready.wait(_PAUSE):
                if not self.waiting or helper.ended:
                    return
            with self.change:
                if not self.waiting:
                    return
                chunk = self.waiting.pop()
                self.away += 1
            try:
                first = self.problems[chunk[0]]
                found = helper.solve(first.pepper, first.scene, [self.problems[k] for k in chunk])
                self._record(chunk, found)
            except UnansweredError:
                with self.change:
                    self.left.append(chunk)
            finally:
                with self.change:
                    self.away -= 1
                    self.change.notify()

    def _record(self, chunk: Sequence[int], found: Sequence[Outcome]) -> None:
        with self.change:
            for number, outcome in zip(chunk, found, strict=True):
                self.outcomes[number] = outcome
            self.done += len(chunk)

    def _tell(self) -> None:
        if self.progress is not None and self.reported < self.done:
            self.reported = self.done
            self.progress(self.reported, len(self.problems))
