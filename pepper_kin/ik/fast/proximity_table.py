"""The shapes of a robot and a scene as the block that `core.inverse_kinematics.proximity` reads."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.near_pairs import _tables_of
from pepper_kin.core.collision import distances
from pepper_kin.core.inverse_kinematics.proximity import (
    BLOCK,
    FULL,
    HEAD,
    PLANE,
    SEGMENT,
    place_still,
    sizes,
)
from pepper_kin.ik.tasks.task import Array

LEVER = 0.3
"""Meters that count as a radian where joints leave a dependent range."""

_KINDS = {
    distances.SEGMENT: SEGMENT,
    distances.BOX: BLOCK,
    distances.BOXED: BLOCK,
    distances.PLANE: PLANE,
}


def proximity_block(checker: CollisionChecker, apart: float) -> Array:
    """Return the block of a robot in a scene.

    Args:
        checker: The robot and scene, with the margin to it.
        apart: How far bodies shall stay apart beyond margins [m].
    """
    known, pepper = _tables_of(checker), checker.pepper
    joints, shapes = known.joints, known.shapes.copy()
    shapes[:, 0] = [_KINDS[int(kind)] for kind in shapes[:, 0]]
    above = np.zeros((len(joints), len(joints) - 1))
    for k in range(1, len(joints)):
        above[k] = above[int(joints[k, 0])]
        above[k, k - 1] = 1.0
    gains = np.asarray(pepper.full_map)
    full = np.zeros((len(joints) - 1, FULL))
    full[:, 0] = np.abs(gains).argmax(axis=1)
    full[:, 1] = gains[np.arange(len(gains)), full[:, 0].astype(int)]
    full[:, 2] = pepper.full_offset
    ends, planes = known.pairs[:, :2], shapes[known.pairs[:, 1], 0] == PLANE
    keep = apart + checker._margins
    far = np.where(planes, np.inf, shapes[ends, 18].sum(axis=1) + keep)
    pairs = np.column_stack([ends, keep, far])
    heads, tables = [], [np.zeros(0)]
    for table in checker._ranges:
        heads.append([table.first, table.second, sum(map(len, tables)), len(table.positions)])
        tables += [np.concatenate([table.positions, table.lower, table.upper])]
    values = np.concatenate(tables)
    head = np.array([pepper.n, len(joints), len(shapes), len(pairs), len(heads), values.size, LEVER, apart])
    room = np.zeros(sum(sizes(*head[1:6].astype(int))[-4:]))
    parts = (head, joints, full, above, shapes, pairs, np.array(heads, dtype=float), values, room)
    assert head.size == HEAD
    block = np.concatenate([np.ravel(part) for part in parts])
    place_still(block.ctypes.data)
    return block
