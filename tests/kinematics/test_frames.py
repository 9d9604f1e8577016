from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError

REFERENCE = np.load(Path(__file__).parents[1] / "data" / "fk_reference.npz")


def angle(a, b):
    """Angle of the rotation between two rotation matrices, precise near zero."""
    return np.linalg.norm(a - b, axis=(-2, -1)) / np.sqrt(2)


@pytest.fixture(scope="module")
def reference_q():
    pepper = pk.load_pepper(hands="mimic")
    order = [list(REFERENCE["joints"]).index(name) for name in pepper.joint_names]
    return pepper, REFERENCE["q"][:, order]


@pytest.mark.parametrize("frame", [str(name) for name in REFERENCE["frames"]])
def test_published_configurations(reference_q, frame):
    """200 configurations computed from the public descriptions: 1e-6 m and 1e-6 rad."""
    pepper, q = reference_q
    expected = REFERENCE["poses"][:, list(REFERENCE["frames"]).index(frame)]
    found = pk.kinematics.frame_pose(pepper, q, frame)
    assert np.abs(found[:, :3, 3] - expected[:, :3, 3]).max() < 1e-6
    assert angle(found[:, :3, :3], expected[:, :3, :3]).max() < 1e-6


def test_cameras_are_where_naoqi_on_a_robot_says():
    """NAOqi's positions less the newest URDF's [mm]: a constant length, and the mean over 5,067 postures of a
    head in the robot's axes, measured on the data of PepperKinematics (RO-MAN 2021).

    The postures fill the range of the head, so that the mean is compared with one over a grid.
    """
    for frame, newest, distance, mean in [
        ("CameraTop_frame", (0.0868, 0.0, 0.1631), 0.83, (-0.28, -0.05, -0.35)),
        ("CameraBottom_frame", (0.0936, 0.0, 0.0616), 1.00, (-0.38, -0.06, 0.03)),
    ]:
        pepper = pk.load_pepper()
        head_yaw, head_pitch = pepper.joint_index("HeadYaw"), pepper.joint_index("HeadPitch")
        q = np.zeros((25, 20, 15))
        q[..., head_yaw] = np.linspace(-2.08, 2.08, 25)[:, None]
        q[..., head_pitch] = np.linspace(-0.7, 0.445, 20)
        q = q[~pk.collision.in_collision(pepper, q)]
        ours, head = (pk.kinematics.frame_pose(pepper, q, name) for name in (frame, "Head"))
        shift = 1e3 * (ours[:, :3, 3] - (head @ [*newest, 1.0])[:, :3])
        assert np.linalg.norm(shift, axis=1) == pytest.approx(distance, abs=0.01)
        assert shift.mean(axis=0) == pytest.approx(mean, abs=0.08)


def test_heights_at_zero():
    pepper = pk.load_pepper()
    heights = {"torso": 0.681, "torso_naoqi": 0.82, "Tibia": 0.334, "base_footprint": 0.0}
    for frame, z in heights.items():
        assert pk.kinematics.frame_pose(pepper, np.zeros(15), frame)[2, 3] == pytest.approx(z, abs=1e-12)


def test_positive_joints_move_as_documented():
    pepper = pk.load_pepper()

    def head(joint):
        q = np.zeros(15)
        q[pepper.joint_index(joint)] = 0.3
        return pk.kinematics.frame_pose(pepper, q, "Head")[:3, 3]

    assert head("KneePitch")[0] < -0.1  # leans backward
    assert head("HipPitch")[0] < -0.05
    assert head("HipRoll")[1] > 0.05  # leans to the left


def test_batch_axes_lead():
    pepper = pk.load_pepper()
    rng = np.random.default_rng(0)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (2, 3, 15))
    poses = pk.kinematics.frame_pose(pepper, q, "LArm_effector")
    assert poses.shape == (2, 3, 4, 4)
    np.testing.assert_array_equal(poses[1, 2], pk.kinematics.frame_pose(pepper, q[1, 2], "LArm_effector"))
    assert pk.kinematics.frame_pose(pepper, np.empty((0, 15)), "Head").shape == (0, 4, 4)
    links = pk.kinematics.link_poses(pepper, q)
    assert links.shape == (2, 3, len(pepper.link_names), 4, 4)
    np.testing.assert_array_equal(links[0, 1, pepper.link_names.index("LArm_effector")], poses[0, 1])


@pytest.mark.parametrize(
    ("base", "hands"), [("fixed", "locked"), ("planar", "mimic"), ("fixed", "independent")]
)
def test_jacobian_is_the_derivative_of_the_pose(base, hands):
    pepper = pk.load_pepper(base, hands)
    rng = np.random.default_rng(1)
    lower, upper = np.clip(pepper.lower_limits, -2, 2), np.clip(pepper.upper_limits, -2, 2)
    step = 1e-6
    for frame in ("LArm_effector", "CameraTop_frame", "RFinger23_link"):
        q = rng.uniform(lower, upper)
        jacobian = pk.kinematics.frame_jacobian(pepper, q, frame)
        rotation = pk.kinematics.frame_pose(pepper, q, frame)[:3, :3]
        for j in range(pepper.n):
            move = np.eye(pepper.n)[j] * step
            ahead = pk.kinematics.frame_pose(pepper, q + move, frame)
            behind = pk.kinematics.frame_pose(pepper, q - move, frame)
            linear = (ahead[:3, 3] - behind[:3, 3]) / (2 * step)
            spin = (ahead[:3, :3] - behind[:3, :3]) / (2 * step) @ rotation.T
            angular = [spin[2, 1], spin[0, 2], spin[1, 0]]
            np.testing.assert_allclose(jacobian[:, j], [*linear, *angular], atol=1e-8)


def test_bad_q_is_named():
    for q, message in [
        (np.zeros(14), r"q: got shape \(14,\), expected shape \(..., 15\), one value per joint: KneePitch"),
        (np.full(15, np.nan), "q: got nan at joint KneePitch"),
        ([*np.zeros(14), np.inf], "q: got inf at joint RWristYaw"),
        ("hello", "q: got 'hello', expected numbers"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            pk.kinematics.frame_pose(pk.load_pepper(), q, "Head")


def test_unknown_frame_lists_frames():
    with pytest.raises(
        UnknownNameError,
        match=r"unknown frame 'Hand' \(did you mean 'r_hand'\?\); available: .*LArm_effector",
    ):
        pk.kinematics.frame_jacobian(pk.load_pepper(), np.zeros(15), "Hand")


@pytest.mark.parametrize("options", [{}, {"base": "planar"}, {"hands": "mimic"}, {"hands": "independent"}])
def test_joints_that_carry_a_frame_are_those_that_move_it(options):
    pepper = pk.load_pepper(**options)
    q = np.random.default_rng(3).uniform(
        np.maximum(pepper.lower_limits, -1.0), np.minimum(pepper.upper_limits, 1.0)
    )
    for frame in pepper.frame_names:
        moving = np.abs(pk.kinematics.frame_jacobian(pepper, q, frame)).max(axis=0) > 1e-9
        assert pepper.joints_above(frame) == np.flatnonzero(moving).tolist(), frame
    with pytest.raises(UnknownNameError, match="frame"):
        pepper.joints_above("tail")
