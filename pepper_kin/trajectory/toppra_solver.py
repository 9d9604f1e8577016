"""Time-optimal speed along a path by the package toppra."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.trajectory.path_limits import Grid, PathLimits

Array = NDArray[np.float64]

_UNTHREADED_PRODUCT = 200_000  # multiplications that OpenBLAS does without threads
_GREATEST = 1e6  # bound on scaled x where no velocity limit acts; toppra wants numbers


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """Speed along the path at the grid points, or where the search for one ended.

    Attributes:
        speed: ds/dt, shape (N + 1,); None where there is none.
        failed_at: Grid point from which the end cannot be reached; None on success.
    """

    speed: Array | None
    failed_at: int | None = None


def fastest_speed(
    grid: Grid,
    limits: PathLimits,
    row_scale: Array,
    velocity_scale: Array,
    frame_scale: Array | float = 1.0,
) -> SpeedProfile:
    """Return the fastest speed from rest to rest.

    The path's acceleration is constant on each interval, and the limits hold at both ends of each interval
    ("interpolation scheme" of toppra).  toppra works with absolute tolerances, so that the path is scaled to
    unit length and time such that one unit of acceleration is what the limits typically allow.

    Args:
        grid: The path's grid.
        limits: The limits along it.
        row_scale: Factors on `limits.bound`, shape (r,).
        velocity_scale: Factors on `limits.velocity`, shape (n,).
        frame_scale: Factors on the frames' speed limits, shape (f,).

    Returns:
        The profile.
    """
    length = float(grid.s[-1] - grid.s[0])
    bound = limits.bound * row_scale
    speed_bound = limits.speed_bound(velocity_scale, frame_scale)
    time_unit = _time_unit(limits, bound, speed_bound, length)
    gain = length / time_unit**2
    constraints = _canonical_form(grid, limits, bound, gain, length, speed_bound * time_unit**2 / length**2)
    scaled_speed, failed_at = _solve((grid.s - grid.s[0]) / length, constraints)
    if scaled_speed is None:
        return SpeedProfile(None, failed_at)
    return SpeedProfile(scaled_speed * length / time_unit)


def _time_unit(limits: PathLimits, bound: Array, speed_bound: Array, length: float) -> float:
    """Return a time in which the typical acceleration allowed covers the path [s]."""
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(limits.a != 0, np.maximum(bound - np.abs(limits.c), 0.0) / np.abs(limits.a), np.inf)
    u = room.min(axis=-1).ravel() if room.shape[-1] else np.array([])
    u = u[np.isfinite(u) & (u > 0)]
    if u.size:
        return float(np.sqrt(length / np.median(u)))
    x = speed_bound[np.isfinite(speed_bound) & (speed_bound > 0)]
    return float(length / np.sqrt(np.median(x)))


def _canonical_form(
    grid: Grid, limits: PathLimits, bound: Array, gain: float, length: float, x_most: Array
) -> list[tuple[Any, ...]]:
    """Return toppra's (a, b, c, F, g, ubound, xbound) of `|a u + b x + c| <= bound` at both ends.

    With v = (rows at the first end, rows at the second end), F v <= g reads v <= 1, -v <= 1.
    At the second end x is x + 2 D u.  Unit length and time: u = gain u', x = gain L x'.

    The rows come in groups: toppra multiplies each group by its F, and products above a certain size are
    handed to threads, whose start costs more than all the rest where the machine is busy.
    """
    a = limits.a * (gain / bound)
    b = limits.b * (gain * length / bound)
    c = limits.c / bound
    step = (np.diff(grid.s) / length)[:, None]
    rows = [
        np.concatenate([first, second], axis=-1)
        for first, second in ((a[0], a[1] + 2 * step * b[1]), (b[0], b[1]), (c[0], c[1]))
    ]
    rows = [np.concatenate([row, row[-1:]]) for row in rows]  # the last grid point has no interval
    k = rows[0].shape[-1]
    x_bound = np.stack([np.zeros(grid.size + 1), np.minimum(x_most, _GREATEST)], axis=-1)
    constraints: list[tuple[Any, ...]] = [(None, None, None, None, None, None, x_bound)]
    group = max(1, int(np.sqrt(_UNTHREADED_PRODUCT / (2 * (grid.size + 1)))))
    for start in range(0, k, group):
        part = [np.ascontiguousarray(row[:, start : start + group]) for row in rows]
        identity = np.eye(part[0].shape[1])
        constraints.append((*part, np.vstack([identity, -identity]), np.ones(2 * len(identity)), None, None))
    return constraints


def _solve(s: Array, constraints: list[tuple[Any, ...]]) -> tuple[Array | None, int | None]:
    with _quiet():
        from toppra.algorithm import TOPPRA
        from toppra.constraint import DiscretizationType, LinearConstraint

        class Limits(LinearConstraint):
            """Coefficients that were evaluated beforehand."""

            def __init__(self, params: tuple[Any, ...]) -> None:
                super().__init__()
                self._params = params
                self.identical = True
                self.discretization_type = DiscretizationType.Interpolation
                self._format_string = ""

            def compute_constraint_params(self, path: Any, gridpoints: Any, *args: Any) -> Any:
                return self._params

        class Line:
            """toppra asks a path for nothing but its interval where coefficients are given."""

            path_interval = (s[0], s[-1])

        rows = [Limits(params) for params in constraints]
        solver = TOPPRA(rows, Line(), gridpoints=s, solver_wrapper="seidel")
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
def _quiet() -> Iterator[None]:
    """Keep toppra from logging, for this call only: what it reports is in the returned profile."""
    logger = logging.getLogger("toppra")
    level = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(level)
