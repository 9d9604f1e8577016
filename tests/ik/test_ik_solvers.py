"""The steps of both solvers against a third, and all kinds of robots."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import pepper_kin as pk
from pepper_kin.core.inverse_kinematics.local_solver import STEP_BOUND
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.problem import POSTURE_WEIGHT, make_problem
from pepper_kin.ik.solver import HalfSpaces
from pepper_kin.ik.solvers import SOLVERS
from pepper_kin.ik.solvers.reference import make_step_solver
from pepper_kin.model.shapes import rotation_rpy, transform

TASK_LISTS = {
    "position": [pk.ik.HandPosition("left", (0.4, 0.2, 0.9), weight=2.0)],
    "position and gaze": [pk.ik.HandPosition("right", (0.3, -0.4, 1.0)), pk.ik.LookAt((0.6, -0.4, 1.0))],
    "gaze behind": [pk.ik.LookAt((-1.0, 0.2, 0.9), weight=0.5)],
    "pointing": [pk.ik.Point("left", (0.2, 1.0, 0.3), weight=3.0)],
    "orientation": [pk.ik.FrameOrientation("LArm_effector", rotation_rpy(1.0, 0.5, -0.4))],
    "center of mass": [pk.ik.CenterOfMass((0.05, 0.02))],
    "both hands": list(
        pk.ik.RelativePose("LArm_effector", "RArm_effector", transform((0.0, 0.3, 0.0))).parts
    ),
    "over the wheels": [pk.ik.CenterOfMassOverWheels(0.08)],
    "torque": [pk.ik.HoldingTorque(0.2)],
    "posture": [pk.ik.JointPosture((0.5, 0.2), joints=("HeadYaw", "KneePitch"), weight=1.5)],
}


def least_squares_form(problem, q, reference, damping):
    """The same program as a bounded linear least-squares problem: matrix, right side, bounds."""
    index = np.flatnonzero(problem.movable)
    rows = np.vstack(
        [
            problem.jacobian(q)[:, index],
            np.diag(np.sqrt(damping) * problem.scale[index]),
            POSTURE_WEIGHT * np.eye(index.size),
        ]
    )
    right = np.concatenate(
        [-problem.stack(problem.residuals(q)), np.zeros(index.size), POSTURE_WEIGHT * (reference - q)[index]]
    )
    low = np.maximum(problem.lower - q, -STEP_BOUND)[index]
    high = np.minimum(problem.upper - q, STEP_BOUND)[index]
    return rows, right, (low - 1e-12, high + 1e-12)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("name", TASK_LISTS)
def test_step_solves_the_program(name, solver):
    pepper = pk.load_pepper()
    generator = np.random.default_rng(4)
    movable = np.ones(pepper.n, dtype=bool)
    problem = make_problem(pepper, TASK_LISTS[name], pepper.neutral(), movable, keep_idle=True)
    step_solver = make_step_solver(solver, problem)
    for damping in (1e-6, 1e-3, 0.1):
        q = np.where(problem.movable, generator.uniform(pepper.lower_limits, pepper.upper_limits), problem.q0)
        step = step_solver.step(q, problem.residuals(q), problem.q0, damping)
        rows, right, bounds = least_squares_form(problem, q, problem.q0, damping)
        other = lsq_linear(rows, right, bounds, method="bvls", tol=1e-14, max_iter=1000)
        own = step[problem.movable]
        cost = 0.5 * np.sum((rows @ own - right) ** 2)
        if solver == "placo" and name in ("orientation", "both hands"):
            assert cost <= 1.1 * other.cost  # placo's own tasks linearize turns in another way
        else:
            assert cost == pytest.approx(other.cost, rel=1e-6, abs=2e-9)
            np.testing.assert_allclose(own, other.x, atol=2e-3)
        assert np.all(own >= bounds[0] - 1e-8)
        assert np.all(own <= bounds[1] + 1e-8)
        assert not step[~problem.movable].any()


@pytest.mark.parametrize("solver", SOLVERS)
def test_step_keeps_half_spaces(solver):
    pepper = pk.load_pepper()
    movable = np.ones(pepper.n, dtype=bool)
    problem = make_problem(pepper, TASK_LISTS["position"], pepper.neutral(), movable, keep_idle=True)
    step_solver, q = make_step_solver(solver, problem), problem.q0
    free = step_solver.step(q, problem.residuals(q), q, 1e-3)
    normal = np.where(problem.movable, 1.0, 0.0)[None]
    for bound in float(normal[0] @ free) - np.array([0.3, 0.6]):
        walls = HalfSpaces(normal, np.array([bound]))
        step = step_solver.step(q, problem.residuals(q), q, 1e-3, walls)
        assert normal[0] @ step == pytest.approx(bound, abs=1e-6)
    again = step_solver.step(q, problem.residuals(q), q, 1e-3)
    np.testing.assert_allclose(again, free, atol=1e-6)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("base", ["fixed", "planar"])
@pytest.mark.parametrize("hands", ["locked", "mimic", "independent"])
def test_every_kind_of_robot(solver, base, hands):
    pepper = pk.load_pepper(base, hands)
    point = (0.45, 0.25, 0.85)
    result = pk.ik.solve(
        pepper, [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)], solver=solver, collisions=False
    )
    assert result.success, result.report()
    hand = pk.kinematics.frame_pose(pepper, result.q, "LArm_effector")[:3, 3]
    assert np.linalg.norm(hand - point) < 1e-3


@pytest.mark.parametrize("solver", SOLVERS)
def test_fingers_driven_by_the_hand_reach_too(solver):
    pepper = pk.load_pepper(hands="mimic")
    wanted = pepper.joint_vector({"LHand": 0.9, "LWristYaw": 0.5, "LElbowRoll": -1.0})
    tip = pk.kinematics.frame_pose(pepper, wanted, "LFinger13_link")[:3, 3]
    joints = ("LHand", "LWristYaw", "LElbowRoll")
    result = pk.ik.solve(
        pepper, [pk.ik.FramePosition("LFinger13_link", tip)], solver=solver, joints=joints, collisions=False
    )
    assert result.success, result.report()
    found = pk.kinematics.frame_pose(pepper, result.q, "LFinger13_link")[:3, 3]
    assert np.linalg.norm(found - tip) < 1e-3


@pytest.mark.parametrize("solver", SOLVERS)
def test_base_drives_to_a_far_target(solver):
    pepper = pk.load_pepper(base="planar")
    point = (3.0, -2.0, 0.9)
    result = pk.ik.solve(
        pepper, [pk.ik.HandPosition("right", point), pk.ik.LookAt(point)], solver=solver, collisions=False
    )
    assert result.success, result.report()
    assert np.hypot(*result.q[:2]) > 2.0


@pytest.mark.parametrize("solver", SOLVERS)
def test_pose_from_a_configuration_is_met(solver):
    pepper = pk.load_pepper()
    generator = np.random.default_rng(7)
    for _ in range(5):
        wanted = 0.7 * generator.uniform(pepper.lower_limits, pepper.upper_limits) + 0.3 * pepper.neutral()
        pose = pk.kinematics.frame_pose(pepper, wanted, "RArm_effector")
        result = pk.ik.solve(pepper, pk.ik.HandPose("right", pose), solver=solver, collisions=False)
        assert result.success, result.report()
        found = pk.kinematics.frame_pose(pepper, result.q, "RArm_effector")
        np.testing.assert_allclose(found, pose, atol=0.01)


@pytest.mark.placo
def test_placo_refuses_mimic_offsets_by_name():
    urdf = """<robot name="two"><link name="a"/><link name="b"/><link name="c"/>
    <joint name="lead" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
      <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
    <joint name="follow" type="revolute"><parent link="b"/><child link="c"/><origin xyz="1 0 0"/>
      <axis xyz="0 0 1"/><limit lower="-9" upper="9" velocity="1" effort="1"/>
      <mimic joint="lead" multiplier="2" offset="0.1"/></joint></robot>"""
    robot = pk.load_robot(urdf)
    tip = pk.kinematics.frame_pose(robot, [0.4], "c")
    task = pk.ik.FrameOrientation("c", tip[:3, :3])
    with pytest.raises(InvalidValueError, match="'proxsuite' for a robot whose mimic joints have an offset"):
        pk.ik.solve(robot, task, solver="placo", collisions=False)
    result = pk.ik.solve(robot, task, solver="proxsuite", collisions=False)
    assert result.success
    assert result.q[0] == pytest.approx(0.4, abs=0.01)


def test_models_do_not_disturb_one_another():
    """placo's robots are kept: neither another call nor another model may leave a trace."""
    first, second = pk.load_pepper(), pk.load_pepper(base="planar")
    task = pk.ik.HandPosition("left", (0.45, 0.25, 0.85))
    before = pk.ik.solve(first, task, collisions=False)
    pk.ik.solve(second, pk.ik.LookAt((-1, 0, 1)), collisions=False)
    pk.ik.solve(
        first,
        pk.ik.FramePose("RArm_effector", transform((0.2, -0.3, 0.7))),
        joints="right_arm",
        collisions=False,
    )
    after = pk.ik.solve(first, task, collisions=False)
    np.testing.assert_array_equal(before.q, after.q)
    assert before.iterations == after.iterations


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_task_that_no_joint_moves(solver):
    """Two frames of the base: nothing can be done, and that is the answer."""
    pepper = pk.load_pepper()
    task = pk.ik.RelativePosition("base_footprint", "base_link", (0.0, 0.0, 1.0))
    result = pk.ik.solve(pepper, task, solver=solver, collisions=False)
    assert result.status is pk.ik.IKStatus.CLOSEST_UNREACHABLE
    np.testing.assert_array_equal(result.q, pepper.neutral())
