"""Time-optimal motion along a path within all limits, by the compiled core."""

from __future__ import annotations

import math
import threading
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.timing.constraints import fill_rows, tighten_joints, tighten_states
from pepper_kin.core.timing.grid import coefficient_states, fill_grid, frame_states, interval_count
from pepper_kin.core.timing.parameterization import (
    FOUND,
    NO_PROFILE,
    all_instants,
    evaluate_motion,
    instant_count,
    instants_near_limits,
    motion_polynomials,
    optimal_profile,
    profile_duration,
)
from pepper_kin.core.timing.reachability import fastest_profile
from pepper_kin.core.timing.tables import (
    Instants,
    PathEffects,
    PathGrid,
    PathLimits,
    PathRows,
    ProfileSpace,
    StateEffects,
)
from pepper_kin.core.timing.whole_timing import (
    CHECK_STEP,
    LEAST,
    LONGEST_MOTION,
    MORE,
    TOLERANCE,
    TimedPath,
    time_path,
)
from pepper_kin.dynamics.load import carried_words
from pepper_kin.exceptions import InfeasibleError, beside_limits
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.limits import Limits, quantities_of, share_of
from pepper_kin.trajectory.trajectory import Trajectory, known_trajectory

_GREATEST = 1e12  # squared speed if no velocity limit acts [path lengths^2/s^2]

MOST_TABLES = 256
"""Maximum number of path sizes whose tables a thread keeps."""


