"""Bounds of distances as expressions of the joint positions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.collision.fast.solids import BOX, Solid
from pepper_kin.collision.fast.spheres import spheres_of
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.alignment import snapped
from pepper_kin.symbolic.bodies import numbers
from pepper_kin.symbolic.functions import make_function
from pepper_kin.symbolic.states import State, make_state, new_inputs
from pepper_kin.symbolic.tree import Tree, read_tree
from pepper_kin.symbolic.vectors import (
    IDENTITY,
    ZERO,
    Matrix,
    Vector,
    add,
    product,
    subtract,
    times,
    times_transposed,
)

if TYPE_CHECKING:
    import casadi

SLACK = 2e-5
"""Added to outer radii and taken from inner ones for the rounding of single precision [m]."""


class Bodies:
    """Poses of bodies relative to one another, on one graph.

    Args:
        pepper: The robot.
    """

    def __init__(self, pepper: PepperModel) -> None:
        self.tree: Tree = read_tree(pepper, compact=True)
        self.graph, self.inputs = new_inputs(self.tree, "q")
        self.state: State = make_state(self.tree, self.inputs["q"])
        self._known: dict[tuple[int, int], tuple[Matrix, Vector]] = {}

    def common(self, a: int, b: int) -> int:
        """Return the last body that carries both."""
        path = set(self.tree.path(a))
        shared = [body for body in self.tree.path(b) if body in path]
        return shared[-1] if shared else -1

    def pose(self, body: int, top: int) -> tuple[Matrix, Vector]:
        """Return rotation and origin of a body in the frame of one that carries it."""
        if body == top:
            return IDENTITY, ZERO
        if (body, top) not in self._known:
            rotation, position = self.pose(self.tree.bodies[body].parent, top)
            turn, r = self.state.turns[body], self.state.translations[body]
            self._known[body, top] = turn.compose(rotation), add(position, times(rotation, r))
        return self._known[body, top]

    def place(self, solid: Solid, points: Any) -> list[Vector]:
        """Return points of the frame of a solid's joint in the frame of its body."""
        if solid.joint == 0:
            return [numbers(p) for p in np.asarray(points)]
        alignment = self.tree.alignments[solid.joint - 1]
        return [numbers(alignment.place(np.eye(3), p)[1]) for p in np.asarray(points)]

    def turn(self, solid: Solid) -> Matrix:
        """Return the axes of a solid's core in the frame of its body."""
        if solid.joint == 0:
            return numbers(snapped(solid.rotation))
        rotation = self.tree.alignments[solid.joint - 1].rotation
        return numbers(snapped(rotation.T @ solid.rotation))


def pair_bounds(
    pepper: PepperModel, groups: Sequence[Sequence[tuple[Solid, Solid]]], *, inner: bool = True
) -> casadi.Function:
    """Return the function (q, margin) -> numbers that tell whether any pair of solids of a group is near.

    One solid of each pair is covered by spheres with centres c_i, outer radii R_i and inner radii r_i; the
    other, of core K and radius r, is exact.  With d_i = |c_i - K|,

        outer = min_i d_i^2 - (R_i + r + margin)^2,   inner = min_i d_i^2 - (r_i + r + margin)^2:

    if `outer` is above zero no pair of the group is nearer than the margin; if `inner` is below, one is.

    Args:
        pepper: The robot.
        groups: Pairs of the robot's solids.
        inner: Whether inner numbers are wanted, too.

    Returns:
        Function of q (n) and margin; its output holds the outer number of each group, then the inner ones.
    """
    import casadi

    bodies = Bodies(pepper)
    tests = [[_Test(bodies, *pair) for pair in pairs] for pairs in groups]
    rows = {f"pair{g}_{k}": test.rows for g, group in enumerate(tests) for k, test in enumerate(group)}
    geometry = make_function("geometry", bodies.graph, bodies.inputs, rows)
    q, margin = casadi.SX.sym("q", pepper.n), casadi.SX.sym("margin")
    results = geometry(q)
    values = iter(results if isinstance(results, tuple) else (results,))
    outer_bounds, inner_bounds = [], []
    for group in tests:
        outers, inners = [], [casadi.SX(1.0)]
        for test in group:
            for squared, reach, inside in test.distances(next(values)):
                outers.append(squared - (reach + SLACK + margin) ** 2)
                if inside > SLACK:
                    inners.append(squared - (inside - SLACK + margin) ** 2)
        outer_bounds.append(_least(outers))
        inner_bounds.append(_least(inners))
    bounds = casadi.vertcat(*outer_bounds, *(inner_bounds if inner else []))
    return casadi.Function("pair_bounds", [q, margin], [casadi.cse(bounds)])


