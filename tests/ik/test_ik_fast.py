"""The fast solver against the others, against SciPy, and against its own rules."""

import math
import pickle

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

import pepper_kin as pk
from pepper_kin.core.inverse_kinematics.box_step import solve_box
from pepper_kin.ik.fast.compiled_tasks import used_joints
from pepper_kin.ik.fast.expression import task_function
from pepper_kin.ik.tasks.structure import known_structures, target_of
from pepper_kin.ik.tasks.symbolic_angles import direction_residual, rotation_residual
from pepper_kin.ik.tasks.task import HARD_WEIGHT
from pepper_kin.model.shapes import rotation_rpy, transform

PEPPER = pk.load_pepper()
LOW, HIGH = PEPPER.lower_limits, PEPPER.upper_limits
TASKS = {
    "position": [pk.ik.HandPosition("left", (0.4, 0.2, 0.9), weight=2.0)],
    "height": [pk.ik.FrameInPlane("LArm_effector", (0.0, 0.0, 0.9), weight=2.0)],
    "slanted plane": [pk.ik.FrameInPlane("RArm_effector", (0.3, -0.2, 0.8), (1, 2, -0.5), hard=True)],
    "orientation": [pk.ik.FrameOrientation("LArm_effector", rotation_rpy(1.0, 0.5, -0.4))],
    "pointing": [pk.ik.Point("left", (0.2, 1.0, 0.3), weight=3.0)],
    "slanted axis": [pk.ik.AxisAlignment("RArm_effector", (1.0, 0.3, 0.2), axis=(0.5, 1.0, -0.4))],
    "gaze": [pk.ik.LookAt((-1.0, 0.2, 0.9), weight=0.5)],
    "forearm's line": [pk.ik.PointAt("left", (1.5, 0.8, 0.6), weight=2.0)],
    "arm's line behind": [pk.ik.PointAt("right", (-1.0, -0.4, 1.2), line="arm", hard=True)],
    "hand before the eye": [pk.ik.LineThroughPoint("CameraTop_frame", "RArm_effector", (2.0, -0.4, 0.9))],
    "optical gaze": [pk.ik.LookAt((1.0, 0.2, 0.9), camera="CameraTop_optical_frame")],
    "posture": [pk.ik.JointPosture((0.5, 0.2), joints=("HeadYaw", "KneePitch"), weight=1.5)],
    "whole posture": [pk.ik.JointPosture(np.zeros(15))],
    "joint": [pk.ik.JointValue("HipPitch", -0.3, weight=2.0, hard=True)],
    "both hands": list(
        pk.ik.RelativePose(
            "LArm_effector", "RArm_effector", transform((0.0, 0.3, 0.0), (0.1, 0.2, 0.3))
        ).parts
    ),
    "center of mass": [pk.ik.CenterOfMass((0.02, -0.01), weight=3.0)],
    "over the wheels": [pk.ik.CenterOfMassOverWheels(0.08).on(PEPPER)],
    "torque": [pk.ik.HoldingTorque(0.2, weight=2.0)],
    "expression": [
        pk.ik.Expression(PEPPER, lambda q: casadi.vertcat(q[3] * q[4], casadi.sin(q[5])), 0.1, [0.1, 0.2])
    ],
    "hard and soft": [pk.ik.HandPosition("left", (0.4, 0.2, 0.9), hard=True), pk.ik.LookAt((1.0, 0.0, 1.0))],
    "several": [
        pk.ik.HandPosition("left", (0.4, 0.2, 0.9)),
        pk.ik.HandPosition("right", (0.4, -0.2, 0.9), weight=3.0),
        pk.ik.LookAt((1.0, 0.0, 1.0)),
    ],
}


def reachable(generator, scale=1.0):
    middle = PEPPER.neutral()
    q = middle + scale * (generator.uniform(LOW, HIGH) - middle)
    hand = pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")
    camera = pk.kinematics.frame_pose(PEPPER, q, "CameraTop_frame")
    return hand[:3, 3], camera[:3, 3] + camera[:3, 0]


