"""The mass of an attached object in timing, certificates, plans and optimization: against Pinocchio.

The reference is Pinocchio's model with the object's inertia appended to the joint that carries its frame.
"""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin import dynamics
from pepper_kin.collision import load_torque, load_wrench, loads_of
from pepper_kin.dynamics import WHEEL_CONTACTS
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.motion import PlanStatus
from pepper_kin.motion.static_limits import static_limits

PEPPER = pk.load_pepper().with_requirements("limits")
STAND = PEPPER.joint_vector({"LShoulderRoll": 0.4, "LShoulderPitch": 1.2, "LElbowRoll": -0.8})
MASS, SIZE = 0.35, (0.12, 0.04, 0.05)
POSE = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -0.1, 0.2), np.array([0.03, 0.004, 0.02]))
CUP = pk.Scene().add_box("cup", SIZE, (2.0, 2.0, 0.5))
HELD = CUP.attach("cup", "l_gripper", POSE.homogeneous, mass=MASS)


def loaded_model(mass=MASS, frame="l_gripper", pepper=PEPPER):
    """Return Pinocchio's model of the robot with the object as part of a link, and its mass on the floor."""
    model = pepper.inner_model.copy()
    place = model.frames[pepper.frame_id(frame)]
    model.appendBodyToJoint(place.parentJoint, pinocchio.Inertia.FromBox(mass, *SIZE), place.placement * POSE)
    return model


def torques(model, q, v, a):
    """Return joint torques by Pinocchio, shape (m, n)."""
    data = model.createData()
    return np.array([pinocchio.rnea(model, data, *state) for state in zip(q, v, a, strict=True)])


def wrenches(model, q, v, a):
    """Return the floor's wrench about the world's origin by Pinocchio, with the links fixed to the floor."""
    data, still, found = model.createData(), model.inertias[0], []
    weight = -model.gravity.linear * still.mass
    for state in zip(q, v, a, strict=True):
        pinocchio.rnea(model, data, *state)
        total = np.zeros(6)
        for joint in [j for j in range(1, model.njoints) if model.parents[j] == 0]:
            total += data.liMi[joint].act(data.f[joint]).vector
        total[:3] += weight
        total[3:] += np.cross(still.lever, weight)
        found.append(total)
    return np.array(found)


def margins(model, q, v, a):
    """Return how far inside the triangle of the wheels the zero-moment point is [m], shape (m,)."""
    corners = np.array(WHEEL_CONTACTS)
    edges = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    wrench = wrenches(model, q, v, a)
    point = np.stack([-wrench[:, 4], wrench[:, 3]], axis=1) / wrench[:, 2:3]
    return np.einsum("mki,ki->mk", point[:, None] - corners, inward).min(axis=1)


