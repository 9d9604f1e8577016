"""Solutions that the motors hold: the task, and what `solve` keeps of the robot's requirements."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import MotionRequirements

PEPPER = pk.load_pepper()
GRIPPERS = {"left": "l_gripper", "right": "r_gripper"}
SHARE = PEPPER.requirements.holding_share


def shares(q, pepper=PEPPER):
    """What holding still takes of each motor, by Pinocchio's RNEA alone."""
    model, none = pepper.pinocchio_model, np.zeros(pepper.n)
    return np.abs(pinocchio.rnea(model, model.createData(), q, none, none)) / pepper.effort_limits


def drawn_targets(count, seed):
    """Yield hands, and points where they can be."""
    rng, n = np.random.default_rng(seed), 0
    while n < count:
        q = rng.uniform(PEPPER.lower_limits, PEPPER.upper_limits)
        if not pk.collision.in_collision(PEPPER, q):
            hand = ("left", "right")[n % 2]
            n += 1
            yield hand, pk.kinematics.frame_pose(PEPPER, q, GRIPPERS[hand])[:3, 3]


@pytest.mark.parametrize("solver", ["fast", "proxsuite"])
def test_a_motor_is_spared(solver):
    """Behind and beside it, which the knee pays for where nothing is asked."""
    reach = pk.ik.HandPosition("left", (-0.24, 0.51, 0.9))
    plain = pk.ik.solve(PEPPER, [reach], solver=solver, balance=None)
    spared = pk.ik.solve(PEPPER, [reach, pk.ik.HoldingTorque(0.5)], solver=solver, balance=None)
    assert plain.success
    assert spared.success
    assert shares(plain.q).max() > 0.7
    assert shares(spared.q).max() <= 0.501


def test_solutions_are_held_with_what_motions_leave():
    """As a plan asks for; what is not held has no such solution among many starts, and the report says so."""
    weak = []
    for hand, point in drawn_targets(120, 0):
        found = pk.ik.solve(PEPPER, pk.ik.HandPosition(hand, point))
        assert found.success
        if shares(found.q).max() > SHARE:
            weak.append((hand, point, found))
    assert len(weak) < 12
    for hand, point, found in weak:
        held = "cannot hold" if shares(found.q).max() > 1.0 else "motions leave 85.5 %"
        assert held in found.report()
        kept = pk.ik.HoldingTorque(SHARE, tolerance=1e-4), pk.ik.CenterOfMassOverWheels(0.014, tolerance=1e-4)
        assert not pk.ik.solve(PEPPER, [pk.ik.HandPosition(hand, point), *kept], restarts=64).success


def test_a_batch_holds_what_single_calls_hold():
    points = np.array([point for hand, point in drawn_targets(80, 1) if hand == "left"])
    found = pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points))
    for q, point in zip(found.q, points, strict=True):
        np.testing.assert_array_equal(q, pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point)).q)


def test_sliders_far_from_zero_and_little_torque_are_no_obstacle():
    joint = '<joint name="lift" type="prismatic"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
    joint += '<limit lower="4" upper="6" velocity="1" effort="100"/></joint>'
    arm = '<link name="arm"><inertial><mass value="20"/>'
    arm += '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    robot = pk.load_robot(f'<robot name="lift"><link name="base"/>{arm}{joint}</robot>')
    for one in (robot, robot.with_requirements(MotionRequirements(None, 5e-4))):
        found = pk.ik.solve(one, pk.ik.FramePosition("arm", (0.0, 0.0, 5.0)))
        assert found.success
        assert "the robot cannot hold this posture" in found.report()


def test_misuse_is_refused():
    with pytest.raises(InvalidValueError, match="share of holding torque"):
        pk.ik.HoldingTorque(1.2)
    with pytest.raises(UnknownNameError, match="KneePitch"):
        pk.ik.solve(PEPPER, pk.ik.HoldingTorque(0.8, joints=["Knee"]))
