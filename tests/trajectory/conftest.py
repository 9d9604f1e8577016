"""A motion that several tests look at."""

import pytest

import pepper_kin as pk


@pytest.fixture(scope="module")
def pepper():
    """The robot whose motions use all that the limits allow: limits are what is tested here."""
    return pk.load_pepper().with_requirements("limits")


@pytest.fixture(scope="module")
def trajectory(pepper):
    q = pepper.posture("Stand")
    goal = pepper.joint_vector({"LShoulderPitch": 0.6, "LElbowYaw": -0.4, "HeadYaw": 0.5, "HipPitch": -0.15})
    return pk.retime(pepper, [q, goal])
