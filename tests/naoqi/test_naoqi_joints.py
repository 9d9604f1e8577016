"""ALMotion's joints: what is commanded is reached, in the time and at the speed documented."""

import threading

import numpy as np
import pinocchio as pin
import pytest

import pepper_kin as pk
from pepper_kin.naoqi import NaoqiError
from pepper_kin.naoqi.joint_followers import JointFollowers
from pepper_kin.naoqi.joint_names import ACTUATED, BODY, CHAINS
from pepper_kin.naoqi.joint_tasks import SpeedTask
from pepper_kin.naoqi.simulated_time import CYCLE
from pepper_kin.naoqi.tasks import BodyTask
from pepper_kin.twin import joint_response

DOCUMENTED_HEAD = ["HeadYaw", "HeadPitch"]


def test_body_names_are_in_the_order_of_the_robot(motion):
    assert motion.getBodyNames("Body")[:2] == DOCUMENTED_HEAD
    assert motion.getBodyNames("Body")[-3:] == ["WheelFL", "WheelFR", "WheelB"]
    assert len(motion.getBodyNames("Body")) == 20
    assert motion.getBodyNames("LArm") == [f"L{part}" for part in (
        "ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw", "Hand")]  # fmt: skip


def test_angle_interpolation_takes_its_time_and_gets_there(broker, motion):
    rng = np.random.default_rng(1)
    names = [name for name in ACTUATED if name not in ("LHand", "RHand")]
    limits = dict(zip(names, motion.getLimits("Joints"), strict=True))
    start = broker.body.time.now
    errors = []
    for _ in range(5):
        goal = [float(rng.uniform(0.4, 0.6) * (limits[n][1] - limits[n][0]) + limits[n][0]) for n in names]
        motion.angleInterpolation(names, goal, 2.0, True)
        measured = np.array(motion.getAngles(names, True))
        errors.append(measured - goal)
    assert broker.body.time.now - start == pytest.approx(5 * 2.02)
    assert np.sqrt(np.mean(np.square(errors))) < 1e-3


def test_relative_interpolation_adds_to_the_command(motion):
    before = motion.getAngles("HeadYaw", False)[0]
    motion.angleInterpolation("HeadYaw", [0.2, -0.1], [0.5, 1.0], False)
    assert motion.getAngles("HeadYaw", False)[0] == pytest.approx(before - 0.1)


def test_set_angles_keeps_its_share_of_the_fastest_speed(broker, motion):
    fastest = motion.getLimits("LShoulderPitch")[0][2]
    motion.setAngles("LShoulderPitch", -1.0, 0.2)
    found_here = [motion.getAngles("LShoulderPitch", False)[0]]
    while motion.getTaskList():
        broker.body.time.sleep(0.02)
        found_here.append(motion.getAngles("LShoulderPitch", False)[0])
    rates = np.abs(np.diff(found_here)) / 0.02
    assert rates.max() == pytest.approx(0.2 * fastest, rel=1e-3)
    assert found_here[-1] == pytest.approx(-1.0)


def test_set_angles_returns_at_once_and_the_last_one_counts(broker, motion):
    before = broker.body.time.now
    motion.setAngles("HeadYaw", 1.0, 0.1)
    motion.setAngles("HeadYaw", -0.3, 0.3)
    assert broker.body.time.now == before
    broker.body.time.sleep(3.0)
    assert motion.getAngles("HeadYaw", True)[0] == pytest.approx(-0.3, abs=1e-3)


def test_a_task_waits_for_its_joints_and_others_do_not(broker, motion):
    rows = []
    broker.body.listeners.append(lambda: rows.append(broker.body.configuration(False)))
    first = motion.pCall("angleInterpolation", "HeadYaw", 0.5, 20.0, True)
    while motion.areResourcesAvailable(["HeadYaw"]):  # until its thread has come to it
        assert motion.isRunning(first)
    second = motion.pCall("angleInterpolation", "HeadYaw", -0.5, 1.0, True)
    motion.angleInterpolation("HeadPitch", 0.1, 1.0, True)
    motion.wait(second, 0)
    yaw, pitch = (np.array(rows)[:, broker.body.index[name]] for name in ("HeadYaw", "HeadPitch"))
    top = int(np.argmax(yaw))
    assert yaw[top] == pytest.approx(0.5)  # the second has waited for the end of the first
    assert (np.diff(yaw[: top + 1]) > -1e-9).all()
    assert (np.diff(yaw[top:]) < 1e-9).all()
    assert yaw[-1] == pytest.approx(-0.5)
    assert len(rows) > 1000
    assert int(np.argmax(pitch > 0.0999)) < top  # another joint has not


