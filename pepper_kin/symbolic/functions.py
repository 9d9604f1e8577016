"""Conversion of a graph of scalars to a CasADi function."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from pepper_kin.symbolic.scalars import GraphScalar, ScalarGraph, Value

if TYPE_CHECKING:
    import casadi

Rows = Sequence[Sequence[Value]]
"""Rows of an output's values; known zeros become structural zeros."""


def make_function(
    name: str, graph: ScalarGraph, inputs: Mapping[str, Sequence[GraphScalar]], outputs: Mapping[str, Rows]
) -> casadi.Function:
    """Build a CasADi `SX` function.

    Args:
        name: Name of the function.
        graph: Graph of the scalars.
        inputs: Input name -> scalars; all inputs of the graph in the order of their creation.
        outputs: Output name -> rows of values, all rows of equal length.

    Returns:
        Function of column vectors with only the operations that outputs need.
    """
    import casadi

    symbols = {
        key: [casadi.SX.sym(f"{key}_{k}") for k in range(len(values))] for key, values in inputs.items()
    }
    expressions = _expressions(graph, [s for group in symbols.values() for s in group], outputs)
    return casadi.Function(
        name,
        [casadi.vertcat(*group) for group in symbols.values()],
        [_output(rows, expressions) for rows in outputs.values()],
        list(inputs),
        list(outputs),
    )


def _expressions(
    graph: ScalarGraph, symbols: list[casadi.SX], outputs: Mapping[str, Rows]
) -> dict[int, casadi.SX]:
    """Return the `SX` expression of every node that an output needs."""
    import casadi

    codes = {"add": casadi.OP_ADD, "sub": casadi.OP_SUB, "mul": casadi.OP_MUL}
    unary = {"cos": casadi.OP_COS, "sin": casadi.OP_SIN, "inv": casadi.OP_INV}
    made: dict[int, casadi.SX] = {}
    for place in _needed(graph, outputs):
        operation, first, second = graph.nodes[place]
        if operation == "input":
            made[place] = symbols[int(first)]
        elif operation == "const":
            made[place] = casadi.SX(first)
        elif operation in unary:
            made[place] = casadi.SX.unary(unary[operation], made[int(first)])
        elif operation == "mul" and first == second:
            made[place] = casadi.SX.unary(casadi.OP_SQ, made[int(first)])
        else:
            made[place] = casadi.SX.binary(codes[operation], made[int(first)], made[int(second)])
    return made


def _needed(graph: ScalarGraph, outputs: Mapping[str, Rows]) -> list[int]:
    """Return the indices of the nodes on which outputs depend, operands first."""
    needed = {
        value.place
        for rows in outputs.values()
        for row in rows
        for value in row
        if isinstance(value, GraphScalar)
    }
    for place in range(len(graph.nodes) - 1, -1, -1):
        operation, first, second = graph.nodes[place]
        if place in needed and operation not in ("input", "const"):
            needed.update((int(first), int(second)))
    return sorted(needed)


def _output(rows: Rows, expressions: dict[int, casadi.SX]) -> casadi.SX:
    """Return an output as a matrix whose known zeros are structural zeros."""
    import casadi

    columns = len(rows[0])
    row_of, column_of, values = [], [], []
    for j in range(columns):
        for i, row in enumerate(rows):
            value = row[j]
            if isinstance(value, GraphScalar):
                made = expressions[value.place]
                values.append(casadi.SX.unary(casadi.OP_NEG, made) if value.negative else made)
            elif value != 0.0:
                values.append(casadi.SX(value))
            else:
                continue
            row_of.append(i)
            column_of.append(j)
    sparsity = casadi.Sparsity.triplet(len(rows), columns, row_of, column_of)
    return casadi.SX(sparsity, casadi.vertcat(*values)) if values else casadi.SX(len(rows), columns)
