"""The contact problem solved by Newton steps on velocities, in machine code."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.twin.world.cholesky import factor, solve

Array = NDArray[np.float64]

ITERATIONS = 60
LINE_STEPS = 40
DECREMENT = 1e-20
"""Kinetic energy that a further step would take off, at which there is none [J]."""


@njit("void(float64[:, ::1], float64[::1], float64[::1])", **OPTIONS)
def times(matrix: Array, vector: Array, result: Array) -> None:
    """Write the product of a matrix and a vector."""
    for i in range(matrix.shape[0]):
        total = 0.0
        for k in range(matrix.shape[1]):
            total += matrix[i, k] * vector[k]
        result[i] = total


@njit("void(float64[::1], float64[::1], float64[::1], float64[:, ::1])", **OPTIONS)
def edges(slip: Array, drop: Array, friction: Array, result: Array) -> None:
    """Write y = v_n +- mu v_t + drop of every point's four edges, from rows (v_n, v_1, v_2)."""
    for c in range(len(drop)):
        normal = slip[3 * c] + drop[c]
        first, second = friction[c] * slip[3 * c + 1], friction[c] * slip[3 * c + 2]
        result[c, 0], result[c, 1] = normal + first, normal - first
        result[c, 2], result[c, 3] = normal + second, normal - second


@njit("void(float64[:, ::1], float64[::1], float64[::1], float64[::1])", **OPTIONS)
def impulses(y: Array, soft: Array, friction: Array, result: Array) -> None:
    """Write impulses (normal, first, second tangent) of all points: those of the edges are max(0, -y) / R."""
    for c in range(len(soft)):
        a, b = max(0.0, -y[c, 0]) / soft[c], max(0.0, -y[c, 1]) / soft[c]
        d, e = max(0.0, -y[c, 2]) / soft[c], max(0.0, -y[c, 3]) / soft[c]
        result[3 * c] = a + b + d + e
        result[3 * c + 1] = friction[c] * (a - b)
        result[3 * c + 2] = friction[c] * (d - e)


@njit("float64(float64[:, ::1], float64[:, ::1], float64[::1], float64, float64)", **OPTIONS)
def _length(y: Array, change: Array, soft: Array, slope: float, curve: float) -> float:
    """Return the step along a direction at which the cost is least: the root of a piecewise linear slope."""
    low, high, step = 0.0, math.inf, 1.0
    for _ in range(LINE_STEPS):
        value, rise = slope + step * curve, curve
        for c in range(len(soft)):
            for e in range(4):
                now = y[c, e] + step * change[c, e]
                if now < 0:
                    value += now * change[c, e] / soft[c]
                    rise += change[c, e] ** 2 / soft[c]
        if value > 0:
            high = step
        else:
            low = step
        better = step - value / rise
        if abs(better - step) <= 1e-14 * step:
            return better
        if not low < better < high:
            better = 0.5 * (low + high) if high < math.inf else 2.0 * step
        step = better
    return step


@njit("void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[::1], float64[::1])", **OPTIONS)
def _add_active(hessian: Array, jacobian: Array, y: Array, soft: Array, friction: Array) -> None:
    """Add J_a^T R^-1 J_a of the edges that push to the lower triangle of a matrix."""
    size = len(hessian)
    for c in range(len(soft)):
        mu, stiff = friction[c], 1.0 / soft[c]
        first, second = (stiff if y[c, 0] < 0 else 0.0), (stiff if y[c, 1] < 0 else 0.0)
        third, fourth = (stiff if y[c, 2] < 0 else 0.0), (stiff if y[c, 3] < 0 else 0.0)
        nn = first + second + third + fourth
        if nn == 0:
            continue
        n1, n2 = mu * (first - second), mu * (third - fourth)
        t1, t2 = mu * mu * (first + second), mu * mu * (third + fourth)
        a, b, d = jacobian[3 * c], jacobian[3 * c + 1], jacobian[3 * c + 2]
        for i in range(size):
            x = nn * a[i] + n1 * b[i] + n2 * d[i]
            y1 = n1 * a[i] + t1 * b[i]
            y2 = n2 * a[i] + t2 * d[i]
            if x == 0.0 and y1 == 0.0 and y2 == 0.0:
                continue
            for k in range(i + 1):
                hessian[i, k] += x * a[k] + y1 * b[k] + y2 * d[k]


