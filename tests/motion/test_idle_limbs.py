"""Joints that no task names rest, or give way gently and are named."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.ik import AxisAlignment, HandPosition
from pepper_kin.motion import LIN, FollowStatus, Line, Route, cartesian_path, follow, sequence

PEPPER = pk.load_pepper()
READY, STAND = PEPPER.posture("Ready"), PEPPER.posture("Stand")
ARM = [PEPPER.joint_index(name) for name in PEPPER.joint_group("right_arm")]
BEGIN = np.array((0.30, 0.30, 0.85))
END = BEGIN - (0, 0.30, 0)
LEVEL = AxisAlignment("LArm_effector", (0, 0, 1), axis=(0, 0, 1), tolerance=np.radians(3))


def cup(point):
    return [HandPosition("left", point), LEVEL]


def start(posture):
    found = pk.ik.solve(PEPPER, cup(BEGIN), start=posture, balance="robot")
    assert found.success
    return found.q


@pytest.mark.parametrize("posture", [READY, STAND])
@pytest.mark.parametrize("way", ["follow", "sequence"])
def test_the_arm_without_a_task_rests_while_a_level_cup_is_carried(way, posture):
    q = start(posture)
    route = Route.of(pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:3, 3], Line(END))
    if way == "follow":
        found = follow(PEPPER, q, lambda s: cup(route(s)), route, speed=0.1)
    else:
        found = sequence(PEPPER, q, "left", [LIN(END)], speed=0.1, tasks=lambda points: [LEVEL])
    assert found.success, found.report()
    states = found.trajectory(np.arange(0.0, found.trajectory.duration, 0.01))
    assert np.ptp(states.position[:, ARM], axis=0).max() < 0.1
    assert np.abs(states.velocity[:, ARM]).max() < 0.3
    assert found.aside == ()


@pytest.mark.parametrize("way", [sequence, follow])
def test_an_arm_that_is_in_the_way_moves_gently_and_is_named(way):
    """The hand goes where the torso has to turn the other wrist toward the pelvis."""
    q = pk.ik.solve(PEPPER, HandPosition("left", (0.30, 0.05, 0.75)), start=STAND, balance="robot").q
    ball = pk.kinematics.frame_pose(PEPPER, q, "RArm_effector")[:3, 3] + (0.115, 0.0, 0.0)
    scene = pk.Scene().add_sphere("ball", radius=0.04, position=ball)
    route = Line((0.12, 0.12, 0.0), relative=True)
    if way is follow:
        found = follow(PEPPER, q, "left", route, speed=0.1, scene=scene)
    else:
        found = sequence(PEPPER, q, "left", [route], speed=0.1, scene=scene)
    assert found.success, found.report()
    states = found.trajectory(np.arange(0.0, found.trajectory.duration, 0.01))
    moved = np.ptp(states.position[:, ARM], axis=0).max()
    assert (moved > 0.1) == bool(found.aside) == ("out of the way" in found.message)
    assert np.abs(states.velocity[:, ARM]).max() < 0.5


def test_a_start_within_tolerance_of_the_route_is_led_onto_it():
    """A start 0.7 mm off the route, as IK leaves it, was bent onto it within a millimeter: TOO_FAST."""
    exact = pk.ik.solve(PEPPER, [HandPosition("left", BEGIN, tolerance=1e-6)], start=READY, balance="robot")
    route = Route.of(BEGIN + np.array((0.0, 0.0, 7e-4)), Line(END))
    found = follow(PEPPER, exact.q, lambda s: [HandPosition("left", route(s))], route, speed=0.1)
    assert found.success, found.report()
    times = np.linspace(0.0, found.trajectory.duration, 500)
    hands = pk.kinematics.frame_pose(PEPPER, found.trajectory(times).position, "LArm_effector")[:, :3, 3]
    away = np.min(np.linalg.norm(hands[:, None] - route(np.linspace(0, route.length, 2000)), axis=2), axis=1)
    assert away.max() < 7.5e-4
    assert away[times > 0.6 * times[-1]].max() < 2e-4


def test_joints_that_make_a_way_impossible_are_told_as_that():
    q = start(STAND)
    route = Route.of(pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:3, 3], Line(END))
    found = follow(PEPPER, q, lambda s: cup(route(s)), route, speed=0.1, joints="left_arm")
    assert found.status is not FollowStatus.DONE
    assert "The joints that may move cannot meet position of left hand" in found.message
    assert "with the torso free it would be reached" in found.message
    wider = follow(PEPPER, q, lambda s: cup(route(s)), route, speed=0.1, joints=["left_arm", "torso"])
    assert wider.success, wider.report()


def lines(count):
    rng = np.random.default_rng(3)
    while count:
        first = rng.uniform((0.2, 0.05, 0.65), (0.4, 0.35, 1.1))
        last = first + rng.normal(0.0, 0.1, 3)
        ends = [
            pk.ik.solve(PEPPER, HandPosition("left", end), start=READY, balance="robot")
            for end in (first, last)
        ]
        if all(end.success for end in ends):
            count -= 1
            yield ends[0].q, first, last


def test_random_lines_leave_the_other_arm_and_head_alone():
    idle = [*ARM, PEPPER.joint_index("HeadYaw"), PEPPER.joint_index("HeadPitch")]
    aside = 0
    for q, first, last in lines(6):
        found = pk.ik.solve(PEPPER, HandPosition("left", last), start=q, balance="robot")
        far = np.abs(found.q - q)[idle].max() > 0.1
        assert far == ("no task moves" in found.report())
        aside += far
        path = cartesian_path(PEPPER, q, "left", LIN(last))
        far = np.ptp(path.path[:, idle], axis=0).max() > 0.1
        assert far == ("out of the way" in path.message)
        aside += far
        servo = pk.servo.Servo(PEPPER, q, rate=50.0, balance=0.01)
        for share in np.linspace(0.0, 1.0, 100):
            servo.set_target(HandPosition("left", first + share * (last - first)))
            state = servo.step()
            assert np.abs(state.v[idle]).max() <= 0.3 + 1e-9
        assert np.abs(state.q - q)[idle].max() < 0.1
    assert aside <= 2  # of 12: one line to the edge of what balance allows, solved and followed


def test_ik_names_an_arm_that_has_to_give_way():
    q = pk.ik.solve(PEPPER, HandPosition("left", BEGIN), start=READY).q
    hand = pk.kinematics.frame_pose(PEPPER, q, "RArm_effector")[:3, 3]
    found = pk.ik.solve(
        PEPPER, HandPosition("left", BEGIN), start=q, joints="both_arms",
        scene=pk.Scene().add_sphere("ball", radius=0.03, position=hand),
    )  # fmt: skip
    assert found.success, found.report()
    assert "no task moves" in found.report()
    assert "to keep clear, or in balance" in found.report()