class TimingProblem:
    """A path on its grid with the limits along it.

    The tables are views of memory that each thread reuses, because new pages are slow: a problem is valid
    until the next one is made in the same thread.  The tables are filled by `fill` or `fastest`.

    Attributes:
        grid: The path.
        effects: Torques, edge moments and frame speeds at the grid's nodes.
        limits: Limits of the joints.
        rows: Memory for the constraints.
        space: Work space of the search; `x[0]` is the squared speed (ds/dt)^2 at the start, initially 0.
        quantities: Limited quantities, to be evaluated at other states.
        loads: Carried loads.

    Args:
        pepper: The robot.
        breaks: Ends of the path's pieces, increasing, shape (m + 1,).
        coefficients: Coefficients, constant term first [rad or m], shape (m, 4, n).
        intervals: Approximate number of intervals of the grid.
        limits: The limits.
    """

    def __init__(
        self, pepper: PepperModel, breaks: Array, coefficients: Array, intervals: int, limits: Limits
    ) -> None:
        self._names, self._units = pepper.joint_names, pepper.joint_units
        self.quantities, self.loads = quantities_of(pepper, limits), limits.loads
        self._path, self._intervals = (breaks, coefficients), intervals
        torques, edges = self.quantities.torque_limit.size, self.quantities.edges
        count = interval_count(breaks, intervals)
        self._tables = _tables_of(count, len(breaks) - 1, pepper.n, torques, edges)
        self.grid, self.effects, self.rows, self.space = self._tables[:4]
        self.space.x[0] = 0.0
        self.limits = PathLimits(
            limits.velocity, limits.acceleration, self.quantities.torque_limit,
            min(_GREATEST * float(breaks[-1] - breaks[0]) ** 2, limits.path_speed**2),
        )  # fmt: skip

    @property
    def plain(self) -> bool:
        """Whether only velocity, acceleration, and torque without a load are limited."""
        return not (self.quantities.edges or self.quantities.frames or self.loads)

    def fastest(self) -> tuple[int, int | None, float, Trajectory | None]:
        """Fill the tables of a plain problem and search its fastest motion in one call of machine code.

        Returns:
            Status, failed grid point and stretch as `time_path` returns them, and the motion if there is one.
        """
        breaks, coefficients = self._path
        times, motion = self._tables.times, self._tables.motion
        path = TimedPath(
            breaks, coefficients, self.grid, self.effects, self._tables.torques, self.limits, self.rows,
            self.space, self._tables.states, times, motion,
        )  # fmt: skip
        status, failed, stretch = time_path(path, self.quantities.torque_kernel, self._intervals)
        if status != FOUND or stretch == np.inf:
            return status, failed, stretch, None
        return status, failed, stretch, known_trajectory(self._names, self._units, times, motion)

    def fill(self) -> None:
        """Fill the tables of the path, torques, edge moments and frame speeds."""
        quantities, tables, nodes = self.quantities, self._tables, self.grid.at.shape[1]
        fill_grid(*self._path, self._intervals, self.grid)
        if quantities.torque_limit.size or quantities.edges:
            coefficient_states(self.grid.at, tables.states)
            tables.torques[:] = quantities.torque(*tables.states)
            self.effects.moments[:] = quantities.moments(*tables.states).reshape(self.effects.moments.shape)
        if quantities.frames:
            posture = np.empty((2, nodes + self.grid.step.size, self.grid.at.shape[2]))
            frame_states(self.grid, posture)
            speed = quantities.speed(*posture)
            self.effects = self.effects._replace(frame_speed=speed[:nodes], frame_middle=speed[nodes:])

    def share(self, point: int) -> float:
        """Return the position of a grid point along the path, from 0 to 1."""
        s = self.grid.s
        return float((s[point] - s[0]) / (s[-1] - s[0]))

    def trajectory(self, x: Array, stretch: float = 1.0) -> Trajectory:
        """Return the motion with squared speeds (ds/dt)^2 at grid points, (N + 1,), slowed by `stretch`."""
        times, motion = self._tables.times, self._tables.motion
        motion_polynomials(self.grid, x, stretch, times, motion)
        return known_trajectory(self._names, self._units, times, motion)

    def infeasible(self, failed_at: int | None) -> InfeasibleError:
        """Return the error that says why there is no trajectory.

        With velocity and acceleration limits alone there always is one.

        Args:
            failed_at: Grid point at which the search ended.
        """
        torque, limit = self.effects.torque[0], self.limits.torque
        use = share_of(np.abs(torque), limit)  # 0 for wheels, which do not accelerate at rest
        if use.size and use.max() >= 1.0:
            node, joint = np.unravel_index(int(np.argmax(use)), use.shape)
            needed, most = beside_limits(abs(torque[node, joint]), limit[joint], outside=True)
            reason = (
                f"{self._names[joint]} needs {needed} N m to hold still against gravity"
                f"{carried_words(self.loads)} {self._node_share(node):.0%} along the path, "
                f"and its limit is {most} N m"
            )
            advice = "choose a path with less load on that joint" + (", or carry less" if self.loads else "")
            return InfeasibleError("trajectory", reason, advice)
        moments = self.effects.moments[0]
        if moments.size and moments.min() < 0:
            node = np.argmin(moments.min(axis=1))
            reason = f"{self._node_share(node):.0%} along the path the robot would tip over even at rest"
            nearer = (
                "choose a path whose center of mass is nearer to the middle of the wheels, or less balance"
            )
            return InfeasibleError("trajectory", reason, nearer)
        x, (least, most) = self.space.x[0], self.space.reach[0]
        if failed_at == 0 and x > 0.0 and most > 0.0:
            bound = f"at most {np.sqrt(most / x):.6g}" if x > most else f"at least {np.sqrt(least / x):.6g}"
            reason = f"along the path start_velocity could be {bound} times as large"
            return InfeasibleError("trajectory", reason, "another start_velocity, or `Trajectory.replaced`")
        where = "" if failed_at is None else f" from {self.share(failed_at):.0%} of it on"
        return InfeasibleError(
            "trajectory",
            f"no speed along the path obeys all limits{where}",
            "raise the scales, use more grid points, or smooth the path",
        )

    def _node_share(self, node: np.intp) -> float:
        """Return the position of a node along the path, from 0 to 1."""
        interval = int(np.searchsorted(self.grid.first, node, side="right")) - 1
        return self.share(interval + int(node - self.grid.first[interval]))


