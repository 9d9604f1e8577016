"""The compiled search as Python sees it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pepper_kin.ik.fast.loop import solve_rows
from pepper_kin.ik.fast.prepared import EXTRA, Prepared, prepare, unit_points
from pepper_kin.ik.fast.structure import structures_of, target_of
from pepper_kin.ik.result import Found, Status
from pepper_kin.ik.tasks.task import Array, Task
from pepper_kin.model import PepperModel

STATUSES = (Status.SOLVED, Status.CLOSEST_UNREACHABLE, Status.CLOSEST_LIMITS)
"""By the number that the compiled search writes."""


def solve_one(
    prepared: Prepared,
    tasks: Sequence[Task],
    q0: Array,
    movable: np.ndarray | None,
    seed: int,
    restarts: int,
    max_iterations: int,
) -> Found:
    """Search for one set of targets.

    Args:
        prepared: What is ready for tasks of these structures.
        tasks: The tasks.
        q0: The start, within the limits, shape (n,).
        movable: Joints that may move, shape (n,); None for all.
        seed: Draws the restarts.
        restarts: Number of restarts at most.
        max_iterations: Steps from each start.
    """
    n, desk = q0.size, prepared.desk()
    row, tolerance, stop = desk.row, desk.tolerance, True
    row[:n] = q0
    for k, (task, targets) in enumerate(zip(tasks, prepared.target_places, strict=True)):
        weight, allowed = task.weight, task.tolerance
        row[n + k] = weight * weight
        row[targets] = target_of(task)
        tolerance[k] = allowed * allowed
        stop = stop and allowed < math.inf
    solve_rows(
        numbers_for(prepared, stop), prepared.index, bounds_for(prepared, q0, movable), prepared.effort,
        tolerance, unit_points(prepared.index.size, seed, restarts), max_iterations, desk.given,
        desk.answers, 0, 1,
    )  # fmt: skip
    q = desk.answer[:n].copy()
    q.setflags(write=False)
    status, iterations, used = desk.answer[-EXTRA:].tolist()
    prepared.desks.append(desk)
    return Found(q, STATUSES[int(status)], int(iterations), int(used))


def numbers_for(prepared: Prepared, stop_when_met: bool) -> np.ndarray:
    """Return the addresses and options of a call."""
    if stop_when_met:
        return prepared.numbers
    numbers = prepared.numbers.copy()
    numbers[3] = 0
    return numbers


def bounds_for(prepared: Prepared, q0: Array, movable: np.ndarray | None) -> Array:
    """Return the bounds of the joints that the tasks depend on; those that may not move stay at q0."""
    if movable is None:
        return prepared.all_bounds
    moves, here = movable[prepared.index], q0[prepared.index]
    lower, upper = np.where(moves, prepared.lower, here), np.where(moves, prepared.upper, here)
    return prepared.bounds(lower, upper, moves)


class Rows:
    """Many sets of targets, solved piece by piece on any thread.

    Args:
        pepper: The robot.
        tasks: The tasks; some have N targets.
        starts: q0 of each row, within the limits, shape (N, n).
        movable: Joints that may move, shape (n,); None for all.
        seed: Draws the restarts.
        restarts: Number of restarts at most.
        max_iterations: Steps from each start.

    Attributes:
        statuses: The status of each number that `answers` gives.
    """

    def __init__(
        self,
        pepper: PepperModel,
        tasks: Sequence[Task],
        starts: Array,
        movable: np.ndarray | None,
        seed: int,
        restarts: int,
        max_iterations: int,
    ) -> None:
        prepared = prepare(pepper, structures_of(tasks))
        n, t = pepper.n, len(tasks)
        self.statuses = STATUSES
        self._given = np.empty((len(starts), prepared.width))
        self._given[:, :n] = starts
        self._given[:, n : n + t] = [task.weight**2 for task in tasks]
        for place, task in zip(prepared.target_places, tasks, strict=True):
            targets = getattr(task, task.target_name)
            self._given[:, place] = targets.reshape(-1, place.stop - place.start)
        moves = np.ones(prepared.index.size) if movable is None else movable[prepared.index]
        bounds = prepared.bounds(prepared.lower, prepared.upper, moves)
        tolerance = np.array([task.tolerance**2 for task in tasks])
        numbers = numbers_for(prepared, all(task.tolerance < math.inf for task in tasks))
        points = unit_points(prepared.index.size, seed, restarts)
        self._answers = np.empty((len(starts), n + t + EXTRA))
        self._prepared, self._sizes = prepared, (n, t)
        self._fixed = (numbers, prepared.index, bounds, prepared.effort, tolerance, points, max_iterations)

    def solve(self, begin: int, end: int) -> None:
        """Solve some rows; the interpreter is free for other threads meanwhile."""
        solve_rows(*self._fixed, self._given, self._answers, begin, end)

    def answers(self) -> tuple[Array, np.ndarray, Array, np.ndarray, np.ndarray]:
        """Return q, status numbers, errors, iterations and restarts of all rows."""
        n, t = self._sizes
        counts = self._answers[:, n + t :].astype(np.int64)
        errors = np.sqrt(self._answers[:, n : n + t])
        return self._answers[:, :n].copy(), counts[:, 0], errors, counts[:, 1], counts[:, 2]


def alternatives(
    pepper: PepperModel,
    tasks: Sequence[Task],
    q0: Array,
    movable: np.ndarray | None,
    seed: int,
    count: int,
    max_iterations: int,
) -> list[Array]:
    """Return solutions that `count` starts lead to, those nearest to q0 first.

    The starts lie ever farther from q0 on the way to points that fill the joint box evenly.
    """
    prepared = prepare(pepper, structures_of(tasks))
    index = prepared.index
    here = q0[index]
    low, high = np.maximum(prepared.lower, here - np.pi), np.minimum(prepared.upper, here + np.pi)
    points = unit_points(index.size, seed, count)[:, 0]
    reach = np.linspace(1 / max(count, 1), 1, count)[:, None]
    starts = np.tile(q0, (count, 1))
    starts[:, index] += reach * (low + points * (high - low) - here)
    if movable is not None:
        starts[:, ~movable] = q0[~movable]
    return solutions_from(pepper, tasks, q0, movable, starts, max_iterations)


def solutions_from(
    pepper: PepperModel,
    tasks: Sequence[Task],
    q0: Array,
    movable: np.ndarray | None,
    starts: Array,
    max_iterations: int,
) -> list[Array]:
    """Return solutions that given starts, shape (m, n), lead to, those nearest to q0 first.

    Joints that no task depends on stay where a start has them; how far they move counts unweighted.
    """
    prepared = prepare(pepper, structures_of(tasks))
    rows = Rows(pepper, tasks, starts, movable, 0, 0, max_iterations)
    rows.solve(0, len(starts))
    q, status, *_ = rows.answers()
    solved = q[status == STATUSES.index(Status.SOLVED)]
    scale = np.ones(q0.size)
    scale[prepared.index] = prepared.scale
    motion = ((solved - q0) ** 2 * scale).sum(axis=1)
    return list(solved[np.argsort(motion, kind="stable")])
