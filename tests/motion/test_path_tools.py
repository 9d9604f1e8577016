"""Tools for paths from elsewhere, against coal and Pinocchio state by state."""

import itertools
import re

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.fast import fast_checker_for
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.kernels import progress
from pepper_kin.motion import PlanStatus, ValidationStatus, interpolate_path, simplify_path, validate
from pepper_kin.trajectory.path import CubicPath

SCENE = pk.Scene().add_box("post", size=(0.06, 0.06, 0.9), position=(0.33, -0.26, 0.5))


@pytest.fixture(scope="module")
def pepper():
    return pk.load_pepper().with_requirements("limits")


def straight(points, count):
    """States on straight edges, each equally dense."""
    parts = [
        a + (b - a) * np.linspace(0, 1, count, endpoint=False)[:, None] for a, b in itertools.pairwise(points)
    ]
    return np.concatenate([*parts, points[-1:]])


@pytest.fixture(scope="module")
def across(pepper):
    """A detour of the right arm around the post, and the straight way through it."""
    side = {"RShoulderPitch": 0.5, "RElbowRoll": 0.1, "RShoulderRoll": -0.6}
    front = {"RShoulderPitch": 0.5, "RElbowRoll": 0.1, "RShoulderRoll": -0.02}
    ends = np.array([pepper.joint_vector(side), pepper.joint_vector(front)])
    plan = pk.plan(pepper, ends[0], ends[1], SCENE, joints="right_arm", seed=3)
    assert plan.success
    assert pk.collision.in_collision(pepper, straight(ends, 400), SCENE).any()
    return ends, plan


def test_the_first_contact_is_found_where_coal_finds_it(pepper, across):
    ends, _ = across
    found = validate(pepper, ends, SCENE)

    states = straight(ends, 4000)
    touching = np.flatnonzero([pk.collision.in_collision(pepper, q, SCENE) for q in states])
    assert found.status is ValidationStatus.COLLISION
    assert not found.success
    assert found.place == pytest.approx(touching[0] / 4000, abs=2e-3)
    assert pk.collision.in_collision(pepper, found.q, SCENE)
    assert "post" in found.contacts[0]
    assert "post" in found.message
    assert found.message.startswith(f"Invalid from {found.place:.6g} of 1 on: the state is in collision: ")


def test_plans_and_their_trajectories_are_valid(pepper, across):
    _, plan = across
    for path in (plan, plan.curve, pk.retime(pepper, plan)):
        found = validate(pepper, path, SCENE)
        assert found.success, found.report()
        assert found.states_checked > 100
    blocked = SCENE.add_box("wall", size=(0.05, 2.0, 2.0), position=(0.25, 0.0, 1.0))
    assert validate(pepper, plan, blocked).status is ValidationStatus.COLLISION


def test_margins_are_asked_for(pepper, across):
    _, plan = across
    clearance = min(pk.collision.clearance(pepper, q, SCENE) for q in interpolate_path(plan, step=0.01))
    assert clearance > 0.0
    found = validate(pepper, plan, SCENE, margin=0.2)
    assert found.status is ValidationStatus.COLLISION
    assert "mm apart, less than the margin of 200.0 mm" in found.message


def test_joint_limits_come_first_where_they_are_first(pepper, across):
    ends, _ = across
    joint = pepper.joint_index("LElbowRoll")
    outside = ends.copy()
    outside[1, joint] = 0.5
    found = validate(pepper, outside)
    assert (found.status, found.joint) == (ValidationStatus.JOINT_LIMIT, "LElbowRoll")
    span = outside[1, joint] - outside[0, joint]
    assert found.place == pytest.approx((pepper.upper_limits[joint] - outside[0, joint]) / span, abs=1e-2)
    assert "the position of LElbowRoll is" in found.message
    # What is touched before that is told first.
    assert validate(pepper, [ends[0], ends[1], outside[1]], SCENE).status is ValidationStatus.COLLISION


def test_postures_that_cannot_be_held_are_named(pepper):
    ahead = {"LShoulderPitch": 0.2, "RShoulderPitch": 0.2, "LElbowRoll": -0.1, "RElbowRoll": 0.1}
    path = np.array([pepper.joint_vector(ahead), pepper.joint_vector({**ahead, "HipPitch": -0.9})])
    found = validate(pepper, path)
    torque = np.abs(pk.dynamics.gravity_torque(pepper, straight(path, 1000))) / pepper.effort_limits
    assert found.status is ValidationStatus.STATIC_TORQUE_LIMIT
    assert found.place == pytest.approx(np.argmax(torque.max(axis=1) > 0.95) / 1000, abs=2e-3)
    assert "N m at HipPitch" in found.message
    assert found.joint == "HipPitch"


