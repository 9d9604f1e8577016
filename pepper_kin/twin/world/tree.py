"""The robot's tree of joints for compiled code."""

from __future__ import annotations

import numpy as np

from pepper_kin.collision.fast.joint_table import joint_table
from pepper_kin.core.kinematic_tree import JOINT
from pepper_kin.core.simulation.tree_motion import TreeTable
from pepper_kin.model import PepperModel


def tree_table(pepper: PepperModel | None) -> TreeTable:
    """Return the tree of a robot; of None, the world alone."""
    joints = np.zeros((1, JOINT)) if pepper is None else joint_table(pepper)
    count = len(joints)
    tree = TreeTable(joints, np.full(count, -1, np.int64), np.zeros(count), np.zeros(count))
    if pepper is None:
        return tree
    for joint in range(1, count):
        column = pepper.inner_model.joints[joint].idx_v
        row = pepper.full_map[column]
        driver = int(np.argmax(np.abs(row)))
        if row[driver] != 0.0:
            tree.driver[joint], tree.ratio[joint] = driver, row[driver]
        tree.offset[joint] = pepper.full_offset[column]
    return tree
