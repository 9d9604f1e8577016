"""Time-optimal speed along a path, in compiled code from the way-points to the polynomials."""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.trajectory import fast_samples  # noqa: F401  (a trajectory evaluates by it once it is there)
from pepper_kin.trajectory.fast_effects import Effects
from pepper_kin.trajectory.fast_motion import (
    inspect,
    inspect_joints,
    instants,
    motion,
    polynomials,
    rows_at_nodes,
    speed_bound,
    times,
)
from pepper_kin.trajectory.fast_passes import passes
from pepper_kin.trajectory.fast_path import nodes, spline_within
from pepper_kin.trajectory.fast_search import (
    FOUND,
    NO_SPEED,
    coefficient_states,
    frame_states,
    lines_size,
    near_limits,
    search,
)
from pepper_kin.trajectory.limit_use import Limits
from pepper_kin.trajectory.path import LIMIT_TOLERANCE, SAME, PathLike

Array = NDArray[np.float64]

CHECK_STEP = 0.001  # [s]
_TRIALS = 9  # solutions with tightened limits where time cannot be stretched
_MORE, _LEAST = 1.1, 2e-6  # stretch a little further than needed
_SHRINK = 1e-3  # share of limits left unused where time cannot be stretched
_TOLERANCE = 1e-9  # of a limit, for rounding
_GREATEST = 1e12  # squared speed where no velocity limit acts, in path lengths squared a second squared


_memory = threading.local()


@dataclass(frozen=True, eq=False)
class FastResult:
    """A time law and its polynomials, or where the search for one ended.

    Attributes:
        breaks: Times at the grid points [s], shape (N + 1,); None where there is no time law.
        coefficients: Constant term first, shape (N, 7, n).
        failed_at: Share of the path's length from which the end cannot be reached; None on success.
    """

    breaks: Array | None
    coefficients: Array | None
    failed_at: float | None = None


def quick_spline(pepper: PepperModel, path: PathLike) -> tuple[Array, Array] | None:
    """Return what `as_cubic_path` makes of way-points; None where it has something to say about them."""
    points = path if isinstance(path, np.ndarray) else None
    if points is None:
        try:
            points = np.asarray(path, dtype=float)
        except (TypeError, ValueError):
            return None
    if points.ndim != 2 or points.shape[1] != pepper.n or len(points) < 2 or points.dtype.kind not in "fiu":
        return None
    if not points.flags.writeable or not points.flags.c_contiguous or points.dtype != np.float64:
        points = np.array(points, dtype=float, order="C")
    lower, upper = pepper.lower_limits, pepper.upper_limits
    within, breaks, coefficients = spline_within(points, lower, upper, SAME, LIMIT_TOLERANCE)
    return (breaks, coefficients) if within else None


def fast_time_law(
    pepper: PepperModel, breaks: Array, coefficients: Array, intervals: int, limits: Limits
) -> FastResult:
    """Return the fastest motion along a path from rest to rest that keeps limits.

    Velocity and acceleration keep their limits at every instant, the others at both ends of every interval
    and at every multiple of 1 ms.  Where a limit is exceeded between grid points, that interval's is
    tightened by the excess before the passes are run again; what is left is removed by stretching time (see
    `pepper_kin.trajectory.fast_search`).  Of the multiples of 1 ms, those are examined that lie on intervals
    where a limit is near.

    Args:
        pepper: The robot.
        breaks: Ends of the path's pieces, shape (m + 1,).
        coefficients: Constant term first, shape (m, 4, n).
        intervals: Least number of intervals.
        limits: The limits.
    """
    task = _Task(pepper, breaks, coefficients, intervals, limits)
    found = search(
        task.step, task.first, task.at, task.taylor, task.torque, task.effects.torque_limit, task.moments,
        task.frame_speed, task.frame_middle, task.velocity, task.acceleration, task.greatest,
        task.room,
    )  # fmt: skip
    x, stretch = found[1:3]
    if found[0] == FOUND:
        stretch = _stretched(task, x, stretch, found[3:])
    elif found[0] != NO_SPEED:
        slow = _WithoutRest(task)
        alone = slow.solve()
        if alone is None:
            return FastResult(None, None, slow.failed_at)
        x, stretch = alone, 1.0
    if found[0] == NO_SPEED or not np.isfinite(stretch):
        return FastResult(None, None, 0.0)
    time, powers = polynomials(task.taylor, task.step, x, stretch)
    return FastResult(time, powers)


def _room(size: int) -> Array:
    """Return memory for intermediate numbers, kept by each thread, for new pages would take long."""
    kept = getattr(_memory, "room", None)
    if kept is None or kept.size < size:
        kept = _memory.room = np.empty(2 * size)
    return np.asarray(kept)


