"""Scalars that fold constants, share equal operations and keep their sign without an operation.

The algorithms of this package work on numbers that are either Python floats (constants of the model) or
`GraphScalar`s (values that depend on the inputs).  Zeros and ones vanish, repeated operations share one node,
and a minus sign costs no operation until it must be stored. This module does not depend on CasADi; the
finished graph is converted to `SX` by `functions.py`, which is several times faster than building `SX`
expressions operator by operator.
"""

from __future__ import annotations

from typing import TypeAlias, Union

Value: TypeAlias = Union["GraphScalar", float]
"""A number in an algorithm; a float is a constant of the expression."""


class ScalarGraph:
    """Unique operations in the order of their creation.

    Attributes:
        nodes: (operation, operand, operand): operands are indices in this list; for "input" the second field
            is the index of the input, for "const" the constant; unary operations repeat their operand.
    """

    def __init__(self) -> None:
        self.nodes: list[tuple[str, float, float]] = []
        self._places: dict[tuple[str, float, float], int] = {}

    def node(self, operation: str, first: float, second: float) -> int:
        """Return the index of an operation, which is added if it is new."""
        key = (operation, first, second)
        place = self._places.get(key)
        if place is None:
            place = self._places[key] = len(self.nodes)
            self.nodes.append(key)
        return place

    def inputs(self, count: int) -> list[GraphScalar]:
        """Return `count` further input scalars."""
        first = sum(operation == "input" for operation, _, _ in self.nodes)
        return [GraphScalar(self, self.node("input", first + k, 0), False) for k in range(count)]


class GraphScalar:
    """A node of a graph, or its negative.

    Attributes:
        graph: The graph.
        place: Index of the node.
        negative: Whether the scalar is minus the node.
    """

    __slots__ = ("graph", "negative", "place")

    def __init__(self, graph: ScalarGraph, place: int, negative: bool) -> None:
        self.graph, self.place, self.negative = graph, place, negative

    def __neg__(self) -> GraphScalar:
        return GraphScalar(self.graph, self.place, not self.negative)

    def __add__(self, other: Value) -> Value:
        graph = self.graph
        if isinstance(other, GraphScalar):
            place, negative = other.place, other.negative
        elif other == 0.0:
            return self
        else:
            place, negative = graph.node("const", abs(other), 0), other < 0
        mine = self.place
        if self.negative == negative:
            first, second = (mine, place) if mine <= place else (place, mine)
            return GraphScalar(graph, graph.node("add", first, second), negative)
        if mine == place:
            return 0.0
        if mine < place:
            return GraphScalar(graph, graph.node("sub", mine, place), self.negative)
        return GraphScalar(graph, graph.node("sub", place, mine), negative)

    __radd__ = __add__

    def __sub__(self, other: Value) -> Value:
        return self + (-other)

    def __rsub__(self, other: Value) -> Value:
        return -self + other

    def __mul__(self, other: Value) -> Value:
        graph = self.graph
        if isinstance(other, GraphScalar):
            place, negative = other.place, self.negative != other.negative
        elif other == 0.0:
            return 0.0
        elif abs(other) == 1.0:
            return self if other > 0 else -self
        else:
            place, negative = graph.node("const", abs(other), 0), self.negative != (other < 0)
        mine = self.place
        first, second = (mine, place) if mine <= place else (place, mine)
        return GraphScalar(graph, graph.node("mul", first, second), negative)

    __rmul__ = __mul__

    def __truediv__(self, other: Value) -> Value:
        return self * reciprocal(other)

    def __rtruediv__(self, other: Value) -> Value:
        return reciprocal(self) * other


def reciprocal(x: Value) -> Value:
    """Return 1 / x."""
    if not isinstance(x, GraphScalar):
        return 1.0 / x
    return GraphScalar(x.graph, x.graph.node("inv", x.place, x.place), x.negative)


def cosine(x: GraphScalar) -> GraphScalar:
    """Return cos(x); x and -x share one node."""
    return GraphScalar(x.graph, x.graph.node("cos", x.place, x.place), False)


def sine(x: GraphScalar) -> GraphScalar:
    """Return sin(x); x and -x share one node."""
    return GraphScalar(x.graph, x.graph.node("sin", x.place, x.place), x.negative)