@pytest.mark.parametrize("name", TASKS)
def test_expression_is_that_of_the_tasks(name):
    tasks = TASKS[name]
    structures = known_structures(tasks)
    index = used_joints(PEPPER, structures)
    function = task_function(PEPPER, structures, index)
    generator = np.random.default_rng(2)
    weights = [task.weight**2 for task in tasks]
    targets = np.concatenate([target_of(task) for task in tasks])
    for _ in range(20):
        q = generator.uniform(LOW, HIGH)
        found = np.array(function(q, weights, targets)).ravel()
        strengths = [(HARD_WEIGHT if task.hard else 1.0) * task.weight for task in tasks]
        pairs = list(zip(strengths, tasks, strict=True))
        residual = np.concatenate([s * task.residual(PEPPER, q) for s, task in pairs])
        jacobian = np.concatenate([s * task.jacobian(PEPPER, q) for s, task in pairs])
        assert np.abs(np.delete(jacobian, index, axis=1)).max(initial=0.0) < 1e-14
        jacobian = jacobian[:, index]
        wanted = np.concatenate(
            [
                [task.error(PEPPER, q) ** 2 for task in tasks],
                [0.5 * residual @ residual],
                jacobian.T @ residual,
                (jacobian.T @ jacobian)[np.triu_indices(index.size)],
            ]
        )
        np.testing.assert_allclose(found, wanted, atol=1e-7, rtol=1e-9)


def test_expression_of_the_base():
    planar = pk.load_pepper(base="planar")
    tasks = pk.ik.BasePlacement((0.3, -0.2), 4.0).parts
    structures = known_structures(tasks)
    index = used_joints(planar, structures)
    assert [planar.joint_names[i] for i in index] == ["BaseX", "BaseY", "BaseYaw"]
    function = task_function(planar, structures, index)
    for yaw in np.linspace(-9.0, 9.0, 13):
        q = planar.neutral()
        q[index] = 0.5, 0.7, yaw
        found = np.array(function(q, [1.0, 1.0], [0.3, -0.2, 4.0])).ravel()
        turn = math.remainder(yaw - 4.0, 2 * math.pi)
        np.testing.assert_allclose(found[:2], [0.2**2 + 0.9**2, turn**2], atol=1e-12)
        np.testing.assert_allclose(found[3:6], [0.2, 0.9, turn], atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 0.01, 1.0, 3.0, 3.13, 3.1415, math.pi - 1e-7, math.pi])
