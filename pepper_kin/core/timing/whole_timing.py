"""Whole timing of a piecewise cubic path in one call, down to the polynomials of its fastest motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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

Array = NDArray[np.float64]

CHECK_STEP = 0.001
"""Torques and edge moments are looked at at multiples of this [s]."""

MORE, LEAST = 1.1, 2e-6
"""A motion is stretched a little further than needed: by so many times the excess, and by so much."""

TOLERANCE = 1e-9
"""Of a limit, for rounding."""


class TorqueKernel(NamedTuple):
    """What gives the torques of many states.

    Attributes:
        address: Of the `batch` of a kernel from q, v and a to torques.
        work: As large as the kernel asks.
        words: Room for 8 numbers.
    """

    address: int
    work: Floats1
    words: Ints1


class TimedPath(NamedTuple):
    """A path whose timing is sought, with room for all that is worked out on the way.

    Attributes:
        breaks: Ends of the pieces, shape (m + 1,).
        curve: Coefficients, constant term first, shape (m, 4, n).
        grid: Room for the path on its grid.
        effects: Room for its torques; no moments and no speeds of frames.
        torques: The same memory with a row for each state, shape (3 M, n or 0).
        limits: Its limits, those of torque included.
        rows: Room for the constraints.
        space: Work space of the search, of which `states` may share memory with `lines`.
        states: Room, shape (3, 3 M, n).
        times: Receives the times at the grid points, shape (N + 1,).
        motion: Receives the pieces of the motion, constant term first, shape (N, 7, n).
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
    """Write the torques of states, shape (3, T, n)."""
    evaluate_batch(kernel.address, states[0], states[1], states[2], torque, kernel.work, kernel.words)


@compiled
def _kept(path: TimedPath, kernel: TorqueKernel, stretch: float) -> float:
    """Look at torques at every multiple of 1 ms where they are near their limits; return the stretch."""
    grid, rows, limit, x, n = path.grid, path.rows, path.limits.torque, path.space.best, path.curve.shape[2]
    duration = profile_duration(grid, x)
    while stretch < np.inf:
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
        stretch *= 1.0 + MORE * (more - 1.0) + LEAST  # the samples examined next are others
    return stretch


@compiled("Tuple(int64, int64, float64)(TimedPath, TorqueKernel, int64)")
def time_path(path: TimedPath, kernel: TorqueKernel, intervals: int) -> tuple[int, int, float]:
    """Find the fastest motion along a path within limits of velocity, acceleration and torque.

    Args:
        path: The path; its scratch arrays are written to.
        kernel: Of the torques.
        intervals: Least number of intervals of the grid, those that the arrays are made for.

    Returns:
        As `optimal_profile`: where the status is FOUND and the stretch is finite, `times` and `motion` are
        written, and the stretch is what torques need as well.
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


@compiled("int64(float64[::1], float64[:, :, ::1], float64, int64[::1])")
def find_kinks(breaks: Floats1, curve: Floats3, least: float, kinks: Ints1) -> int:
    """Find the breaks at which the derivative of a piecewise cubic path jumps.

    Args:
        breaks: Ends of the pieces, shape (m + 1,).
        curve: Coefficients, constant term first, shape (m, 4, n).
        least: Jumps up to this part of the derivatives are rounding.
        kinks: Receives the places among the breaks, room for m.

    Returns:
        Their number.
    """
    found = 0
    for i in range(1, curve.shape[0]):
        h, before, after, gap = breaks[i] - breaks[i - 1], 0.0, 0.0, 0.0
        for j in range(curve.shape[2]):
            first, second, third = curve[i - 1, 1, j], curve[i - 1, 2, j], curve[i - 1, 3, j]
            end, start = first + (2.0 * second + 3.0 * third * h) * h, curve[i, 1, j]
            before, after, gap = max(before, abs(end)), max(after, abs(start)), max(gap, abs(start - end))
        if gap > least * (before + after + least):
            kinks[found] = i
            found += 1
    return found