def test_trajectories_are_held_against_their_limits(pepper, across):
    ends, _ = across
    motion = pk.retime(pepper, [ends[0], ends[0] + 0.2 * (ends[1] - ends[0])])
    assert validate(pepper, motion).success
    hasty = motion.with_duration(0.6 * motion.duration)
    found = validate(pepper, hasty)
    assert found.status in (ValidationStatus.VELOCITY_LIMIT, ValidationStatus.ACCELERATION_LIMIT)
    assert found.message.endswith("rad/s^2.") or found.message.endswith("rad/s.")
    weak = pk.load_robot(re.sub(r'effort="[^"]*"', 'effort="0.01"', pepper.urdf))
    assert validate(weak, motion).status is ValidationStatus.TORQUE_LIMIT


def test_a_crooked_path_becomes_short_and_smooth(pepper, across):
    _, plan = across
    turning = [pepper.joint_index(name) for name in ("RElbowYaw", "RWristYaw", "HeadYaw", "HeadPitch")]

    def crooked_way(seed):
        path = interpolate_path(plan, count=12)
        path[1:-1, turning] += np.random.default_rng(seed).normal(0, 0.15, (10, 4))
        return np.clip(path, pepper.lower_limits, pepper.upper_limits)

    ways = [crooked_way(seed) for seed in range(20)]
    crooked = next(way for way in ways if validate(pepper, way, SCENE).success)
    found = simplify_path(pepper, crooked, SCENE)
    assert found.success
    assert found.planner == "simplify_path"
    np.testing.assert_array_equal(found.path[0], crooked[0])
    np.testing.assert_allclose(found.path[-1], crooked[-1], atol=1e-12)
    assert found.length < 0.9 * np.linalg.norm(np.diff(crooked, axis=0), axis=1).sum()
    states = interpolate_path(found, step=0.002)
    assert not pk.collision.in_collision(pepper, states, SCENE).any()
    assert pk.retime(pepper, found).check(pepper, scene=SCENE).success
    again = simplify_path(pepper, crooked, SCENE)
    np.testing.assert_array_equal(found.path, again.path)


def test_curves_and_trajectories_are_simplified_too(pepper, across):
    _, plan = across
    for path in (plan, plan.curve, pk.retime(pepper, plan)):
        found = simplify_path(pepper, path, SCENE)
        assert found.success, found.report()
        assert found.length <= 1.05 * plan.length


def test_a_path_that_touches_is_not_simplified(pepper, across):
    ends, _ = across
    found = simplify_path(pepper, ends, SCENE)
    assert found.status is PlanStatus.PATH_INVALID
    assert found.path is None
    assert "post" in found.report()
    stays = simplify_path(pepper, [ends[0], ends[0]], SCENE)
    assert stays.success
    assert len(stays.path) == 1


def test_interpolation_keeps_the_step_and_the_points():
    points = np.array([[0.0, 0.0], [1.0, 0.2], [1.0, 0.2], [0.5, 2.0]])
    dense = interpolate_path(points, step=0.1)
    assert np.abs(np.diff(dense, axis=0)).max() <= 0.1 + 1e-12
    assert len(dense) == 1 + 10 + 1 + 18
    for point in points:
        assert np.abs(dense - point).max(axis=1).min() < 1e-12
    even = interpolate_path(points, count=7)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_array_equal(even[[0, -1]], points[[0, -1]])
    inner = even[np.linalg.norm(even - points[1], axis=1) > 0]
    assert len(inner) == 7
    s = np.concatenate([[0.0], np.cumsum(lengths)])
    expected = [np.interp(np.linspace(0, s[-1], 7), s, points[:, k]) for k in range(2)]
    np.testing.assert_allclose(even, np.transpose(expected), atol=1e-12)


