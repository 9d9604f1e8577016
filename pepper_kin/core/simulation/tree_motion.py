"""Poses and velocities of the joints of a tree."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Floats3, Ints1


class TreeTable(NamedTuple):
    """Joints from parent to child; row 0 is the world and moves nothing.

    Attributes:
        parent: Row of the parent, shape (m,).
        rotation: Placement in the parent's frame, shape (m, 3, 3).
        position: [m], shape (m, 3).
        axis: Of the joint, in its own frame, shape (m, 3).
        slides: Whether it is prismatic, shape (m,).
        driver: Joint of the robot that moves it, -1 for none, shape (m,).
        ratio: Change of its coordinate over that of the driver, shape (m,).
        offset: Its coordinate where the driver's is zero [rad or m], shape (m,).
    """

    parent: Ints1
    rotation: Floats3
    position: Floats2
    axis: Floats2
    slides: Flags1
    driver: Ints1
    ratio: Floats1
    offset: Floats1


class TreeMotion(NamedTuple):
    """Where the joints are in the world, and how fast.

    Attributes:
        rotation: Shape (m, 3, 3).
        position: [m], shape (m, 3).
        axis: Of the joints in the world, shape (m, 3).
        linear: Velocity of each joint's origin [m/s], shape (m, 3).
        angular: [rad/s], shape (m, 3).
    """

    rotation: Floats3
    position: Floats2
    axis: Floats2
    linear: Floats2
    angular: Floats2


def tree_motion(tree: TreeTable) -> TreeMotion:
    """Return arrays for the motion of a tree."""
    count = len(tree.parent)
    return TreeMotion(np.tile(np.eye(3), (count, 1, 1)), *(np.zeros((count, 3)) for _ in range(4)))


@compiled
def move_joints(tree: TreeTable, q: Floats1, v: Floats1, at: TreeMotion) -> None:
    """Write where all joints are at q [rad or m] and how fast at v, shape (n,) each."""
    turn = np.empty((3, 3))
    base = np.empty((3, 3))
    for j in range(1, len(tree.parent)):
        p, k = tree.parent[j], tree.driver[j]
        angle = tree.offset[j] + (tree.ratio[j] * q[k] if k >= 0 else 0.0)
        rate = tree.ratio[j] * v[k] if k >= 0 else 0.0
        for i in range(3):
            at.position[j, i] = at.position[p, i]
            for m in range(3):
                at.position[j, i] += at.rotation[p, i, m] * tree.position[j, m]
                base[i, m] = 0.0
                for o in range(3):
                    base[i, m] += at.rotation[p, i, o] * tree.rotation[j, o, m]
        for i in range(3):
            at.axis[j, i] = (
                base[i, 0] * tree.axis[j, 0] + base[i, 1] * tree.axis[j, 1] + base[i, 2] * tree.axis[j, 2]
            )
        if tree.slides[j]:
            for i in range(3):
                at.position[j, i] += angle * at.axis[j, i]
                for m in range(3):
                    at.rotation[j, i, m] = base[i, m]
        else:
            _rotation_about(tree.axis[j], angle, turn)
            for i in range(3):
                for m in range(3):
                    at.rotation[j, i, m] = (
                        base[i, 0] * turn[0, m] + base[i, 1] * turn[1, m] + base[i, 2] * turn[2, m]
                    )
        x, y = at.position[j, 0] - at.position[p, 0], at.position[j, 1] - at.position[p, 1]
        z = at.position[j, 2] - at.position[p, 2]
        wx, wy, wz = at.angular[p, 0], at.angular[p, 1], at.angular[p, 2]
        at.linear[j, 0] = at.linear[p, 0] + wy * z - wz * y
        at.linear[j, 1] = at.linear[p, 1] + wz * x - wx * z
        at.linear[j, 2] = at.linear[p, 2] + wx * y - wy * x
        for i in range(3):
            at.angular[j, i] = at.angular[p, i]
            if tree.slides[j]:
                at.linear[j, i] += rate * at.axis[j, i]
            else:
                at.angular[j, i] += rate * at.axis[j, i]


@compiled(lean=True)
def _rotation_about(axis: Floats1, angle: float, turn: Floats2) -> None:
    """Write the rotation by an angle [rad] about a unit axis."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    t = 1.0 - c
    turn[0, 0], turn[0, 1], turn[0, 2] = c + t * x * x, t * x * y - s * z, t * x * z + s * y
    turn[1, 0], turn[1, 1], turn[1, 2] = t * x * y + s * z, c + t * y * y, t * y * z - s * x
    turn[2, 0], turn[2, 1], turn[2, 2] = t * x * z - s * y, t * y * z + s * x, c + t * z * z
