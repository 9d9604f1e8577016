"""Forward kinematics of a table of joints."""

from __future__ import annotations

import math

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

JOINT = 17
"""Size of a joint: its parent, 1 if it is prismatic, its placement in the parent as a pose (12), its axis
(3).

A pose is the origin [m], then the x, y and z axis, shape (12,)."""


@compiled(lean=True)
def compose(outer: Floats1, inner: Floats1, pose: Floats1) -> None:
    """Write the pose of a frame in the world from its pose in another frame; all have the shape (12,).

    Args:
        outer: Pose of the other frame in the world.
        inner: Pose of the frame in the other.
        pose: Output.
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
        joints: Rows of JOINT numbers, the universe first, shape (njoints, JOINT).
        q: Coordinates of `pinocchio_model` [rad or m], shape (njoints - 1,).
        poses: Output, poses of the joints, shape (njoints, 12) [m].
        axes: Output, unit axes of the joints, shape (njoints, 3).
    """
    poses[0] = 0.0
    poses[0, 3], poses[0, 7], poses[0, 11] = 1.0, 1.0, 1.0
    axes[0] = 0.0
    for k in range(1, joints.shape[0]):
        pose, x, y, z = poses[k], joints[k, 14], joints[k, 15], joints[k, 16]
        compose(poses[int(joints[k, 0])], joints[k, 2:14], pose)
        slides = joints[k, 1] > 0.0
        sine, rest = (0.0, 0.0) if slides else (math.sin(q[k - 1]), 1.0 - math.cos(q[k - 1]))
        for i in range(3):
            # Row i of R exp([u] q) = R + sin q R [u] + (1 - cos q) (w u^T - R), with w = R u.
            a, b, c = pose[3 + i], pose[6 + i], pose[9 + i]
            w = a * x + b * y + c * z
            axes[k, i] = w
            if slides:
                pose[i] += q[k - 1] * w
            else:
                pose[3 + i] = a + sine * (b * z - c * y) + rest * (w * x - a)
                pose[6 + i] = b + sine * (c * x - a * z) + rest * (w * y - b)
                pose[9 + i] = c + sine * (a * y - b * x) + rest * (w * z - c)