class _Task:
    """A path on its grid, and what its nodes ask for."""

    def __init__(
        self, pepper: PepperModel, breaks: Array, coefficients: Array, intervals: int, limits: Limits
    ) -> None:
        self.effects = effects = Effects(pepper, limits)
        self.step, self.first, self.at, self.taylor, self.s = nodes(breaks, coefficients, intervals)
        self.velocity, self.acceleration = np.array(limits.velocity), np.array(limits.acceleration)
        self.greatest = _GREATEST * float(breaks[-1] - breaks[0]) ** 2
        count = self.at.shape[1]
        torques, edges = effects.torque_limit.size, 0 if effects.polygon is None else len(effects.polygon)
        rows = self.at.shape[2] + torques + edges
        self.room = _room(max(9 * self.at[0].size, lines_size(self.step.size, rows)))
        self.torque, self.moments = np.empty((3, count, torques)), np.empty((3, count, edges))
        if torques or edges:
            states = coefficient_states(self.at, self.room)
            self.torque = effects.torque(*states).reshape(3, count, torques)
            self.moments = effects.moments(*states).reshape(3, count, edges)
        q, first = frame_states(self.at, self.taylor, self.step) if limits.speed else self.at[:2]
        speed = effects.speed(q, first)
        self.frame_speed, self.frame_middle = speed[:count], speed[count:]


def _stretched(task: _Task, x: Array, stretch: float, rows: tuple[Array, Array, Array, Array]) -> float:
    """Return how much slower than x says torques and balance ask to be; inf if that is of no use."""
    effects = task.effects
    if effects.torque_limit.size:
        stretch = _kept(task, x, stretch, rows, effects.torque_limit, 0)
    if task.moments.shape[2]:
        stretch = _kept(task, x, stretch, rows, np.zeros(task.moments.shape[2]), effects.torque_limit.size)
    return stretch


def _kept(
    task: _Task, x: Array, stretch: float, rows: tuple[Array, Array, Array, Array], limit: Array, begin: int
) -> float:
    """Look at torques, or edge moments (with limits of 0), at every multiple of 1 ms where they are near."""
    n, empty = task.taylor.shape[2], np.zeros((0, 0))
    while np.isfinite(stretch):
        interval, state = near_limits(
            task.step, task.first, task.taylor, *rows, limit, x, stretch, CHECK_STEP, begin
        )
        if not interval.size:
            break
        none = np.zeros((interval.size, 0))
        if limit[0]:
            asked = task.effects.torque(*state), limit, none, none
        else:
            asked = none, np.zeros(0), task.effects.moments(*state), none
        more = inspect(interval, n + begin, *asked, rows[2], task.first, empty, empty, np.zeros(0), False)
        if more <= 1.0 + _TOLERANCE:
            break
        stretch *= 1.0 + _MORE * (more - 1.0) + _LEAST  # the instants looked at next are others
    return stretch


class _WithoutRest:
    """Search for a motion past postures that the robot could not hold: there, slower is not easier."""

    def __init__(self, task: _Task) -> None:
        self.task, self.effects, self.n = task, task.effects, task.taylor.shape[2]
        self.a, self.b, self.c, self.low, self.high = rows_at_nodes(
            task.at, task.first, task.step.size, task.acceleration,
            task.torque, self.effects.torque_limit, task.moments,
        )  # fmt: skip
        self.x_most = speed_bound(task.at, task.first, task.velocity, task.frame_speed, task.greatest)
        self.failed_at = 0.0

    def solve(self) -> Array | None:
        """Return x that keeps all limits as it is; None where none is found."""
        task = self.task
        self.low += _SHRINK * np.where(np.isfinite(self.low), np.abs(self.low), 0.0)
        self.high -= _SHRINK * np.where(np.isfinite(self.high), np.abs(self.high), 0.0)
        self.low[:, self.n + self.effects.torque_limit.size :] += _SHRINK
        self.x_most *= 1.0 - 2 * _SHRINK
        changed = np.zeros(task.step.size, bool)
        joints = task.velocity, task.acceleration, self.low, self.high, self.x_most, 0.0, changed
        rows = self.a, self.b, self.c, self.low, self.high, self.x_most
        for trial in range(_TRIALS):
            x, failed = passes(task.step, task.first, *rows)
            if failed >= 0:
                self.failed_at = float((task.s[failed] - task.s[0]) / (task.s[-1] - task.s[0]))
                return None
            before = self.x_most.copy()
            if max(inspect_joints(task.taylor, task.step, x, *joints), self._rest(x)) <= 1.0 + _TOLERANCE:
                return np.asarray(x)
            # The speed inside an interval hangs on both ends, of which the bound may act at one only: by
            # lowering it as much as the excess, half of that may be left.  So lower it more each time.
            self.x_most *= (self.x_most / before) ** trial
        return None

    def _rest(self, x: Array) -> float:
        """Return how much slower limits but those of joints' motion ask to be; tighten them."""
        task, effects = self.task, self.effects
        interval, local = instants(times(task.step, x), 1.0, CHECK_STEP)
        q, v, a = motion(task.taylor, task.step, x, interval, local, 1.0)
        asked = effects.torque(q, v, a), effects.torque_limit, effects.moments(q, v, a), effects.speed(q, v)
        bounds = self.c, task.first, self.low, self.high, self.x_most
        return float(inspect(interval, self.n, *asked, *bounds, True))
