"""The surroundings of a robot in a scene, as the memory that `core.inverse_kinematics.proximity` reads."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.checker import CollisionChecker
from pepper_kin.collision.fast.near_table import movable, near_table
from pepper_kin.collision.fast.structure import structure_of
from pepper_kin.core.array_memory import memory_of
from pepper_kin.core.collision.distances import near_points
from pepper_kin.core.inverse_kinematics.local_solver import MOST_NEAR
from pepper_kin.core.inverse_kinematics.proximity import FULL
from pepper_kin.model import PepperModel, kept_for_robot

LEVER = 0.3
"""Meters that count as a radian where joints leave a dependent range."""


def proximity_memory(checker: CollisionChecker, apart: float, most: int = MOST_NEAR) -> tuple[Array, object]:
    """Return the memory of a robot in a scene, for one thread, and what has to live as long as it.

    Args:
        checker: The robot and scene, with the margin to it.
        apart: How far bodies shall stay apart beyond margins [m].
        most: Number of pairs that are found at most.
    """
    pepper, near = checker.pepper, movable(near_table(checker))
    to_world = (near.pairs[:, :2] >= len(structure_of(checker).solids)).any(axis=1)
    near = near._replace(keep=np.where(to_world, checker.margin, checker.self_margin))
    heads, tables = [], [np.zeros(0)]
    for table in checker.dependent_ranges:
        heads.append([table.first, table.second, sum(map(len, tables)), len(table.positions)])
        tables.append(np.concatenate([table.positions, table.lower, table.upper]))
    joints = len(near.joints)
    return memory_of(
        [pepper.n, LEVER, apart],
        [
            *near, _full_rows(pepper), np.array(heads, dtype=float), np.concatenate(tables),
            np.zeros(joints - 1), np.zeros((joints, 12)), np.zeros((joints, 3)), np.zeros(joints - 1),
            *near_points(near, most, 0),
        ],
    )  # fmt: skip


@kept_for_robot(most=32)
def _full_rows(pepper: PepperModel) -> Array:
    """Return how the coordinates of the tree depend on q, shape (njoints - 1, FULL)."""
    gains = np.asarray(pepper.full_map)
    full = np.zeros((len(gains), FULL))
    full[:, 0] = np.abs(gains).argmax(axis=1)
    full[:, 1] = gains[np.arange(len(gains)), full[:, 0].astype(int)]
    full[:, 2] = pepper.full_offset
    return full
