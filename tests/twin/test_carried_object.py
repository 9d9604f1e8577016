"""The twin of a robot that carries an object, against Pinocchio with the object as part of a link."""

import copy

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.twin import Recorder, TwinBatch, load_recording
from pepper_kin.twin.world import World

PEPPER = pk.load_pepper()
SIZE, MASS = (0.12, 0.04, 0.05), 0.35
POSE = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -0.1, 0.2), np.array([0.03, 0.004, 0.02]))
CUP = pk.Scene().add_box("cup", SIZE, (2.0, 2.0, 0.5))
HELD = CUP.attach("cup", "l_gripper", POSE.homogeneous, mass=MASS)


def append(pepper, inertia, placement):
    """Add a body to the model of the hand."""
    model = pepper.pinocchio_model
    frame = model.frames[pepper.frame_id("l_gripper")]
    model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement * placement)
    return pepper.with_pinocchio_model(model)


@pytest.fixture(scope="module")
def loaded():
    return append(copy.deepcopy(pk.load_pepper()), pinocchio.Inertia.FromBox(MASS, *SIZE), POSE)


def references(count=150):
    time = 0.002 * np.arange(count)[:, None]
    return PEPPER.posture("Stand") + 0.05 * np.sin(6.0 * time + np.arange(PEPPER.n))


def test_a_twin_moves_as_one_of_the_robot_with_the_object_as_part_of_a_link(loaded):
    rows = references()
    run = pk.Twin(PEPPER, 0.002, feedforward="none", world=World(PEPPER, HELD)).follow(rows)
    other = pk.Twin(loaded, 0.002, feedforward="none").follow(rows)
    alone = pk.Twin(PEPPER, 0.002, feedforward="none").follow(rows)
    np.testing.assert_allclose(run.position, other.position, atol=1e-9)
    np.testing.assert_allclose(run.torque[1:], other.torque[1:], atol=1e-6)
    assert np.abs(run.position - alone.position).max() > 1e-4
    assert [load.mass for load in run.loads] == [MASS]


def test_the_steady_torque_is_that_of_gravity_with_the_object(loaded):
    twin = pk.Twin(PEPPER, 0.002, world=World(PEPPER, HELD))
    for _ in range(3000):
        state = twin.step(PEPPER.posture("Stand"))
    expected = pk.dynamics.gravity_torque(loaded, state.position)
    assert np.abs(state.velocity).max() < 1e-4
    np.testing.assert_allclose(state.torque, expected, atol=2e-3)
    assert np.abs(pk.dynamics.gravity_torque(PEPPER, state.position) - expected).max() > 0.1


def test_robots_of_a_batch_carry_the_object_and_their_payloads():
    payload = np.array([0.0, 0.1, 0.2])
    batch = TwinBatch(PEPPER, 3, 0.002, feedforward="none", scene=HELD, payload={"left": payload})
    run = batch.follow(references(), every=1)
    for k, mass in enumerate(payload):
        options = {"payload": {"left": float(mass)}} if mass else {}
        one = pk.Twin(PEPPER, 0.002, feedforward="none", world=World(PEPPER, HELD), **options)
        np.testing.assert_allclose(run.position[k], one.follow(references()).position, atol=1e-9)


def test_recordings_keep_what_was_carried(tmp_path):
    recorder = Recorder(pk.Twin(PEPPER, 0.002, world=World(PEPPER, HELD)), tmp_path / "run")
    run = recorder.follow(references(40))
    found = load_recording(tmp_path / "run")
    assert found.run().loads == run.loads
    found.replay(pk.Twin(PEPPER, 0.002, world=World(PEPPER, HELD)))
    with pytest.raises(InvalidValueError, match="loads of the twin"):
        found.replay(pk.Twin(PEPPER, 0.002, world=World(PEPPER, CUP)))
    header = tmp_path / "run" / "recording.json"
    header.write_text(header.read_text().replace('"cup"', "3"))
    with pytest.raises(FileFormatError, match="loads"):
        load_recording(tmp_path / "run")
