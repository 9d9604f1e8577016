"""Inverse kinematics and the servo with an attached object: against Pinocchio with it as part of a link."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin import ik
from pepper_kin.collision import loads_of
from pepper_kin.collision.loads import center_of_mass_jacobian_with, center_of_mass_with
from pepper_kin.core.balance_rows import write_balance_rows
from pepper_kin.servo.balance_table import balance_table

PEPPER = pk.load_pepper()
SIZE, MASS = (0.06, 0.04, 0.05), 0.8
POSE = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -0.1, 0.2), np.array([0.03, 0.004, 0.02]))
HELD = (
    pk.Scene().add_box("cup", SIZE, (2.0, 2.0, 0.5)).attach("cup", "l_gripper", POSE.homogeneous, mass=MASS)
)
LOADS = loads_of(PEPPER, HELD)


def loaded_model():
    model = PEPPER.inner_model.copy()
    place = model.frames[PEPPER.frame_id("l_gripper")]
    model.appendBodyToJoint(place.parentJoint, pinocchio.Inertia.FromBox(MASS, *SIZE), place.placement * POSE)
    return model


def center(q):
    """Return the center of mass of all links and the object by Pinocchio [m], shape (3,)."""
    model, still = loaded_model(), PEPPER.inner_model.inertias[0]
    moving = pinocchio.computeTotalMass(model)
    place = pinocchio.centerOfMass(model, model.createData(), q)
    return (moving * place + still.mass * still.lever) / (moving + still.mass)


def postures(count, seed=0):
    return np.random.default_rng(seed).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (count, PEPPER.n))


def test_the_center_of_mass_and_its_jacobian_count_the_object():
    for q in postures(5):
        np.testing.assert_allclose(center_of_mass_with(PEPPER, LOADS, q), center(q), atol=1e-12)
        slopes = [(center(q + h) - center(q - h)) / 2e-6 for h in 1e-6 * np.eye(PEPPER.n)]
        np.testing.assert_allclose(
            center_of_mass_jacobian_with(PEPPER, LOADS, q), np.transpose(slopes), atol=1e-8
        )


@pytest.mark.parametrize("solver", ["fast", "proxsuite"])
def test_a_task_on_the_center_of_mass_is_met_with_the_object(solver):
    found = ik.solve(PEPPER, [ik.CenterOfMass((0.0, 0.0))], scene=HELD, solver=solver)
    assert found.success, found.report()
    assert np.linalg.norm(center(found.q)[:2]) <= ik.CenterOfMass((0.0, 0.0)).tolerance
    assert np.linalg.norm(pk.dynamics.center_of_mass(PEPPER, found.q)[:2]) > 1e-3


def test_a_task_on_torques_counts_the_object():
    model, task = loaded_model(), ik.HoldingTorque(0.1).altered(loads=LOADS)
    for q in postures(5, 1):
        use = pinocchio.computeGeneralizedGravity(model, model.createData(), q) / PEPPER.effort_limits
        np.testing.assert_allclose(task.use(PEPPER, q), use, atol=1e-12)
        slopes = [(task.use(PEPPER, q + h) - task.use(PEPPER, q - h)) / 2e-6 for h in 1e-6 * np.eye(PEPPER.n)]
        np.testing.assert_allclose(task.dependence(PEPPER, q), np.transpose(slopes), atol=1e-8)
    found = ik.solve(PEPPER, [ik.HandPosition("left", (0.3, 0.2, 0.85)), ik.HoldingTorque(0.6)], scene=HELD)
    held = pinocchio.computeGeneralizedGravity(model, model.createData(), found.q)
    assert found.success
    assert (np.abs(held) <= 0.601 * PEPPER.effort_limits).all()


@pytest.mark.parametrize("solver", ["fast", "proxsuite"])
def test_what_motors_hold_is_preferred_and_certified_with_the_object(solver):
    found = ik.solve(PEPPER, [ik.HandPosition("left", (0.25, 0.25, 0.85))], scene=HELD, solver=solver)
    model = loaded_model()
    torque = np.abs(pinocchio.computeGeneralizedGravity(model, model.createData(), found.q))
    assert found.success
    assert found.torque_use.ratio == pytest.approx((torque / PEPPER.effort_limits).max(), rel=1e-9)


def test_a_payload_counts_in_each_call_as_a_point_mass_in_the_hand():
    points, payload = np.array([(0.38, 0.22, 0.82), (0.25, 0.25, 0.85)]), {"left": 0.6}
    model, still = PEPPER.inner_model.copy(), PEPPER.inner_model.inertias[0]
    hand = model.frames[PEPPER.frame_id("LArm_effector")]
    point = pinocchio.Inertia(0.6, np.zeros(3), np.zeros((3, 3)))
    model.appendBodyToJoint(hand.parentJoint, point, hand.placement)
    corners = np.array(pk.dynamics.WHEEL_CONTACTS)
    edges = np.roll(corners, -1, axis=0) - corners

    def ratio_and_balance(q):
        data = model.createData()
        torque = np.abs(pinocchio.computeGeneralizedGravity(model, data, q)) / PEPPER.effort_limits
        moving = pinocchio.computeTotalMass(model)
        place = moving * pinocchio.centerOfMass(model, data, q) + still.mass * still.lever
        away = place[:2] / (moving + still.mass) - corners
        inside = (edges[:, 0] * away[:, 1] - edges[:, 1] * away[:, 0]) / np.linalg.norm(edges, axis=1)
        return torque.max(), inside.min()

    batch = ik.solve_batch(PEPPER, ik.HandPosition("left", points), payload=payload)
    for k, target in enumerate(points):
        task = ik.HandPosition("left", target)
        for found in (ik.solve(PEPPER, task, payload=payload), batch.result(k)):
            assert (found.torque_use.ratio, found.balance) == pytest.approx(ratio_and_balance(found.q))
        several = [ratio_and_balance(q) for q in ik.solutions(PEPPER, task, payload=payload, count=20)]
        held = [ratio <= 1 and inside >= 0.01 for ratio, inside in several]
        assert held == sorted(held, reverse=True)
    goal = pk.plan(PEPPER, PEPPER.posture("Ready"), task, payload=payload, seed=0).ik
    assert goal.torque_use.ratio == pytest.approx(ratio_and_balance(goal.q)[0])


def test_the_rows_of_balance_are_the_wrench_of_the_loaded_robot():
    corners = np.array(pk.dynamics.WHEEL_CONTACTS)
    edges = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    model, still, dt = loaded_model(), PEPPER.inner_model.inertias[0], 0.02
    rng, standing = np.random.default_rng(4), PEPPER.posture("Stand")
    for _ in range(5):
        q, v, after = standing, 0.3 * rng.normal(size=PEPPER.n), 0.3 * rng.normal(size=PEPPER.n)
        data = model.createData()
        pinocchio.rnea(model, data, q, v, (after - v) / dt)
        wrench = sum(
            data.liMi[j].act(data.f[j]).vector for j in range(1, model.njoints) if not model.parents[j]
        )
        weight = -still.mass * model.gravity.linear
        wrench = wrench + np.concatenate([weight, np.cross(still.lever, weight)])
        tilt = np.array([-wrench[4], wrench[3]])
        expected = inward @ tilt - (np.einsum("ij,ij->i", inward, corners) + 0.01) * wrench[2]
        matrix, least, slack = np.empty((6, PEPPER.n)), np.empty(6), np.empty(6)
        write_balance_rows(balance_table(PEPPER, 0.01, LOADS), q, v, dt, matrix, least, slack)
        found = matrix[:3] @ after - least[:3]
        # Rows are divided by the floor's force without acceleration.
        pinocchio.rnea(model, data, q, v, np.zeros(PEPPER.n))
        lift = (
            sum(
                data.liMi[j].act(data.f[j]).linear[2] for j in range(1, model.njoints) if not model.parents[j]
            )
            + weight[2]
        )
        np.testing.assert_allclose(found * lift, expected, atol=1e-8)
