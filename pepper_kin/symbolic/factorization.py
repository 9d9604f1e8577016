"""Factorization M = L^T D L that keeps the zeros of the tree, and solutions of linear systems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pepper_kin.exceptions import ModelError
from pepper_kin.symbolic.scalars import GraphScalar, Value, reciprocal


@dataclass(frozen=True)
class Factors:
    """L and 1 / D of a symmetric positive definite M = L^T D L.

    Rows are eliminated from the last to the first: if every joint comes after its parent, L has entries only
    where one joint carries the other (Featherstone, 2008, section 6.5).

    Attributes:
        lower: Entries lower[i][j], j < i, of L below its unit diagonal.
        inverse_diagonal: 1 / D_i.
    """

    lower: tuple[dict[int, Value], ...]
    inverse_diagonal: tuple[Value, ...]

    def solve(self, right: Sequence[Value]) -> list[Value]:
        """Return M^-1 b; leading zeros remain structural zeros."""
        x = list(right)
        for i in reversed(range(len(x))):
            for j, value in self.lower[i].items():
                x[j] = x[j] - value * x[i]
        for i, value in enumerate(self.inverse_diagonal):
            x[i] = value * x[i]
            for j, factor in self.lower[i].items():
                x[i] = x[i] - factor * x[j]
        return x

    def inverse_entries(self) -> dict[tuple[int, int], Value]:
        """Return the lower half of M^-1 = W D^-1 W^T, where W = L^-1 has the zeros of L."""
        inverse: list[dict[int, Value]] = []
        for i, row in enumerate(self.lower):
            w: dict[int, Value] = {}
            for j, value in row.items():
                w[j] = w.get(j, 0.0) - value
                for k, other in inverse[j].items():
                    if k != j:
                        w[k] = w.get(k, 0.0) - value * other
            w[i] = 1.0
            inverse.append(w)
        result: dict[tuple[int, int], Value] = {}
        scaled = [{k: self.inverse_diagonal[k] * value for k, value in row.items()} for row in inverse]
        for i, row in enumerate(scaled):
            for j in range(i + 1):
                common = [k for k in row if k in inverse[j]]
                if common:
                    total: Value = 0.0
                    for k in common:
                        total = total + row[k] * inverse[j][k]
                    result[i, j] = total
        return result


def factorize(entries: Mapping[tuple[int, int], Value], joint_names: Sequence[str]) -> Factors:
    """Factorize a symmetric positive definite matrix.

    Args:
        entries: Lower half of the matrix without zeros.
        joint_names: Name of the joint of each row.

    Raises:
        ModelError: naming joints that move no mass, for which M has no inverse.
    """
    n = len(joint_names)
    idle = [name for i, name in enumerate(joint_names) if _is_zero(entries.get((i, i), 0.0))]
    if idle:
        raise ModelError(f"the mass matrix has no inverse: no mass is moved by {', '.join(idle)}")
    rows: list[dict[int, Value]] = [
        {j: entries[i, j] for j in range(i + 1) if (i, j) in entries and not _is_zero(entries[i, j])}
        for i in range(n)
    ]
    inverses: list[Value] = [1.0] * n
    for i in reversed(range(n)):
        inverses[i] = reciprocal(rows[i].pop(i))
        factors = {j: value * inverses[i] for j, value in rows[i].items()}
        for j, factor in factors.items():
            for k, value in rows[i].items():
                if k <= j:
                    rows[j][k] = rows[j].get(k, 0.0) - factor * value
        rows[i] = factors
    return Factors(tuple(rows), tuple(inverses))


def _is_zero(value: Value) -> bool:
    """Return whether a value is a constant zero."""
    return not isinstance(value, GraphScalar) and value == 0.0
