"""Coulomb's law by a few convex problems: what slips lift is taken off, and pyramids turn to the slips."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.twin.world.newton import newton, times

Array = NDArray[np.float64]

SWEEPS = 10
LIFT = 1e-4
"""A further problem is solved where a slip lifts by more than this [m/s]."""


@njit("void(float64[:, ::1], float64[::1], float64[::1], float64[::1])", **OPTIONS)
def first_shift(jacobian: Array, start: Array, friction: Array, shift: Array) -> None:
    """Write mu |v_t| of every point before the step."""
    slip = np.empty(3 * len(friction))
    times(jacobian, start, slip)
    for c in range(len(friction)):
        shift[c] = friction[c] * math.hypot(slip[3 * c + 1], slip[3 * c + 2])


@njit("void(float64[::1], float64[:, ::1], float64[::1], float64[::1])", **OPTIONS)
def velocities(free: Array, response: Array, pushes: Array, u: Array) -> None:
    """Write free + M^-1 J^T p."""
    for k in range(len(u)):
        u[k] = free[k]
    for r in range(len(pushes)):
        if pushes[r] != 0.0:
            for k in range(len(u)):
                u[k] += response[r, k] * pushes[r]


@njit(
    "float64(float64[:, ::1], float64[::1], float64[::1], float64[::1], float64[::1], float64[::1], "
    "float64[::1])",
    **OPTIONS,
)
def lift(
    jacobian: Array, u: Array, pushes: Array, drop: Array, friction: Array, shift: Array, slip: Array
) -> float:
    """Return by how much a slip that was not allowed for lifts or lowers a point that matters [m/s]."""
    times(jacobian, u, slip)
    worst = 0.0
    for c in range(len(drop)):
        if pushes[3 * c] <= 0.0 and slip[3 * c] + drop[c] > -LIFT:
            continue
        first, second = abs(slip[3 * c + 1]), abs(slip[3 * c + 2])
        length = math.hypot(first, second)
        off = friction[c] * (length - max(first, second))
        worst = max(worst, off + abs(friction[c] * length - shift[c]))
    return worst


@njit("void(float64[:, ::1], int64, float64, float64)", **OPTIONS)
def _turn(matrix: Array, row: int, a: float, b: float) -> None:
    """Turn two rows by an angle of cosine a and sine b."""
    for k in range(matrix.shape[1]):
        x, y = matrix[row, k], matrix[row + 1, k]
        matrix[row, k], matrix[row + 1, k] = a * x + b * y, a * y - b * x


@njit(
    "void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1], "
    "float64[::1], int64)",
    **OPTIONS,
)
def follow(
    jacobian: Array,
    response: Array,
    tangents: Array,
    rows: Array,
    slip: Array,
    friction: Array,
    shift: Array,
    sweep: int,
) -> None:
    """Take over the slips: their share of the drop, and half of the way to their directions.

    A pyramid looks the same after a quarter turn, so that no turn is longer than an eighth.  All the way, a
    point's slip and its direction can chase one another; shorter steps with every sweep end that.
    """
    turning = 1.0 / (1 + sweep)
    sharing = 1.0 if sweep < 4 else 0.5
    for c in range(len(friction)):
        a, b = slip[3 * c + 1], slip[3 * c + 2]
        length = math.hypot(a, b)
        shift[c] += sharing * (friction[c] * length - shift[c])
        if length < LIFT:
            continue
        turn = math.atan2(b, a)
        turn = turning * (turn - 0.5 * math.pi * round(turn / (0.5 * math.pi)))
        a, b = math.cos(turn), math.sin(turn)
        _turn(jacobian, 3 * c + 1, a, b)
        _turn(response, 3 * c + 1, a, b)
        x, y, z = tangents[c, 0], tangents[c, 1], tangents[c, 2]
        nx, ny, nz = rows[c, 3], rows[c, 4], rows[c, 5]
        tangents[c, 0] = a * x + b * (ny * z - nz * y)
        tangents[c, 1] = a * y + b * (nz * x - nx * z)
        tangents[c, 2] = a * z + b * (nx * y - ny * x)


@njit(
    "Tuple((int64, int64, float64))(float64[:, ::1], float64[::1], float64[::1], float64[:, ::1], "
    "float64[:, ::1], float64[::1], float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], "
    "float64[::1], float64[::1])",
    **OPTIONS,
)
def solve_compiled(
    mass: Array,
    free: Array,
    start: Array,
    jacobian: Array,
    response: Array,
    soft: Array,
    drop: Array,
    friction: Array,
    tangents: Array,
    rows: Array,
    u: Array,
    pushes: Array,
) -> tuple[int, int, float]:
    """Solve a step by Newton's method; write velocities and impulses.

    Returns:
        Newton steps, -1 if it failed; convex problems; the lift that is left [m/s].
    """
    shift, shifted, slip = np.empty(len(drop)), np.empty(len(drop)), np.empty(len(pushes))
    first_shift(jacobian, start, friction, shift)
    guess = start.copy()
    total, left = 0, 0.0
    for sweep in range(1, SWEEPS + 1):
        for c in range(len(drop)):
            shifted[c] = drop[c] + shift[c]
        steps = newton(mass, free, jacobian, soft, shifted, friction, guess, pushes)
        if steps < 0:
            return -1, sweep, left
        total += steps
        velocities(free, response, pushes, u)
        left = lift(jacobian, u, pushes, drop, friction, shift, slip)
        if left <= LIFT or sweep == SWEEPS:
            return total, sweep, left
        follow(jacobian, response, tangents, rows, slip, friction, shift, sweep)
    return total, SWEEPS, left
