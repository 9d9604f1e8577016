"""Where the head stops: as a robot's did in 5,067 settled postures published with PepperKinematics (2021)."""

import numpy as np
import pytest

HEAD = ["HeadYaw", "HeadPitch"]
STOPS = {51: 22.9, 63: 20.7, 75: 17.7, 87: 14.8, 99: 13.8, 119: 13.8}
"""|yaw| -> where the pitch stopped when 25.5 was commanded [deg]."""


@pytest.mark.parametrize(("yaw", "stop"), STOPS.items())
def test_the_pitch_stops_where_a_robot_s_did(broker, motion, yaw, stop):
    for side in (-1, 1):
        motion.setAngles(HEAD, np.radians([side * yaw, 25.5]).tolist(), 0.3)
        broker.body.time.sleep(4.0)
        found = np.degrees(motion.getAngles(HEAD, True))
        assert found[0] == pytest.approx(side * yaw, abs=0.1)
        assert found[1] == pytest.approx(stop, abs=0.45)
        assert motion.getTaskList() == []


@pytest.mark.parametrize("yaw", [0, 20, 45, -45, 99])
def test_elsewhere_it_goes_where_it_is_sent(broker, motion, yaw):
    for pitch in (-40.4, 13.0, 25.5 if abs(yaw) <= 45 else 13.8):
        motion.setAngles(HEAD, np.radians([yaw, pitch]).tolist(), 0.3)
        broker.body.time.sleep(4.0)
        assert np.degrees(motion.getAngles(HEAD, True)) == pytest.approx([yaw, pitch], abs=0.1)


def test_calls_that_wait_return_in_their_time(broker, motion):
    began = broker.body.time.now
    motion.angleInterpolation(HEAD, np.radians([99.0, 30.0]).tolist(), 2.0, True)
    assert broker.body.time.now - began == pytest.approx(2.02, abs=0.02)
    assert np.degrees(motion.getAngles("HeadPitch", False)[0]) == pytest.approx(13.8, abs=0.05)
    motion.angleInterpolationWithSpeed(HEAD, np.radians([75.0, 25.5]).tolist(), 0.3)
    assert np.degrees(motion.getAngles("HeadPitch", False)[0]) == pytest.approx(17.7, abs=0.45)
    motion.angleInterpolation("HeadPitch", 0.1, 1.0, True)
    assert motion.getAngles("HeadPitch", True)[0] == pytest.approx(0.1, abs=1e-3)


def test_the_yaw_pushes_the_pitch(broker, motion):
    """Every command that the twin gets is one that a robot reaches."""
    motion.angleInterpolation(HEAD, np.radians([0.0, 25.0]).tolist(), 1.0, True)
    rows = []
    broker.body.listeners.append(lambda: rows.append(broker.body.configuration(False)))
    motion.angleInterpolation("HeadYaw", np.radians(-110.0), 1.0, True)
    yaw, pitch = (np.degrees(np.array(rows)[:, broker.body.index[name]]) for name in HEAD)
    stops = np.interp(np.abs(yaw), [45.0, *STOPS], [25.5, *STOPS.values()])
    assert (pitch < stops + 0.35).all()
    assert pitch[0] == pytest.approx(25.0)
    assert pitch[-1] == pytest.approx(13.8, abs=0.05)
