"""Poses and velocities of the joints of a tree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.core.kinematic_tree import place_joints
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1


class TreeTable(NamedTuple):
    """Joints from parent to child; row 0 is the world, which does not move.

    Attributes:
        joints: Placements of the joints, see `core.kinematic_tree`, shape (m, JOINT).
        driver: Joint of the robot that drives each joint, -1 for none, shape (m,).
        ratio: Ratio of the joint's coordinate to the driver's, shape (m,).
        offset: Coordinate of the joint where the driver's is zero [rad or m], shape (m,).
    """

    joints: Floats2
    driver: Ints1
    ratio: Floats1
    offset: Floats1


class TreeMotion(NamedTuple):
    """Poses and velocities of the joints in the world.

    Attributes:
        coordinate: Coordinates of all joints but the world [rad or m], shape (m - 1,).
        pose: Center and axes of each joint; see `core.kinematic_tree`, shape (m, 12).
        axis: Axes of the joints in the world, shape (m, 3).
        linear: Velocity of each joint's origin [m/s], shape (m, 3).
        angular: Angular velocity of each joint [rad/s], shape (m, 3).
    """

    coordinate: Floats1
    pose: Floats2
    axis: Floats2
    linear: Floats2
    angular: Floats2


def tree_motion(tree: TreeTable) -> TreeMotion:
    """Return arrays for the motion of a tree."""
    count = len(tree.joints)
    return TreeMotion(np.zeros(count - 1), np.zeros((count, 12)), *(np.zeros((count, 3)) for _ in range(3)))


@compiled
def move_joints(tree: TreeTable, q: Floats1, v: Floats1, at: TreeMotion) -> None:
    """Write poses at q [rad or m] and velocities at v of all joints, shape (n,) each."""
    joints, pose = tree.joints, at.pose
    for j in range(1, len(joints)):
        k = tree.driver[j]
        at.coordinate[j - 1] = tree.offset[j] + (tree.ratio[j] * q[k] if k >= 0 else 0.0)
    place_joints(joints, at.coordinate, pose, at.axis)
    for j in range(1, len(joints)):
        p, k = int(joints[j, 0]), tree.driver[j]
        rate = tree.ratio[j] * v[k] if k >= 0 else 0.0
        x, y, z = pose[j, 0] - pose[p, 0], pose[j, 1] - pose[p, 1], pose[j, 2] - pose[p, 2]
        wx, wy, wz = at.angular[p, 0], at.angular[p, 1], at.angular[p, 2]
        at.linear[j, 0] = at.linear[p, 0] + wy * z - wz * y
        at.linear[j, 1] = at.linear[p, 1] + wz * x - wx * z
        at.linear[j, 2] = at.linear[p, 2] + wx * y - wy * x
        slides = joints[j, 1] > 0.0
        for i in range(3):
            at.angular[j, i] = at.angular[p, i]
            if slides:
                at.linear[j, i] += rate * at.axis[j, i]
            else:
                at.angular[j, i] += rate * at.axis[j, i]
