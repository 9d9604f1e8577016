"""Expressions of the joint positions as constraints: beside FrameInPlane, Pinocchio and finite tolerances."""

import pickle

import casadi
import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion import PlanStatus, manifold_of

POST = pk.Scene().add_box("post", size=(0.05, 0.05, 1.0), position=(0.33, 0.17, 0.85))
EFFECTOR = "LArm_effector"


def hand_height(pepper, q):
    return pk.kinematics.frame_pose(pepper, q, EFFECTOR)[..., 2, 3]


def height(pepper, **options):
    pose = pk.symbolic.frame_pose(pepper, EFFECTOR)
    return pk.ik.Expression(pepper, lambda q: pose(q)[2, 3], label="height of the hand", **options)


def dense(curve, count=40):
    segments = np.repeat(np.arange(len(curve.breaks) - 1), count)
    within = np.tile(np.linspace(0.0, 1.0, count), len(curve.breaks) - 1)
    return curve.at(segments, within * np.diff(curve.breaks)[segments])


@pytest.fixture(scope="module")
def beside_the_post(pepper):
    tasks = [pk.ik.HandPosition("left", (0.28, 0.32, 0.85))]
    found = pk.ik.solve(pepper, tasks, start=pepper.posture("Stand"), scene=POST, joints="left_arm")
    assert found.success
    return found.q


def test_a_height_is_that_of_the_task(pepper):
    ours = height(pepper, lower=0.85, upper=0.85, tolerance=0.002)
    task = pk.ik.FrameInPlane(EFFECTOR, (0, 0, 0.85), tolerance=0.002)
    for q in np.random.default_rng(0).uniform(pepper.lower_limits, pepper.upper_limits, (20, pepper.n)):
        np.testing.assert_allclose(ours.residual(pepper, q), task.residual(pepper, q), atol=1e-12)
        np.testing.assert_allclose(ours.jacobian(pepper, q), task.jacobian(pepper, q), atol=1e-12)
    free, q = np.arange(pepper.n), pepper.posture("Stand")
    states = np.random.default_rng(1).uniform(pepper.lower_limits, pepper.upper_limits, (20, pepper.n))
    errors = [manifold_of(pepper, [one], q, free).errors(states) for one in (ours, task)]
    np.testing.assert_allclose(*errors, atol=1e-12)


@pytest.mark.parametrize("bounds", [(0.85, 0.85, 0.002), (0.80, 0.90, 1e-3), (0.84, None, 1e-3)])
def test_a_hand_stays_between_heights_all_the_way(pepper, beside_the_post, bounds):
    lower, upper, tolerance = bounds
    kept = height(pepper, lower=lower, upper=upper, tolerance=tolerance)
    goal = [pk.ik.HandPosition("left", (0.30, 0.05, 0.85))]
    plan = pk.plan(pepper, beside_the_post, goal, POST, joints="left_arm", constraints=[kept], timeout=10)
    assert plan.status is PlanStatus.SOLVED
    q = dense(plan.curve)
    found = hand_height(pepper, q)
    assert found.min() >= lower - tolerance
    assert upper is None or found.max() <= upper + tolerance
    beyond = np.maximum(lower - found, 0 if upper is None else np.maximum(found - upper, 0)).max()
    assert plan.constraint_errors[0] == pytest.approx(beyond, abs=2e-5)
    assert not pk.collision.in_collision(pepper, q, POST).any()
    np.testing.assert_allclose(
        pk.kinematics.frame_pose(pepper, plan.goal, EFFECTOR)[:3, 3], (0.30, 0.05, 0.85), atol=1e-3
    )


def test_torques_are_bounded_all_the_way(pepper):
    """A quantity for which there is no task: what the shoulder holds."""
    torque, shoulder = pk.symbolic.gravity_torque(pepper), pepper.joint_index("LShoulderPitch")
    start = pepper.posture("Stand")
    goal = start.copy()
    goal[shoulder] = -1.2
    free = pk.plan(pepper, start, goal, joints="left_arm")
    highest = np.abs([pk.dynamics.gravity_torque(pepper, q)[shoulder] for q in dense(free.curve)]).max()
    ends = [abs(pk.dynamics.gravity_torque(pepper, q)[shoulder]) for q in (start, goal)]
    allowed = max(max(ends), 0.8 * highest)
    assert allowed < highest
    light = pk.ik.Expression(
        pepper, lambda q: torque(q)[shoulder], -allowed, allowed, 0.01, label="shoulder", unit="N m"
    )
    plan = pk.plan(pepper, start, goal, joints="left_arm", constraints=[light], timeout=10)
    assert plan.success, plan.report()
    found = np.abs([pk.dynamics.gravity_torque(pepper, q)[shoulder] for q in dense(plan.curve)])
    assert found.max() <= allowed + 0.01


