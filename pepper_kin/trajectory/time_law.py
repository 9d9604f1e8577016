"""From a speed along a path to positions as polynomials of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.trajectory.path_limits import Grid
from pepper_kin.trajectory.trajectory import Trajectory

Array = NDArray[np.float64]


def compose(pepper: PepperModel, grid: Grid, speed: Array) -> Trajectory:
    """Return q(s(t)) exactly, for constant d2s/dt2 between grid points.

    On an interval s(t) = s_i + w t + h t^2, with w its first speed and h half its acceleration, so that with
    d = s - s_i
        d = w t + h t^2,   d^2 = w^2 t^2 + 2 w h t^3 + h^2 t^4,
        d^3 = w^3 t^3 + 3 w^2 h t^4 + 3 w h^2 t^5 + h^3 t^6,
    and q is a polynomial of degree 6.

    Args:
        pepper: The robot, which gives the names.
        grid: The path's grid.
        speed: ds/dt at the grid points, shape (N + 1,); no two successive ones may both be zero.

    Returns:
        The trajectory.
    """
    step = np.diff(grid.s)
    w, w_next = speed[:-1], speed[1:]
    h = (w_next**2 - w**2) / (4 * step)
    time = 2 * step / (w + w_next)
    zero = np.zeros_like(w)
    powers = np.array(
        [
            [1 + zero, zero, zero, zero, zero, zero, zero],
            [zero, w, h, zero, zero, zero, zero],
            [zero, zero, w**2, 2 * w * h, h**2, zero, zero],
            [zero, zero, zero, w**3, 3 * w**2 * h, 3 * w * h**2, h**3],
        ]
    )
    taylor = [grid.path.at(grid.piece, grid.local[0], p) / (1, 1, 2, 6)[p] for p in range(4)]
    coefficients = np.einsum("dpi,din->ipn", powers, np.array(taylor))
    breaks = np.concatenate([[0.0], np.cumsum(time)])
    return Trajectory(pepper.joint_names, breaks, coefficients, pepper.joint_units)


def slower(trajectory: Trajectory, factor: float) -> Trajectory:
    """Return the trajectory that takes `factor` times as long along the same path."""
    return trajectory.scaled(factor)