class _Test:
    """Distances of the spheres of one solid to the core of another."""

    def __init__(self, bodies: Bodies, first: Solid, second: Solid) -> None:
        self.covered, self.exact = _roles(first, second)
        self.spheres = spheres_of(self.covered)
        a, b = self.covered.joint - 1, self.exact.joint - 1
        top = bodies.common(a, b)
        centers = [_moved(bodies, a, top, c) for c in bodies.place(self.covered, self.spheres.centers)]
        middle, turn = bodies.place(self.exact, [self.exact.position])[0], bodies.turn(self.exact)
        if self.exact.segment:
            axis = [row[2] for row in turn]
            rotation, _ = bodies.pose(b, top)
            self.rows = [*centers, _moved(bodies, b, top, middle), times(rotation, axis)]
        else:
            rotation, position = bodies.pose(b, top)
            inside = [times_transposed(rotation, subtract(c, position)) for c in centers]
            self.rows = [times_transposed(turn, subtract(c, middle)) for c in inside]

    def distances(self, values: Any) -> list[tuple[Any, float, float]]:
        """Return for each sphere d^2, the outer reach and the inner reach."""
        import casadi

        result = []
        half, radius = self.exact.half, self.exact.radius
        for i, (outer, inner) in enumerate(zip(self.spheres.outer, self.spheres.inner, strict=True)):
            center = values[i, :]
            if not self.exact.segment:
                beyond = casadi.fmax(casadi.fabs(center) - casadi.DM(half).T, 0.0)
                squared = casadi.sumsqr(beyond)
            else:
                gap = center - values[len(self.spheres.outer), :]
                if half[2] > 0:
                    axis = values[len(self.spheres.outer) + 1, :]
                    along = casadi.fmax(casadi.fmin(casadi.dot(gap, axis), half[2]), -half[2])
                    gap = gap - along * axis
                squared = casadi.sumsqr(gap)
            inside = float(inner) + radius if self.exact.kind == BOX and inner > 0 else -1.0
            result.append((squared, float(outer) + radius, inside))
        return result


def _roles(first: Solid, second: Solid) -> tuple[Solid, Solid]:
    """Return the solid to cover by spheres and the one to take as it is."""
    order = sorted((first, second), key=lambda s: (not s.segment, len(spheres_of(s).outer)))
    return order[0], order[1]


def reaches(first: Solid, second: Solid) -> list[float]:
    """Return R_i + r of a pair, as in `pair_bounds` [m]."""
    covered, exact = _roles(first, second)
    return [float(outer) + exact.radius for outer in spheres_of(covered).outer]


def _moved(bodies: Bodies, body: int, top: int, point: Vector) -> Vector:
    rotation, position = bodies.pose(body, top)
    return add(position, times(rotation, point))


def _least(values: list[Any]) -> Any:
    """Return the least of expressions, as a tree so that no long chain must be waited for."""
    import casadi

    while len(values) > 1:
        pairs = [casadi.fmin(a, b) for a, b in zip(values[::2], values[1::2], strict=False)]
        values = pairs + ([values[-1]] if len(values) % 2 else [])
    return values[0]


def sphere_centers(pepper: PepperModel, solids: Sequence[Solid], centers: Sequence[Any]) -> casadi.Function:
    """Return the function q -> points that are fixed to solids, in the world.

    Args:
        pepper: The robot.
        solids: Solids of the robot.
        centers: For each solid its points in the frame of its joint, shape (k, 3) [m].

    Returns:
        Function of q (n); output (3 s), all x, then all y, then all z [m].
    """
    bodies = Bodies(pepper)
    points: list[Vector] = []
    for solid, own in zip(solids, centers, strict=True):
        points += [_moved(bodies, solid.joint - 1, -1, p) for p in bodies.place(solid, own)]
    rows = [[point[axis]] for axis in range(3) for point in points]
    return make_function("sphere_centers", bodies.graph, bodies.inputs, {"centers": rows})


def solid_poses(pepper: PepperModel, solids: Sequence[Solid]) -> casadi.Function:
    """Return the function q -> poses of solids' cores in the world.

    Returns:
        Function of q (n); output (12 s): of each solid the centre [m] and the x, y and z axes of its core, of
        a segment the z axis only.
    """
    bodies = Bodies(pepper)
    rows: list[Any] = []
    for solid in solids:
        body = solid.joint - 1
        rotation, _ = bodies.pose(body, -1)
        turn = product(rotation, bodies.turn(solid))
        center = _moved(bodies, body, -1, bodies.place(solid, [solid.position])[0])
        rows += [[value] for value in center]
        for axis in range(3):
            rows += [[0.0 if solid.segment and axis < 2 else turn[i][axis]] for i in range(3)]
    return make_function("solid_poses", bodies.graph, bodies.inputs, {"poses": rows})
