"""The shapes of a robot and a scene as the block that `core.inverse_kinematics.proximity` reads."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.joint_table import joint_table
from pepper_kin.collision.fast.solids import HULL, OTHER, Solid
from pepper_kin.collision.fast.structure import Structure, structure_of
from pepper_kin.collision.kept_size import MOST_BYTES, bytes_of, kept_within
from pepper_kin.core.inverse_kinematics.proximity import FULL, HEAD, SHAPE, place_still, sizes
from pepper_kin.model import PepperModel, kept_for_robot

LEVER = 0.3
"""Meters that count as a radian where joints leave a dependent range."""

MOST_VERTICES = 64
"""Of hulls of more, only the vertices are kept that lie farthest in so many directions: they guide only."""


def proximity_block(checker: CollisionChecker, apart: float) -> Array:
    """Return the block of a robot in a scene.

    Args:
        checker: The robot and scene, with the margin to it.
        apart: How far bodies shall stay apart beyond margins [m].
    """
    pepper, structure = checker.pepper, structure_of(checker)
    shapes, vertices = _shapes(structure.solids)
    objects, more = _shapes(structure.objects)
    objects = objects.copy()
    objects[:, 19] += len(vertices)
    shapes, vertices = np.concatenate([shapes, objects]), np.concatenate([vertices, more])
    own, world = _pairs(structure)
    ends = np.concatenate([own, world])
    keep = apart + np.repeat([checker.self_margin, checker.margin], [len(own), len(world)])
    segments = (shapes[:, 0] == 0) & (shapes[:, 14] == 0) & (shapes[:, 15] == 0)
    swapped = segments[ends[:, 1]] & ~segments[ends[:, 0]]
    ends[swapped] = ends[swapped, ::-1]
    pairs = np.column_stack([ends, keep, (shapes[ends, 18].sum(axis=1) + keep) ** 2])
    pairs = pairs[(shapes[ends, 0] != OTHER).all(axis=1)]
    heads, tables = [], [np.zeros(0)]
    for table in checker.dependent_ranges:
        heads.append([table.first, table.second, sum(map(len, tables)), len(table.positions)])
        tables.append(np.concatenate([table.positions, table.lower, table.upper]))
    values, (joints, above, full) = np.concatenate(tables), _tree(pepper)
    counts = [len(joints), len(shapes), len(pairs), len(heads), values.size, len(vertices)]
    head = np.array([pepper.n, *counts, LEVER, apart], dtype=float)
    assert head.size == HEAD
    scratch = np.zeros(sum(sizes(*counts)[-4:]))
    parts = (
        head,
        joints,
        full,
        above,
        shapes,
        pairs,
        np.array(heads, dtype=float),
        values,
        vertices,
        scratch,
    )
    block = np.concatenate([np.ravel(part) for part in parts])
    place_still(block.ctypes.data)
    return block


def _pairs(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of the robot with itself and with the scene, places among all shapes, shape (k, 2)."""
    own = [pair for pairs in structure.classes for pair in pairs]
    count = len(structure.solids)
    world = [
        (member, count + int(place))
        for places, met in zip(np.split(structure.members, structure.ends[:-1]), structure.met, strict=False)
        for group in np.flatnonzero(met)
        for member in structure.groups[group]
        for place in places.tolist()
    ]
    first, second = (np.array(pairs, dtype=np.int64).reshape(-1, 2) for pairs in (own, world))
    return first, second


@kept_within(MOST_BYTES / 4, bytes_of)
def _shapes(solids: tuple[Solid, ...]) -> tuple[Array, Array]:
    """Return the rows of solids, shape (k, SHAPE), and the vertices of hulls, shape (v, 3)."""
    rows, vertices, place = np.zeros((len(solids), SHAPE)), [np.zeros((0, 3))], 0
    for row, solid in zip(rows, solids, strict=True):
        kind = HULL if len(solid.vertices) else solid.kind  # what is held as a cloud is its hull here
        corners = _outermost(solid.vertices)
        row[:2], row[2:5] = (kind, solid.joint), solid.position
        row[5:14], row[14:17] = solid.rotation.T.ravel(), solid.half
        row[17:] = solid.radius, solid.bounding_radius, place, len(corners)
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
def _tree(pepper: PepperModel) -> tuple[Array, Array, Array]:
    """Return the joints of the tree, which of them carry each, and how their coordinates depend on q."""
    joints, gains = joint_table(pepper), np.asarray(pepper.full_map)
    above = np.zeros((len(joints), len(joints) - 1))
    for k in range(1, len(joints)):
        above[k] = above[int(joints[k, 0])]
        above[k, k - 1] = 1.0
    full = np.zeros((len(joints) - 1, FULL))
    full[:, 0] = np.abs(gains).argmax(axis=1)
    full[:, 1] = gains[np.arange(len(gains)), full[:, 0].astype(int)]
    full[:, 2] = pepper.full_offset
    return joints, above, full
