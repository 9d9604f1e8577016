"""Rotations from body to parent: a constant rotation times one about z."""

from __future__ import annotations

from functools import cached_property

from pepper_kin.symbolic.scalars import GraphScalar, Value
from pepper_kin.symbolic.vectors import (
    Matrix,
    Vector,
    product,
    symmetric,
    times,
    times_transposed,
    transpose,
)


class Turn:
    """The rotation R = C Rz(q) of a body's frame to its parent's.

    Args:
        constant: C.
        cosine: cos(q).
        sine: sin(q).
    """

    def __init__(self, constant: Matrix, cosine: Value, sine: Value) -> None:
        self.constant, self.cosine, self.sine = constant, cosine, sine
        full = sum(value not in (0.0, 1.0, -1.0) for row in constant for value in row)
        self._at_once = full > 6 and isinstance(cosine, GraphScalar)

    @cached_property
    def matrix(self) -> Matrix:
        """R as a matrix."""
        rows = []
        for x, y, z in self.constant:
            rows.append((x * self.cosine + y * self.sine, y * self.cosine - x * self.sine, z))
        return tuple(rows)

    def outward(self, u: Vector) -> Vector:
        """Return R u: body to parent."""
        if self._at_once:
            return times(self.matrix, u)
        c, s = self.cosine, self.sine
        return times(self.constant, (c * u[0] - s * u[1], s * u[0] + c * u[1], u[2]))

    def inward(self, u: Vector) -> Vector:
        """Return R^T u: parent to body."""
        if self._at_once:
            return times_transposed(self.matrix, u)
        c, s = self.cosine, self.sine
        x, y, z = times_transposed(self.constant, u)
        return (c * x + s * y, c * y - s * x, z)

    def outward_symmetric(self, m: Matrix) -> Matrix:
        """Return R M R^T of a symmetric M.

        For the rotation about z, with k = s (xx - yy) + 2 c xy: xx' = xx - s k, yy' = yy + s k,
        xy' = c k - xy, which takes half the operations of two matrix products.
        """
        c, s = self.cosine, self.sine
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = m
        k = s * (xx - yy) + c * (2.0 * xy)
        turned = symmetric(xx - s * k, yy + s * k, zz, c * k - xy, c * xz - s * yz, s * xz + c * yz)
        return (
            congruence(self.constant, turned) if isinstance(c, GraphScalar) else congruence(self.constant, m)
        )

    def outward_general(self, m: Matrix) -> Matrix:
        """Return R M R^T of any M."""
        columns = transpose(tuple(self.outward(column) for column in transpose(m)))
        return tuple(self.outward(row) for row in columns)

    def compose(self, orientation: Matrix) -> Matrix:
        """Return Q R, the orientation of the body, from its parent's orientation Q."""
        x, y, z = transpose(product(orientation, self.constant))
        c, s = self.cosine, self.sine
        return tuple((c * a + s * b, c * b - s * a, e) for a, b, e in zip(x, y, z, strict=True))


def congruence(c: Matrix, m: Matrix) -> Matrix:
    """Return C M C^T of a symmetric M and a constant C."""
    half = product(c, m)
    rows = product(half, transpose(c))
    # Both halves are equal; using one keeps the other's operations out of the expression.
    return symmetric(rows[0][0], rows[1][1], rows[2][2], rows[0][1], rows[0][2], rows[1][2])