def test_posted_calls_that_ended_are_forgotten_one_day(broker, motion):
    first = motion.pCall("getAngles", "Tail", True)
    with pytest.raises(NaoqiError, match="'Tail' is no joint"):
        motion.wait(first, 0)
    assert not motion.isRunning(first)
    slow = motion.pCall("angleInterpolation", "HeadYaw", 0.2, 100.0, True)
    for _ in range(1000):
        motion.wait(motion.pCall("getAngles", "HeadYaw", True), 0)
    assert not motion.wait(first, 0), "nothing is known of it"
    assert motion.isRunning(slow), "of what runs, something is"
    motion.killAll()


def test_a_killed_task_ends(broker, motion):
    number = motion.pCall("angleInterpolation", "HeadYaw", 1.0, 5.0, True)
    broker.body.time.sleep(0.5)
    ((name, task),) = motion.getTaskList()
    assert name == "angleInterpolation"
    assert motion.killTask(task)
    motion.wait(number, 0)
    assert broker.body.time.now < 2.0
    assert abs(motion.getAngles("HeadYaw", True)[0]) < 0.5
    assert not motion.killTask(task)


def test_without_stiffness_an_arm_falls_and_is_where_it_fell(broker, motion):
    motion.angleInterpolation("LShoulderPitch", 0.3, 1.0, True)
    motion.setStiffnesses("LArm", 0.0)
    broker.body.time.sleep(6.0)
    hanging = motion.getAngles("LShoulderPitch", True)[0]
    assert hanging > 1.0
    motion.setStiffnesses("LArm", 1.0)
    broker.body.time.sleep(0.5)
    assert motion.getAngles("LShoulderPitch", True)[0] == pytest.approx(hanging, abs=0.05)


def test_bezier_curves_pass_through_their_keys(broker, motion):
    times = [[0.5, 1.2, 2.0]]
    keys = [[[0.3, [3, -0.17, 0.0], [3, 0.23, 0.0]], [-0.2, [3, -0.23, 0.1], [3, 0.27, -0.1]],
             [0.0, [3, -0.27, 0.0], [3, 0.0, 0.0]]]]  # fmt: skip
    found, body = {}, broker.body
    body.listeners.append(lambda: found.update({round(body.time.now, 2): body.commanded("HeadYaw")}))
    number = motion.pCall("angleInterpolationBezier", ["HeadYaw"], times, keys)
    while motion.isRunning(number):
        body.time.sleep(0.02)
    begun = min(time for time, angle in found.items() if angle != 0.0) - 0.02
    for time, (value, *_) in zip(times[0], keys[0], strict=True):
        nearest = min(found, key=lambda t: abs(t - begun - time))
        assert found[nearest] == pytest.approx(value, abs=0.03)


def test_hands_open_and_close(motion):
    motion.closeHand("LHand")
    assert motion.getAngles("LHand", True)[0] == pytest.approx(0.02, abs=1e-2)
    motion.openHand("LHand")
    assert motion.getAngles("LHand", True)[0] == pytest.approx(0.98, abs=1e-2)


def test_limits_are_those_of_the_description(broker, motion):
    model = pin.buildModelFromXML(broker.body.pepper.urdf)
    for name in CHAINS["Joints"]:
        joint = model.joints[model.getJointId(name)]
        lower, upper, velocity, torque = motion.getLimits(name)[0]
        assert lower == model.lowerPositionLimit[joint.idx_q]
        assert upper == model.upperPositionLimit[joint.idx_q]
        assert velocity == model.velocityLimit[joint.idx_v]
        assert torque == model.effortLimit[joint.idx_v]


def test_angles_are_clipped_to_their_limits(motion):
    motion.angleInterpolationWithSpeed("HeadPitch", 3.0, 0.5)
    assert motion.getAngles("HeadPitch", False)[0] == motion.getLimits("HeadPitch")[0][1]


