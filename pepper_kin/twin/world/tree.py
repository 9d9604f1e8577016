"""The robot's tree as arrays, and where its links are and how fast."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.model import PepperModel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Tree:
    """Joints of the Pinocchio model from parent to child; row 0 is the world and moves nothing.

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

    parent: Indices
    rotation: Array
    position: Array
    axis: Array
    slides: NDArray[np.bool_]
    driver: Indices
    ratio: Array
    offset: Array

    @classmethod
    def of(cls, pepper: PepperModel | None) -> Tree:
        """Return the tree of a robot; of None, the world alone."""
        count = 1 if pepper is None else pepper.pinocchio_model.njoints
        tree = cls(
            np.zeros(count, np.int64),
            np.tile(np.eye(3), (count, 1, 1)),
            np.zeros((count, 3)),
            np.zeros((count, 3)),
            np.zeros(count, bool),
            np.full(count, -1, np.int64),
            np.zeros(count),
            np.zeros(count),
        )
        if pepper is None:
            return tree
        import pinocchio

        model = pepper.pinocchio_model
        data = model.createData()
        pinocchio.computeJointJacobians(model, data, np.zeros(model.nq))
        for joint in range(1, count):
            column = model.joints[joint].idx_v
            motion = pinocchio.getJointJacobian(model, data, joint, pinocchio.LOCAL)[:, column]
            placement = model.jointPlacements[joint]
            tree.parent[joint] = model.parents[joint]
            tree.rotation[joint], tree.position[joint] = placement.rotation, placement.translation
            tree.slides[joint] = bool(np.abs(motion[3:]).max() < 1e-12)
            tree.axis[joint] = motion[:3] if tree.slides[joint] else motion[3:]
            row = pepper.full_map[column]
            driver = int(np.argmax(np.abs(row)))
            if row[driver] != 0.0:
                tree.driver[joint], tree.ratio[joint] = driver, row[driver]
            tree.offset[joint] = pepper.full_offset[column]
        return tree


@dataclass(frozen=True, eq=False)
class TreeState:
    """Where the joints are in the world; overwritten by every `place`.

    Attributes:
        rotation: (m, 3, 3).
        position: [m], shape (m, 3).
        axis: Of the joints in the world, shape (m, 3).
        linear: Velocity of each joint's origin [m/s], shape (m, 3).
        angular: [rad/s], shape (m, 3).
    """

    rotation: Array
    position: Array
    axis: Array
    linear: Array
    angular: Array

    @classmethod
    def of(cls, tree: Tree) -> TreeState:
        """Return room for a tree."""
        count = len(tree.parent)
        vectors = [np.zeros((count, 3)) for _ in range(4)]
        return cls(np.tile(np.eye(3), (count, 1, 1)), *vectors)


def place(tree: Tree, state: TreeState, q: Array, v: Array) -> None:
    """Write where all joints are at q [rad or m] and how fast at v, shape (n,)."""
    place_joints(
        tree.parent, tree.rotation, tree.position, tree.axis, tree.slides, tree.driver, tree.ratio,
        tree.offset, q, v, state.rotation, state.position, state.axis, state.linear, state.angular,
    )  # fmt: skip


@njit("void(float64[::1], float64, float64[:, ::1])", **OPTIONS)
def rodrigues(axis: Array, angle: float, turn: Array) -> None:
    """Write the rotation by an angle [rad] about a unit axis."""
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    t = 1.0 - c
    turn[0, 0], turn[0, 1], turn[0, 2] = c + t * x * x, t * x * y - s * z, t * x * z + s * y
    turn[1, 0], turn[1, 1], turn[1, 2] = t * x * y + s * z, c + t * y * y, t * y * z - s * x
    turn[2, 0], turn[2, 1], turn[2, 2] = t * x * z - s * y, t * y * z + s * x, c + t * z * z


@njit(
    "void(int64[::1], float64[:, :, ::1], float64[:, ::1], float64[:, ::1], boolean[::1], int64[::1], "
    "float64[::1], float64[::1], float64[::1], float64[::1], float64[:, :, ::1], float64[:, ::1], "
    "float64[:, ::1], float64[:, ::1], float64[:, ::1])",
    **OPTIONS,
)
def place_joints(
    parent: Indices,
    rotation: Array,
    position: Array,
    axis: Array,
    slides: NDArray[np.bool_],
    driver: Indices,
    ratio: Array,
    offset: Array,
    q: Array,
    v: Array,
    at_rotation: Array,
    at_position: Array,
    at_axis: Array,
    linear: Array,
    angular: Array,
) -> None:
    """Write poses and velocities of all joints; see `Tree` and `TreeState`."""
    turn = np.empty((3, 3))
    base = np.empty((3, 3))
    for j in range(1, len(parent)):
        p, k = parent[j], driver[j]
        angle = offset[j] + (ratio[j] * q[k] if k >= 0 else 0.0)
        rate = ratio[j] * v[k] if k >= 0 else 0.0
        for i in range(3):
            at_position[j, i] = at_position[p, i]
            for m in range(3):
                at_position[j, i] += at_rotation[p, i, m] * position[j, m]
                base[i, m] = 0.0
                for o in range(3):
                    base[i, m] += at_rotation[p, i, o] * rotation[j, o, m]
        for i in range(3):
            at_axis[j, i] = base[i, 0] * axis[j, 0] + base[i, 1] * axis[j, 1] + base[i, 2] * axis[j, 2]
        if slides[j]:
            for i in range(3):
                at_position[j, i] += angle * at_axis[j, i]
                for m in range(3):
                    at_rotation[j, i, m] = base[i, m]
        else:
            rodrigues(axis[j], angle, turn)
            for i in range(3):
                for m in range(3):
                    at_rotation[j, i, m] = (
                        base[i, 0] * turn[0, m] + base[i, 1] * turn[1, m] + base[i, 2] * turn[2, m]
                    )
        x, y = at_position[j, 0] - at_position[p, 0], at_position[j, 1] - at_position[p, 1]
        z = at_position[j, 2] - at_position[p, 2]
        wx, wy, wz = angular[p, 0], angular[p, 1], angular[p, 2]
        linear[j, 0] = linear[p, 0] + wy * z - wz * y
        linear[j, 1] = linear[p, 1] + wz * x - wx * z
        linear[j, 2] = linear[p, 2] + wx * y - wy * x
        for i in range(3):
            angular[j, i] = angular[p, i]
            if slides[j]:
                linear[j, i] += rate * at_axis[j, i]
            else:
                angular[j, i] += rate * at_axis[j, i]
