"""The fastest motion along a path that keeps all limits, by the compiled core."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.timing.constraints import fill_rows, tighten_joints, tighten_states
from pepper_kin.core.timing.parameterization import (
    FOUND,
    NO_PROFILE,
    all_instants,
    evaluate_motion,
    instant_count,
    instants_near_limits,
    optimal_profile,
    profile_duration,
)
from pepper_kin.core.timing.reachability import fastest_profile
from pepper_kin.core.timing.tables import Instants, StateEffects
from pepper_kin.core.timing.whole_timing import CHECK_STEP, LEAST, LONGEST_MOTION, MORE, TOLERANCE
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.trajectory.timing_problem import TimingProblem
from pepper_kin.trajectory.trajectory import Trajectory


class TooLongError(Exception):
    """A motion that is too long to be checked every millisecond; `retime` makes the user's error of it.

    Attributes:
        duration: What it would take at least [s].
    """

    def __init__(self, duration: float) -> None:
        super().__init__(f"{duration} s")
        self.duration = duration


def refuse_long(duration: float) -> None:
    """Refuse a motion that has more milliseconds than memory has place for.

    Raises:
        TooLongError: for one longer than `LONGEST_MOTION`.
    """
    if duration > LONGEST_MOTION:
        raise TooLongError(duration)


_TRIALS = 9  # solutions with tightened limits where time cannot be stretched
_MARGINS = (1e-3, 1e-5)  # shares of limits left unused there, to be tried in turn


def fastest_motion(problem: TimingProblem, start: float = 0.0) -> Trajectory:
    """Return the fastest motion along a path to rest that keeps limits.

    Velocity and acceleration keep their limits at every instant, the others at both ends of every interval
    and at every multiple of 1 ms.  Where a limit is exceeded between grid points, that interval's is
    tightened by the excess before the passes are run again; what is left is removed by stretching time (see
    `pepper_kin.core.timing.parameterization`).  Of the multiples of 1 ms, those are examined that lie on
    intervals where a limit is near.  A motion that is going to be stretched begins faster by as much.

    Args:
        problem: The path and its limits.
        start: ds/dt at the start [1/s].

    Raises:
        InfeasibleError: where there is none, saying why.
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
    """Search the fastest motion from the squared speed at the start; see `TimingProblem.fastest`."""
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
    """Return how much slower than x, shape (N + 1,), all limits ask to be; inf if of no use."""
    limit, edges = problem.limits.torque, problem.quantities.edges
    if problem.quantities.frames:
        stretch = _slow_enough_for_frames(problem, x, stretch)
    if limit.size:
        stretch = _kept(problem, x, stretch, limit, 0)
    if edges:
        stretch = _kept(problem, x, stretch, np.zeros(edges), limit.size)
    return stretch


def _slow_enough_for_frames(problem: TimingProblem, x: Array, stretch: float) -> float:
    """Return how much slower than x, shape (N + 1,), frames and wheels ask to be at multiples of 1 ms."""
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
        stretch *= most * (1.0 + LEAST)  # speeds are in proportion; the instants looked at next are others
    return stretch


def _kept(problem: TimingProblem, x: Array, stretch: float, limit: Array, begin: int) -> float:
    """Look at torques, or edge moments (with limits of 0), at every multiple of 1 ms where they are near.

    Args:
        problem: The path and its limits.
        x: Squared speeds (ds/dt)^2 at the grid points, shape (N + 1,).
        stretch: How much slower than x the motion is.
        limit: As `LimitedQuantities.torque_limit`, or 0 for each edge moment, shape (k,).
        begin: Number of torques and edge moments before the first of them.

    Returns:
        How much slower than x they ask to be; inf if that is of no use.
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
        stretch *= 1.0 + MORE * (more - 1.0) + LEAST  # the instants looked at next are others
    return stretch


def _workspace_for(duration: float, stretch: float) -> Instants:
    count = instant_count(duration, stretch, CHECK_STEP)
    return Instants(np.empty(count, np.int64), np.empty(count))


def _motion_without_rest(problem: TimingProblem) -> Trajectory:
    """Search for a motion past postures that the robot could not hold: there, slower is not easier.

    Raises:
        InfeasibleError: where none is found.
    """
    for margin in _MARGINS:
        found, failed = _swing(problem, margin)
        if found is not None:
            return found
    raise problem.infeasible(failed)


def _swing(problem: TimingProblem, margin: float) -> tuple[Trajectory | None, int | None]:
    """Return a motion with a share of the limits left unused, or the grid point where the search ended."""
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
        # The speed inside an interval depends on both ends, of which the bound may act at one only: by
        # lowering it as much as the excess, half of that may be left.  So lower it more each time.
        rows.x_most[...] *= (rows.x_most / before) ** trial
    # What is left of the excess is small: a motion that is slower by so little may still keep all limits.
    stretch = slower * (1.0 + LEAST)
    if np.isfinite(stretch) and _tightened_by_states(problem, space.x, stretch, False) <= 1.0 + TOLERANCE:
        return problem.trajectory(space.x, stretch), None
    return None, None


def _tightened_by_states(problem: TimingProblem, x: Array, stretch: float, tighten: bool) -> float:
    """Return how much slower torques, balance and frames at every multiple of 1 ms ask to be.

    Args:
        problem: The path and its limits.
        x: Squared speeds (ds/dt)^2 at the grid points, shape (N + 1,).
        stretch: How much slower than x the motion is.
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
