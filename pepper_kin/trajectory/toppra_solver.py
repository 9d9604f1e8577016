"""Time-optimal speed along a path by the package toppra, for reference."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.timing.constraints import fill_rows
from pepper_kin.core.timing.whole_timing import CHECK_STEP
from pepper_kin.exceptions import InfeasibleError, optional
from pepper_kin.kernels.working_time import not_counted
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.active_limits import measure_use, stretch_at_extremes
from pepper_kin.trajectory.limits import Limits
from pepper_kin.trajectory.samples import sample_times
from pepper_kin.trajectory.time_optimal import TimingProblem, refuse_long
from pepper_kin.trajectory.trajectory import Trajectory

_ROUNDS = 4  # maximum number of solutions with tightened limits before time is stretched
_SMALL_STRETCH = 1e-3  # relative slow-down below which stretching time is cheaper than solving again
_INSIDE = (0.5,)  # fractions of each interval at which limits are examined, besides its ends
_MORE = 1.0 + 2e-6  # additional factor on stretches, because the next instants examined differ
_TOLERANCE = 1e-9  # violation attributed to rounding, relative to the limit
_UNTHREADED_PRODUCT = 200_000  # number of multiplications that OpenBLAS does without threads
_GREATEST = 1e6  # bound on scaled x if no velocity limit acts; toppra needs finite numbers
_FARTHEST = 20.0  # upper bound on edge moments over their maximum at rest; toppra needs finite numbers


def toppra_motion(pepper: PepperModel, problem: TimingProblem, limits: Limits) -> Trajectory:
    """Return the fastest motion along a path by toppra; all limits hold at every multiple of 1 ms.

    The path's acceleration is constant on each interval, and the limits hold at both ends of each interval
    ("interpolation scheme" of toppra).  Then the motion is examined; limits are tightened along the whole
    path by their largest excess until they nearly hold, and time is stretched until they do.

    Args:
        pepper: The robot.
        problem: The path and its limits.
        limits: The same limits, for the examination.

    Raises:
        InfeasibleError: if there is no such motion, with the reason.
    """
    allowed, effects = problem.limits, problem.effects
    best: Trajectory | None = None
    failed_at: int | None = None
    for _ in range(_ROUNDS):
        fill_rows(problem.grid, effects, allowed, problem.rows)
        x, failed_at = _fastest_profile(problem)
        if x is None:
            break
        candidate = problem.trajectory(x)
        use = measure_use(pepper, candidate.at_segments(*_inspection_points(candidate)), limits)
        if np.isfinite(use.stretch) and (best is None or candidate.duration * use.stretch < best.duration):
            best = candidate.scaled(use.stretch * _MORE)
        if use.stretch <= 1.0 + _SMALL_STRETCH:
            break
        over = {quantity: np.maximum(1.0, share) for quantity, share in use.share.items()}
        allowed = allowed._replace(
            velocity=allowed.velocity / over["velocity"],
            acceleration=allowed.acceleration / over["acceleration"],
            torque=allowed.torque / over["torque"] if allowed.torque.size else allowed.torque,
        )
        if limits.speed:
            effects = effects._replace(frame_speed=effects.frame_speed * over["frame speed"])
    if best is None:
        raise problem.infeasible(failed_at)
    return _hold_every_millisecond(pepper, best, limits)


def _inspection_points(trajectory: Trajectory) -> tuple[NDArray[np.intp], Array]:
    """Return pieces and local times [s] of both ends of every piece and of points inside."""
    h = np.diff(trajectory.breaks)
    share = np.array([0.0, *_INSIDE, 1.0])
    return np.repeat(np.arange(h.size), share.size), (h[:, None] * share).ravel()


def _hold_every_millisecond(pepper: PepperModel, trajectory: Trajectory, limits: Limits) -> Trajectory:
    """Slow a motion, if necessary, until all limits hold every 1 ms, velocity and acceleration always."""
    while True:
        refuse_long(trajectory.duration)
        state = trajectory(sample_times(trajectory.duration, CHECK_STEP))
        stretch = max(measure_use(pepper, state, limits).stretch, stretch_at_extremes(trajectory, limits))
        if stretch <= 1.0 + _TOLERANCE:
            return trajectory
        if not np.isfinite(stretch):
            raise InfeasibleError(
                "trajectory",
                "between grid points the path passes postures that need more torque than the limits allow",
                "use more grid points",
            )
        trajectory = trajectory.scaled(stretch * _MORE)


def _fastest_profile(problem: TimingProblem) -> tuple[Array | None, int | None]:
    """Return the squared speed at the grid points, or the grid point from which the end cannot be reached.

    toppra works with absolute tolerances, so that the path is scaled to unit length and time such that one
    unit of acceleration is what the limits typically allow: u = gain u', x = gain length x'.
    """
    grid, rows = problem.grid, problem.rows
    finite = np.isfinite(rows.low[0]) | np.isfinite(rows.high[0])
    low, high = (bound[0][finite] for bound in (rows.low, rows.high))
    high = np.where(np.isfinite(high), high, low + _FARTHEST * np.abs(rows.c[:, finite]).max(initial=1e-3))
    middle, bound = (low + high) / 2, (high - low) / 2
    ends = np.stack([grid.first, grid.first + 1])
    a, b, c = (row[ends][..., finite] for row in (rows.a, rows.b, rows.c))
    c = c - middle
    # If a resting joint cannot be held, or a joint needs effort but has none, no speed is possible; toppra
    # would divide by zero.
    rests = (a == 0) & (b == 0)
    stuck = ((rests & (np.abs(c) > bound)) | (~rests & (bound == 0))).any(axis=(0, 2))
    if stuck.any():
        return None, int(np.argmax(stuck))
    some = bound > 0
    a, b, c, bound = a[..., some], b[..., some], c[..., some], bound[some]
    length = float(grid.s[-1] - grid.s[0])
    time_unit = _time_unit(a, c, bound, rows.x_most[rows.x_most < problem.limits.x], length)
    gain = length / time_unit**2
    scaled = a * (gain / bound), b * (gain * length / bound), c / bound
    x_most = rows.x_most * time_unit**2 / length**2
    speed, failed_at = _solve(
        (grid.s - grid.s[0]) / length, _canonical_form(grid.step / length, *scaled, x_most)
    )
    return (None, failed_at) if speed is None else ((speed * length / time_unit) ** 2, None)


def _time_unit(a: Array, c: Array, bound: Array, x_most: Array, length: float) -> float:
    """Return a time in which the typical acceleration allowed covers the path [s].

    Args:
        a: Gains on u at both ends of the intervals, shape (2, N, r).
        c: Values at rest less the middle of their bounds, shape (2, N, r).
        bound: Half the width of the bounds, shape (r,).
        x_most: Upper bounds on x that limits of speed set, shape (k,).
        length: Length of the path, in its parameter.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        slack = np.where(a != 0, np.maximum(bound - np.abs(c), 0.0) / np.abs(a), np.inf)
    u = slack.min(axis=-1).ravel() if slack.shape[-1] else np.array([])
    u = u[np.isfinite(u) & (u > 0)]
    if u.size:
        return float(np.sqrt(length / np.median(u)))
    return float(length / np.sqrt(np.median(x_most)))