class _Tables(NamedTuple):
    """Tables for paths of one size; the states share memory with the work space."""

    grid: PathGrid
    effects: PathEffects
    rows: PathRows
    space: ProfileSpace
    states: Array
    torques: Array
    times: Array
    motion: Array


class _Memory(threading.local):
    """Memory of a thread, and tables by their sizes, which all share this memory."""

    def __init__(self) -> None:
        self.workspace, self.tables = np.empty(0), dict[tuple[int, ...], _Tables]()


_memory = _Memory()


def _tables_of(size: int, segments: int, n: int, torques: int, edges: int) -> _Tables:
    """Return this thread's tables of `size` intervals."""
    key = size, segments, n, torques, edges
    found = _memory.tables.get(key)
    if found is not None:
        return found
    nodes, r = size + segments, n + torques + edges
    total = (
        nodes * (3 * n + 6 * r) + size * (4 * n + 3 * (r - n) + 2 * r + 10)
        + max(9 * nodes * n, size * 3 * (2 * r + 1)) + size * (7 * n + 1) + 11
    )  # fmt: skip
    if _memory.workspace.size < total or len(_memory.tables) >= MOST_TABLES:
        _memory.tables.clear()
        _memory.workspace = np.empty(max(2 * total, _memory.workspace.size))
    workspace, used = _memory.workspace, 0

    def take(*shape: int) -> Array:
        nonlocal used
        begin, used = used, used + math.prod(shape)
        return np.asarray(workspace[begin:used].reshape(shape))

    grid = PathGrid(take(size), np.empty(size, np.int64), take(size + 1), take(3, nodes, n), take(size, 4, n))
    rows = PathRows(
        take(nodes, r), take(nodes, r), take(nodes, r), take(3, size, r - n), take(size, r), take(size, r),
        take(size + 1),
    )  # fmt: skip
    torque, moments = take(3, nodes, torques), take(3, nodes, edges)
    effects = PathEffects(torque, moments, np.empty((nodes, 0)), np.empty((size, 0)))
    times, motion = take(size + 1), take(size, 7, n)
    span, reach, x, best, begin = take(size, 3), take(size + 1, 2), take(size + 1), take(size + 1), used
    states = take(3, 3 * nodes, n)
    used = begin
    space = ProfileSpace(take(size, 3, 2 * r + 1), span, reach, np.ones(size, np.bool_), x, best)
    torque_rows = torque.reshape(3 * nodes, torques)
    found = _Tables(grid, effects, rows, space, states, torque_rows, times, motion)
    _memory.tables[key] = found
    return found


class TooLongError(Exception):
    """A motion that is too long to be checked every millisecond; `retime` turns it into the user's error.

    Attributes:
        duration: Lower bound on the motion's duration [s].
    """

    def __init__(self, duration: float) -> None:
        super().__init__(f"{duration} s")
        self.duration = duration


def refuse_long(duration: float) -> None:
    """Refuse a motion of more milliseconds than memory can hold.

    Raises:
        TooLongError: for a duration longer than `LONGEST_MOTION`.
    """
    if duration > LONGEST_MOTION:
        raise TooLongError(duration)


_TRIALS = 9  # maximum number of solutions with tightened limits if time cannot be stretched
_MARGINS = (1e-3, 1e-5)  # fractions of limits left unused there, tried in turn