@njit("void(float64[:, ::1], float64[::1], float64[::1])", **OPTIONS)
def _take_pushes(jacobian: Array, pushes: Array, gradient: Array) -> None:
    """Take J^T p from a gradient."""
    for r in range(len(pushes)):
        if pushes[r] != 0.0:
            for k in range(len(gradient)):
                gradient[k] -= jacobian[r, k] * pushes[r]


@njit("void(float64[::1], float64, float64[::1])", **OPTIONS)
def _move(u: Array, step: float, direction: Array) -> None:
    for k in range(len(u)):
        u[k] += step * direction[k]


@njit("boolean(float64[:, ::1], float64[:, ::1])", **OPTIONS)
def _same_sides(y: Array, change: Array) -> bool:
    """Whether the same edges push after a change."""
    for c in range(len(y)):
        for e in range(4):
            if (y[c, e] + change[c, e] < 0) != (y[c, e] < 0):
                return False
    return True


@njit(
    "int64(float64[:, ::1], float64[::1], float64[:, ::1], float64[::1], float64[::1], float64[::1], "
    "float64[::1], float64[::1])",
    **OPTIONS,
)
def newton(
    mass: Array,
    free: Array,
    jacobian: Array,
    soft: Array,
    drop: Array,
    friction: Array,
    u: Array,
    pushes: Array,
) -> int:
    """Minimise (u - free)^T M (u - free) / 2 + sum over edges of max(0, -y(u))^2 / (2 R).

    The cost is convex, once differentiable and piecewise quadratic.  Newton's step with the exact line search
    ends on the exact minimum (but for rounding) once it is taken in full and no edge changes sides.

    Args:
        mass: M, shape (N, N).
        free: Velocities without contact, shape (N,).
        jacobian: Shape (3 k, N).
        soft: R, shape (k,).
        drop: See `ContactProblem`, shape (k,).
        friction: mu, shape (k,).
        u: The first guess; overwritten by the solution, shape (N,).
        pushes: Overwritten by the impulses, shape (3 k,).

    Returns:
        Number of iterations; -1 where they did not suffice or the matrix is not positive definite.
    """
    size, rows, count = len(free), len(pushes), len(soft)
    slip, moved = np.empty(rows), np.empty(rows)
    y, change = np.empty((count, 4)), np.empty((count, 4))
    direction, gradient, apart = np.empty(size), np.empty(size), np.empty(size)
    hessian, none = np.empty((size, size)), np.zeros(count)
    for iteration in range(ITERATIONS):
        times(jacobian, u, slip)
        edges(slip, drop, friction, y)
        impulses(y, soft, friction, pushes)
        for k in range(size):
            apart[k] = u[k] - free[k]
        times(mass, apart, gradient)
        _take_pushes(jacobian, pushes, gradient)
        for i in range(size):
            for k in range(i + 1):
                hessian[i, k] = mass[i, k]
        _add_active(hessian, jacobian, y, soft, friction)
        if not factor(hessian):
            return -1
        for k in range(size):
            direction[k] = -gradient[k]
        solve(hessian, direction)
        decrement = 0.0
        for k in range(size):
            decrement -= gradient[k] * direction[k]
        if decrement < DECREMENT:
            return iteration
        times(jacobian, direction, moved)
        edges(moved, none, friction, change)
        if _same_sides(y, change):
            _move(u, 1.0, direction)
            times(jacobian, u, slip)
            edges(slip, drop, friction, y)
            impulses(y, soft, friction, pushes)
            return iteration + 1
        slope, curve = 0.0, 0.0
        times(mass, direction, gradient)
        for k in range(size):
            slope += apart[k] * gradient[k]
            curve += direction[k] * gradient[k]
        _move(u, _length(y, change, soft, slope, curve), direction)
    return -1
