"""Robots of a single joint, of whose matrices Pinocchio's binding drops an axis."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import PepperKinError
from pepper_kin.twin.base import BalanceMonitor, OmniBase, pepper_base
from pepper_kin.twin.sensors import SensorSuite
from pepper_kin.twin.world import World

URDF = """<robot name="one">
<link name="base"><inertial><mass value="1"/>
 <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
 <collision><geometry><sphere radius="0.05"/></geometry></collision></link>
<link name="arm"><inertial><origin xyz="0.1 0 0.5"/><mass value="1"/>
 <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
 <collision><origin xyz="0 0 0.5"/><geometry><sphere radius="0.05"/></geometry></collision></link>
<joint name="j" type="{type}"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
 <limit lower="-1" upper="1" effort="20" velocity="2"/></joint></robot>"""


@pytest.fixture(scope="module", params=["revolute", "prismatic"])
def robot(request):
    return pk.load_robot(URDF.format(type=request.param))


@pytest.mark.parametrize(
    ("function", "inputs", "frame", "shape"),
    [
        (pk.kinematics.frame_jacobian, 1, True, (6, 1)),
        (pk.kinematics.frame_jacobian_rate, 2, True, (6, 1)),
        (pk.kinematics.manipulability, 1, True, ()),
        (pk.dynamics.mass_matrix, 1, False, (1, 1)),
        (pk.dynamics.inverse_mass_matrix, 1, False, (1, 1)),
        (pk.dynamics.coriolis_matrix, 2, False, (1, 1)),
        (pk.dynamics.regressor, 3, False, (1, 10)),
        (pk.dynamics.centroidal_map, 1, False, (6, 1)),
        (pk.dynamics.center_of_mass_jacobian, 1, False, (3, 1)),
        (pk.dynamics.base_wrench, 3, False, (6,)),
    ],
)
def test_one_state_few_and_many_give_the_same(robot, function, inputs, frame, shape):
    last = ("arm",) if frame else ()
    one = [np.array([x]) for x in (0.2, 0.3, -0.4)[:inputs]]
    alone = np.asarray(function(robot, *one, *last))
    assert alone.shape == shape
    for count in (3, 40):  # through Pinocchio, and by machine code
        many = function(robot, *(np.tile(x, (count, 1)) for x in one), *last)
        np.testing.assert_allclose(many, np.tile(alone, (count, *(1,) * len(shape))), atol=1e-12)


def test_jacobians_are_derivatives(robot):
    q, step = np.array([0.3]), 1e-6
    above, below = (pk.kinematics.frame_pose(robot, q + way * step, "arm") for way in (1, -1))
    jacobian = pk.kinematics.frame_jacobian(robot, q, "arm")
    np.testing.assert_allclose(jacobian[:3, 0], (above - below)[:3, 3] / (2 * step), atol=1e-8)
    center = [pk.dynamics.center_of_mass(robot, q + sign * step) for sign in (1, -1)]
    slope = (center[0] - center[1]) / (2 * step)
    np.testing.assert_allclose(pk.dynamics.center_of_mass_jacobian(robot, q)[:, 0], slope, atol=1e-8)
    load = pk.dynamics.external_torque(robot, q, {"arm": np.arange(6.0)})
    np.testing.assert_allclose(load, jacobian.T @ np.arange(6.0))


def test_servo_twin_and_monitor_take_them(robot):
    servo = pk.servo.Servo(robot, [0.0], scene=pk.Scene().add_box("wall", (0.1, 0.1, 0.1), (3, 0, 0)))
    target = pk.kinematics.frame_pose(robot, [0.3], "arm")
    servo.set_target(pk.ik.FramePose("arm", target))
    for _ in range(49):
        state = servo.step()
    assert state.q[0] == pytest.approx(0.3, abs=1e-3)
    twin = pk.Twin(robot, world=World(robot, pk.Scene().add_half_space("ground", (0, 0, 1), -2.0)))
    twin.push("arm", [0.5, 0.2, 0.0])
    run = twin.follow(np.zeros((20, 1)))
    assert run.success
    assert BalanceMonitor(robot, pepper_base(), base_frame="base").assess_run(run).balanced
    assert pk.TwinBatch(robot, 3).follow(np.zeros((20, 1))).success.all()
    clearance = pk.collision.clearance(robot, [0.0], pk.Scene().add_sphere("ball", 0.1, (1.0, 0.0, 0.5)))
    assert clearance == pytest.approx(0.85)


def test_what_needs_a_base_or_sensors_refuses_by_name(robot):
    for build in [BalanceMonitor, OmniBase, SensorSuite, lambda r: pk.servo.Servo(r, [0], balance=0.01)]:
        with pytest.raises(PepperKinError, match=r"frame|joint|sensor"):
            build(robot)


def test_the_least_torque_of_a_single_joint_is_near_the_closed_form():
    """About a vertical axis, from rest to rest: q is cubic, and the effort 12 (I d / limit)^2 / T^3.

    The spline's accelerations begin and end at zero, which costs a little; the quintic takes 120 / 7.
    """
    flat = URDF.format(type="revolute").replace('xyz="0 1 0"', 'xyz="0 0 1"')
    robot = pk.load_robot(flat.replace('velocity="2"', 'velocity="9" acceleration="99"'))
    inertia, way, time = 0.1 + 0.1**2, 1.6, 1.2
    found = pk.motion.minimum_torque_trajectory(robot, [-0.8], [0.8], time)
    assert found.success, found.report()
    assert 12.0 <= found.figures.effort / ((inertia * way / 20) ** 2 / time**3) < 14.0
    better = pk.motion.optimize(robot, [[-0.8], [0.8]])
    assert better.success, better.report()
    assert better.trajectory.check(robot).success
    assert better.trajectory.end == pytest.approx([0.8])