def fastest_motion(problem: TimingProblem, start: float = 0.0) -> Trajectory:
    """Return the fastest motion along a path to rest that keeps limits.

    Velocity and acceleration keep their limits at every instant, the other quantities at both ends of every
    interval and at every multiple of 1 ms.  If a limit is exceeded between grid points, the limit of that
    interval is tightened by the excess before the passes are run again; the remaining excess is removed by
    stretching time (see `pepper_kin.core.timing.parameterization`).  Multiples of 1 ms are examined only on
    intervals where a limit is near.  A motion that will be stretched begins faster by the same factor.

    Args:
        problem: The path and its limits.
        start: ds/dt at the start [1/s].

    Raises:
        InfeasibleError: if there is no such motion, with the reason.
        TooLongError: for a motion longer than `LONGEST_MOTION`.
    """
    stretch = 1.0
    for _ in range(_TRIALS):
        problem.space.x[0] = (start * stretch) ** 2
        status, failed, needed, found = _fastest(problem)
        if status == NO_PROFILE:
            raise problem.infeasible(failed)
        if found is None or start == 0.0:
            break
        if needed <= stretch:
            return problem.trajectory(problem.space.best, stretch)
        stretch = needed * (1.0 + LEAST)
    if status == FOUND and found is None:
        refuse_long(profile_duration(problem.grid, problem.space.best))
    if start > 0.0:
        reason = "in motion from the start, it passes postures that the robot can barely hold"
        raise InfeasibleError("trajectory", reason, "`Trajectory.replaced`, or a path with less load")
    return _motion_without_rest(problem) if found is None else found


def _fastest(problem: TimingProblem) -> tuple[int, int | None, float, Trajectory | None]:
    """Search the fastest motion from the squared speed at the start, as `TimingProblem.fastest` does."""
    if problem.plain:
        return problem.fastest()
    problem.fill()
    status, failed, stretch = optimal_profile(
        problem.grid, problem.effects, problem.limits, problem.rows, problem.space
    )
    if status == FOUND:
        stretch = _stretched(problem, problem.space.best, stretch)
        if np.isfinite(stretch):
            return status, failed, stretch, problem.trajectory(problem.space.best, stretch)
    return status, failed, stretch, None


def _stretched(problem: TimingProblem, x: Array, stretch: float) -> float:
    """Return the stretch of the motion x, shape (N + 1,), that all limits need; inf if none helps."""
    limit, edges = problem.limits.torque, problem.quantities.edges
    if problem.quantities.frames:
        stretch = _slow_enough_for_frames(problem, x, stretch)
    if limit.size:
        stretch = _kept(problem, x, stretch, limit, 0)
    if edges:
        stretch = _kept(problem, x, stretch, np.zeros(edges), limit.size)
    return stretch


def _slow_enough_for_frames(problem: TimingProblem, x: Array, stretch: float) -> float:
    """Return the stretch of the motion x, (N + 1,), that speeds of frames and wheels need every 1 ms."""
    grid, n = problem.grid, problem.grid.at.shape[2]
    duration = profile_duration(grid, x)
    while np.isfinite(stretch):
        refuse_long(duration * stretch)
        sample_times = _workspace_for(duration, stretch)
        state = np.empty((3, all_instants(grid, x, stretch, CHECK_STEP, sample_times), n))
        evaluate_motion(grid, x, sample_times, stretch, state)
        most = float(problem.quantities.speed(state[0], state[1]).max())
        if most <= 1.0 + TOLERANCE:
            break
        stretch *= most * (1.0 + LEAST)  # speeds are inversely proportional; the next instants differ
    return stretch


def _kept(problem: TimingProblem, x: Array, stretch: float, limit: Array, begin: int) -> float:
    """Return the stretch that torques, or edge moments, need at multiples of 1 ms near their limits.

    Args:
        problem: The path and its limits.
        x: Squared speeds (ds/dt)^2 at the grid points, shape (N + 1,).
        stretch: Factor by which the motion is slower than x.
        limit: Limits as `LimitedQuantities.torque_limit`, or 0 for each edge moment, shape (k,).
        begin: Index of the first of the quantities among torques and edge moments.

    Returns:
        Factor by which the motion has to be slower than x; inf if none helps.
    """
    grid, n = problem.grid, problem.grid.at.shape[2]
    duration = profile_duration(grid, x)
    while np.isfinite(stretch):
        refuse_long(duration * stretch)
        sample_times = _workspace_for(duration, stretch)
        count = instants_near_limits(grid, problem.rows, limit, begin, x, stretch, CHECK_STEP, sample_times)
        if not count:
            break
        state, none = np.empty((3, count, n)), np.empty((count, 0))
        evaluate_motion(grid, x, sample_times, stretch, state)
        if limit[0]:
            asked, bound = StateEffects(problem.quantities.torque(*state), none, none), limit
        else:
            asked, bound = StateEffects(none, problem.quantities.moments(*state), none), np.empty(0)
        interval = sample_times.interval[:count]
        more = tighten_states(grid, bound, problem.rows, n + begin, interval, asked, False)
        if more <= 1.0 + TOLERANCE:
            break
        stretch *= 1.0 + MORE * (more - 1.0) + LEAST  # the next instants differ
    return stretch


