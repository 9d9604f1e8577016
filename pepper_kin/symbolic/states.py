"""Symbolic states of the robot, from which every recursion starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.functions import Rows, make_function
from pepper_kin.symbolic.scalars import GraphScalar, ScalarGraph, Value, cosine, sine
from pepper_kin.symbolic.tree import Tree, read_tree
from pepper_kin.symbolic.turns import Turn
from pepper_kin.symbolic.vectors import Vector

if TYPE_CHECKING:
    import casadi


@dataclass(frozen=True, eq=False)
class StateExpressions:
    """A tree with values of its coordinates.

    Attributes:
        tree: The robot.
        cosines: Cosine of each coordinate; not used for prismatic joints.
        sines: Sine of each coordinate.
        q: Coordinates [rad or m]; used for prismatic joints only.
        v: Velocities [rad/s or m/s].
        a: Accelerations [rad/s^2 or m/s^2].
    """

    tree: Tree
    cosines: Sequence[Value]
    sines: Sequence[Value]
    q: Sequence[Value]
    v: Sequence[Value]
    a: Sequence[Value]

    @cached_property
    def turns(self) -> list[Turn]:
        """Rotation of each body to its parent."""
        return [
            Turn(body.rotation, 1.0 if body.slides else c, 0.0 if body.slides else s)
            for body, c, s in zip(self.tree.bodies, self.cosines, self.sines, strict=True)
        ]

    @cached_property
    def translations(self) -> list[Vector]:
        """Origin of each body in its parent's frame."""
        result: list[Vector] = []
        for body, turn, q in zip(self.tree.bodies, self.turns, self.q, strict=True):
            r = body.translation
            if body.slides:
                slide = turn.outward((0.0, 0.0, q))
                r = (r[0] + slide[0], r[1] + slide[1], r[2] + slide[2])
            result.append(r)
        return result


def make_state(
    tree: Tree,
    q: Sequence[Value],
    v: Sequence[Value] | None = None,
    a: Sequence[Value] | None = None,
) -> StateExpressions:
    """Return the state of the robot at joint vectors of length n; mimic joints follow by E and e.

    Args:
        tree: The robot.
        q: n positions [rad or m]; equal angles share a sine and a cosine.
        v: n velocities [rad/s or m/s], zero by default.
        a: n accelerations [rad/s^2 or m/s^2], zero by default.
    """
    still = [0.0] * len(q)
    full_q = follow(tree.full_map, q, tree.full_offset)
    full_v, full_a = follow(tree.full_map, v or still), follow(tree.full_map, a or still)
    angles = [isinstance(x, GraphScalar) and not b.slides for x, b in zip(full_q, tree.bodies, strict=True)]
    return StateExpressions(
        tree,
        cosines=[cosine(x) if angle else 1.0 for x, angle in zip(full_q, angles, strict=True)],  # type: ignore[arg-type]
        sines=[sine(x) if angle else 0.0 for x, angle in zip(full_q, angles, strict=True)],  # type: ignore[arg-type]
        q=full_q,
        v=full_v,
        a=full_a,
    )


def follow(full_map: Array, x: Sequence[Value], offset: Array | None = None) -> list[Value]:
    """Return E x + e, one value for each of the N joints.

    Args:
        full_map: E, from the robot's n coordinates to the N joints' coordinates, shape (N, n).
        x: n values.
        offset: e, shape (N,); zero by default.
    """
    result: list[Value] = []
    for i, row in enumerate(full_map.tolist()):
        total: Value = 0.0
        for gain, value in zip(row, x, strict=True):
            total = total + gain * value
        result.append(total if offset is None else total + float(offset[i]))
    return result


def gather(full_map: Array, x: Sequence[Value]) -> list[Value]:
    """Return E^T x, n values, from E, shape (N, n), and x, one value for each of the N joints."""
    return follow(full_map.T, x)


def new_inputs(tree: Tree, *names: str) -> tuple[ScalarGraph, dict[str, list[GraphScalar]]]:
    """Return a graph with joint vectors of the robot as inputs, by name."""
    graph = ScalarGraph()
    return graph, {name: graph.inputs(tree.full_map.shape[1]) for name in names}


class Symbols(NamedTuple):
    """Inputs of a function under construction.

    Attributes:
        graph: Graph of the scalars.
        inputs: Input name -> scalars.
    """

    graph: ScalarGraph
    inputs: dict[str, list[GraphScalar]]

    def function(self, name: str, **outputs: Rows) -> casadi.Function:
        """Return the function of the inputs with outputs, rows of values, by name."""
        return make_function(name, self.graph, self.inputs, outputs)


def new_state(
    pepper: PepperModel, *names: str, compact: bool = True, wrench: bool = False
) -> tuple[StateExpressions, Symbols]:
    """Return the state of a robot at symbolic inputs, and the inputs.

    Args:
        pepper: The robot.
        *names: Names of joint vectors that are inputs, in order: "q", "v" and "a" of the state, or others.
        compact: Whether to use compact body frames, see `read_tree`.
        wrench: Whether to add an input `wrench` (6).
    """
    tree = read_tree(pepper, compact=compact)
    graph, inputs = new_inputs(tree, *names)
    if wrench:
        inputs["wrench"] = graph.inputs(6)
    state = make_state(tree, *(inputs[name] for name in ("q", "v", "a") if name in inputs))
    return state, Symbols(graph, inputs)