def test_wrong_calls_say_what_is_wrong(motion):
    for call, words in (
        (lambda: motion.getAngles("Foot", True), "'Foot' is no joint and no chain"),
        (lambda: motion.setAngles("HeadYaw", [0.1, 0.2], 0.1), "2 numbers for 1 joints"),
        (lambda: motion.setAngles("HeadYaw", float("nan"), 0.1), "expected a finite number"),
        (lambda: motion.setAngles("HeadYaw", 0.1, 0.0), "above 0 and at most 1"),
        (
            lambda: motion.angleInterpolation("HeadYaw", [0.1, 0.2], [1.0, 0.5], True),
            "times above 0 that rise",
        ),
        (lambda: motion.angleInterpolation("HeadYaw", [0.1, 0.2], [1.0], True), "2 values and 1 times"),
        (lambda: motion.openHand("Hand"), "LHand, RHand"),
    ):
        with pytest.raises(NaoqiError, match="ALMotion::") as error:
            call()
        assert words in str(error.value)
        assert isinstance(error.value, RuntimeError)


def test_the_summary_lists_every_joint(motion):
    text = motion.getSummary()
    assert all(name in text for name in BODY)


def test_joints_that_follow_as_measured_are_late_by_latency_and_lag():
    """On a ramp at a constant speed a joint is latency plus lag behind, and half the play."""
    pepper = pk.load_pepper()
    response = joint_response(pepper, "ideal").changed(latency=0.05, lag=0.1, backlash=0.004)
    followers = JointFollowers(pepper, response, np.zeros(pepper.n), 0.02)
    for k in range(100):
        reached = followers.step(np.full(pepper.n, 0.5 * CYCLE * (k + 1)))

    behind = 0.5 * (0.03 + CYCLE / (1.0 - np.exp(-CYCLE / 0.1)) - CYCLE) + 0.004
    np.testing.assert_allclose(0.5 * CYCLE * 100 - reached, behind, atol=1e-6)
    followers.place(np.ones(pepper.n))
    np.testing.assert_array_equal(followers.step(np.ones(pepper.n)), 1.0)


@pytest.mark.parametrize(
    ("stop", "moves"),
    [
        (lambda motion, _: motion.killAll(), False),
        (lambda motion, _: motion.killTasksUsingResources(["HeadYaw", "LHand"]), False),
        (lambda motion, number: motion.stop(number), False),
        (lambda motion, _: motion.killTasksUsingResources(["LArm"]), True),
        (lambda motion, _: motion.killMove(), True),
    ],
)
def test_a_call_on_its_way_does_not_move_joints_that_are_stopped_meanwhile(broker, motion, stop, moves):
    go, (rest,) = threading.Event(), motion.getAngles("HeadYaw", False)

    def call():
        go.wait(60.0)
        motion.setAngles("HeadYaw", 0.3, 0.5)

    number = broker.post(call)
    stop(motion, number)
    go.set()
    assert not broker.wait_for(number, None)
    broker.body.time.sleep(1.0)
    assert motion.getAngles("HeadYaw", False) == pytest.approx([0.3 if moves else rest])
    motion.setAngles("HeadYaw", -0.2, 0.5)
    broker.body.time.sleep(1.0)
    assert motion.getAngles("HeadYaw", False) == pytest.approx([-0.2])


def test_what_a_task_begins_while_a_stopped_call_waits_is_not_of_that_call(broker, motion):
    """Time passes in the thread that waits, which runs the cycles of all."""

    class Begins(BodyTask):
        def step(self, body):
            body.tasks.add(SpeedTask("setAngles", {"HeadYaw": 0.3}, 0.5))
            return False

    go = threading.Event()
    number = broker.post(lambda: go.wait(60.0) and broker.body.time.sleep(2.0))
    motion.killAll()
    broker.body.do(Begins("begins", ["HeadPitch"]))
    go.set()
    broker.wait_for(number, None)
    assert motion.getAngles("HeadYaw", False) == pytest.approx([0.3])


@pytest.mark.parametrize("stopped", [False, True])
def test_a_posted_posture_stops_what_moves_before_and_is_stopped_itself(broker, motion, stopped):
    posture, go = broker.module("ALRobotPosture"), threading.Event()
    number = broker.post(lambda: go.wait(60.0) and posture.goToPosture("Crouch", 0.8))
    if stopped:
        motion.killAll()
    motion.killMove()
    go.set()
    before = motion.getAngles("KneePitch", False)
    broker.body.time.sleep(6.0)
    assert (motion.getAngles("KneePitch", False) == before) is stopped
    broker.wait_for(number, 60.0)
