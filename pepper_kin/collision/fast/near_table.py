"""Shapes of a robot and a scene, and their pairs, as the table that `core.collision.distances` reads."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.joint_table import joint_table
from pepper_kin.collision.fast.structure import ComparedParts, structure_of
from pepper_kin.collision.solids import HalfSpace
from pepper_kin.core.collision.distances import CARRIER, COUNT, FIRST, PLANE, SHAPE, NearTable
from pepper_kin.core.collision.layout import BOX, HULL, OTHER
from pepper_kin.core.collision.scene_rows import BOUNDING, HALF, KIND, ROW
from pepper_kin.model import PepperModel, kept_for_robot

MOST_VERTICES = 64
"""Number of directions, and of vertices above which a hull keeps only the vertices farthest along one: hulls
serve only as a guide."""


_kept: WeakKeyDictionary[ComparedParts, NearTable] = WeakKeyDictionary()


def near_table(checker: CollisionChecker) -> NearTable:
    """Return the shapes and pairs of a checker, both in its order; the pairs keep no distance.

    Half-spaces are represented exactly, all other shapes as `Solid`.
    """
    structure = structure_of(checker)
    table = _kept.get(structure)
    if table is None:
        table = _kept[structure] = _make_table(checker.pepper, structure)
    return table


def _make_table(pepper: PepperModel, structure: ComparedParts) -> NearTable:
    """Return the table of a structure's shapes and pairs."""
    moving, count = structure.moving, len(structure.solids)
    rows = np.concatenate([moving.rows, structure.object_rows])
    shapes, vertices, place = np.zeros((len(rows), SHAPE)), [np.zeros((0, 3))], 0
    shapes[:, :ROW] = rows
    shapes[:count, CARRIER] = [solid.joint for solid in moving.solids]
    special = {count + o: solid for o, solid in structure.special.items()}
    for k, solid in (dict(enumerate(moving.solids)) | special).items():
        if len(solid.vertices):  # an attached cloud is its convex hull here
            corners = _outermost(solid.vertices)
            shapes[k, KIND], shapes[k, FIRST], shapes[k, COUNT] = HULL, place, len(corners)
            vertices.append(corners)
            place += len(corners)
    planes = [count + o for o, item in enumerate(structure.items) if isinstance(item.geometry, HalfSpace)]
    shapes[planes, KIND], shapes[planes, BOUNDING] = PLANE, np.inf
    first, second = _pairs(structure).T
    segments = (shapes[:, KIND] == BOX) & (shapes[:, HALF] == 0) & (shapes[:, HALF + 1] == 0)
    swapped = segments[second] & ~segments[first]
    pairs = np.column_stack([np.where(swapped, second, first), np.where(swapped, first, second), swapped])
    reaches = shapes[first, BOUNDING] + shapes[second, BOUNDING]
    keep = np.zeros(len(pairs))
    return NearTable(*joint_tree(pepper), shapes, np.concatenate(vertices), pairs, reaches, keep)


def among(table: NearTable, chosen: NDArray[Any]) -> NearTable:
    """Return a table of some of the pairs, selected by a mask, shape (m,), or by indices."""
    return table._replace(pairs=table.pairs[chosen], reaches=table.reaches[chosen], keep=table.keep[chosen])


def movable(table: NearTable) -> NearTable:
    """Return a table of the pairs that move against each other, without shapes that only coal supports."""
    shapes, (first, second) = table.shapes, table.pairs[:, :2].T
    carriers, known = shapes[:, CARRIER], shapes[:, KIND] != OTHER
    return among(table, known[first] & known[second] & (carriers[first] != carriers[second]))


def _pairs(structure: ComparedParts) -> NDArray[np.int64]:
    """Return the pairs that a checker compares, indices among all shapes, sorted, shape (k, 2)."""
    count = len(structure.solids)
    own = [pair for pairs in structure.classes for pair in pairs]
    found = [np.array(own, np.int64).reshape(-1, 2), structure.resting + np.array([0, count])]
    sets = np.split(structure.members, structure.ends[:-1])
    for places, met in zip(sets, structure.met, strict=False):
        members = [member for group in np.flatnonzero(met) for member in structure.groups[group]]
        found.append(np.stack(np.meshgrid(members, places + count, indexing="ij"), axis=-1).reshape(-1, 2))
    pairs = np.concatenate(found).astype(np.int64)
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


def _outermost(vertices: Array) -> Array:
    """Return the vertices, shape (m, 3), that are farthest along some direction of all, shape (v, 3) [m].

    The directions are spread evenly; up to MOST_VERTICES vertices, all are kept.
    """
    if len(vertices) <= MOST_VERTICES:
        return vertices
    # Points of a spiral that are evenly distributed on the sphere.
    k = np.arange(MOST_VERTICES) + 0.5
    height, turn = 1.0 - 2.0 * k / MOST_VERTICES, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height * height)
    directions = np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    return np.asarray(vertices[np.unique((vertices @ directions.T).argmax(axis=0))])


@kept_for_robot(most=32)
def joint_tree(pepper: PepperModel) -> tuple[Array, Array]:
    """Return the joints of the tree, and 1 for each joint that carries another or itself, else 0."""
    joints = joint_table(pepper)
    above = np.zeros((len(joints), len(joints) - 1))
    for k in range(1, len(joints)):
        above[k] = above[int(joints[k, 0])]
        above[k, k - 1] = 1.0
    return joints, above
