"""A term as a CasADi function whose values and first derivatives machine code computes."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np

from ..vectors import FloatArray
from .rows import Rows, Term


class TermCallback(casadi.Callback):
    """(q, v, a), shape (n, K) each -> values, shape (R, K), of a term at all samples at once.

    Derivatives are the term's own; second derivatives count as zero, so that what a solver takes for the
    Hessian lacks the curvature of the term, and its steps are Gauss and Newton's.  Asked for values and
    derivatives at one place, the term computes them once.

    Args:
        term: The term.
        n: Number of coordinates.
        count: Number K of samples.
    """

    def __init__(self, term: Term, n: int, count: int) -> None:
        super().__init__()
        self._term, self._n, self._count = term, n, count
        rows = term.rows(*np.zeros((3, count, n)))
        self.rows = rows.value.shape[1]
        self._sparsity = [_blocks(self.rows, n, count, part is not None) for part in _parts(rows)]
        self._slopes: _Slopes | None = None
        self.construct("term", {})

    def get_n_in(self) -> int:
        """Three inputs."""
        return 3

    def get_n_out(self) -> int:
        """One output."""
        return 1

    def get_sparsity_in(self, i: int) -> Any:
        """Return the shape of an input."""
        return casadi.Sparsity.dense(self._n, self._count)

    def get_sparsity_out(self, i: int) -> Any:
        """Return the shape of the output."""
        return casadi.Sparsity.dense(self.rows, self._count)

    def eval(self, arguments: Any) -> Any:
        """Return the values."""
        return [casadi.DM(self._term.values(*_states(arguments)).T)]

    def has_jac_sparsity(self, out: int, inputs: int) -> bool:
        """What depends on what is known."""
        return True

    def get_jac_sparsity(self, out: int, inputs: int, symmetric: bool) -> Any:
        """Return which values depend on which numbers: those of the same sample."""
        return self._sparsity[inputs]

    def has_jacobian(self) -> bool:
        """Derivatives are known."""
        return True

    def get_jacobian(self, name: Any, inames: Any, onames: Any, options: Any) -> Any:
        """Return the function of the derivatives."""
        self._slopes = _Slopes(name, self._term, (self._n, self._count, self.rows), self._sparsity, options)
        return self._slopes


class _Slopes(casadi.Callback):
    """(q, v, a, values) -> derivatives of the values by each, block by block of a sample."""

    def __init__(
        self, name: str, term: Term, sizes: tuple[int, int, int], sparsity: list[Any], options: dict[str, Any]
    ) -> None:
        super().__init__()
        self._term, self._sparsity = term, sparsity
        self._n, self._count, self._rows = sizes
        self._flat: Any = None
        self.construct(name, options)

    def get_n_in(self) -> int:
        """Three inputs and the values."""
        return 4

    def get_n_out(self) -> int:
        """Three outputs."""
        return 3

    def get_sparsity_in(self, i: int) -> Any:
        """Return the shape of an input; the values are not needed."""
        if i == 3:
            return casadi.Sparsity(self._rows, self._count)
        return casadi.Sparsity.dense(self._n, self._count)

    def get_sparsity_out(self, i: int) -> Any:
        """Return where derivatives are not zero."""
        return self._sparsity[i]

    def eval(self, arguments: Any) -> Any:
        """Return the derivatives."""
        answers = []
        parts = _parts(self._term.rows(*_states(arguments[:3])))
        for part, sparsity in zip(parts, self._sparsity, strict=True):
            # Stored column by column: sample, coordinate, row.
            numbers = np.zeros(0) if part is None else np.ascontiguousarray(part.transpose(0, 2, 1)).ravel()
            answers.append(casadi.DM(sparsity, numbers))
        return answers

    def has_jac_sparsity(self, out: int, inputs: int) -> bool:
        """What depends on what is known."""
        return True

    def get_jac_sparsity(self, out: int, inputs: int, symmetric: bool) -> Any:
        """Return that nothing counts as depending on anything."""
        return casadi.Sparsity(self.sparsity_out(out).numel(), self.sparsity_in(inputs).numel())

    def has_jacobian(self) -> bool:
        """Second derivatives count as zero."""
        return True

    def get_jacobian(self, name: Any, inames: Any, onames: Any, options: Any) -> Any:
        """Return the function of the second derivatives, which are zero."""
        shapes = [self.sparsity_in(i) for i in range(4)]
        outputs = [self.sparsity_out(i) for i in range(3)]
        inputs = [casadi.MX.sym(f"i{k}", shape) for k, shape in enumerate([*shapes, *outputs])]
        zeros = [casadi.MX(out.numel(), shape.numel()) for out in outputs for shape in shapes]
        self._flat = casadi.Function(name, inputs, zeros, inames, onames, options)
        return self._flat


def _blocks(rows: int, n: int, count: int, present: bool) -> Any:
    if not present:
        return casadi.Sparsity(rows * count, n * count)
    return casadi.diagcat(*[casadi.Sparsity.dense(rows, n)] * count)


def _states(arguments: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    q, v, a = (np.ascontiguousarray(np.array(part).T) for part in arguments)
    return q, v, a


def _parts(rows: Rows) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None]:
    return rows.by_position, rows.by_velocity, rows.by_acceleration
