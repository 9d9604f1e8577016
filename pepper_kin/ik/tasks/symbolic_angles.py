"""Symbolic angles between directions and between orientations, without inverse trigonometric functions.

Both residuals are an angle times a unit vector.  The angle comes from its cosine c by two half-angle steps,
h = cos(theta/2) = sqrt((1 + c)/2) and k = cos(theta/4) = sqrt((1 + h)/2), and a polynomial for the arc
tangent of tan(theta/8) = sqrt((1 - k)/(1 + k)) <= 0.4143.  Only theta / sin(theta) is ever needed, which is
smooth at zero, so that no precision is lost where c is near 1.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.ik.tasks.direction import NEAREST, PARALLEL

# Degree of the polynomial for atan(x)/x in x^2; the error is below 1e-15.
DEGREE = 11


def skew(vector: Any) -> Any:
    """Return [a]x of an SX vector, with structural zeros on the diagonal."""
    import casadi

    x, y, z = vector[0], vector[1], vector[2]
    matrix = casadi.SX(3, 3)
    matrix[0, 1], matrix[0, 2], matrix[1, 2] = -z, y, -x
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = z, -y, x
    return matrix


def unit_and_length(line: Any) -> tuple[Any, Any]:
    """Return the unit vector of a line and its length [m], as `direction.unit_and_length`."""
    import casadi

    length = casadi.sqrt(casadi.sumsqr(line))
    distance, near = casadi.fmax(length, NEAREST), length < NEAREST
    return (1 - near) * line / distance + near * np.array([1.0, 0.0, 0.0]), distance


def angle_over_sine(cosine: Any) -> Any:
    """Return theta / sin(theta) with theta = acos(c), for c in (-1, 1]."""
    import casadi

    c = casadi.fmin(casadi.fmax(cosine, -1.0), 1.0)
    half = casadi.sqrt(0.5 * (1 + c))
    quarter = casadi.sqrt(0.5 * (1 + half))
    square = (1 - quarter) / (1 + quarter)
    value = casadi.SX(0)
    for coefficient in reversed(_arc_tangent()):
        value = value * square + coefficient
    # sin(theta) = 8 t (1 - t^2) (1 - 6 t^2 + t^4) / (1 + t^2)^4 with t = tan(theta/8); theta = 8 t value.
    sine = (1 - square) * (1 - square * (6 - square))
    return value * (1 + square) ** 4 / casadi.fmax(sine, 1e-16)


def direction_residual(axis: Array, basis: Array, direction: Any) -> tuple[Any, Any]:
    """Return r and dr/dd as `pepper_kin.ik.tasks.direction.direction_residual`, for an SX direction.

    Args:
        axis: a, unit vector in the frame, shape (3,).
        basis: B, two unit rows normal to the axis, shape (2, 3).
        direction: d, a unit SX vector of 3 rows.

    Returns:
        SX expressions r, 2 rows [rad], and dr/dd, 2 rows and 3 columns.
    """
    import casadi

    row, sideways = casadi.DM(axis[None]), casadi.DM(basis)
    across, cosine = sideways @ direction, row @ direction
    behind = _is_behind(casadi.sumsqr(across), cosine)
    across = casadi.vertcat(
        casadi.if_else(behind, PARALLEL, across[0]), casadi.if_else(behind, 0.0, across[1])
    )
    factor, slope = _factor_and_slope(casadi.sumsqr(across), cosine)
    return factor * across, factor * sideways + slope * (across @ row)


def turn_between(first: Any, second: Any) -> tuple[Any, Any, Any]:
    """Return r, dr/da and dr/dd as `pepper_kin.ik.tasks.direction.turn_between`, for SX directions."""
    import casadi

    across, cosine = casadi.cross(first, second), casadi.dot(first, second)
    behind = _is_behind(casadi.sumsqr(across), cosine)
    # For opposite directions the rotation is about the first direction of `sideways_basis`.
    helper = casadi.if_else(casadi.fabs(first[1]) < 0.9, casadi.DM([0, 1, 0]), casadi.DM([0, 0, 1]))
    aside = helper - casadi.dot(helper, first) * first
    aside = PARALLEL * aside / casadi.sqrt(casadi.sumsqr(aside))
    across = casadi.vertcat(*[casadi.if_else(behind, aside[k], across[k]) for k in range(3)])
    factor, slope = _factor_and_slope(casadi.sumsqr(across), cosine)
    by_first = -factor * skew(second) + slope * (across @ second.T)
    return factor * across, by_first, factor * skew(first) + slope * (across @ first.T)


def _is_behind(square: Any, cosine: Any) -> Any:
    """Return whether two directions are opposite, so that the axis of rotation is arbitrary."""
    import casadi

    return casadi.logic_and(square < PARALLEL**2, cosine < 0)


def _factor_and_slope(square: Any, cosine: Any) -> tuple[Any, Any]:
    """Return f = theta / sin(theta) and its derivative by cos(theta), given the sine's square."""
    import casadi

    square = casadi.fmax(square, PARALLEL**2)
    # Near c = -1 the cosine has lost the precision of the angle, which the sine still has.
    factor = casadi.if_else(
        cosine < -0.99, (math.pi - _small_arc_sine(square)) / casadi.sqrt(square), angle_over_sine(cosine)
    )
    slope = casadi.if_else(
        casadi.logic_and(square < 1e-6, cosine > 0), -1 / 3, (cosine * factor - 1) / square
    )
    return factor, slope