def _canonical_form(step: Array, a: Array, b: Array, c: Array, x_most: Array) -> list[tuple[Any, ...]]:
    """Return toppra's (a, b, c, F, g, ubound, xbound) of `|a u + b x + c| <= 1` at both ends.

    With v = (rows at the first end, rows at the second end), F v <= g reads v <= 1, -v <= 1.
    At the second end x is x + 2 D u.  Arrays have shape (2, N, r).

    The rows are split into groups: toppra multiplies each group by its F, and products above a certain size
    use threads, whose start dominates on a busy machine.
    """
    rows = [
        np.concatenate([first, second], axis=-1)
        for first, second in ((a[0], a[1] + 2 * step[:, None] * b[1]), (b[0], b[1]), (c[0], c[1]))
    ]
    rows = [np.concatenate([row, row[-1:]]) for row in rows]  # the last grid point has no interval: repeat
    count = rows[0].shape[-1]
    x_bound = np.stack([np.zeros(x_most.size), np.minimum(x_most, _GREATEST)], axis=-1)
    constraints: list[tuple[Any, ...]] = [(None, None, None, None, None, None, x_bound)]
    group = max(1, int(np.sqrt(_UNTHREADED_PRODUCT / (2 * x_most.size))))
    for start in range(0, count, group):
        part = [np.ascontiguousarray(row[:, start : start + group]) for row in rows]
        identity = np.eye(part[0].shape[1])
        constraints.append((*part, np.vstack([identity, -identity]), np.ones(2 * len(identity)), None, None))
    return constraints


def _solve(s: Array, constraints: list[tuple[Any, ...]]) -> tuple[Array | None, int | None]:
    """Return the scaled speed at grid points, or the grid point from which the end cannot be reached.

    Args:
        s: Path parameter at the grid points, from 0 to 1, shape (N + 1,).
        constraints: Constraints in toppra's form, as `_canonical_form` returns them.

    Returns:
        Speed, shape (N + 1,), or None; and the grid point, or None.
    """
    with _silent():
        with not_counted():
            algorithm = optional("toppra.algorithm", extra="reference", need='solver="toppra"')
            from toppra.constraint import DiscretizationType, LinearConstraint

        class GivenLimits(LinearConstraint):
            """Coefficients that were evaluated beforehand."""

            def __init__(self, params: tuple[Any, ...]) -> None:
                super().__init__()
                self._params = params
                self.identical = True
                self.discretization_type = DiscretizationType.Interpolation
                self._format_string = ""

            def compute_constraint_params(self, path: Any, gridpoints: Any, *args: Any) -> Any:
                return self._params

        class GivenInterval:
            """Path with only its interval, which is all that toppra needs if coefficients are given."""

            path_interval = (s[0], s[-1])

        rows = [GivenLimits(params) for params in constraints]
        solver = algorithm.TOPPRA(rows, GivenInterval(), gridpoints=s, solver_wrapper="seidel")
        _, speed, _, controllable = solver.compute_parameterization(0.0, 0.0, return_data=True)
    if speed is None:
        empty = np.flatnonzero(np.isnan(controllable).any(axis=1))
        return None, int(empty.max()) if empty.size else 0
    if np.isnan(speed).any():
        return None, int(np.flatnonzero(np.isnan(speed))[0])
    if np.any((speed[:-1] + speed[1:]) <= 0):
        return None, int(np.flatnonzero(speed[:-1] + speed[1:] <= 0)[0])
    return np.asarray(speed), None


@contextmanager
def _silent() -> Iterator[None]:
    """Keep toppra from logging, for this call only: what it reports is in the returned profile."""
    logger = logging.getLogger("toppra")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)
