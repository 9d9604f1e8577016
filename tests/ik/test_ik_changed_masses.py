"""IK of a robot whose masses were changed: never with what was compiled for the robot as it was."""

import json
import pickle
import uuid

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk

POINT = (0.045, 0.02)
TASK = pk.ik.CenterOfMass(POINT, tolerance=1e-4)
PROGRAM = """
import json, sys
import pepper_kin as pk

answers = []
for change in sys.argv[2:]:
    pepper = pk.load_robot(pk.load_pepper().urdf + f"<!-- {sys.argv[1]} -->")
    if change == "changed":
        model = pepper.pinocchio_model
        model.inertias[model.getJointId("LWristYaw")].mass += 3.0
        pepper = pepper.with_pinocchio_model(model)
    result = pk.ik.solve(pepper, pk.ik.CenterOfMass((0.045, 0.02), tolerance=1e-4), collisions=False)
    answers.append((result.success, result.q.tolist()))
print(json.dumps(answers))
"""


def new_pepper(heavy):
    pepper = pickle.loads(pickle.dumps(pk.load_pepper()))
    return make_heavy(pepper) if heavy else pepper


def make_heavy(pepper):
    model = pepper.pinocchio_model
    model.inertias[model.getJointId("LWristYaw")].mass += 3.0
    return pepper.with_pinocchio_model(model)


def center(q, heavy):
    """Center of mass over the floor by Pinocchio alone, of the robot put free into space."""
    model = pinocchio.buildModelFromXML(pk.load_pepper().urdf, pinocchio.JointModelFreeFlyer())
    if heavy:
        model.inertias[model.getJointId("LWristYaw")].mass += 3.0
    full = pinocchio.neutral(model)
    for name, value in zip(pk.load_pepper().joint_names, q, strict=True):
        full[model.idx_qs[model.getJointId(name)]] = value
    return pinocchio.centerOfMass(model, model.createData(), full)[:2]


@pytest.mark.thorough
@pytest.mark.parametrize("order", [("plain", "changed", "plain"), ("changed", "plain", "changed")])
def test_in_processes_of_their_own(child, order):
    """A robot that no cache knows: one kind first, then the other; then both from disk."""
    name = str(uuid.uuid4())
    for _ in range(2):
        found = json.loads(child(PROGRAM, name, *order).stdout)
        for change, (success, q) in zip(order, found, strict=True):
            assert success
            np.testing.assert_allclose(center(q, change == "changed"), POINT, atol=2e-4)


@pytest.mark.parametrize("first", [False, True])
def test_one_robot_changed_between_two_calls(first):
    pepper = new_pepper(first)
    result = pk.ik.solve(pepper, TASK, collisions=False)
    assert result.success, result.report()
    np.testing.assert_allclose(center(result.q, first), POINT, atol=2e-4)
    model = pepper.pinocchio_model
    model.inertias[model.getJointId("LWristYaw")].mass += -3.0 if first else 3.0
    pepper = pepper.with_pinocchio_model(model)
    again = pk.ik.solve(pepper, TASK, collisions=False)
    assert again.success, again.report()
    np.testing.assert_allclose(center(again.q, not first), POINT, atol=2e-4)
    assert np.abs(again.q - result.q).max() > 1e-3
    batch = pk.ik.solve_batch(
        pepper, pk.ik.CenterOfMass(np.array([POINT, POINT]), tolerance=1e-4), collisions=False
    )
    assert batch.success.all()
    np.testing.assert_allclose(center(batch.q[1], not first), POINT, atol=2e-4)


@pytest.mark.parametrize("solver", ["placo", "proxsuite"])
def test_reference_solvers(solver):
    pepper = new_pepper(False)
    for heavy in (False, True):
        pepper = make_heavy(pepper) if heavy else pepper
        result = pk.ik.solve(pepper, TASK, solver=solver, collisions=False)
        assert result.success, result.report()
        np.testing.assert_allclose(center(result.q, heavy), POINT, atol=2e-4)


@pytest.mark.parametrize("solver", ["placo", "proxsuite"])
@pytest.mark.parametrize("what", ["joint", "frame"])
def test_reference_solvers_know_changed_placements(solver, what):
    """placo kept the description's: what is reached was beyond reach, 16 mm off."""
    pepper, point = new_pepper(False), np.array([0.38, 0.22, 0.82])
    model = pepper.pinocchio_model
    joint, frame = model.getJointId("LElbowYaw"), model.frames[model.getFrameId("LArm_effector")]
    place = model.jointPlacements[joint] if what == "joint" else frame.placement
    place.translation = place.translation + np.array([0.05, 0.0, 0.01])
    pepper = pepper.with_pinocchio_model(model)
    result = pk.ik.solve(pepper, pk.ik.HandPosition("left", point), solver=solver, collisions=False)
    assert result.success, result.report()
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, result.q)
    found = data.oMf[model.getFrameId("LArm_effector")].translation
    np.testing.assert_allclose(found, point, atol=1e-3)


def test_placement_of_the_base():
    pepper = new_pepper(True)
    robot = pk.base_placement.moving_base.moving_base(pepper).robot
    q = pepper.posture("Stand")
    expected = pk.dynamics.center_of_mass(pepper, q)
    whole = np.array(
        [q[pepper.joint_index(n)] if n in pepper.joint_names else 0.0 for n in robot.joint_names]
    )
    np.testing.assert_allclose(pk.dynamics.center_of_mass(robot, whole), expected, atol=1e-9)
    np.testing.assert_allclose(expected[:2], center(q, True), atol=1e-9)
