"""What the servo follows, how closely, and where it slows down."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")
CENTER = np.array([0.30, 0.20, 0.95])


def hand(q, side="left"):
    return pk.kinematics.frame_pose(PEPPER, q, pk.ik.HandPosition(side, (0, 0, 0)).frame)[:3, 3]


def circle(time, radius=0.06, period=4.0):
    angle = 2 * np.pi * time / period
    return CENTER + radius * np.array([0.0, np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("scene", [None, pk.Scene()])
def test_follows_a_circle_while_looking_at_the_hand(scene):
    servo = pk.servo.Servo(PEPPER, STAND, scene=scene)
    hand_errors, gaze_errors = [], []
    for _ in range(700):
        target = circle(servo.time)
        servo.set_target([pk.ik.HandPosition("left", target), pk.ik.LookAt(target)])
        state = servo.step()
        hand_errors.append(np.linalg.norm(hand(state.q) - circle(state.time)))
        gaze_errors.append(pk.ik.LookAt(circle(state.time)).error(PEPPER, state.q))
    assert max(hand_errors[300:]) < 0.1e-3
    assert max(gaze_errors[300:]) < 0.5e-3
    assert state.status is pk.servo.ServoStatus.ARRIVED


def test_both_hands_and_gaze_at_once_come_to_rest_at_their_targets():
    servo = pk.servo.Servo(PEPPER, STAND, command_timeout=10.0, collisions=False)
    left, right = np.array([0.30, 0.25, 0.95]), np.array([0.25, -0.30, 0.85])
    servo.set_target(
        [pk.ik.HandPosition("left", left), pk.ik.HandPosition("right", right), pk.ik.LookAt((1.0, 0.3, 1.0))]
    )
    states = [servo.step() for _ in range(900)]
    assert states[300].status is states[-1].status is pk.servo.ServoStatus.ARRIVED
    assert max(states[-1].errors) < 2e-4
    # What freedom is left is used to drift back towards the first posture, ever more slowly.
    assert np.abs(states[-1].v).max() < 3e-2 < np.abs(states[300].v).max()
    # The hand comes in without swinging past its target.
    distances = [np.linalg.norm(hand(state.q) - left) for state in states]
    first = next(i for i, distance in enumerate(distances) if distance < 5e-3)
    assert max(distances[first:]) < 6e-3


def test_out_of_reach_it_comes_near_and_rests_there():
    servo = pk.servo.Servo(PEPPER, STAND, command_timeout=60.0, collisions=False)
    target = np.array([1.2, 0.3, 1.0])
    servo.set_target(pk.ik.HandPosition("left", target))
    states = [servo.step() for _ in range(1500)]
    closest = pk.ik.solve(
        PEPPER, pk.ik.HandPosition("left", target), start=STAND, solver="proxsuite", collisions=False
    )
    assert states[-1].errors[0] < closest.errors[0].value + 0.03
    late = np.array([state.v for state in states[-200:]])
    assert np.abs(late).max() < 0.1
    assert states[-1].status is pk.servo.ServoStatus.LIMITED
    assert states[-1].limited_by


def test_twist_is_followed_in_world_and_hand_axes():
    start = PEPPER.joint_vector({"LShoulderPitch": 0.6, "LElbowRoll": -1.0, "LShoulderRoll": 0.3})
    rotation = pk.kinematics.frame_pose(PEPPER, start, "LArm_effector")[:3, :3]
    for axes, turn in (("world", np.eye(3)), ("hand", rotation)):
        servo = pk.servo.Servo(PEPPER, start, collisions=False)
        velocity = np.array([0.02, -0.03, 0.05])
        states = []
        for _ in range(40):
            servo.set_twist("left", velocity, axes=axes)
            states.append(servo.step())
        last = states[-1]
        jacobian = pk.kinematics.frame_jacobian(PEPPER, states[-2].q, "LArm_effector")
        assert jacobian[:3] @ last.v == pytest.approx(turn @ velocity, abs=6e-3)
        assert last.scale == 1.0


def test_angular_twist_turns_the_hand():
    start = PEPPER.joint_vector({"LShoulderPitch": 0.6, "LElbowRoll": -1.0, "LShoulderRoll": 0.3})
    servo = pk.servo.Servo(PEPPER, start, collisions=False)
    for _ in range(30):
        servo.set_twist("left", (0, 0, 0), (0.0, 0.0, 0.2))
        before = servo.q
        servo.step()
    moved = pk.kinematics.frame_jacobian(PEPPER, before, "LArm_effector") @ servo.v
    assert moved == pytest.approx([0, 0, 0, 0, 0, 0.2], abs=0.03)


def test_an_outstretched_arm_slows_down_and_keeps_still_in_the_lost_direction():
    """Along the arm nothing is left to give; across it the same arm is as free as ever."""
    straight = PEPPER.joint_vector({"LShoulderPitch": 0.2, "LElbowRoll": -0.05, "LShoulderRoll": 0.2})
    locked = ("torso", "head", "right_arm")
    arm = hand(straight) - pk.kinematics.frame_pose(PEPPER, straight, "LShoulder")[:3, 3]
    along = arm / np.linalg.norm(arm)
    across = np.cross(along, (0.0, 0.0, 1.0))
    scales, speeds = [], []
    for direction in (along, across):
        servo = pk.servo.Servo(PEPPER, straight, locked=locked, collisions=False)
        for _ in range(15):
            servo.set_twist("left", 0.1 * direction)
            state = servo.step()
        scales.append(state.scale)
        speeds.append(np.abs(state.v).max())
    assert scales[0] < 0.4 < 0.9 < scales[1]
    assert "singularity of left hand" in servo_words(straight, locked, along)
    assert max(speeds) < 0.1 / 0.05 * 1.2  # no joint faster than the threshold allows


def servo_words(start, locked, direction):
    servo = pk.servo.Servo(PEPPER, start, locked=locked, collisions=False)
    servo.set_twist("left", 0.1 * direction)
    return servo.step().report()


def test_slowing_grows_as_the_arm_stretches():
    scales = []
    for bend in (-1.2, -0.6, -0.3, -0.1, -0.02):
        start = PEPPER.joint_vector({"LShoulderPitch": 0.2, "LElbowRoll": bend, "LShoulderRoll": 0.2})
        servo = pk.servo.Servo(PEPPER, start, locked=("torso", "head", "right_arm"), collisions=False)
        arm = [PEPPER.joint_index(name) for name in PEPPER.joint_group("left_arm")]
        jacobian = pk.kinematics.frame_jacobian(PEPPER, start, "LArm_effector")[:3, arm]
        servo.set_twist("left", 0.1 * np.linalg.svd(jacobian)[0][:, 2])
        scales.append(servo.step().scale)
    assert scales[0] == 1.0
    assert scales[-1] < 0.4
    assert np.all(np.diff(scales) <= 1e-9)


def test_locked_joints_keep_still():
    servo = pk.servo.Servo(PEPPER, STAND, locked=("torso", "LWristYaw"), collisions=False)
    for _ in range(100):
        servo.set_target(pk.ik.HandPosition("left", (0.3, 0.3, 1.0)))
        state = servo.step()
    still = [PEPPER.joint_index(name) for name in (*PEPPER.joint_group("torso"), "LWristYaw")]
    assert np.array_equal(state.q[still], STAND[still])
    assert np.abs(state.q - STAND).max() > 0.1


def test_states_are_frozen_values():
    servo = pk.servo.Servo(PEPPER, STAND, collisions=False)
    servo.set_twist("left", (0.0, 0.0, 0.1))
    first = servo.step()
    kept = first.q.copy()
    servo.step()
    assert np.array_equal(first.q, kept)
    assert first.q == pytest.approx(STAND + 0.01 * first.v, abs=1e-15)
    with pytest.raises(ValueError, match="read-only"):
        first.q[0] = 1.0
    with pytest.raises(AttributeError):
        first.tick = 3


def test_differential_step_does_what_the_servo_does():
    task = pk.ik.HandPosition("left", (0.3, 0.2, 0.9))
    servo = pk.servo.Servo(PEPPER, STAND, collisions=False)
    servo.set_target(task)
    step = pk.servo.differential_step(PEPPER, STAND, np.zeros(15), 0.01, task, collisions=False)
    state = servo.step()
    assert step.v == pytest.approx(state.v, abs=1e-12)
    assert step.q == pytest.approx(STAND + 0.01 * step.v)
    assert not step.blocked
    ahead = pk.servo.differential_step(PEPPER, step.q, step.v, 0.01, task, collisions=False)
    before, after = task.error(PEPPER, STAND), task.error(PEPPER, ahead.q)
    assert after < before


def test_differential_step_brakes_before_a_limit():
    """Fast towards a limit, with a target beyond it: braking at once is the only answer, and it is enough."""
    i = PEPPER.joint_index("HeadYaw")
    q, v = np.array(STAND), np.zeros(15)
    v[i] = 5.0
    loss = 0.01 * PEPPER.acceleration_limits[i]
    travel = 0.01 * sum(np.arange(5.0 - loss, 0.0, -loss))
    q[i] = PEPPER.upper_limits[i] - travel - 1e-6
    target = pk.ik.JointPosture([3.0], joints=["HeadYaw"])
    step = pk.servo.differential_step(PEPPER, q, v, 0.01, target, collisions=False)
    assert step.v[i] == pytest.approx(5.0 - loss, abs=1e-4)
    for _ in range(40):
        step = pk.servo.differential_step(PEPPER, step.q, step.v, 0.01, target, collisions=False)
        assert step.q[i] <= PEPPER.upper_limits[i]
    assert step.q[i] == pytest.approx(PEPPER.upper_limits[i], abs=1e-3)
    q[i] += 0.1
    with pytest.raises(LimitError, match="v: HeadYaw = 5"):
        pk.servo.differential_step(PEPPER, q, v, 0.01, target, collisions=False)


def test_numbers_that_are_not_allowed_are_refused_by_name():
    for arguments, words in [
        ({"rate": 0}, "rate: got 0, expected a finite number above 0"),
        ({"rate": float("nan")}, "rate"),
        ({"command_timeout": -1}, "command_timeout: got -1"),
        ({"gain": 0}, "gain: got 0"),
        ({"margin": 0}, "margin: got 0"),
        ({"approach": -2}, "approach: got -2"),
        ({"singularity": 0}, "singularity: got 0"),
        ({"velocity_scale": 1.5}, "velocity_scale: got 1.5, expected a share above 0 and up to 1"),
        ({"acceleration_scale": 0}, "acceleration_scale: got 0"),
        ({"balance": float("nan")}, "balance"),
        ({"scene": "table"}, "scene: got 'table'"),
        ({"locked": "whole_body"}, "locked: got every joint"),
    ]:
        with pytest.raises(InvalidValueError, match=words.replace("(", r"\(")):
            pk.servo.Servo(PEPPER, STAND, **arguments)


def test_misuse_is_refused_by_name():
    beyond = STAND.copy()
    beyond[3] = 3.0
    with pytest.raises(LimitError, match=r"start: HeadYaw = 3 rad is outside"):
        pk.servo.Servo(PEPPER, beyond, collisions=False)
    with pytest.raises(InvalidValueError, match="start: got nan at joint HeadYaw"):
        pk.servo.Servo(PEPPER, np.where(np.arange(15) == 3, np.nan, STAND), collisions=False)
    with pytest.raises(UnknownNameError, match="unknown joint or group 'Tail'"):
        pk.servo.Servo(PEPPER, STAND, locked=["Tail"], collisions=False)
    servo = pk.servo.Servo(PEPPER, STAND, collisions=False)
    with pytest.raises(UnknownNameError, match="unknown frame 'tail'"):
        servo.set_target(pk.ik.FramePosition("tail", (0, 0, 1)))
    with pytest.raises(InvalidValueError, match="target of left hand: got nan"):
        servo.set_target(pk.ik.HandPosition("left", (0, np.nan, 1)))
    with pytest.raises(InvalidValueError, match="tasks: got none, expected at least one task"):
        servo.set_target([])
    with pytest.raises(UnknownNameError, match="unknown hand 'third'; available: left, right"):
        servo.set_twist("third", (0, 0, 0))
    with pytest.raises(InvalidValueError, match="linear: got nan"):
        servo.set_twist("left", (0, np.nan, 0))
    with pytest.raises(InvalidValueError, match="axes: got 'tool', expected one of 'world', 'hand'"):
        servo.set_twist("left", (0, 0, 0), axes="tool")
    with pytest.raises(InvalidValueError, match=r"start: got shape \(2, 15\)"):
        pk.servo.Servo(PEPPER, [STAND, STAND], collisions=False)
    with pytest.raises(InvalidValueError, match="dt: got 0"):
        pk.servo.differential_step(
            PEPPER, STAND, np.zeros(15), 0, pk.ik.HandPosition("left", (0, 0, 1)), collisions=False
        )


@pytest.mark.parametrize("weight", [1e-6, 1e-3, 1e3])
def test_one_weight_for_all_changes_nothing(weight):
    """Weights are compared with one another only: a servo arrived nowhere with 1e-3."""

    def end(w):
        servo = pk.servo.Servo(PEPPER, STAND, collisions=False)
        for _ in range(120):
            servo.set_target([pk.ik.HandPosition("left", CENTER, weight=w), pk.ik.LookAt(CENTER, weight=w)])
            servo.step()
        return servo.q

    def step(w):
        tasks = [pk.ik.HandPosition("left", CENTER, weight=w)]
        return pk.servo.differential_step(PEPPER, STAND, np.zeros(15), 0.01, tasks, collisions=False).v

    np.testing.assert_array_equal(end(weight), end(1.0))
    np.testing.assert_array_equal(step(weight), step(1.0))
