"""What a robot's digest sees, and that nothing made for a robot as it was is used once it has changed."""

import copy
import pickle
import timeit

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.base_placement.moving_base import moving_base
from pepper_kin.model import RobotMemory, kept_while_private, robot_digest

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


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_of_the_model_changes_the_digest(change):
    pepper = new_pepper()
    first = robot_digest(pepper)
    CHANGES[change](pepper.pinocchio_model)
    second = robot_digest(pepper)
    assert second != first
    assert robot_digest(pepper) == second
    again = new_pepper()
    CHANGES[change](again.pinocchio_model)
    assert robot_digest(again) == second


def test_looking_at_the_model_changes_nothing():
    pepper = new_pepper()
    first = robot_digest(pepper)
    assert pepper.inner_model is pepper.inner_model
    assert robot_digest(pepper) == first
    mass = pepper.pinocchio_model.inertias[3].mass
    assert pepper.pinocchio_model is pepper.inner_model
    assert robot_digest(pepper) == first
    pepper.pinocchio_model.inertias[3].mass = 2.0
    assert robot_digest(pepper) != first
    pepper.pinocchio_model.inertias[3].mass = mass
    assert robot_digest(pepper) == first


def test_texts_count():
    assert robot_digest(pk.load_pepper()) == robot_digest(new_pepper())
    others = {
        robot_digest(pk.load_pepper(base, hands))
        for base in ("fixed", "planar")
        for hands in ("locked", "mimic")
    }
    assert len(others) == 4


def test_it_is_quick():
    pepper = new_pepper()
    for _ in range(2):
        robot_digest(pepper)
        assert min(timeit.repeat(lambda: robot_digest(pepper), number=10, repeat=5)) / 10 < 2e-4
        _ = pepper.pinocchio_model


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize(
    "duplicate", [copy.copy, copy.deepcopy, lambda robot: pickle.loads(pickle.dumps(robot))]
)
def test_a_copy_has_what_was_changed_and_can_be_changed_by_itself(change, duplicate):
    pepper = new_pepper()
    CHANGES[change](pepper.pinocchio_model)
    digest = robot_digest(pepper)
    other = duplicate(pepper)
    assert robot_digest(other) == digest
    other.pinocchio_model.inertias[5].mass += 1.0
    assert robot_digest(other) != digest
    assert robot_digest(pepper) == digest


def test_a_robot_put_on_wheels_has_what_was_changed():
    pepper = new_pepper()
    model = pepper.pinocchio_model
    model.gravity.linear = np.array([0.0, 0.0, -1.62])
    model.inertias[model.getJointId("LWristYaw")].mass += 2.0
    model.armature[3] = 0.5
    moving = moving_base(pepper)
    q, rng = pepper.neutral(), np.random.default_rng(0)
    v, a = rng.normal(size=(2, pepper.n))
    states = [np.zeros(moving.robot.n) for _ in range(3)]
    for state, values in zip(states, (q, v, a), strict=True):
        state[moving.body] = values
    torque = pk.dynamics.inverse_dynamics(moving.robot, *states)[moving.body]
    np.testing.assert_allclose(torque, pk.dynamics.inverse_dynamics(pepper, q, v, a), atol=1e-9)


def test_memory_forgets_a_robot_that_was_changed():
    pepper, memory = new_pepper(), RobotMemory()
    memory.of(pepper)["x"] = 1
    model = pepper.pinocchio_model
    assert memory.of(pepper) == {"x": 1}
    model.inertias[3].mass += 1.0
    assert memory.of(pepper) == {}
    memory.of(pepper)["x"] = 2
    assert memory.of(pepper) == {"x": 2}


def test_what_is_kept_while_private_is_computed_anew_afterwards():
    calls = []
    kept = kept_while_private(lambda robot: calls.append(robot) or len(calls))
    pepper = new_pepper()
    assert [kept(pepper), kept(pepper)] == [1, 1]
    _ = pepper.pinocchio_model
    assert [kept(pepper), kept(pepper)] == [2, 3]


def test_dynamics_follow_the_model():
    pepper, q = new_pepper(), pk.load_pepper().posture("Stand")
    light, center = pk.dynamics.total_mass(pepper), pk.dynamics.center_of_mass(pepper, q)
    batch = pk.dynamics.center_of_mass(pepper, np.tile(q, (40, 1)))
    np.testing.assert_allclose(batch[0], center, atol=1e-12)
    model = pepper.pinocchio_model
    model.inertias[model.getJointId("LWristYaw")].mass += 2.0
    assert pk.dynamics.total_mass(pepper) == pytest.approx(light + 2.0)
    moved = pk.dynamics.center_of_mass(pepper, q)
    assert np.abs(moved - center).max() > 0.01
    np.testing.assert_allclose(pk.dynamics.center_of_mass(pepper, np.tile(q, (40, 1)))[0], moved, atol=1e-12)