def states(count, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.uniform(PEPPER.lower_limits, PEPPER.upper_limits, (count, PEPPER.n))
    v, a = rng.normal(size=(2, count, PEPPER.n)) * 2
    return q, v, a


def swing(factor=1.0):
    """Return a path of the left arm and the trunk that is heavy for shoulder and elbow."""
    first, last = STAND.copy(), STAND.copy()
    for name, there in {
        "LShoulderPitch": 0.2,
        "LElbowYaw": -1.2,
        "LElbowRoll": -0.6,
        "HipPitch": -0.2,
    }.items():
        last[PEPPER.joint_index(name)] += factor * (there - STAND[PEPPER.joint_index(name)])
    return np.stack([first, (first + last) / 2 + 0.05 * (last != first), last])


@pytest.mark.parametrize("count", [3, 40])
def test_torques_and_wrenches_are_those_of_a_robot_with_the_object_as_part_of_a_link(count):
    q, v, a = states(count)
    model, loads = loaded_model(), loads_of(PEPPER, HELD)
    expected = torques(model, q, v, a)
    found = dynamics.inverse_dynamics(PEPPER, q, v, a) + load_torque(PEPPER, loads, q, v, a)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_allclose(dynamics.newton_euler(PEPPER, q, v, a, loads), expected, atol=1e-9)
    wrench = dynamics.base_wrench(PEPPER, q, v, a) + load_wrench(PEPPER, loads, q, v, a)
    np.testing.assert_allclose(wrench, wrenches(model, q, v, a), atol=1e-9)


@pytest.mark.parametrize("frame", ["Head", "torso", "base_link", "r_wrist"])
def test_objects_may_hang_anywhere(frame):
    if frame not in PEPPER.frame_names:
        frame = next(name for name in PEPPER.frame_names if name.lower().startswith(frame.lower()[:4]))
    q, v, a = states(5, 1)
    scene = CUP.attach("cup", frame, POSE.homogeneous, mass=1.5)
    expected = torques(loaded_model(1.5, frame), q, v, a)
    loads = loads_of(PEPPER, scene)
    found = dynamics.inverse_dynamics(PEPPER, q, v, a) + load_torque(PEPPER, loads, q, v, a)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_allclose(dynamics.newton_euler(PEPPER, q, v, a, loads), expected, atol=1e-9)


@pytest.mark.parametrize("options", [{}, {"solver": "toppra"}, {"jerk": "brisk"}, {"balance": 0.0}])
def test_timing_uses_the_torques_of_the_robot_with_the_object_up_to_their_limits(options):
    scale = 1.0
    motion = pk.retime(PEPPER, swing(), torque_scale=scale, scene=HELD, **options)
    time = np.concatenate([np.arange(0.0, motion.duration, 1e-3), motion.breaks])
    state = motion(np.clip(time, 0.0, motion.duration))
    use = np.abs(torques(loaded_model(), *state)) / (scale * PEPPER.effort_limits)
    assert use.max() <= 1.0 + 1e-6
    alone = pk.retime(PEPPER, swing(), torque_scale=scale, **options)
    state = alone(np.clip(time, 0.0, alone.duration))
    assert (np.abs(torques(loaded_model(), *state)) / (scale * PEPPER.effort_limits)).max() > 1.02
    if not options:
        assert use.max() > 0.999  # a limit acts


def test_the_certificate_has_the_greatest_torques_and_the_least_margin_of_the_loaded_robot():
    motion = pk.retime(PEPPER, swing(), scene=HELD, balance=0.0)
    found = motion.check(PEPPER, HELD)
    time = np.concatenate([np.linspace(0.0, motion.duration, 2001), motion.breaks])
    state = motion(time)
    greatest = np.abs(torques(loaded_model(), *state)).max(axis=0)
    assert found.success, found.report()
    np.testing.assert_allclose(np.abs(found.torque.value), greatest, atol=2e-3)
    assert (greatest <= np.abs(found.torque.value) + found.torque.resolution + 1e-9).all()
    least = margins(loaded_model(), *state).min()
    assert found.balance.value == pytest.approx(least, abs=1e-4)
    assert least >= found.balance.value - found.balance.resolution - 1e-9
    np.testing.assert_array_less(motion.check(PEPPER).torque.value[2], found.torque.value.max() + 1)
    assert motion.check(PEPPER).balance.value != pytest.approx(found.balance.value, abs=1e-6)


def test_a_motion_timed_without_the_object_fails_its_certificate():
    heavy = CUP.attach("cup", "l_gripper", POSE.homogeneous, mass=1.2)
    motion = pk.retime(PEPPER, swing())
    assert motion.check(PEPPER).torque.success
    assert not motion.check(PEPPER, heavy).torque.success
    with pytest.raises(InfeasibleError, match=r"with 1\.2 kg of 'cup' at l_gripper"):
        pk.retime(PEPPER, swing(), scene=heavy)


def test_a_payload_and_an_attached_object_add_up():
    both = pk.retime(PEPPER, swing(), payload={"l_gripper": 0.1}, scene=HELD).check(
        PEPPER, HELD, payload={"l_gripper": 0.1}
    )
    heavier = loads_of(PEPPER, HELD, {"l_gripper": 0.1})
    q, v, a = states(4, 2)
    model = loaded_model()
    place = model.frames[PEPPER.frame_id("l_gripper")]
    model.appendBodyToJoint(
        place.parentJoint, pinocchio.Inertia(0.1, np.zeros(3), np.zeros((3, 3))), place.placement
    )
    assert both.success
    np.testing.assert_allclose(
        dynamics.inverse_dynamics(PEPPER, q, v, a) + load_torque(PEPPER, heavier, q, v, a),
        torques(model, q, v, a),
        atol=1e-9,
    )


def test_postures_are_held_as_pinocchio_says():
    q, none = states(400, 3)[0], np.zeros((400, PEPPER.n))
    statics = static_limits(PEPPER, 0.02, None, HELD)
    torque, inside = torques(loaded_model(), q, none, none), margins(loaded_model(), q, none, none)
    held = (np.abs(torque) <= statics.effort_limits).all(axis=1) & (inside >= 0.024)
    assert 30 < held.sum() < 370
    np.testing.assert_array_equal(statics.hold(q), held)
    np.testing.assert_allclose(statics.torque(q[0]), torque[0], atol=1e-9)
    assert statics.distance_inside(q[0]) == pytest.approx(inside[0], abs=1e-9)


def test_plans_hold_the_object_and_their_timing_counts_it():
    goal = swing(0.6)[-1]
    made = pk.plan(PEPPER, STAND, goal, HELD, balance=0.01)
    assert made.success, made.report()
    assert made.loads == loads_of(PEPPER, HELD)
    motion = pk.retime(PEPPER, made, balance=0.01)
    state = motion(np.linspace(0.0, motion.duration, 3001))
    assert (np.abs(torques(loaded_model(), *state)) <= PEPPER.effort_limits * (1 + 1e-6)).all()
    assert margins(loaded_model(), *state).min() > 0.01 - 1e-5
    assert motion.duration > pk.retime(PEPPER, made, scene=pk.Scene(), balance=0.01).duration
    heavy = CUP.attach("cup", "l_gripper", POSE.homogeneous, mass=3.0)
    refused = pk.plan(PEPPER, STAND, swing()[-1], heavy)
    assert refused.status in (PlanStatus.GOAL_TORQUE_LIMIT, PlanStatus.START_TORQUE_LIMIT)
    assert "with 3 kg of 'cup' at l_gripper" in refused.message


@pytest.mark.thorough
def test_optimized_motions_keep_the_torques_and_the_balance_of_the_loaded_robot():
    found = pk.motion.optimize(PEPPER, swing(0.7), HELD, balance=0.0, timeout=20.0)
    assert found.success, found.message
    state = found.trajectory(np.linspace(0.0, found.trajectory.duration, 2001))
    use = np.abs(torques(loaded_model(), *state)) / PEPPER.effort_limits
    assert use.max() <= 1.0 + 1e-6
    assert margins(loaded_model(), *state).min() > -1e-6
    alone = pk.motion.optimize(PEPPER, swing(0.7), balance=0.0, timeout=20.0)
    state = alone.trajectory(np.linspace(0.0, alone.trajectory.duration, 2001))
    assert (np.abs(torques(loaded_model(), *state)) / PEPPER.effort_limits).max() > 1.01


@pytest.mark.thorough
def test_the_effort_that_is_optimized_is_that_of_the_loaded_robot():
    q, duration = swing(0.5), 1.5
    found = pk.motion.minimum_torque_trajectory(PEPPER, q[0], q[-1], duration, scene=HELD)
    assert found.success, found.report()
    state = found.trajectory(np.linspace(0.0, duration, 151))
    share = (torques(loaded_model(), *state) / PEPPER.effort_limits) ** 2
    effort = np.trapezoid(share.sum(axis=1), dx=duration / 150)
    assert found.figures.effort == pytest.approx(effort, rel=1e-6)
    alone = pk.motion.minimum_torque_trajectory(PEPPER, q[0], q[-1], duration)
    state = alone.trajectory(np.linspace(0.0, duration, 151))
    share = (torques(loaded_model(), *state) / PEPPER.effort_limits) ** 2
    assert np.trapezoid(share.sum(axis=1), dx=duration / 150) > effort


def test_a_hand_follows_no_line_with_what_it_cannot_hold():
    """Of a cup of 5 kg, which LWristYaw cannot hold, the hand did all of the line."""
    line = [pk.motion.Line((0.0, 0.0, 0.02), relative=True)]
    light, heavy = (CUP.attach("cup", "l_gripper", POSE.homogeneous, mass=mass) for mass in (0.05, 5.0))
    assert pk.motion.cartesian_path(PEPPER, STAND, "left", line, light).success
    found = pk.motion.cartesian_path(PEPPER, STAND, "left", line, heavy)
    assert found.status is pk.motion.CartesianStatus.START_INVALID
    assert "with 5 kg of 'cup' at l_gripper" in found.message

    low = PEPPER.joint_vector({"LShoulderPitch": 1.3, "LElbowRoll": -0.6, "LShoulderRoll": 0.4})
    out = [pk.motion.Line((0.2, 0.0, 0.25), relative=True)]
    held = [CUP.attach("cup", "l_gripper", np.eye(4), mass=mass) for mass in (0.05, 1.0)]
    free, found = (
        pk.motion.cartesian_path(PEPPER, low, "left", out, scene, joints="left_arm") for scene in held
    )
    assert found.status is pk.motion.CartesianStatus.TORQUE_LIMIT
    assert 0.0 < found.fraction < free.fraction
    model = PEPPER.inner_model.copy()
    place = model.frames[PEPPER.frame_id("l_gripper")]
    inertia = pinocchio.Inertia.FromBox(1.0, *SIZE)
    model.appendBodyToJoint(place.parentJoint, inertia, place.placement)
    torque = np.abs(torques(model, found.path, 0 * found.path, 0 * found.path))
    assert np.all(torque <= PEPPER.effort_limits)
