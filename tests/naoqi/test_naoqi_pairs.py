"""Calls that block, while something moves the robot that does not end by itself: each returns.

The law: after at most the time that both motions take one after the other, whatever runs beside.  The maker's
documents name no call that waits for a tracker or a velocity to be stopped.
"""

import numpy as np
import pinocchio as pin
import pytest

from pepper_kin.naoqi import Broker
from pepper_kin.naoqi.simulated_time import TimeIsUp

LONGEST = 40.0
FACE = [2.0, 0.8, 1.2]
HEY = "animations/Stand/Gestures/Hey_1"


def track(broker, mode="Head", effector="None", place=FACE):
    tracker = broker.module("ALTracker")
    tracker.registerTarget("Face", 0.1)
    if place is not None:
        tracker.place_target("Face", place)
    tracker.setMode(mode)
    tracker.setEffector(effector)
    tracker.track("Face")


BEGUN = {
    "head follows": track,
    "head and arms follow": lambda b: track(b, "WholeBody", "Arms"),
    "base follows": lambda b: track(b, "Move", "LArm"),
    "nothing to follow": lambda b: track(b, place=None),
    "move": lambda b: b.motion.move(0.05, 0.0, 0.0),
    "breathing": lambda b: b.motion.setBreathEnabled("Body", True),
    "limp head": lambda b: b.motion.setStiffnesses("Head", 0.0),
}
CALLS = {
    "lookAt": lambda b: b.module("ALTracker").lookAt([1.0, 0.5, 1.0], 0.5, False),
    "lookAt with the body": lambda b: b.module("ALTracker").lookAt([1.0, 0.5, 1.0], 2, 0.5, True),
    "pointAt": lambda b: b.module("ALTracker").pointAt("LArm", [1.0, 0.5, 1.0], 2, 0.5),
    "angleInterpolation": lambda b: b.motion.angleInterpolation("Head", [0.3, -0.1], 1.0, True),
    "stiffnessInterpolation": lambda b: b.motion.stiffnessInterpolation("Head", 1.0, 0.5),
    "openHand": lambda b: b.motion.openHand("LHand"),
    "goToPosture": lambda b: b.module("ALRobotPosture").goToPosture("StandInit", 0.6),
    "wbGoToBalance": lambda b: b.motion.wbGoToBalance("Legs", 1.0),
    "run": lambda b: b.module("ALAnimationPlayer").run(HEY),
    "say": lambda b: b.module("ALAnimatedSpeech").say(f"^start({HEY}) hello ^wait({HEY})"),
    "moveTo": lambda b: b.motion.moveTo(0.2, 0.0, 0.0),
    "navigateTo": lambda b: b.module("ALNavigation").navigateTo(0.2, 0.0),
    "moveAlong": lambda b: b.module("ALNavigation").moveAlong(["Holonomic", ["Line", [0.2, 0.0]], 0.0, 3.0]),
    "waitUntilMoveIsFinished": lambda b: b.motion.waitUntilMoveIsFinished(),
}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("begun", BEGUN)
def test_a_call_that_blocks_returns_whatever_else_moves(begun):
    forever = []
    for name, call in CALLS.items():
        with Broker(real_time=False) as broker:
            BEGUN[begun](broker)
            broker.body.time.sleep(0.5)
            broker.body.time.limit(broker.body.time.now + LONGEST)
            try:
                call(broker)
            except TimeIsUp:
                forever.append(name)
    assert forever == []


def off_axis(broker, point):
    """The angle between the top camera's axis and a point of FRAME_ROBOT [rad], by Pinocchio alone."""
    model = pin.buildModelFromXML(broker.body.pepper.urdf)
    data, q = model.createData(), pin.neutral(model)
    for name in broker.motion.getBodyNames("Joints"):
        q[model.joints[model.getJointId(name)].idx_q] = broker.body.commanded(name)
    pin.framesForwardKinematics(model, data, q)
    base, eye = (data.oMf[model.getFrameId(name)] for name in ("base_footprint", "CameraTop_frame"))
    x, y, z = base.actInv(eye).actInv(np.array(point))
    return float(np.arctan2(np.hypot(y, z), x))


def test_a_tracker_makes_way_for_calls_and_takes_its_joints_back(broker):
    track(broker)
    tracker, motion = broker.module("ALTracker"), broker.motion
    broker.body.time.sleep(2.0)
    assert off_axis(broker, FACE) < 0.02
    tracker.lookAt([1.5, -0.9, 1.0], 2, 0.5, False)
    assert off_axis(broker, [1.5, -0.9, 1.0]) < 0.02
    broker.body.time.sleep(2.0)
    assert off_axis(broker, FACE) < 0.02
    motion.setAngles("HeadYaw", -0.8, 0.5)
    lowest = 0.0
    for _ in range(100):
        broker.body.time.sleep(0.02)
        lowest = min(lowest, motion.getAngles("HeadYaw", False)[0])
    assert lowest == pytest.approx(-0.8, abs=0.02)
    assert off_axis(broker, FACE) < 0.02
    assert tracker.isActive()
    motion.killAll()
    assert not tracker.isActive()