def rotation_residual(turn: Any) -> tuple[Any, Any]:
    """Return log(E) and L(log(E))^-1, L the left Jacobian of SO(3), for an SX rotation matrix E.

    With v = sin(theta) n the vector of E's skew part and f = theta / sin(theta), log(E) = f v and

        L^-1 = I - [r]x / 2 + (1 - f (1 + c) / 2) / theta^2 [r]x^2.

    If theta is near pi, v is inaccurate; n is then taken from the largest column of E + I.
    """
    import casadi

    v = 0.5 * casadi.vertcat(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
    cosine = 0.5 * (turn[0, 0] + turn[1, 1] + turn[2, 2] - 1)
    square = casadi.sumsqr(v)
    far = casadi.logic_and(square < 1e-4, cosine < 0)
    reversed_turn = _near_reversal(turn, v)
    plain = angle_over_sine(casadi.fmax(cosine, -0.99999)) * v
    residual = casadi.vertcat(*[casadi.if_else(far, reversed_turn[k], plain[k]) for k in range(3)])
    angle_square = casadi.sumsqr(residual)
    # f (1 + c): near pi, f is large and 1 + c suffers from cancellation.
    product = casadi.if_else(
        cosine < 0,
        casadi.sqrt(angle_square * square) / (1 - cosine),
        casadi.sqrt(angle_square / casadi.fmax(square, 1e-30)) * (1 + cosine),
    )
    second = casadi.if_else(
        angle_square < 1e-4,
        1 / 12 + angle_square / 720,
        (1 - 0.5 * product) / casadi.fmax(angle_square, 1e-30),
    )
    cross = skew(residual)
    return residual, casadi.SX.eye(3) - 0.5 * cross + second * (cross @ cross)


def _near_reversal(turn: Any, v: Any) -> Any:
    """Return log(E) for theta near pi: n is along the largest column of the symmetric part of E + I."""
    import casadi

    symmetric = 0.5 * (turn + turn.T) + casadi.SX.eye(3)
    first, second, third = (symmetric[k, k] for k in range(3))
    take_first = casadi.logic_and(first >= second, first >= third)
    column = [
        casadi.if_else(
            take_first, symmetric[k, 0], casadi.if_else(second >= third, symmetric[k, 1], symmetric[k, 2])
        )
        for k in range(3)
    ]
    n = casadi.vertcat(*column)
    n = n / casadi.sqrt(casadi.fmax(casadi.sumsqr(n), 1e-30))
    along = casadi.dot(n, v)
    sign = casadi.if_else(along < 0, -1.0, 1.0)
    return sign * (math.pi - _small_arc_sine(casadi.sumsqr(v))) * n


def _small_arc_sine(square: Any) -> Any:
    """Return asin(s) from s^2 < 0.02, by its power series."""
    import casadi

    s = casadi.sqrt(square)
    return s * (
        1
        + square
        * (1 / 6 + square * (3 / 40 + square * (15 / 336 + square * (105 / 3456 + square * 945 / 42240))))
    )


@lru_cache(maxsize=1)
def _arc_tangent() -> tuple[float, ...]:
    """Return the coefficients of atan(x)/x in x^2 on [0, tan(pi/8)^2], lowest first (Chebyshev nodes)."""
    top = math.tan(math.pi / 8) ** 2 * 1.0001
    series = np.polynomial.Chebyshev.interpolate(
        lambda y: np.arctan(np.sqrt(y)) / np.sqrt(np.maximum(y, 1e-300)), DEGREE, [0.0, top]
    )
    return tuple(series.convert(kind=np.polynomial.Polynomial).coef.tolist())