def test_angles_from_none_to_a_half_turn(angle):
    """The compiled residuals have no singularity where the others have none."""
    task = pk.ik.FrameOrientation("base_footprint", np.eye(3))
    generator = np.random.default_rng(1)
    symbol = casadi.SX.sym("E", 3, 3)
    turn = casadi.Function("f", [symbol], list(rotation_residual(symbol)))
    basis = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    direction = casadi.SX.sym("d", 3)
    lean = casadi.Function("g", [direction], list(direction_residual(np.eye(3)[0], basis, direction)))
    for _ in range(5):
        axis = generator.normal(size=3)
        axis /= np.linalg.norm(axis)
        cross = np.cross(np.eye(3), axis).T
        matrix = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
        residual, inverse = (np.array(x) for x in turn(matrix))
        assert task.size(residual.ravel()) == pytest.approx(angle, abs=2e-8)
        assert np.isfinite(inverse).all()
        np.testing.assert_allclose(inverse @ residual, residual, atol=1e-6)
        d = [math.cos(angle), math.sin(angle) * 0.6, math.sin(angle) * 0.8]
        sideways, slope = (np.array(x) for x in lean(d))
        assert np.linalg.norm(sideways) == pytest.approx(angle, abs=2e-7)
        assert np.isfinite(slope).all()


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), k=st.integers(1, 15))
def test_box_program_against_scipy(seed, k):
    generator = np.random.default_rng(seed)
    rows = generator.normal(size=(max(k // 2, 1), k))
    matrix = rows.T @ rows + 1e-3 * np.eye(k)
    gradient = generator.normal(size=k)
    low, high = -generator.uniform(0, 0.5, k), generator.uniform(0, 0.5, k)
    step = np.zeros(k)
    assert solve_box(matrix, gradient, low, high, step, np.zeros(k, np.int64), np.zeros((k, k + 1)), False)
    root = np.linalg.cholesky(matrix).T
    other = lsq_linear(root, -np.linalg.solve(root.T, gradient), (low - 1e-13, high + 1e-13), tol=1e-14)

    def cost(x):
        return gradient @ x + 0.5 * x @ matrix @ x

    assert np.all((low <= step) & (step <= high))
    assert cost(step) <= cost(other.x) + 1e-7


@pytest.mark.thorough
@pytest.mark.parametrize("solver", ["placo", "proxsuite"])
def test_agrees_with_the_other_solvers(solver):
    generator = np.random.default_rng(11)
    for k in range(12):
        hand, gaze = reachable(generator)
        if k % 3 == 2:
            hand = hand * 2.5
        tasks = [pk.ik.HandPosition("left", hand)] + ([pk.ik.LookAt(gaze)] if k % 3 == 1 else [])
        fast, other = (pk.ik.solve(PEPPER, tasks, solver=name, collisions=False) for name in ("fast", solver))
        if other.success:
            assert fast.success
        elif not fast.success:
            assert fast.status is other.status
            assert fast.errors[0].value <= other.errors[0].value + 1e-3


@pytest.mark.parametrize("name", TASKS)
def test_success_is_what_the_certificate_says(name):
    """The verdict comes from compiled code, the errors from the tasks."""
    result = pk.ik.solve(PEPPER, TASKS[name], collisions=False)
    assert result.success == all(error.met for error in result.errors)
    assert np.all((result.q >= LOW) & (result.q <= HIGH))


@pytest.mark.thorough
@settings(max_examples=150, deadline=None)
@given(
    point=st.tuples(*[st.floats(-3, 3)] * 3),
    gaze=st.tuples(*[st.floats(-3, 3)] * 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_fuzz_limits_and_numbers(point, gaze, seed):
    q0 = np.random.default_rng(seed).uniform(LOW, HIGH)
    tasks = [pk.ik.HandPosition("right", point), pk.ik.LookAt(gaze), pk.ik.Point("left", (1, 2, 3))]
    result = pk.ik.solve(PEPPER, tasks, q0, seed=seed % 7, restarts=3, collisions=False)
    assert np.all((result.q >= LOW) & (result.q <= HIGH))
    assert result.success == all(error.met for error in result.errors)
    start = sum(task.weight**2 * task.error(PEPPER, q0) ** 2 for task in tasks)
    end = sum(task.weight**2 * task.error(PEPPER, result.q) ** 2 for task in tasks)
    assert result.success or end <= start + 1e-9


def test_same_arguments_same_result_and_a_copy_of_q0():
    hand, gaze = reachable(np.random.default_rng(3))
    tasks = [pk.ik.HandPosition("left", hand), pk.ik.LookAt(gaze)]
    q0 = PEPPER.neutral()
    first = pk.ik.solve(PEPPER, tasks, q0, seed=4, collisions=False)
    q0[:] = 0
    second = pk.ik.solve(PEPPER, tasks, seed=4, collisions=False)
    np.testing.assert_array_equal(first.q, second.q)
    assert (first.iterations, first.restarts) == (second.iterations, second.restarts)
    assert first.certificate == second.certificate
    with pytest.raises(ValueError, match="read-only"):
        first.q[0] = 0


def test_self_collision_is_avoided():
    generator = np.random.default_rng(6)
    clear = 0
    for _ in range(25):
        q = generator.uniform(LOW, HIGH)
        if pk.collision.in_collision(PEPPER, q):
            continue
        hand = pk.kinematics.frame_pose(PEPPER, q, "LArm_effector")[:3, 3]
        result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", hand), scene=pk.Scene())
        assert not pk.collision.in_collision(PEPPER, result.q)
        assert result.success, result.report()
        clear += 1
    assert clear >= 5


def test_locked_joints_keep_still():
    hand, _ = reachable(np.random.default_rng(12), 0.5)
    q0 = PEPPER.joint_vector({"HipPitch": -0.2, "HeadYaw": 0.4})
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", hand), q0, joints="left_arm", collisions=False)
    moved = {PEPPER.joint_names[i] for i in np.flatnonzero(result.q != q0)}
    assert moved <= set(PEPPER.joint_group("left_arm"))


def test_results_travel_between_processes():
    result = pk.ik.solve(PEPPER, pk.ik.HandPose("left", transform((0.4, 0.2, 0.9))), collisions=False)
    again = pickle.loads(pickle.dumps(result))
    assert again.certificate == result.certificate
    assert again.report() == result.report()


@pytest.mark.parametrize("away", [0.0, 3e-7, 2e-3, 0.05])
def test_a_point_in_the_camera_is_not_called_met_unless_it_is_looked_at(away):
    """Nearer than a micrometer a point has no direction; what is called solved is so by the task."""
    q = PEPPER.posture("Stand")
    origin = pk.kinematics.frame_pose(PEPPER, q, "CameraTop_frame")[:3, 3]
    task = pk.ik.LookAt(origin + np.array([0.0, away, 0.0]))
    result = pk.ik.solve(PEPPER, task, q, solver="fast", collisions=False)
    assert result.success == (task.error(PEPPER, result.q) <= task.tolerance * (1 + 1e-6))
    assert result.errors[0].value == pytest.approx(task.error(PEPPER, result.q), abs=1e-12)
