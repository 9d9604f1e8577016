"""Drives of a differential base: where it points, within its turning radius and its wheels' limits."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import Wheels
from pepper_kin.motion import PlanStatus, plan_costed, simplify_path, validate

CART = """<robot name="cart">
  <link name="base"><inertial><origin xyz="0 0 0.2"/><mass value="20"/>
      <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
    <collision><origin xyz="0 0 0.25"/><geometry><box size="0.5 0.4 0.4"/></geometry></collision></link>
  <link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry><box size="0.06 0.06 0.4"/></geometry></collision></link>
  <link name="tip"/>
  <joint name="lift" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/>
    <axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="30" velocity="2" acceleration="5"/></joint>
  <joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0 0 0.4"/></joint>
</robot>"""
WHEELS = Wheels(speed=0.6, acceleration=0.8, track=0.4, turning_radius=0.4)
SCENE = (
    pk.Scene()
    .add_box("wall", size=(0.1, 2.0, 1.0), position=(1.0, 0.4, 0.5))
    .add_box("other wall", size=(0.1, 2.0, 1.0), position=(2.0, -0.6, 0.5))
)


@pytest.fixture(scope="module")
def cart():
    return pk.load_robot(CART, base="differential", wheels=WHEELS)


def there(robot, **values):
    return robot.joint_vector({"BaseX": 3.0, "BaseYaw": 1.0, **values})


def assert_drives(robot, plan, scene, forward_only=False):
    """The timed motion keeps all limits and touches nothing; the base rolls without slipping sideways."""
    trajectory = pk.retime(robot, plan)
    certificate = trajectory.check(robot, scene=scene)
    assert certificate.success, certificate.report()
    state = trajectory.sample(0.002)
    yaw, (vx, vy, turning) = state.position[:, 2], state.velocity[:, :3].T
    forward = vx * np.cos(yaw) + vy * np.sin(yaw)
    sideways = vy * np.cos(yaw) - vx * np.sin(yaw)
    assert np.abs(sideways).max() < 0.01
    moving = np.abs(forward) > 0.05
    assert (np.abs(forward[moving]) >= 0.99 * WHEELS.turning_radius * np.abs(turning[moving])).all()
    assert not forward_only or (forward > -1e-6).all()
    for side in (-1, 1):
        rim = forward + side * WHEELS.track / 2 * turning
        assert np.abs(rim).max() <= WHEELS.speed * (1 + 1e-3)
        assert np.abs(np.diff(rim) / 0.002).max() <= WHEELS.acceleration * 1.05
    return trajectory


@pytest.mark.parametrize("seed", range(4))
def test_drives_around_walls(cart, seed):
    plan = pk.plan(cart, cart.neutral(), there(cart), SCENE, seed=seed)
    assert plan.success, plan.report()
    assert plan.message.startswith("Drive of ")
    assert plan.clearance.obstacles > 0
    np.testing.assert_array_equal(plan.path[0], cart.neutral())
    full_turns = (plan.goal - there(cart)) / (2 * np.pi)
    np.testing.assert_allclose(full_turns, [0, 0, np.round(full_turns[2]), 0], atol=1e-15)
    np.testing.assert_array_equal(plan.path[:, 3], 0.0)  # the body is held
    assert validate(cart, plan, SCENE).success
    assert_drives(cart, plan, SCENE)


def test_a_base_that_only_goes_forward(cart):
    wheels = Wheels(speed=0.6, acceleration=0.8, track=0.4, turning_radius=0.4, backward=False)
    robot = pk.load_robot(CART, base="differential", wheels=wheels)
    plan = pk.plan(robot, robot.neutral(), there(robot, BaseX=0.0, BaseY=1.5), SCENE, seed=1)
    assert plan.success, plan.report()
    assert_drives(robot, plan, SCENE, forward_only=True)


@pytest.mark.thorough
def test_the_body_moves_before_or_after_the_drive(cart):
    after = pk.plan(cart, cart.neutral(), there(cart, lift=1.0), SCENE)
    assert after.success, after.report()
    assert "then the body moves" in after.message
    assert after.goal[3] == pytest.approx(1.0)
    assert_drives(cart, after, SCENE)
    # A beam that the upright arm does not pass under: it must be lowered first.
    beam = pk.Scene().add_box("beam", size=(0.2, 24.0, 0.2), position=(1.5, 0.0, 0.85))
    before = pk.plan(cart, cart.neutral(), there(cart, lift=1.5), beam, timeout=4.0)
    assert before.success, before.report()
    assert "after the body has moved" in before.message
    assert_drives(cart, before, beam)


@pytest.mark.thorough
def test_the_body_is_folded_where_neither_end_can_be_driven():
    group = '<group name="whole_body"><joint name="lift"/></group>'
    state = '<group_state name="folded" group="whole_body"><joint name="lift" value="1.5"/></group_state>'
    srdf = f'<robot name="cart">{group}{state}</robot>'
    cart = pk.load_robot(CART, srdf, base="differential", wheels=WHEELS)
    beam = pk.Scene().add_box("beam", size=(0.2, 24.0, 0.2), position=(1.5, 0.0, 0.85))
    joints = ("BaseX", "BaseY", "BaseYaw", "lift")
    plan = pk.plan(cart, cart.neutral(), there(cart, lift=0.1), beam, joints=joints, timeout=8.0)
    assert plan.success, plan.report()
    assert "between two motions of the body" in plan.message
    drives = np.abs(np.diff(plan.path[:, :3], axis=0)).max(axis=1) > 1e-6
    np.testing.assert_allclose(plan.path[1:, 3][drives], 1.5, atol=1e-9)
    assert_drives(cart, plan, beam)


def test_tasks_are_driven_to(cart):
    target = [pk.ik.FramePosition("tip", (2.8, 0.8, 0.75), tolerance=1e-3)]
    plan = pk.plan(cart, cart.neutral(), target, SCENE, seed=2)
    assert plan.success, plan.report()
    reached = pk.kinematics.frame_pose(cart, plan.goal, "tip")[:3, 3]
    np.testing.assert_allclose(reached, (2.8, 0.8, 0.75), atol=2e-3)
    assert_drives(cart, plan, SCENE)


def test_the_body_alone_is_planned_as_ever(cart):
    plan = pk.plan(cart, cart.neutral(), cart.joint_vector({"lift": 1.0}), SCENE)
    assert plan.success
    assert plan.message.startswith("Path of")
    np.testing.assert_array_equal(plan.path[:, :3], 0.0)


def test_what_cannot_be_is_said(cart):
    shut = SCENE.add_box("front", size=(0.1, 20.0, 1.0), position=(0.7, 0.0, 0.5))
    plan = pk.plan(cart, cart.neutral(), there(cart), shut, timeout=0.3)
    assert plan.status is PlanStatus.NO_PATH_IN_TIME
    assert "Most often in the way there: front, mostly of base" in plan.message
    with pytest.raises(InvalidValueError, match="planner: got given, while the differential base may move"):
        pk.plan(cart, cart.neutral(), there(cart), planner="aorrtc")
    level = pk.ik.AxisAlignment("arm", (0, 0, 1), axis=(0, 0, 1), tolerance=0.1)
    with pytest.raises(InvalidValueError, match="constraints or costs: got given"):
        pk.plan(cart, cart.neutral(), there(cart), constraints=[level])
    with pytest.raises(InvalidValueError, match="constraints or costs: got given"):
        plan_costed(cart, cart.neutral(), there(cart), costs=[level])
    with pytest.raises(InvalidValueError, match="a drive of a differential base"):
        simplify_path(cart, [cart.neutral(), cart.joint_vector({"BaseX": 0.2})])
