"""Vectors of 3 and 3 x 3 matrices of scalars; known zeros cost no operation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from pepper_kin.symbolic.scalars import Value

Vector: TypeAlias = Sequence[Value]
"""Three values."""
Matrix: TypeAlias = Sequence[Sequence[Value]]
"""Three rows of three values."""

ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
ZERO_MATRIX: Matrix = (ZERO, ZERO, ZERO)


def add(*vectors: Vector) -> Vector:
    """Return the sum of vectors."""
    x, y, z = vectors[0]
    for u in vectors[1:]:
        x, y, z = x + u[0], y + u[1], z + u[2]
    return (x, y, z)


def subtract(u: Vector, w: Vector) -> Vector:
    """Return u - w."""
    return (u[0] - w[0], u[1] - w[1], u[2] - w[2])


def scale(factor: Value, u: Vector) -> Vector:
    """Return factor u."""
    return (factor * u[0], factor * u[1], factor * u[2])


def dot(u: Vector, w: Vector) -> Value:
    """Return u . w."""
    return u[0] * w[0] + u[1] * w[1] + u[2] * w[2]


def cross(u: Vector, w: Vector) -> Vector:
    """Return u x w."""
    return (u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0])


def z_cross(u: Vector) -> Vector:
    """Return z x u."""
    return (-u[1], u[0], 0.0)


def times(m: Matrix, u: Vector) -> Vector:
    """Return M u."""
    return (dot(m[0], u), dot(m[1], u), dot(m[2], u))


def times_transposed(m: Matrix, u: Vector) -> Vector:
    """Return M^T u."""
    return times(transpose(m), u)


def transpose(m: Matrix) -> Matrix:
    """Return M^T."""
    return tuple(tuple(row[k] for row in m) for k in range(3))


def product(m: Matrix, n: Matrix) -> Matrix:
    """Return M N."""
    columns = transpose(n)
    return tuple(tuple(dot(row, column) for column in columns) for row in m)


def add_matrices(m: Matrix, n: Matrix) -> Matrix:
    """Return M + N."""
    return tuple(add(a, b) for a, b in zip(m, n, strict=True))


def outer(u: Vector, w: Vector) -> Matrix:
    """Return u w^T."""
    return tuple(scale(value, w) for value in u)


def trace(m: Matrix) -> Value:
    """Return the sum of the diagonal."""
    return m[0][0] + m[1][1] + m[2][2]


def symmetric(xx: Value, yy: Value, zz: Value, xy: Value, xz: Value, yz: Value) -> Matrix:
    """Return a symmetric matrix from its six values."""
    return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
