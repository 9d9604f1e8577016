"""Complete timing of a piecewise cubic path in one call, up to the polynomials of its fastest motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.kernel_batch import evaluate_batch
from pepper_kin.core.timing.constraints import tighten_states
from pepper_kin.core.timing.grid import coefficient_states, fill_grid
from pepper_kin.core.timing.parameterization import (
    FOUND,
    evaluate_motion,
    instant_count,
    instants_near_limits,
    motion_polynomials,
    optimal_profile,
    profile_duration,
)
from pepper_kin.core.timing.tables import (
    Instants,
    PathEffects,
    PathGrid,
    PathLimits,
    PathRows,
    ProfileSpace,
    StateEffects,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1

CHECK_STEP = 0.001
"""Time between the samples at which torques are examined [s]."""

LONGEST_MOTION = 3600.0
"""Maximum duration of a motion [s]: a longer one is not examined every millisecond, and is refused."""

MORE, LEAST = 1.1, 2e-6
"""Factor on the violation, and added ratio, by which a motion is stretched a little more than necessary."""

TOLERANCE = 1e-9
"""Tolerance relative to a limit, for rounding."""


class TorqueKernel(NamedTuple):
    """Kernel of the torques of many states.

    Attributes:
        address: Address of the `batch` of a kernel from q, v and a to torques.
        work: Workspace of the kernel, shape (>= work_size,).
        words: Workspace, shape (8,).
    """

    address: int
    work: Floats1
    words: Ints1


class TimedPath(NamedTuple):
    """A path to be timed, with output and workspace.

    Attributes:
        breaks: Ends of the segments, shape (m + 1,).
        curve: Coefficients, constant term first, shape (m, 4, n).
        grid: Output: the path on its grid.
        effects: Output: its torques, without moments and frame speeds.
        torques: The memory of `effects.torque` with a row for each state, shape (3 M, n or 0) [N m or N].
        limits: Limits, including torque.
        rows: Output: the constraints.
        space: Workspace of the search; `states` may share memory with its `lines`.
        states: Workspace, shape (3, 3 M, n).
        times: Output: times at the grid points, shape (N + 1,) [s].
        motion: Output: segments of the motion, constant term first, shape (N, 7, n).
    """

    breaks: Floats1
    curve: Floats3
    grid: PathGrid
    effects: PathEffects
    torques: Floats2
    limits: PathLimits
    rows: PathRows
    space: ProfileSpace
    states: Floats3
    times: Floats1
    motion: Floats3


@compiled
def _write_torques(kernel: TorqueKernel, states: Array, torque: Array) -> None:
    """Write the torques [N m or N], shape (T, n), of states, shape (3, T, n)."""
    evaluate_batch(kernel.address, states[0], states[1], states[2], torque, kernel.work, kernel.words)


@compiled
def _kept(path: TimedPath, kernel: TorqueKernel, stretch: float) -> float:
    """Examine torques at every multiple of 1 ms where they are near their limits; return the stretch factor.

    The result is inf for a motion that would take longer than `LONGEST_MOTION`.
    """
    grid, rows, limit, x, n = path.grid, path.rows, path.limits.torque, path.space.best, path.curve.shape[2]
    duration = profile_duration(grid, x)
    while stretch < np.inf:
        if duration * stretch > LONGEST_MOTION:
            return np.inf
        count_most = instant_count(duration, stretch, CHECK_STEP)
        samples = Instants(np.empty(count_most, np.int64), np.empty(count_most))
        count = instants_near_limits(grid, rows, limit, 0, x, stretch, CHECK_STEP, samples)
        if count == 0:
            break
        states, torque, none = np.empty((3, count, n)), np.empty((count, n)), np.empty((count, 0))
        evaluate_motion(grid, x, samples, stretch, states)
        _write_torques(kernel, states, torque)
        asked = StateEffects(torque, none, none)
        more = tighten_states(grid, limit, rows, n, samples.interval[:count], asked, False)
        if more <= 1.0 + TOLERANCE:
            break
        stretch *= 1.0 + MORE * (more - 1.0) + LEAST  # the next samples lie elsewhere
    return stretch


@compiled("Tuple(int64, int64, float64)(TimedPath, TorqueKernel, int64)")
def time_path(path: TimedPath, kernel: TorqueKernel, intervals: int) -> tuple[int, int, float]:
    """Find the fastest motion along a path within limits of velocity, acceleration and torque.

    Args:
        path: The path; its output and workspace are written.
        kernel: Kernel of the torques.
        intervals: Minimum number of intervals of the grid, as assumed by the sizes of the arrays.

    Returns:
        Status, grid point and stretch factor as of `optimal_profile`: if the status is FOUND and the factor
        is finite, `times` and `motion` are written, and the factor includes torques.
    """
    grid = path.grid
    fill_grid(path.breaks, path.curve, intervals, grid)
    if path.limits.torque.size > 0:
        coefficient_states(grid.at, path.states)
        _write_torques(kernel, path.states, path.torques)
    status, failed, stretch = optimal_profile(grid, path.effects, path.limits, path.rows, path.space)
    if status == FOUND and path.limits.torque.size > 0:
        stretch = _kept(path, kernel, stretch)
    if status == FOUND and stretch < np.inf:
        motion_polynomials(grid, path.space.best, stretch, path.times, path.motion)
    return status, failed, stretch
