"""What is made ready once for each set of tasks, and used again with other targets."""

from __future__ import annotations

import hashlib
import threading
from dataclasses import dataclass, field
from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from pepper_kin.batch import kernel
from pepper_kin.ik.fast.structure import Structure
from pepper_kin.ik.problem import motion_scale
from pepper_kin.ik.tasks.task import Array
from pepper_kin.kernels import Kernel, compile_function
from pepper_kin.model import PepperModel
from pepper_kin.model.shapes import read_only

CANDIDATES = 4
HEAVY = 1.5

# Numbers about a search that follow q and the squared errors in its answer.
EXTRA = 3


class Desk(NamedTuple):
    """Arrays for one search at a time.

    Attributes:
        given: Input of `solve_rows`, shape (1, width).
        answers: Its output, shape (1, n + t + EXTRA).
        tolerance: Squared tolerances, shape (t,).
        row: The row of `given`, shape (width,).
        answer: The row of `answers`, shape (n + t + EXTRA,).
    """

    given: Array
    answers: Array
    tolerance: Array
    row: Array
    answer: Array


@dataclass(frozen=True, eq=False)
class Prepared:
    """Compiled code and tables for the tasks of one structure on one robot.

    Attributes:
        kernel: Of `task_function`.
        gravity: Of the gravity torque.
        numbers: Addresses and options, as `solve_rows` takes them, where all tolerances are finite.
        index: Places of the joints that move a task, shape (k,).
        effort: 1 / effort limit, 0 where there is none, shape (n,).
        lower: Lower limits of the joints in `index`, shape (k,).
        upper: Upper limits of the joints in `index`, shape (k,).
        scale: d_i^2 at the neutral posture, shape (k,).
        target_places: Where each task's target lies in a row of input.
        width: Length of a row of input.
        neutral: The neutral posture, shape (n,), read-only.
        all_bounds: `bounds` where all joints may move.
        desks: Those that no thread works at.
    """

    kernel: Kernel
    gravity: Kernel
    numbers: np.ndarray
    index: np.ndarray
    effort: Array
    lower: Array
    upper: Array
    scale: Array
    target_places: tuple[slice, ...]
    width: int
    neutral: Array
    all_bounds: Array
    desks: list[Desk] = field(default_factory=list)

    def desk(self) -> Desk:
        """Return a desk to work at; append it to `desks` when the work is done."""
        try:
            return self.desks.pop()
        except IndexError:
            tasks = len(self.target_places)
            given, answers = np.empty((1, self.width)), np.empty((1, self.effort.size + tasks + EXTRA))
            return Desk(given, answers, np.empty(tasks), given[0], answers[0])

    def bounds(self, lower: Array, upper: Array, moves: np.ndarray) -> Array:
        """Return bounds as `solve_rows` takes them, shape (5, k), of joint vectors (k,)."""
        return np.array([lower, upper, self.scale, self.scale > HEAVY**2, moves], dtype=float)


_kept: WeakKeyDictionary[PepperModel, dict[tuple[Structure, ...], Prepared]] = WeakKeyDictionary()
_lock = threading.Lock()


def prepare(pepper: PepperModel, tasks: tuple[Structure, ...]) -> Prepared:
    """Return what is ready for tasks of these structures; the first time, compile it or read it from disk."""
    known = _kept.get(pepper)
    found = known.get(tasks) if known is not None else None
    if found is None:
        found = _prepare(pepper, tasks)
        with _lock:
            found = _kept.setdefault(pepper, {}).setdefault(tasks, found)
    return found


@lru_cache(maxsize=64)
def unit_points(dimension: int, seed: int, count: int) -> Array:
    """Return the points of `count` restarts in the unit cube, shape (count, CANDIDATES, dimension)."""
    from pepper_kin.ik.restarts import _generalised_golden_ratio

    alpha = _generalised_golden_ratio(dimension) ** -(1.0 + np.arange(dimension))
    first = np.random.default_rng(seed).random(dimension)
    steps = 1.0 + np.arange(count * CANDIDATES)
    return ((first + steps[:, None] * alpha) % 1.0).reshape(count, CANDIDATES, dimension)


def _prepare(pepper: PepperModel, tasks: tuple[Structure, ...]) -> Prepared:
    from pepper_kin.ik.fast.expression import task_function, used_joints

    index = used_joints(pepper, tasks)
    robot = hashlib.sha256(pepper.urdf.encode()).hexdigest()
    step = compile_function(
        lambda: task_function(pepper, tasks, index), key=f"ik {tasks!r} of {robot} by {_source_digest()}"
    )
    gravity = kernel(pepper, "gravity_torque")
    room = max(step.work_size, gravity.work_size) + 8
    stops, place = [], pepper.n + len(tasks)
    for task in tasks:
        stops.append(slice(place, place + task.target_size))
        place += task.target_size
    limited = np.isfinite(pepper.effort_limits) & (pepper.effort_limits > 0)
    index = index.astype(np.int64)
    lower, upper = pepper.lower_limits[index], pepper.upper_limits[index]
    neutral = read_only(pepper.neutral())
    scale = motion_scale(pepper, neutral)[index] ** 2
    return Prepared(
        kernel=step,
        gravity=gravity,
        numbers=np.array([step.single_address, gravity.single_address, room, 1], dtype=np.int64),
        index=index,
        effort=np.where(limited, 1.0 / np.where(limited, pepper.effort_limits, 1.0), 0.0),
        lower=lower,
        upper=upper,
        scale=scale,
        target_places=tuple(stops),
        width=place,
        neutral=neutral,
        all_bounds=np.array([lower, upper, scale, scale > HEAVY**2, np.ones(index.size)], dtype=float),
    )


@lru_cache(maxsize=1)
def _source_digest() -> str:
    digest = hashlib.sha256()
    for room in ("symbolic", "model", "ik.fast", "ik.tasks"):
        for file in sorted(files(f"pepper_kin.{room}").iterdir(), key=lambda f: f.name):
            if file.name.endswith(".py"):
                digest.update(file.read_bytes())
    return digest.hexdigest()
