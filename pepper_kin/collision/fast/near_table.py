"""The shapes of a robot and a scene, and their pairs, as the table that `core.collision.distances` reads."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.joint_table import joint_table
from pepper_kin.collision.fast.solids import HULL, Solid
from pepper_kin.collision.fast.structure import Structure, structure_of
from pepper_kin.collision.kept_size import MOST_BYTES, bytes_of, kept_within
from pepper_kin.collision.solids import HalfSpace
from pepper_kin.core.collision.distances import (
    FIRST,
    HALF,
    KIND,
    PLACE,
    PLANE,
    RADIUS,
    REACH,
    SHAPE,
    NearTable,
)
from pepper_kin.core.collision.layout import BOX
from pepper_kin.model import PepperModel, kept_for_robot

MOST_VERTICES = 64
"""Of hulls of more, only the vertices are kept that lie farthest in so many directions: they guide only."""


_kept: WeakKeyDictionary[Structure, NearTable] = WeakKeyDictionary()


def near_table(checker: CollisionChecker) -> NearTable:
    """Return the shapes and pairs of a checker, both in its order; the pairs keep no distance.

    Half-spaces are known as such, all else as `Solid`.
    """
    structure = structure_of(checker)
    table = _kept.get(structure)
    if table is None:
        table = _kept[structure] = _make_table(checker.pepper, structure)
    return table


def _make_table(pepper: PepperModel, structure: Structure) -> NearTable:
    (shapes, vertices), (objects, more) = _shapes(structure.solids), _shapes(structure.objects)
    objects = objects.copy()
    objects[:, FIRST] += len(vertices)
    planes = [isinstance(item.geometry, HalfSpace) for item in structure.items]
    objects[planes, KIND], objects[planes, REACH] = PLANE, np.inf
    shapes, vertices = np.concatenate([shapes, objects]), np.concatenate([vertices, more])
    first, second = _pairs(structure).T
    segments = (shapes[:, KIND] == BOX) & (shapes[:, HALF] == 0) & (shapes[:, HALF + 1] == 0)
    swapped = segments[second] & ~segments[first]
    pairs = np.column_stack([np.where(swapped, second, first), np.where(swapped, first, second), swapped])
    reaches = shapes[first, REACH] + shapes[second, REACH]
    return NearTable(*_tree(pepper), shapes, vertices, pairs, reaches, np.zeros(len(pairs)))


def _pairs(structure: Structure) -> NDArray[np.int64]:
    """Return the pairs that a checker compares, places among all shapes, in its order, shape (k, 2)."""
    count = len(structure.solids)
    own = [pair for pairs in structure.classes for pair in pairs]
    found = [np.array(own, np.int64).reshape(-1, 2), structure.resting + np.array([0, count])]
    sets = np.split(structure.members, structure.ends[:-1])
    for places, met in zip(sets, structure.met, strict=False):
        members = [member for group in np.flatnonzero(met) for member in structure.groups[group]]
        found.append(np.stack(np.meshgrid(members, places + count, indexing="ij"), axis=-1).reshape(-1, 2))
    pairs = np.concatenate(found).astype(np.int64)
    return np.asarray(pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))])


@kept_within(MOST_BYTES / 4, bytes_of)
def _shapes(solids: tuple[Solid, ...]) -> tuple[Array, Array]:
    """Return the rows of solids, shape (k, SHAPE), and the vertices of hulls, shape (v, 3)."""
    rows, vertices, place = np.zeros((len(solids), SHAPE)), [np.zeros((0, 3))], 0
    for row, solid in zip(rows, solids, strict=True):
        kind = HULL if len(solid.vertices) else solid.kind  # what is held as a cloud is its hull here
        corners = _outermost(solid.vertices)
        row[:PLACE], row[PLACE:5] = (kind, solid.joint), solid.position
        row[5:HALF], row[HALF:RADIUS] = solid.rotation.T.ravel(), solid.half
        row[RADIUS:] = solid.radius, solid.bounding_radius, place, len(corners)
        vertices.append(corners)
        place += len(corners)
    return rows, np.concatenate(vertices)


def _outermost(vertices: Array) -> Array:
    """Return the vertices, shape (m, 3), of all, shape (v, 3) [m], that lie farthest in some direction.

    The directions are spread evenly; up to MOST_VERTICES vertices, all are kept.
    """
    if len(vertices) <= MOST_VERTICES:
        return vertices
    # Points of a spiral that are even on the sphere.
    k = np.arange(MOST_VERTICES) + 0.5
    height, turn = 1.0 - 2.0 * k / MOST_VERTICES, np.pi * (1.0 + np.sqrt(5.0)) * k
    across = np.sqrt(1.0 - height * height)
    directions = np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    return np.asarray(vertices[np.unique((vertices @ directions.T).argmax(axis=0))])


@kept_for_robot(most=32)
def _tree(pepper: PepperModel) -> tuple[Array, Array]:
    """Return the joints of the tree, and which of them carry each."""
    joints = joint_table(pepper)
    above = np.zeros((len(joints), len(joints) - 1))
    for k in range(1, len(joints)):
        above[k] = above[int(joints[k, 0])]
        above[k, k - 1] = 1.0
    return joints, above