def test_other_bounds_need_no_other_code(pepper):
    free, q = np.arange(pepper.n), pepper.posture("Stand")
    first = manifold_of(pepper, [height(pepper, lower=0.8)], q, free)
    second = manifold_of(pepper, [height(pepper, upper=0.7, tolerance=0.1)], q, free)
    assert first.function.keep_alive is second.function.keep_alive
    at = hand_height(pepper, q)
    assert first.errors(q[None])[0, 0] == pytest.approx(max(0.8 - at, 0), abs=1e-12)
    assert second.errors(q[None])[0, 0] == pytest.approx(max(at - 0.7, 0), abs=1e-12)


def test_each_value_is_a_constraint(pepper):
    two = pk.ik.Expression(pepper, lambda q: [q[2], q[3] - q[4]], [-0.1, 0.0], [0.1, 0.0], 0.01)
    q = pepper.posture("Stand")
    manifold = manifold_of(pepper, [two], q, np.arange(pepper.n))
    assert manifold.tolerances.size == 2
    wanted = max(abs(q[2]) - 0.1, 0), abs(q[3] - q[4])
    np.testing.assert_allclose(manifold.errors(q[None])[0], wanted, atol=1e-12)
    assert two.error(pepper, q) == pytest.approx(max(wanted))


def test_a_start_off_an_expression_is_said(pepper, beside_the_post):
    low = height(pepper, upper=0.80)
    plan = pk.plan(pepper, beside_the_post, beside_the_post, constraints=[low])
    assert plan.status is PlanStatus.START_OFF_CONSTRAINT
    assert "height of the hand is 5.0 cm above 0.8; its tolerance is 1 mm" in plan.message
    force = pk.ik.Expression(pepper, lambda q: q[0] + 30, upper=20, tolerance=0.5, label="pull", unit="N")
    plan = pk.plan(pepper, beside_the_post, beside_the_post, constraints=[force])
    assert "N above 20; its tolerance is 0.5 N" in plan.message


def test_ik_meets_expressions_beside_tasks(pepper):
    kept = height(pepper, lower=0.9, upper=0.95)
    tasks = [kept, pk.ik.Point("left", (1.0, 0.3, 0.9)), pk.ik.LookAt((1.0, 0.0, 1.0))]
    found = pk.ik.solve(pepper, tasks, start=pepper.posture("Stand"))
    assert found.success
    assert 0.899 <= hand_height(pepper, found.q) <= 0.951
    assert "height of the hand" in found.report()


@pytest.mark.parametrize("solver", ["placo", "proxsuite"])
def test_solvers_of_other_libraries_meet_expressions(pepper, solver):
    kept = height(pepper, lower=0.9, upper=0.95)
    assert pk.ik.solve(pepper, [kept], start=pepper.posture("Stand"), solver=solver).success


def test_optimization_keeps_expressions(pepper, beside_the_post):
    kept = height(pepper, lower=0.80, upper=0.90, tolerance=2e-3)
    goal = [pk.ik.HandPosition("left", (0.30, 0.05, 0.85))]
    plan = pk.plan(pepper, beside_the_post, goal, POST, joints="left_arm", constraints=[kept], timeout=10)
    limits = {"balance": None, "torque_scale": 1.0}  # which leave room to gain
    found = pk.motion.optimize(pepper, plan, POST, constraints=[kept], **limits)
    assert found.success, found.report()
    times = np.linspace(0, found.trajectory.duration, 400)
    heights = hand_height(pepper, found.trajectory(times).position)
    assert heights.min() >= 0.798 - 1e-6
    assert heights.max() <= 0.902 + 1e-6


def test_expressions_travel(pepper):
    kept = height(pepper, lower=0.9)
    other, q = pickle.loads(pickle.dumps(kept)), pepper.posture("Stand")
    assert other.error(pepper, q) == kept.error(pepper, q)


def test_bad_expressions_are_refused(pepper):
    for make, words in [
        (lambda p: pk.ik.Expression(p, 3.0), "function of expression"),
        (lambda p: pk.ik.Expression(p, lambda q: 3.0), "depend on no joint"),
        (lambda p: pk.ik.Expression(p, lambda q: "high"), "casadi.SX"),
        (lambda p: pk.ik.Expression(p, lambda q: casadi.MX.sym("x")), "casadi.SX"),
        (lambda p: pk.ik.Expression(p, lambda q: q[0], 1.0, 0.0), "at most the upper bound"),
        (lambda p: pk.ik.Expression(p, lambda q: q[:2], [1.0, 2.0, 3.0]), "one number or 2"),
        (lambda p: pk.ik.Expression(p, lambda q: q[0], np.nan), "no NaN"),
        (lambda p: pk.ik.Expression(p, lambda q: q[0], tolerance=0), "tolerance of expression"),
    ]:
        with pytest.raises(InvalidValueError, match=words):
            make(pepper)


def test_another_robot_is_refused(pepper):
    planar = pk.load_pepper(base="planar")
    with pytest.raises(InvalidValueError, match="another robot"):
        pk.ik.solve(planar, [height(pepper, lower=0.9)])
