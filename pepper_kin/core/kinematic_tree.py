"""Forward kinematics of a table of joints."""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

JOINT = 17
"""Numbers of a joint: its parent, whether it slides, its placement there as a pose (12), its axis (3).

A pose is the origin [m] and the x, y and z axis, shape (12,)."""


@compiled(lean=True)
def compose(outer: Floats1, inner: Floats1, pose: Floats1) -> None:
    """Write the pose of a frame in the world from its pose in another frame; all have the shape (12,).

    Args:
        outer: Pose of the other frame in the world.
        inner: Pose of the frame in the other.
        pose: Written.
    """
    for column in range(4):
        x, y, z = inner[3 * column], inner[3 * column + 1], inner[3 * column + 2]
        for i in range(3):
            own = outer[i] if column == 0 else 0.0
            pose[3 * column + i] = own + x * outer[3 + i] + y * outer[6 + i] + z * outer[9 + i]


@compiled("void(float64[:, ::1], float64[::1], float64[:, ::1], float64[:, ::1])")
def place_joints(joints: Floats2, q: Floats1, poses: Floats2, axes: Floats2) -> None:
    """Write the poses and axes of all joints in the world.

    Args:
        joints: Rows of JOINT numbers, that of the universe first, shape (njoints, JOINT).
        q: Coordinates of `pinocchio_model` [rad or m], shape (njoints - 1,).
        poses: Written, poses of the joints, shape (njoints, 12) [m].
        axes: Written, their axes, shape (njoints, 3).
    """
    motion, still = np.zeros(12), np.empty(12)
    poses[0] = 0.0
    poses[0, 3], poses[0, 7], poses[0, 11] = 1.0, 1.0, 1.0
    axes[0] = 0.0
    for k in range(1, joints.shape[0]):
        slides, u = joints[k, 1] > 0.0, joints[k, 14:17]
        cosine = 1.0 if slides else math.cos(q[k - 1])
        sine = 0.0 if slides else math.sin(q[k - 1])
        for i in range(3):
            motion[i] = q[k - 1] * u[i] if slides else 0.0
            for j in range(3):
                motion[3 + 3 * i + j] = (1.0 - cosine) * u[i] * u[j]
            # Column i of the rotation: cos e_i + sin (u x e_i) + (1 - cos) u_i u.
            motion[3 + 4 * i] += cosine
            motion[3 + 3 * i + (i + 1) % 3] += sine * u[(i + 2) % 3]
            motion[3 + 3 * i + (i + 2) % 3] -= sine * u[(i + 1) % 3]
        compose(poses[int(joints[k, 0])], joints[k, 2:14], still)
        compose(still, motion, poses[k])
        for i in range(3):
            axes[k, i] = u[0] * still[3 + i] + u[1] * still[6 + i] + u[2] * still[9 + i]