def test_interpolation_of_a_curve_is_on_the_curve():
    curve = CubicPath([0.0, 2.0, 3.0], [[[0.0], [1.0], [0.0], [0.25]], [[4.0], [4.0], [1.5], [0.0]]])
    even = interpolate_path(curve, count=7)[:, 0]
    s = np.linspace(0, 3, 7)
    exact = np.where(s < 2, s + 0.25 * s**3, 4 + 4 * (s - 2) + 1.5 * (s - 2) ** 2)
    np.testing.assert_allclose(even, exact, atol=1e-12)
    dense = interpolate_path(curve, step=0.05)[:, 0]
    assert np.abs(np.diff(dense)).max() <= 0.05 + 1e-12
    assert dense[0] == 0.0
    assert dense[-1] == pytest.approx(9.5)


def test_misuse_is_named(pepper, across):
    ends, _ = across
    with pytest.raises(InvalidValueError, match="step and count: got both, expected exactly one of them"):
        interpolate_path(ends, step=0.1, count=3)
    with pytest.raises(InvalidValueError, match="step and count: got neither"):
        interpolate_path(ends)
    with pytest.raises(InvalidValueError, match="count: got 1"):
        interpolate_path(ends, count=1)
    with pytest.raises(InvalidValueError, match="step: got 1e-12"):
        interpolate_path(ends, step=1e-12)
    with pytest.raises(InvalidValueError, match="at least 2"):
        interpolate_path(ends[:1], step=0.1)
    with pytest.raises(InvalidValueError, match="margin: got -1"):
        validate(pepper, ends, margin=-1)
    with pytest.raises(InvalidValueError, match="waypoints: got shape"):
        validate(pepper, ends[:, :3])
    failed = pk.motion.Plan(PlanStatus.NO_PATH_IN_TIME, "No path.", pepper.joint_names)
    for tool in (validate, simplify_path):
        with pytest.raises(InfeasibleError, match="planning failed: No path"):
            tool(pepper, failed)


SPINNING = """<robot name="spinning"><link name="base"/><link name="arm"><inertial><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><origin xyz="0.3 0 0"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
  <limit velocity="2" effort="20"/></joint></robot>"""


@pytest.mark.parametrize("way", [1e5, 1e6, 9e8])
def test_a_path_of_too_many_states_is_refused_by_its_length(way):
    """One of 1e6 rad took 41 GB, and ended after 84 s in a MemoryError."""
    robot = pk.load_robot(SPINNING, acceleration_limits=10.0)
    words = rf"path: got one along which turn goes {re.escape(f'{way:.6g}')} rad, expected at most 4,000,000"
    for tool in (validate, simplify_path):
        with pytest.raises(InvalidValueError, match=words):
            tool(robot, [[0.0], [way / 2], [way]])
    with pytest.raises(InvalidValueError, match=words):
        validate(robot, CubicPath(np.array([0.0, way]), np.array([[[0.0], [1.0], [0.0], [0.0]]])))
    fast = pk.Trajectory(["turn"], [0.0, 10.0], np.array([[[0.0], [way / 10]]]))
    with pytest.raises(InvalidValueError, match=words):
        validate(robot, fast)
    slow = pk.Trajectory(["turn"], [0.0, 1e8], np.array([[[0.0], [0.0]]]))
    with pytest.raises(InvalidValueError, match=r"duration: got 1e\+08 s, expected at most 4000 s"):
        validate(robot, slow)
    assert validate(robot, [[0.0], [100.0]]).success


def test_groups_change_from_call_to_call_without_rebuilding(pepper):
    """No checker, table or machine code is made for other joints, nor for the same ones again."""
    stand = pepper.posture("Stand")
    goals = {
        "left_arm": pepper.joint_vector({"LShoulderPitch": 0.2, "LElbowRoll": -0.8}),
        "right_arm": pepper.joint_vector({"RShoulderPitch": 0.2, "RElbowRoll": 0.8}),
        "head": pepper.joint_vector({"HeadYaw": 0.5}),
    }
    first = pk.plan(pepper, stand, goals["left_arm"], SCENE, joints="left_arm")
    spent, built = progress._spent, fast_checker_for(pepper, SCENE)
    for joints in ("right_arm", "head", "left_arm", "right_arm"):
        again = pk.plan(pepper, stand, goals[joints], SCENE, joints=joints)
        assert again.success
    assert progress._spent == spent  # no machine code was made
    assert fast_checker_for(pepper, SCENE) is built
    np.testing.assert_array_equal(
        pk.plan(pepper, stand, goals["left_arm"], SCENE, joints="left_arm").path, first.path
    )
