"""Arms that are kept from the body and the scene, each cycle of random motions into them."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import collision
from pepper_kin.naoqi import Broker
from pepper_kin.twin.arm_protection import KEPT, TOUCH

TABLE = pk.Scene().add_box("table", size=(0.60, 1.20, 0.03), position=(0.45, 0.0, 0.75))
ARM = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")


def least(body, q):
    """The least distance of links and objects but those within a hand, 3 cm at most [m]."""
    near = collision.near_pairs(body.pepper, q, 0.03, body.scene)
    of_a_hand = [a[0] == b[0] and all("Finger" in n or "Thumb" in n for n in (a, b)) for a, b in near.names]
    return near.distances[~np.array(of_a_hand, dtype=bool)].min(initial=0.03)


def watched(broker):
    """Return a list that gets, each cycle, the least distances of command and body [m]."""
    body, distances = broker.body, []
    body.listeners.append(
        lambda: distances.append([least(body, body.configuration(m)) for m in (False, True)])
    )
    return distances


def colliding(pepper, rng, scene):
    """Angles of the left arm at which it is 1 cm deep in something, the rest standing."""
    while True:
        names = [f"L{name}" for name in ARM]
        k = [pepper.joint_index(name) for name in names]
        q = pepper.posture("Stand").copy()
        q[k] = rng.uniform(pepper.lower_limits[k], pepper.upper_limits[k])
        if collision.closest_pair(pepper, q, scene).distance < -0.01:
            return names, q[k].tolist()


@pytest.mark.parametrize("scene", [None, TABLE], ids=["body", "table"])
def test_an_arm_stops_before_it_touches(scene):
    rng = np.random.default_rng(4)
    with Broker(mode="robot", real_time=False, scene=scene, response="ideal") as broker:
        motion, distances = broker.motion, watched(broker)
        before = broker.body.commanded("LShoulderPitch")
        for _ in range(8):
            names, angles = colliding(broker.body.pepper, rng, scene)
            motion.setAngles(names, angles, float(rng.uniform(0.2, 1.0)))
            broker.body.time.sleep(1.5)
            assert np.abs(np.array(motion.getAngles(names, False)) - angles).max() > 1e-3
        assert broker.body.commanded("LShoulderPitch") != before
    commanded, measured = np.array(distances).T
    assert commanded.min() > TOUCH - 1e-4
    assert commanded.min() < KEPT + 1e-3  # it goes as near as it may
    assert measured.min() > 0.0  # the body comes a cycle later


def test_a_blocked_arm_ends_no_call_and_holds_up_none():
    """Calls that wait for an arm return, and say whether it arrived."""
    with Broker(mode="robot", real_time=False) as broker:
        motion, posture = broker.motion, broker.module("ALRobotPosture")
        names, angles = colliding(broker.body.pepper, np.random.default_rng(4), None)
        motion.angleInterpolationWithSpeed(names, angles, 0.5)
        assert np.abs(np.array(motion.getAngles(names, False)) - angles).max() > 1e-3
        assert posture.goToPosture("Stand", 0.6) is True  # and away from it


def pressed(broker, seconds):
    """Send an arm down beside the body, which keeps it from its target, for some seconds."""
    broker.motion.setAngles(["LShoulderPitch", "LShoulderRoll", "LElbowRoll"], [0.0, 0.3, -0.1], 0.5)
    broker.body.time.sleep(4.0)
    broker.motion.setAngles(["LShoulderPitch", "LShoulderRoll"], [1.6, 0.05], 0.8)
    broker.body.time.sleep(seconds)


@pytest.mark.parametrize("response", ["ideal", "measured"])
def test_an_arm_that_is_kept_off_stays_where_it_was_stopped(response):
    """In mid-motion, while it slides, or at rest before the body: whatever comes free later."""
    for seconds in (0.2, 0.3, 0.6, 3.0):
        with Broker(mode="robot", real_time=False, response=response) as broker:
            motion = broker.motion
            pressed(broker, seconds)
            motion.killAll()
            stopped = motion.getAngles("LArm", False)
            broker.body.time.sleep(1.0)
            assert motion.getAngles("LArm", False) == stopped
            motion.setCollisionProtectionEnabled("Arms", False)
            broker.body.time.sleep(1.0)
            assert motion.getAngles("LArm", False) == stopped


def test_an_arm_that_rests_too_near_is_not_moved_with_others():
    with Broker(mode="robot", real_time=False) as broker:
        motion = broker.motion
        motion.setCollisionProtectionEnabled("Arms", False)
        pressed(broker, 3.0)
        near = least(broker.body, broker.body.configuration(False))
        assert near < KEPT
        motion.setCollisionProtectionEnabled("Arms", True)
        rests = motion.getAngles("LArm", False)
        motion.setAngles(["HeadYaw", "RShoulderPitch"], [0.5, 0.8], 0.3)
        broker.body.time.sleep(1.5)
        assert motion.getAngles("HeadYaw", False) == pytest.approx([0.5])
        assert motion.getAngles("LArm", False) == rests


def test_an_arm_whose_protection_ends_goes_on_no_faster_than_it_may():
    with Broker(mode="robot", real_time=False) as broker:
        motion, commanded = broker.motion, []
        broker.body.listeners.append(lambda: commanded.append(broker.body.configuration(False)))
        pressed(broker, 0.4)
        motion.setCollisionProtectionEnabled("Arms", False)
        broker.body.time.sleep(3.0)
        most = broker.body.pepper.velocity_limits * 0.02
        assert (np.abs(np.diff(commanded, axis=0)) <= most * (1 + 1e-9)).all()
        assert broker.body.commanded("LShoulderRoll") == pytest.approx(0.05)


def test_a_call_ends_when_an_arm_that_slides_has_come_to_rest():
    with Broker(mode="robot", real_time=False, response="ideal") as broker:
        motion = broker.motion
        motion.setAngles(["LShoulderPitch", "LShoulderRoll", "LElbowRoll"], [0.0, 0.3, -0.1], 0.5)
        broker.body.time.sleep(4.0)
        motion.angleInterpolation(["LShoulderPitch", "LShoulderRoll"], [1.6, 0.05], 1.5, True)
        rest = motion.getAngles("LArm", False)
        assert abs(rest[1] - 0.05) > 0.01
        broker.body.time.sleep(1.0)
        assert motion.getAngles("LArm", False) == pytest.approx(rest, abs=1e-4)


def test_postures_are_free_of_it_and_what_follows_is_not():
    """The straight way between these postures leads the hands through the shapes of the hips."""
    with Broker(mode="robot", real_time=False) as broker:
        motion, posture, distances = broker.motion, broker.module("ALRobotPosture"), watched(broker)
        names, angles = colliding(broker.body.pepper, np.random.default_rng(4), None)
        for name in ("Crouch", "Stand"):
            assert posture.goToPosture(name, 0.6) is True
        assert np.array(distances).min() < 0.0
        distances.clear()
        motion.angleInterpolation(names, angles, 3.0, True)
        assert np.array(distances)[:, 0].min() > TOUCH - 1e-4


def test_in_the_mode_of_the_twin_arms_are_free():
    with Broker(real_time=False) as broker:
        names, angles = colliding(broker.body.pepper, np.random.default_rng(4), None)
        broker.motion.angleInterpolation(names, angles, 3.0, True)
        assert broker.motion.getAngles(names, False) == pytest.approx(angles, abs=1e-6)


def test_without_protection_an_arm_goes_where_it_is_sent():
    with Broker(mode="robot", real_time=False) as broker:
        motion = broker.motion
        names, angles = colliding(broker.body.pepper, np.random.default_rng(4), None)
        assert motion.getCollisionProtectionEnabled("Arms") is True
        motion.setCollisionProtectionEnabled("LArm", False)
        assert motion.getCollisionProtectionEnabled("Arms") is False
        assert motion.getCollisionProtectionEnabled("RArm") is True
        motion.angleInterpolation(names, angles, 3.0, True)
        assert motion.getAngles(names, False) == pytest.approx(angles, abs=1e-6)
        assert motion.isCollision("Arms") == "LArm"


def test_the_scene_is_ignored_where_external_protection_is_off():
    rng, reached = np.random.default_rng(4), []
    with Broker(mode="robot", real_time=False, scene=TABLE) as broker:
        motion, pepper = broker.motion, broker.body.pepper
        while True:
            names, angles = colliding(pepper, rng, TABLE)
            q = broker.body.configuration(False)
            q[[pepper.joint_index(name) for name in names]] = angles
            if "table" in collision.closest_pair(pepper, q, TABLE).names and not collision.in_collision(
                pepper, q
            ):
                break
        for protected in (True, False):
            motion.setExternalCollisionProtectionEnabled("LArm", protected)
            assert motion.getExternalCollisionProtectionEnabled("LArm") is protected
            assert motion.getExternalCollisionProtectionEnabled("Move") is True
            motion.angleInterpolation([*names, "HeadYaw"], [*angles, 0.5], 2.0, True)
            assert motion.getAngles("HeadYaw", False) == pytest.approx([0.5])  # the rest goes on
            reached.append(least(broker.body, broker.body.configuration(False)))
    assert reached[0] > TOUCH - 1e-4
    assert reached[1] < -0.005
