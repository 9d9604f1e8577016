"""The robot's tree of joints for compiled code."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.fast.joint_table import joint_table
from pepper_kin.core.kinematic_tree import JOINT
from pepper_kin.core.simulation.tree_motion import TreeTable
from pepper_kin.model import PepperModel


def tree_table(pepper: PepperModel | None) -> TreeTable:
    """Return the tree of a robot; for None, only the world."""
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


def levers_of(pepper: PepperModel | None, tree: TreeTable, radius: Array) -> Array:
    """Return bounds on how far any point moves per motion of each joint [m/rad or 1], shape (n,).

    For a revolute joint, the bound is the length of the longest stretched chain of links to a point;
    prismatic joints on the way count with their maximum travel.

    Args:
        pepper: The robot; None for none.
        tree: The robot's tree of m joints.
        radius: Maximum distance of the shapes of each joint from its origin [m], shape (m,).
    """
    if pepper is None:
        return np.zeros(0)
    model, count = pepper.inner_model, len(tree.joints)
    reach, slides = radius.copy(), tree.joints[:, 1] > 0.0
    low, high = np.append(pepper.lower_limits, 0.0), np.append(pepper.upper_limits, 0.0)
    lever = np.zeros(pepper.n)
    for joint in range(count - 1, 0, -1):
        driver = tree.driver[joint]
        if driver >= 0:
            moves = 1.0 if slides[joint] else reach[joint]
            lever[driver] += abs(tree.ratio[joint]) * moves
        travel = abs(tree.offset[joint]) if slides[joint] else 0.0
        if slides[joint] and driver >= 0:
            travel += abs(tree.ratio[joint]) * max(abs(low[driver]), abs(high[driver]))
        offset = float(np.linalg.norm(model.jointPlacements[joint].translation))
        parent = int(tree.joints[joint, 0])
        reach[parent] = max(reach[parent], offset + travel + reach[joint])
    return lever
