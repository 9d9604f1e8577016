"""The mass of an attached object in the twin and in IK: against Pinocchio with the object on a link."""

import re

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin import ik
from pepper_kin.naoqi import Broker
from pepper_kin.naoqi.run_log import RunLog
from pepper_kin.twin import TwinBatch

PEPPER = pk.load_pepper()
MASS, SIZE = 0.35, (0.12, 0.04, 0.05)
POSE = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -0.1, 0.2), np.array([0.03, 0.004, 0.02]))
CUP = pk.Scene().add_box("cup", SIZE, (2.0, 2.0, 0.5))
STAND = PEPPER.joint_vector({"LShoulderRoll": 0.4, "LShoulderPitch": 1.2, "LElbowRoll": -0.8})


def held(mass=MASS, frame="l_gripper"):
    return CUP.attach("cup", frame, POSE.homogeneous, mass=mass)


def loaded_model(mass=MASS, frame="l_gripper"):
    model = PEPPER.inner_model.copy()
    place = model.frames[PEPPER.frame_id(frame)]
    model.appendBodyToJoint(place.parentJoint, pinocchio.Inertia.FromBox(mass, *SIZE), place.placement * POSE)
    return model


def center_of(model, q):
    """Return the center of mass of the whole robot by Pinocchio, with the links fixed to the floor [m]."""
    moving, still = pinocchio.centerOfMass(model, data := model.createData(), q), model.inertias[0]
    mass = data.mass[0]
    return (mass * moving + still.mass * still.lever) / (mass + still.mass)


def gravity(model, q):
    return pinocchio.rnea(model, model.createData(), q, np.zeros(PEPPER.n), np.zeros(PEPPER.n))


def test_the_twin_at_rest_bears_the_object():
    run = pk.Twin(PEPPER, world=pk.twin.world.World(PEPPER, held())).follow(np.tile(STAND, (6000, 1)))
    assert np.abs(run.velocity[-1]).max() < 1e-6
    np.testing.assert_allclose(run.torque[-1], gravity(loaded_model(), run.position[-1]), atol=1e-4)
    assert np.abs(run.torque[-1] - gravity(PEPPER.inner_model, run.position[-1])).max() > 0.3
    assert run.loads[0].mass == MASS


def test_the_scene_of_a_twin_without_a_world_counts():
    runs = [
        pk.Twin(PEPPER, **options).follow(np.tile(STAND, (200, 1)))
        for options in ({"scene": held()}, {"world": pk.twin.world.World(PEPPER, held())})
    ]
    np.testing.assert_array_equal(runs[0].position, runs[1].position)
    assert runs[0].loads == runs[1].loads != ()
    other = pk.Twin(PEPPER, world=pk.twin.world.World(PEPPER, held()), scene=held(0.1))
    assert [load.mass for load in other.loads] == [0.1]


@pytest.mark.thorough
def test_the_simulated_body_bears_what_hangs_on_it_in_its_scene():
    runs = []
    for scene in (None, held(1.0)):
        with Broker(real_time=False, scene=scene) as broker:
            log = RunLog(broker.body)
            broker.body.time.sleep(2.0)
            runs.append(log.run())
    pepper, (alone, bears) = broker.body.pepper, runs
    assert alone.loads == ()
    assert [load.mass for load in bears.loads] == [1.0]
    rest = np.zeros(pepper.n)
    more = pk.collision.load_torque(pepper, bears.loads, bears.position[-1], rest, rest)
    elbow = pepper.joint_index("LElbowRoll")
    assert more[elbow] < -1.0
    # The gear's friction bears, or adds, a part.
    assert (bears.torque - alone.torque)[-1, elbow] == pytest.approx(more[elbow], abs=0.3)


def test_many_twins_at_rest_bear_the_object():
    run = TwinBatch(PEPPER, 3, scene=held()).follow(np.tile(STAND, (3, 6000, 1)))
    np.testing.assert_allclose(run.torque[1, -1], gravity(loaded_model(), run.position[1, -1]), atol=1e-4)


def test_the_center_of_mass_that_ik_places_is_that_of_the_loaded_robot():
    heavy = held(1.5)
    target = center_of(loaded_model(1.5), STAND)[:2] + np.array([0.012, 0.004])
    found = ik.solve(PEPPER, ik.CenterOfMass(target), start=STAND, scene=heavy)
    assert found.success, found.report()
    np.testing.assert_allclose(center_of(loaded_model(1.5), found.q)[:2], target, atol=2e-4)
    alone = ik.solve(PEPPER, ik.CenterOfMass(target), start=STAND)
    assert np.abs(center_of(loaded_model(1.5), alone.q)[:2] - target).max() > 2e-3


def test_the_torques_that_ik_states_are_those_of_the_loaded_robot():
    points = np.random.default_rng(0).uniform((0.15, 0.05, 0.6), (0.45, 0.4, 1.0), (6, 3))
    for point in points:
        found = ik.solve(PEPPER, ik.HandPosition("left", point), scene=held(1.2))
        use = np.abs(gravity(loaded_model(1.2), found.q)) / PEPPER.effort_limits
        stated = re.search(r"gravity uses at most ([\d.]+) % of a motor's torque \((\w+)\)", found.report())
        assert float(stated[1]) == pytest.approx(100 * use.max(), abs=0.6)
        assert stated[2] == PEPPER.joint_names[int(use.argmax())]
