"""Models with other limits and masses, beside Pinocchio and without a trace of what the old ones had made."""

import pickle
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, ModelError, UnknownNameError

PEPPER = pk.load_pepper()
MANY = np.random.default_rng(0).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (200, 15))


def gravity_by_pinocchio(masses, states):
    """Return gravity torques of Pepper with other masses, changed in another way: Pinocchio's inertias."""
    model = pinocchio.buildModelFromXML(PEPPER.urdf)
    root = ET.fromstring(PEPPER.urdf)
    for link, mass in masses.items():
        inertial = next(e for e in root.findall("link") if e.get("name") == link).find("inertial")
        old = float(inertial.find("mass").get("value"))
        center = np.array([float(x) for x in inertial.find("origin").get("xyz").split()])
        frame = model.frames[model.getFrameId(link)]
        extra = pinocchio.Inertia(mass - old, frame.placement.act(center), np.zeros((3, 3)))
        model.inertias[frame.parentJoint] = model.inertias[frame.parentJoint] + extra
    data = model.createData()
    return np.array([pinocchio.computeGeneralizedGravity(model, data, q) for q in states])


@pytest.mark.parametrize("new_first", [True, False])
def test_masses_hold_for_one_state_and_for_machine_code_in_either_order(new_first):
    masses = {"LForeArm": 0.4 + 0.1 * new_first, "Head": 2.5}
    changed = PEPPER.with_masses(masses)
    pairs = [(changed, masses), (PEPPER, {})]
    for robot, its in (pairs if new_first else pairs[::-1]) * 2:
        expected = gravity_by_pinocchio(its, MANY)
        np.testing.assert_allclose(pk.dynamics.gravity_torque(robot, MANY), expected, atol=1e-10)
        np.testing.assert_allclose(pk.dynamics.gravity_torque(robot, MANY[0]), expected[0], atol=1e-10)
    moved = pk.dynamics.center_of_mass(changed, MANY) - pk.dynamics.center_of_mass(PEPPER, MANY)
    assert np.abs(moved).min(axis=0).max() > 1e-4


def test_inertia_grows_with_the_mass():
    changed = PEPPER.with_masses({"LForeArm": 2 * 0.16579})
    one, two = (pinocchio.buildModelFromXML(robot.urdf) for robot in (PEPPER, changed))
    joint = one.getJointId("LElbowRoll")
    np.testing.assert_allclose(two.inertias[joint].inertia, 2 * one.inertias[joint].inertia, rtol=1e-12)
    np.testing.assert_allclose(two.inertias[joint].lever, one.inertias[joint].lever, rtol=1e-12)


@pytest.mark.parametrize("new_first", [True, False])
def test_ik_and_plans_keep_the_limits_of_their_model_in_either_order(new_first):
    task = [pk.ik.HandPosition("left", (0.35, 0.25, 0.75 + 0.01 * new_first))]
    free = pk.ik.solve(PEPPER, task)
    elbow = PEPPER.joint_index("LElbowRoll")
    least = float(free.q[elbow]) + 0.2
    narrow = PEPPER.with_limits(lower={"LElbowRoll": least})
    for robot in ([narrow, PEPPER] if new_first else [PEPPER, narrow]) * 2:
        result = pk.ik.solve(robot, task)
        assert result.success, result.report()
        assert (result.q[elbow] >= least - 1e-9) == (robot is narrow)
        many = pk.ik.solve_batch(robot, [pk.ik.HandPosition("left", np.tile(task[0].target, (30, 1)))])
        assert np.all(many.q[:, elbow] >= robot.lower_limits[elbow] - 1e-9)
        plan = pk.plan(robot, robot.neutral(), task, scene=pk.Scene())
        assert plan.success, plan.report()
        assert np.all(plan.path[:, elbow] >= robot.lower_limits[elbow] - 1e-9)


@pytest.mark.thorough
def test_timing_keeps_the_new_velocities_and_efforts():
    path = [PEPPER.posture("Stand"), PEPPER.joint_vector({"left_arm": (0.2, 0.4, -0.5, -0.8, 0.3)})]
    slow = PEPPER.with_limits(velocity={"left_arm": 0.4}, acceleration=0.5 * PEPPER.acceleration_limits)
    for robot in (PEPPER, slow, PEPPER):
        state = pk.retime(robot, path).sample(0.002)
        peak = np.abs(state.velocity[:, 5:10]).max()
        assert (peak <= 0.4 + 1e-6) == (robot is slow)
        assert pk.retime(robot, path).check(robot).success
    assert not pk.retime(PEPPER, path).check(slow).success
    weak = PEPPER.with_limits(effort={"LShoulderPitch": 0.05})
    assert not pk.retime(PEPPER, path).check(weak).success


