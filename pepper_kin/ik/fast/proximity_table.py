"""Table of a robot's surroundings for `core.inverse_kinematics.proximity`."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.near_table import movable, near_table
from pepper_kin.collision.fast.structure import structure_of
from pepper_kin.core.collision.distances import near_points
from pepper_kin.core.inverse_kinematics.local_solver import MOST_NEAR
from pepper_kin.core.inverse_kinematics.proximity import ProximityTable
from pepper_kin.kernels.tables import TableMemory

LEVER = 0.3
"""Length that counts as one radian where joints leave a dependent range [m/rad]."""


def proximity_memory(checker: CollisionChecker, apart: float, most: int = MOST_NEAR) -> TableMemory:
    """Return the proximity table of a robot in a scene, for one thread.

    Args:
        checker: The robot and the scene, with its margin.
        apart: Distance that bodies shall keep in addition to margins [m].
        most: Maximum number of pairs.
    """
    pepper, near = checker.pepper, movable(near_table(checker))
    to_world = (near.pairs[:, :2] >= len(structure_of(checker).solids)).any(axis=1)
    near = near._replace(keep=np.where(to_world, checker.margin, checker.self_margin))
    ranges, tables = [], [np.zeros(0)]
    for table in checker.dependent_ranges:
        ranges.append([table.first, table.second, sum(map(len, tables)), len(table.positions)])
        tables.append(np.concatenate([table.positions, table.lower, table.upper]))
    joints, map_to_tree = len(near.joints), np.asarray(pepper.full_map)
    leaders = np.abs(map_to_tree).argmax(axis=1)
    return TableMemory(
        ProximityTable,
        near=near,
        points=near_points(near, most, 0),
        leaders=leaders,
        gains=map_to_tree[np.arange(len(leaders)), leaders],
        offsets=pepper.full_offset,
        ranges=np.array(ranges, np.int64).reshape(-1, 4),
        tables=np.concatenate(tables),
        q_full=np.zeros(joints - 1),
        poses=np.zeros((joints, 12)),
        axes=np.zeros((joints, 3)),
        gradient=np.zeros(joints - 1),
        joints=pepper.n,
        lever=LEVER,
        apart=apart,
    )
