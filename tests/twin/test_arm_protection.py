"""Arms kept off the body: the nearest posture that is clear, by an independent search."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import collision
from pepper_kin.twin.arm_protection import KEPT, TOUCH, arm_protection

JOINTS = ("LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw")


@pytest.fixture(scope="module")
def pepper():
    return pk.load_pepper()


def least(pepper, q):
    return collision.closest_pair(pepper, q).distance


def pressed(pepper, cycles=400):
    """Return where the left arm rests that is sent towards the body, and where it is sent."""
    q = pepper.joint_vector({"LShoulderPitch": 1.75, "LShoulderRoll": 0.5, "LElbowRoll": -0.6})
    wanted = q.copy()
    wanted[pepper.joint_index("LShoulderRoll")] = 0.03
    protection = arm_protection(pepper, 0.02)
    for _ in range(cycles):
        q = protection.allowed(q, wanted)
        assert least(pepper, q) > TOUCH - 1e-4
    return q, wanted


def test_an_arm_rests_at_the_nearest_posture_that_is_clear(pepper):
    """No posture that keeps the distance, among many around, is nearer to where the arm is sent."""
    q, wanted = pressed(pepper)
    assert least(pepper, q) == pytest.approx(KEPT, abs=2e-4)
    found = np.linalg.norm(q - wanted)
    assert found > 0.05
    places = [pepper.joint_index(joint) for joint in JOINTS]
    low, high = pepper.lower_limits, pepper.upper_limits
    rng = np.random.default_rng(0)
    for size in (0.003, 0.01, 0.03):
        for _ in range(300):
            other = q.copy()
            other[places] += size * rng.normal(size=len(places))
            nearer = np.linalg.norm(other - wanted) < found - 1e-3
            assert not (
                nearer
                and np.array_equal(np.clip(other, low, high), other)
                and least(pepper, other) > KEPT + 2e-4
            )


def test_other_joints_and_clear_arms_go_where_they_are_sent(pepper):
    q, wanted = pressed(pepper)
    away = wanted.copy()
    away[pepper.joint_index("LShoulderRoll")], away[pepper.joint_index("HeadYaw")] = 0.5, 0.4
    protection = arm_protection(pepper, 0.02)
    assert protection.allowed(q, away)[pepper.joint_index("HeadYaw")] == 0.4
    for _ in range(20):
        q = protection.allowed(q, away)
    np.testing.assert_array_equal(q, away)
    protection.active = False
    np.testing.assert_array_equal(protection.allowed(q, wanted), wanted)