def test_only_what_is_named_changes_and_the_old_model_stays():
    before = {
        name: getattr(PEPPER, f"{name}_limits").copy() for name in ("lower", "upper", "velocity", "effort")
    }
    changed = PEPPER.with_limits(upper={"HeadYaw": 0.5}, velocity=1.5, effort=np.arange(1.0, 16.0))
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(PEPPER, f"{name}_limits"), values)
    np.testing.assert_array_equal(changed.lower_limits, PEPPER.lower_limits)
    np.testing.assert_array_equal(changed.acceleration_limits, PEPPER.acceleration_limits)
    np.testing.assert_array_equal(changed.upper_limits, np.where(np.arange(15) == 3, 0.5, before["upper"]))
    np.testing.assert_array_equal(changed.velocity_limits, np.full(15, 1.5))
    np.testing.assert_array_equal(changed.effort_limits, np.arange(1.0, 16.0))
    assert not changed.upper_limits.flags.writeable
    assert pk.load_pepper() is PEPPER
    assert pk.model.robot_digest(changed) != pk.model.robot_digest(PEPPER)
    # Pinocchio reads the same from the exported URDF, and so does a copy in another process.
    model = pinocchio.buildModelFromXML(changed.export("urdf"))
    np.testing.assert_allclose(model.upperPositionLimit, changed.upper_limits)
    np.testing.assert_allclose(model.effortLimit, changed.effort_limits)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(changed)).upper_limits, changed.upper_limits)


def test_groups_postures_bases_and_spheres_stay():
    robot = pk.load_pepper(base="planar", hands="mimic")
    changed = robot.with_limits(upper={"HeadPitch": -0.3}).with_masses({"torso": 9.0})
    assert changed.group_names == robot.group_names
    assert len(changed.collision_spheres) == len(robot.collision_spheres)
    assert changed.posture("Stand")[changed.joint_index("HeadPitch")] == -0.3
    assert changed.is_coupled


def test_a_turning_joint_may_lose_and_get_its_bounds():
    endless = PEPPER.with_limits(lower={"LWristYaw": -np.inf}, upper={"LWristYaw": np.inf}, velocity=np.inf)
    assert endless.upper_limits[9] == np.inf
    assert np.all(endless.velocity_limits == np.inf)
    q = np.where(np.arange(15) == 9, 4.0, PEPPER.neutral())
    turned = np.where(np.arange(15) == 9, 4.0 - 2 * np.pi, PEPPER.neutral())
    np.testing.assert_allclose(
        pk.kinematics.frame_pose(endless, q, "l_gripper"),
        pk.kinematics.frame_pose(PEPPER, turned, "l_gripper"),
        atol=1e-12,
    )
    again = endless.with_limits(lower={"LWristYaw": -1.0}, upper={"LWristYaw": 1.0})
    assert (again.lower_limits[9], again.upper_limits[9]) == (-1.0, 1.0)


def test_wrong_limits_are_named():
    for arguments, error, words in [
        ({"upper": {"Tail": 1.0}}, UnknownNameError, "unknown joint or group 'Tail'"),
        ({"upper": {"HeadYaw": -3.0}}, InvalidValueError, "limits of HeadYaw: got -2.08.* to -3 rad"),
        ({"upper": {"HeadYaw": np.inf}}, InvalidValueError, "limits of HeadYaw"),
        ({"upper": {"HeadYaw": np.nan}}, InvalidValueError, "upper limits of HeadYaw: got nan"),
        ({"velocity": {"HeadYaw": 0.0}}, InvalidValueError, "velocity limit of HeadYaw: got 0.0"),
        ({"effort": -1.0}, InvalidValueError, "effort limit of KneePitch: got -1.0"),
        ({"velocity": [1.0, 2.0]}, InvalidValueError, r"velocity limits: got shape \(2,\)"),
    ]:
        with pytest.raises(error, match=words):
            PEPPER.with_limits(**arguments)


def test_wrong_masses_are_named():
    with pytest.raises(
        UnknownNameError, match=r"unknown link with a mass 'LArm_effector'; available: .*LForeArm"
    ):
        PEPPER.with_masses({"LArm_effector": 1.0})
    with pytest.raises(InvalidValueError, match="mass of Head: got 0"):
        PEPPER.with_masses({"Head": 0.0})
    with pytest.raises(InvalidValueError, match=r"mass of Head: got 1e\+31, expected at most 1e\+30 kg"):
        PEPPER.with_masses({"Head": 1e31})  # no description may hold it either


def by_hand():
    """Return a robot with a link that its description does not have."""
    model = PEPPER.pinocchio_model
    model.inertias[4] = pinocchio.Inertia.Random()
    return PEPPER.with_pinocchio_model(model)


def test_what_was_changed_by_hand_is_not_lost_in_silence():
    with pytest.raises(ModelError, match="another pinocchio_model"):
        by_hand().with_limits(velocity=1.0)


@pytest.mark.parametrize("format", ["urdf", "sdf", "mjcf"])
def test_what_was_changed_by_hand_is_not_written_as_it_was_before(format):
    assert PEPPER.export(format)
    robot = by_hand()
    with pytest.raises(
        ModelError, match=r"robot 'pepper': it was given another pinocchio_model.*with_masses"
    ):
        robot.export(format)
    assert robot.export("srdf")


@pytest.mark.parametrize(
    "read", [pk.model.audit, lambda robot: pk.model.compare(PEPPER, robot), pk.load_robot]
)
def test_what_was_changed_by_hand_is_not_read_as_it_was_before(read):
    """`compare` found no difference between a robot and one with another hand."""
    with pytest.raises(ModelError, match="another pinocchio_model"):
        read(by_hand())
