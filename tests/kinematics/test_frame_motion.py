import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError

OPTIONS = [("fixed", "locked"), ("planar", "mimic")]
FRAME = "LArm_effector"


def states(pepper, seed=0):
    rng = np.random.default_rng(seed)
    lower, upper = np.clip(pepper.lower_limits, -2, 2), np.clip(pepper.upper_limits, -2, 2)
    return rng.uniform(lower, upper), rng.normal(size=pepper.n), rng.normal(size=pepper.n)


@pytest.mark.parametrize(("base", "hands"), OPTIONS)
def test_velocity_and_acceleration_are_rates(base, hands):
    pepper = pk.load_pepper(base, hands)
    q, v, a = states(pepper)
    step = 1e-5

    def at(t):
        return q + t * v + t * t / 2 * a, v + t * a

    def rate(function):
        return (function(step) - function(-step)) / (2 * step)

    pose = rate(lambda t: pk.kinematics.frame_pose(pepper, at(t)[0], FRAME))
    spin = pose[:3, :3] @ pk.kinematics.frame_pose(pepper, q, FRAME)[:3, :3].T
    velocity = pk.kinematics.frame_velocity(pepper, q, v, FRAME)
    np.testing.assert_allclose(velocity, [*pose[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8)
    jacobian = pk.kinematics.frame_jacobian(pepper, q, FRAME)
    np.testing.assert_allclose(velocity, jacobian @ v, atol=1e-12)
    acceleration = pk.kinematics.frame_acceleration(pepper, q, v, a, FRAME)
    expected = rate(lambda t: pk.kinematics.frame_velocity(pepper, *at(t), FRAME))
    np.testing.assert_allclose(acceleration, expected, atol=1e-8)
    jacobian_rate = pk.kinematics.frame_jacobian_rate(pepper, q, v, FRAME)
    expected = rate(lambda t: pk.kinematics.frame_jacobian(pepper, at(t)[0], FRAME))
    np.testing.assert_allclose(jacobian_rate, expected, atol=1e-8)
    np.testing.assert_allclose(acceleration, jacobian @ a + jacobian_rate @ v, atol=1e-12)


def test_batches():
    pepper = pk.load_pepper()
    q, v, a = states(pepper)
    many = np.broadcast_to(q, (2, 3, 15))
    assert pk.kinematics.frame_velocity(pepper, many, v, FRAME).shape == (2, 3, 6)
    assert pk.kinematics.frame_acceleration(pepper, q, v, np.stack([a] * 4), FRAME).shape == (4, 6)
    assert pk.kinematics.frame_jacobian_rate(pepper, many, v, FRAME).shape == (2, 3, 6, 15)
    assert pk.kinematics.manipulability(pepper, many, FRAME).shape == (2, 3)


def test_manipulability():
    pepper = pk.load_pepper()
    q, _, _ = states(pepper)
    arm = pepper.joint_group("left_arm")
    jacobian = pk.kinematics.frame_jacobian(pepper, q, FRAME)
    columns = [pepper.joint_index(name) for name in arm]
    for part, rows in (("position", slice(0, 3)), ("rotation", slice(3, 6))):
        block = jacobian[rows][:, columns]
        expected = np.sqrt(np.linalg.det(block @ block.T))
        found = pk.kinematics.manipulability(pepper, q, FRAME, joints=arm, part=part)
        assert found == pytest.approx(expected, rel=1e-9)
    expected = np.sqrt(np.linalg.det(jacobian @ jacobian.T))
    assert pk.kinematics.manipulability(pepper, q, FRAME, part="pose") == pytest.approx(expected, rel=1e-9)
    assert pk.kinematics.manipulability(pepper, q, FRAME, joints=arm, part="pose") == 0
    # The head's two axes meet: turning it moves a point of the yaw axis nowhere.
    head = pepper.joint_group("head")
    assert pk.kinematics.manipulability(pepper, q, "Head", joints=head) == 0


def test_misuse_is_named():
    pepper, q = pk.load_pepper(), np.zeros(15)
    with pytest.raises(InvalidValueError, match="part: got 'linear', expected one of 'position'"):
        pk.kinematics.manipulability(pepper, q, FRAME, part="linear")
    with pytest.raises(InvalidValueError, match=r"joints: got .*, expected .*at least one moving joint"):
        pk.kinematics.manipulability(pepper, q, FRAME, joints=())
    with pytest.raises(UnknownNameError, match="unknown joint or group 'Elbow'"):
        pk.kinematics.manipulability(pepper, q, FRAME, joints=("Elbow",))
    for function in (pk.kinematics.frame_velocity, pk.kinematics.frame_jacobian_rate):
        with pytest.raises(UnknownNameError, match="unknown frame 'Hand'"):
            function(pepper, q, q, "Hand")
    with pytest.raises(InvalidValueError, match="v: got inf at joint KneePitch"):
        pk.kinematics.frame_velocity(pepper, q, [np.inf, *q[1:]], FRAME)
