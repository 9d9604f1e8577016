"""What a robot's digest sees, and that nothing made for one robot is used for a changed one."""

import copy
import pickle

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.base_placement.moving_base import moving_base
from pepper_kin.dynamics.tree_tables import TABLES
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import RobotMemory, once_for_robot, robot_digest

CHANGES = {
    "mass": lambda m: setattr(m.inertias[3], "mass", np.nextafter(m.inertias[3].mass, 9.0)),
    "lever": lambda m: setattr(m.inertias[3], "lever", m.inertias[3].lever + 1e-9),
    "inertia": lambda m: setattr(m.inertias[3], "inertia", m.inertias[3].inertia * 1.0000001),
    "mass of the base": lambda m: setattr(m.inertias[0], "mass", 1.0),
    "placement": lambda m: setattr(
        m.jointPlacements[4], "translation", m.jointPlacements[4].translation + 1e-9
    ),
    "frame": lambda m: setattr(
        m.frames[9].placement, "translation", m.frames[9].placement.translation + 1e-9
    ),
    "armature": lambda m: m.armature.__setitem__(2, 0.1),
    "gravity": lambda m: setattr(m.gravity, "linear", np.array([0.0, 0.0, -1.62])),
    "limit": lambda m: m.lowerPositionLimit.__setitem__(0, -0.1),
    "friction": lambda m: m.friction.__setitem__(1, 0.2),
}


def new_pepper():
    """A Pepper of this test alone: `load_pepper` shares one."""
    return pickle.loads(pickle.dumps(pk.load_pepper()))


def changed(change):
    """Return a new Pepper with one change."""
    pepper = new_pepper()
    model = pepper.pinocchio_model
    CHANGES[change](model)
    return pepper.with_pinocchio_model(model)


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_of_the_model_changes_the_digest(change):
    first, second = robot_digest(new_pepper()), robot_digest(changed(change))
    assert second != first
    assert robot_digest(changed(change)) == second


def test_what_is_handed_out_is_a_copy():
    """To read the model changes nothing, not even which code computes; nor does to change it."""
    pepper, q = new_pepper(), pk.load_pepper().posture("Stand")
    first, torque = robot_digest(pepper), pk.dynamics.gravity_torque(pepper, q)
    pepper.pinocchio_model.inertias[3].mass += 2.0
    assert pepper.pinocchio_model == pepper.inner_model
    assert robot_digest(pepper) == first
    assert TABLES in pepper.kept
    np.testing.assert_array_equal(pk.dynamics.gravity_torque(pepper, q), torque)
    assert pepper.with_pinocchio_model(pepper.pinocchio_model) is pepper


def test_other_models_are_refused():
    pepper, panda = new_pepper(), pinocchio.Model()
    with pytest.raises(InvalidValueError, match=r"model: got joints.*expected the joints of robot 'pepper'"):
        pepper.with_pinocchio_model(panda)
    with pytest.raises(InvalidValueError, match=r"expected a pinocchio\.Model"):
        pepper.with_pinocchio_model(pepper)


def test_texts_count():
    assert robot_digest(pk.load_pepper()) == robot_digest(new_pepper())
    others = {
        robot_digest(pk.load_pepper(base, hands))
        for base in ("fixed", "planar")
        for hands in ("locked", "mimic")
    }
    assert len(others) == 4


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda robot: pickle.loads(pickle.dumps(robot))]
)
def test_a_copy_has_what_was_changed(change, duplicate):
    pepper = changed(change)
    other = duplicate(pepper)
    assert robot_digest(other) == robot_digest(pepper)
    assert other.pinocchio_model == pepper.pinocchio_model


def test_a_robot_put_on_wheels_has_what_was_changed():
    pepper = new_pepper()
    model = pepper.pinocchio_model
    model.gravity.linear = np.array([0.0, 0.0, -1.62])
    model.inertias[model.getJointId("LWristYaw")].mass += 2.0
    model.armature[3] = 0.5
    pepper = pepper.with_pinocchio_model(model)
    moving = moving_base(pepper)
    q, rng = pepper.neutral(), np.random.default_rng(0)
    v, a = rng.normal(size=(2, pepper.n))
    states = [np.zeros(moving.robot.n) for _ in range(3)]
    for state, values in zip(states, (q, v, a), strict=True):
        state[moving.body] = values
    torque = pk.dynamics.inverse_dynamics(moving.robot, *states)[moving.body]
    np.testing.assert_allclose(torque, pk.dynamics.inverse_dynamics(pepper, q, v, a), atol=1e-9)


def test_a_changed_robot_has_a_memory_of_its_own():
    pepper, memory, calls = new_pepper(), RobotMemory(), []
    kept = once_for_robot(lambda robot: calls.append(robot) or len(calls))
    memory.of(pepper)["x"] = 1
    assert [kept(pepper), kept(pepper)] == [1, 1]
    model = pepper.pinocchio_model
    model.inertias[3].mass += 1.0
    heavier = pepper.with_pinocchio_model(model)
    assert memory.of(heavier) == {}
    assert memory.of(pepper) == {"x": 1}
    assert [kept(heavier), kept(heavier), kept(pepper)] == [2, 2, 1]


def test_dynamics_follow_the_model():
    pepper, q = new_pepper(), pk.load_pepper().posture("Stand")
    light, center = pk.dynamics.total_mass(pepper), pk.dynamics.center_of_mass(pepper, q)
    batch = pk.dynamics.center_of_mass(pepper, np.tile(q, (40, 1)))
    np.testing.assert_allclose(batch[0], center, atol=1e-12)
    model = pepper.pinocchio_model
    model.inertias[model.getJointId("LWristYaw")].mass += 2.0
    pepper = pepper.with_pinocchio_model(model)
    assert pk.dynamics.total_mass(pepper) == pytest.approx(light + 2.0)
    moved = pk.dynamics.center_of_mass(pepper, q)
    assert np.abs(moved - center).max() > 0.01
    np.testing.assert_allclose(pk.dynamics.center_of_mass(pepper, np.tile(q, (40, 1)))[0], moved, atol=1e-12)
