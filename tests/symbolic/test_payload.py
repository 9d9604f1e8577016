"""Payloads: Pinocchio, with an inertia more on the body that carries each frame, is the oracle."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin import symbolic
from pepper_kin.exceptions import InvalidValueError, UnknownNameError

PAYLOAD = {"left": 0.5, "Head": 0.2}


@pytest.fixture(scope="module", params=[("fixed", "locked"), ("planar", "mimic")], ids="-".join)
def pair(request):
    """A robot, and Pinocchio's model of it with two masses more."""
    pepper = pk.load_pepper(*request.param)
    model = pepper.inner_model.copy()
    for name, mass in (("LArm_effector", 0.5), ("Head", 0.2)):
        frame = model.frames[pepper.frame_id(name)]
        model.inertias[frame.parentJoint] += frame.placement.act(
            pinocchio.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
        )
    return pepper, model


def test_dynamics_are_pinocchios(pair):
    pepper, model = pair
    data, E, rng = model.createData(), pepper.full_map, np.random.default_rng(0)
    tau, hold, mass, center, kinetic, momentum = (
        getattr(symbolic, name)(pepper, payload=PAYLOAD)
        for name in ("inverse_dynamics", "gravity_torque", "mass_matrix", "center_of_mass", "kinetic_energy",
                     "centroidal_momentum")
    )  # fmt: skip
    forward = symbolic.forward_dynamics(pepper, payload=PAYLOAD)
    for _ in range(5):
        low, high = np.maximum(pepper.lower_limits, -2), np.minimum(pepper.upper_limits, 2)
        q, v, a = rng.uniform(low, high), rng.normal(size=pepper.n), rng.normal(size=pepper.n)
        full, speed = pepper.to_full(q), E @ v
        expected = E.T @ pinocchio.rnea(model, data, full, speed, E @ a)
        np.testing.assert_allclose(np.ravel(tau(q, v, a)), expected, atol=1e-11)
        np.testing.assert_allclose(np.ravel(forward(q, v, expected)), a, atol=1e-7)
        held = E.T @ pinocchio.computeGeneralizedGravity(model, data, full)
        np.testing.assert_allclose(np.ravel(hold(q)), held, atol=1e-11)
        own = pinocchio.crba(model, data, full)
        own = np.triu(own) + np.triu(own, 1).T
        np.testing.assert_allclose(np.array(mass(q).full()), E.T @ own @ E, atol=1e-11)
        energy = pinocchio.computeKineticEnergy(model, data, full, speed)
        assert float(kinetic(q, v)) == pytest.approx(energy, rel=1e-12)
        rate = pinocchio.computeCentroidalMomentum(model, data, full, speed)
        np.testing.assert_allclose(np.ravel(momentum(q, v))[:3], rate.linear, atol=1e-11)
        moving, still = pinocchio.centerOfMass(model, data, full), model.inertias[0]
        total = data.mass[0] + still.mass
        whole = (data.mass[0] * moving + still.mass * still.lever) / total
        np.testing.assert_allclose(np.ravel(center(q)), whole, atol=1e-12)


def test_every_quantity_with_masses_takes_it_and_none_is_the_robot_itself():
    pepper = pk.load_pepper()
    without = {name for name in symbolic.QUANTITIES if name.startswith("frame_")} | {"regressor"}
    for name in set(symbolic.QUANTITIES) - without:
        assert symbolic.function(pepper, name, payload=None) is symbolic.function(pepper, name)
        assert symbolic.function(pepper, name, payload={}) is symbolic.function(pepper, name)
        loaded = symbolic.function(pepper, name, payload=PAYLOAD)
        assert loaded is symbolic.function(pepper, name, payload=dict(PAYLOAD))
        assert loaded is not symbolic.function(pepper, name)


def test_it_means_what_payload_means_elsewhere():
    pepper = pk.load_pepper()
    q, zero = pepper.posture("Stand"), np.zeros(pepper.n)
    loads = pk.collision.loads_of(pepper, None, PAYLOAD)
    added = np.array(pk.collision.load_torque(pepper, loads, q, zero, zero))
    expected = pk.dynamics.gravity_torque(pepper, q) + np.ravel(added)
    found = np.ravel(symbolic.gravity_torque(pepper, payload=PAYLOAD)(q))
    np.testing.assert_allclose(found, expected, atol=1e-11)


def test_misuse_is_refused():
    pepper = pk.load_pepper()
    with pytest.raises(InvalidValueError, match="payload at left"):
        symbolic.inverse_dynamics(pepper, payload={"left": -1.0})
    with pytest.raises(InvalidValueError, match=r"payload: got 0\.5, expected a mapping"):
        symbolic.mass_matrix(pepper, payload=0.5)
    with pytest.raises(UnknownNameError, match="tail"):
        symbolic.gravity_torque(pepper, payload={"tail": 1.0})
