"""Poses and rotations from rpy and quaternions, beside SciPy and Pinocchio."""

import numpy as np
import pinocchio
import pytest
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_rpy,
    rpy_from_rotation,
)

RANDOM = Rotation.random(500, rng=3)
EDGES = Rotation.from_rotvec(
    [(0, 0, 0), (np.pi, 0, 0), (0, np.pi, 0), (0, 0, np.pi), (np.pi - 1e-9, 1e-9, 0), (1e-12, 0, 0)]
)


@pytest.mark.parametrize("turns", [RANDOM, EDGES], ids=["random", "edges"])
def test_quaternions_are_scipys_in_both_orders(turns):
    matrices, xyzw = turns.as_matrix(), turns.as_quat()
    np.testing.assert_allclose(rotation_from_quaternion(xyzw), matrices, atol=1e-14)
    np.testing.assert_allclose(rotation_from_quaternion(-xyzw), matrices, atol=1e-14)
    np.testing.assert_allclose(
        rotation_from_quaternion(xyzw[:, [3, 0, 1, 2]], order="wxyz"), matrices, atol=1e-14
    )
    found = quaternion_from_rotation(matrices)
    np.testing.assert_allclose(Rotation.from_quat(found).as_matrix(), matrices, atol=1e-14)
    assert np.all(found[:, 3] >= 0)
    np.testing.assert_array_equal(quaternion_from_rotation(matrices, order="wxyz"), found[:, [3, 0, 1, 2]])


def test_rpy_is_urdfs():
    angles = np.random.default_rng(1).uniform((-3, -1.5, -3), (3, 1.5, 3), (200, 3))
    matrices = rotation_from_rpy(angles)
    np.testing.assert_allclose(matrices, [pinocchio.rpy.rpyToMatrix(*each) for each in angles], atol=1e-14)
    np.testing.assert_allclose(rpy_from_rotation(matrices), angles, atol=1e-12)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_rpy_where_roll_and_yaw_turn_about_one_axis(pitch):
    matrix = rotation_from_rpy((0.3, pitch, 0.5))
    found = rpy_from_rotation(matrix)
    assert found[2] == 0.0
    np.testing.assert_allclose(rotation_from_rpy(found), matrix, atol=1e-9)


def test_a_pose_is_the_same_in_every_form():
    turn = Rotation.from_euler("xyz", (0.4, -0.2, 1.1))  # lower case: fixed axes
    position = (0.4, 0.2, 0.9)
    expected = pinocchio.SE3(turn.as_matrix(), np.array(position)).homogeneous
    x, y, z, w = turn.as_quat()
    for form in (
        {"rpy": (0.4, -0.2, 1.1)},
        {"quaternion_xyzw": (x, y, z, w)},
        {"quaternion_wxyz": (w, x, y, z)},
        {"rotation": turn.as_matrix()},
    ):
        np.testing.assert_allclose(pk.pose(position, **form), expected, atol=1e-14)
    np.testing.assert_array_equal(pk.pose(position)[:3, :3], np.eye(3))


def test_many_poses_at_once():
    poses = pk.pose(np.zeros((5, 1, 3)), quaternion_xyzw=RANDOM.as_quat()[:4])
    assert poses.shape == (5, 4, 4, 4)
    np.testing.assert_allclose(poses[2, :, :3, :3], RANDOM.as_matrix()[:4], atol=1e-14)
    hands = pk.pose((0.4, 0.2, 0.9), rpy=np.zeros((3, 3)))
    assert pk.ik.solve_batch(pk.load_pepper(), [pk.ik.HandPose("left", hands)]).q.shape == (3, 15)


def test_rounded_quaternions_are_taken_and_made_unit():
    turn = rotation_from_quaternion((0.0, 0.0, 0.707, 0.707))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(turn, rotation_from_rpy((0, 0, np.pi / 2)), atol=1e-15)


def test_misuse_is_named():
    for arguments, words in [
        ({"quaternion_xyzw": (0, 0, 0, 2)}, r"quaternion \(xyzw\): got .* of length 2, expected a unit"),
        ({"quaternion_wxyz": (0, 0, 0, 0)}, r"quaternion \(wxyz\): got .* of length 0"),
        ({"quaternion_xyzw": (0, 0, 1)}, r"quaternion \(xyzw\): got shape \(3,\)"),
        ({"rpy": (0, 0, np.nan)}, "rpy: got nan"),
        ({"rpy": (0, 0)}, r"rpy: got shape \(2,\)"),
        ({"rotation": np.eye(3) * 1.01}, "rotation: got .*expected a rotation matrix"),
        ({"rotation": np.diag([1, 1, -1])}, "right-handed"),
        ({"rpy": (0, 0, 0), "rotation": np.eye(3)}, "orientation: got rpy and rotation, expected one of"),
        ({"position": (0, 0)}, r"position: got shape \(2,\)"),
        ({"position": np.zeros((2, 3)), "rpy": np.zeros((3, 3))}, "leading axes that fit"),
    ]:
        with pytest.raises(InvalidValueError, match=words):
            pk.pose(**arguments)


def test_another_order_is_refused():
    with pytest.raises(InvalidValueError, match="order: got 'xywz', expected one of 'xyzw', 'wxyz'"):
        rotation_from_quaternion((0, 0, 0, 1), order="xywz")
