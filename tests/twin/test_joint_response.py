"""How joints follow, as measured: the data, and what is refused; the sag of servos as stiff as a robot's."""

import copy
import pickle

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.twin import Twin, actuator_parameters, joint_response

MEASURED = ("HipPitch", *(f"{side}{joint}" for side in "LR" for joint in ("ShoulderPitch", "ElbowYaw")))


@pytest.fixture(scope="module")
def pepper():
    return pk.load_pepper()


def test_every_joint_has_values_within_their_intervals_and_a_source(pepper):
    response = joint_response(pepper)
    assert response.joint_names == pepper.joint_names
    for joint in MEASURED:
        j = response.index(joint)
        assert "fitted to 15 sessions" in response.sources[j]
        for quantity in ("speed_share", "latency", "lag", "backlash"):
            low, high = response.intervals[quantity][j]
            assert low < getattr(response, quantity)[j] < high
    head = response.index("HeadYaw")
    assert response.sources[head].startswith("assumed")
    assert np.isnan(response.intervals["lag"][head]).all()
    assert 0.05 < response.lag[head] < 0.15
    assert response.backlash[head] == response.compliance[head] == 0.0


def test_the_base_and_other_robots_follow_at_once():
    planar = joint_response(pk.load_pepper(base="planar"))
    assert planar.lag[planar.index("BaseX")] == planar.latency[planar.index("BaseX")] == 0.0
    assert planar.speed_share[planar.index("BaseX")] == 1.0
    other = joint_response(
        pk.load_robot(
            '<robot name="other"><link name="a"/><link name="b"/><joint name="J" type="revolute">'
            '<parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
            '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
        )
    )
    assert (other.speed_share[0], other.lag[0], other.sources) == (1.0, 0.0, ("ideal",))


def test_values_change_by_name_and_stay_read_only(pepper):
    response = joint_response(pepper, "ideal").changed(lag=0.1, backlash={"HipPitch": 0.01})
    assert (response.lag == 0.1).all()
    assert response.backlash.sum() == 0.01
    for same in (response, copy.deepcopy(response), pickle.loads(pickle.dumps(response))):
        with pytest.raises(ValueError, match="read-only"):
            same.lag[0] = 1.0


def test_what_is_wrong_is_refused(pepper):
    response = joint_response(pepper)
    with pytest.raises(InvalidValueError, match="kind"):
        joint_response(pepper, "best")
    with pytest.raises(UnknownNameError, match="mass"):
        response.changed(mass=1.0)
    with pytest.raises(UnknownNameError, match="Hip"):
        response.changed(lag={"Hip": 1.0})
    with pytest.raises(InvalidValueError, match="speed_share of KneePitch"):
        response.changed(speed_share={"KneePitch": 0.0})
    with pytest.raises(InvalidValueError, match="lag of HeadYaw"):
        response.changed(lag={"HeadYaw": -0.1})


def test_servos_as_stiff_as_the_robots_sag_as_the_robots_did(pepper):
    """Without feed-forward a joint at rest is gravity's torque over its stiffness below its command."""
    twin = Twin(pepper, 0.005, actuators=actuator_parameters(pepper, "measured"), feedforward="none")
    q = pepper.joint_vector(
        {"RShoulderPitch": 0.3, "LShoulderPitch": 0.3, "HeadPitch": 0.2, "HipPitch": -0.1}
    )
    twin.reset(q)
    end = twin.follow(np.tile(q, (600, 1))).position[-1]
    torque = pk.dynamics.gravity_torque(pepper, end)
    for joint, stiffness in {
        "RShoulderPitch": 254,
        "LShoulderPitch": 254,
        "HeadPitch": 164,
        "HipPitch": 556,
    }.items():
        j = pepper.joint_index(joint)
        friction = 0.5 / stiffness  # at most what Coulomb's friction and the encoder's steps hold
        assert q[j] - end[j] == pytest.approx(torque[j] / stiffness, abs=friction, rel=0.05), joint
