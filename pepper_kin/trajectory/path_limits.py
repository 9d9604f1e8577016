"""Limits of a robot along a path, linear in the path's acceleration and squared speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.balance import WHEELS, edge_moments, support_polygon
from pepper_kin.trajectory.limit_use import Limits
from pepper_kin.trajectory.path import CubicPath
from pepper_kin.trajectory.payload import frame_speed_shares, joint_torque

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Grid:
    """A path cut into intervals, none of which spans a break of the path.

    Attributes:
        path: The path.
        s: Path parameter at the grid points, shape (N + 1,).
        piece: Piece of the path that holds each interval, shape (N,).
        local: Path parameter at both ends of each interval since the start of its piece, shape (2, N).
    """

    path: CubicPath
    s: Array
    piece: NDArray[np.intp]
    local: Array

    @property
    def size(self) -> int:
        """Number of intervals N."""
        return int(self.piece.size)

    def at_ends(self, derivative: int) -> Array:
        """Return a derivative of q(s) at both ends of every interval, from inside it, shape (2, N, n)."""
        return self.path.at(self.piece, self.local, derivative)


def make_grid(path: CubicPath, intervals: int) -> Grid:
    """Cut a path into at least `intervals` intervals of about equal size that keep all its breaks."""
    h = np.diff(path.breaks)
    counts = np.maximum(1, np.ceil(intervals * h / h.sum() - 1e-9)).astype(int)
    piece = np.repeat(np.arange(h.size), counts)
    number = np.arange(piece.size) - np.repeat(np.cumsum(counts) - counts, counts)
    step = h / counts
    local = np.stack([number * step[piece], (number + 1) * step[piece]])
    local[1, np.cumsum(counts) - 1] = h
    s = np.append(path.breaks[piece] + local[0], path.breaks[-1])
    return Grid(path, s, piece, local)


@dataclass(frozen=True, eq=False)
class PathLimits:
    """Limits along a path in terms of u = d2s/dt2 and x = (ds/dt)^2.

    At either end of each interval, for every row,
        |a u + b x + c| <= bound,   and   x <= speed_bound.
    Acceleration: a = q', b = q'', c = 0.  Torque: a = M q', b = M q'' + C(q, q') q', c = g.  Balance: the
    moments of the floor's force about the edges of the support polygon.
    Pham and Pham, A new approach to time-optimal path parameterization based on reachability analysis,
    IEEE Trans. Robotics 34 (2018).

    Attributes:
        names: (quantity, joint) of every row; for balance ("balance", edge).
        a: shape (2, N, r).
        b: shape (2, N, r).
        c: shape (2, N, r).
        bound: shape (r,).
        velocity: Joint velocity limits [rad/s or m/s], shape (n,).
        derivative: q' at both ends of each interval, shape (2, N, n).
        frame_speed: |dp/ds| of frames over their speed limits, shape (2, N, f).
    """

    names: tuple[tuple[str, str], ...]
    a: Array
    b: Array
    c: Array
    bound: Array
    velocity: Array
    derivative: Array
    frame_speed: Array

    def speed_bound(self, velocity_scale: Array | float = 1.0, frame_scale: Array | float = 1.0) -> Array:
        """Return the greatest x at every grid point that velocity and speed limits allow, shape (N + 1,)."""
        with np.errstate(divide="ignore"):
            x = np.min((velocity_scale * self.velocity / np.abs(self.derivative)) ** 2, axis=-1)
            if self.frame_speed.shape[-1]:
                x = np.minimum(x, np.min((frame_scale / self.frame_speed) ** 2, axis=-1))
        bound = np.full(x.shape[1] + 1, np.inf)
        bound[:-1] = x[0]
        bound[1:] = np.minimum(bound[1:], x[1])
        return bound


def path_limits(pepper: PepperModel, grid: Grid, limits: Limits) -> PathLimits:
    """Evaluate the coefficients at all grid points at once.

    Args:
        pepper: The robot.
        grid: The path's grid.
        limits: The limits; inf for none.

    Returns:
        The limits along the path; joints without a finite limit have no row.
    """
    q, first, second = (grid.at_ends(derivative) for derivative in range(3))
    kinds = [("acceleration", limits.acceleration, (first, second, np.zeros_like(first)))]
    if limits.torque is not None and np.isfinite(limits.torque).any():
        kinds.append(("torque", limits.torque, _torque_coefficients(pepper, limits, q, first, second)))
    names: list[tuple[str, str]] = []
    rows: list[tuple[Array, Array, Array, Array]] = []
    for quantity, limit, (a, b, c) in kinds:
        finite = np.isfinite(limit)
        names += [(quantity, joint) for joint, use in zip(pepper.joint_names, finite, strict=True) if use]
        rows.append((a[..., finite], b[..., finite], c[..., finite], limit[finite]))
    if limits.balance is not None:
        names += [("balance", f"edge {k}") for k in range(3)]
        rows.append(_balance_coefficients(pepper, limits, q, first, second, limits.balance))
    a, b, c, bound = (np.concatenate(part, axis=-1) for part in zip(*rows, strict=True))
    speed = frame_speed_shares(pepper, limits.speed, q, first)
    return PathLimits(tuple(names), a, b, c, bound, limits.velocity, first, speed)


def _torque_coefficients(
    pepper: PepperModel, limits: Limits, q: Array, first: Array, second: Array
) -> tuple[Array, Array, Array]:
    c, a, b = joint_torque(pepper, limits.payload, *_three_states(q, first, second))
    return a - c, b - c, c


def _balance_coefficients(
    pepper: PepperModel, limits: Limits, q: Array, first: Array, second: Array, margin: float
) -> tuple[Array, Array, Array, Array]:
    """Return rows that keep each edge moment h = a u + b x + c at zero or above.

    Rows are two-sided, |a u + b x + (c - B)| <= B, with B beyond what any motion reaches: the weight at an
    arm of a metre.
    """
    from pepper_kin import dynamics

    polygon = support_polygon(pepper)
    if polygon is None:
        raise InvalidValueError("balance", margin, f"None for a robot without {', '.join(WHEELS)}")
    c, a, b = edge_moments(pepper, polygon, *_three_states(q, first, second), margin, limits.payload)
    mass = dynamics.total_mass(pepper) + sum(held for _, held in limits.payload)
    most = np.full(len(polygon), 9.81 * mass)
    return a - c, b - c, c - most, most


def _three_states(q: Array, first: Array, second: Array) -> tuple[Array, Array, Array]:
    """Return q, v and a of rest, of unit path acceleration and of unit path speed, shape (3, ..., n) each."""
    still = np.zeros_like(q)
    return np.stack([q, q, q]), np.stack([still, still, first]), np.stack([still, first, second])