def _workspace_for(duration: float, stretch: float) -> Instants:
    count = instant_count(duration, stretch, CHECK_STEP)
    return Instants(np.empty(count, np.int64), np.empty(count))


def _motion_without_rest(problem: TimingProblem) -> Trajectory:
    """Search a motion through postures that the robot could not hold, where slower is not easier.

    Raises:
        InfeasibleError: if none is found.
    """
    for margin in _MARGINS:
        found, failed = _swing(problem, margin)
        if found is not None:
            return found
    raise problem.infeasible(failed)


def _swing(problem: TimingProblem, margin: float) -> tuple[Trajectory | None, int | None]:
    """Return a motion with a fraction of the limits left unused, or the grid point where the search ended."""
    grid, limits, rows, space = problem.grid, problem.limits, problem.rows, problem.space
    begin_moments = grid.at.shape[2] + limits.torque.size
    fill_rows(grid, problem.effects, limits, rows)
    rows.low[...] += margin * np.where(np.isfinite(rows.low), np.abs(rows.low), 0.0)
    rows.high[...] -= margin * np.where(np.isfinite(rows.high), np.abs(rows.high), 0.0)
    rows.low[:, begin_moments:] += margin
    rows.x_most[...] *= 1.0 - 2 * margin
    slower = 1.0
    for trial in range(_TRIALS):
        failed = fastest_profile(grid, rows, space)
        if failed >= 0:
            return None, failed
        x, before = space.x, rows.x_most.copy()
        slower = tighten_joints(grid, limits, rows, x, 0.0, space.changed)
        slower = max(slower, _tightened_by_states(problem, x, 1.0, True))
        if slower <= 1.0 + TOLERANCE:
            return problem.trajectory(x), None
        # The speed inside an interval depends on both ends, but the bound may act at one end only: lowering
        # it by the excess may leave half of the excess, so it is lowered more each time.
        rows.x_most[...] *= (rows.x_most / before) ** trial
    # The remaining excess is small: a motion slowed by as little may still keep all limits.
    stretch = slower * (1.0 + LEAST)
    if np.isfinite(stretch) and _tightened_by_states(problem, space.x, stretch, False) <= 1.0 + TOLERANCE:
        return problem.trajectory(space.x, stretch), None
    return None, None


def _tightened_by_states(problem: TimingProblem, x: Array, stretch: float, tighten: bool) -> float:
    """Return the stretch that torques, balance and frame speeds at every multiple of 1 ms need.

    Args:
        problem: The path and its limits.
        x: Squared speeds (ds/dt)^2 at the grid points, shape (N + 1,).
        stretch: Factor by which the motion is slower than x.
        tighten: Whether the limits on x are lowered by the excess.
    """
    grid, n = problem.grid, problem.grid.at.shape[2]
    refuse_long(profile_duration(grid, x) * stretch)
    sample_times = _workspace_for(profile_duration(grid, x), stretch)
    count = all_instants(grid, x, stretch, CHECK_STEP, sample_times)
    state = np.empty((3, count, n))
    evaluate_motion(grid, x, sample_times, stretch, state)
    asked, limit = problem.quantities.of(*state), problem.limits.torque
    return float(tighten_states(grid, limit, problem.rows, n, sample_times.interval, asked, tighten))
