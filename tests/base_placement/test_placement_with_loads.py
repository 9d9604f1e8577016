"""Where to stand with an object in the hand: against Pinocchio with it as part of a link."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin import ik

PEPPER = pk.load_pepper()
SIZE = (0.06, 0.04, 0.05)
POSE = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -0.1, 0.2), np.array([0.03, 0.004, 0.02]))
CUP = pk.Scene().add_box("cup", SIZE, (5.0, 5.0, 0.5))
TARGET = ik.HandPosition("left", (2.0, 0.4, 0.9))


def held(mass):
    return CUP.attach("cup", "l_gripper", POSE.homogeneous, mass=mass)


def loaded_model(mass):
    model = PEPPER.inner_model.copy()
    place = model.frames[PEPPER.frame_id("l_gripper")]
    model.appendBodyToJoint(place.parentJoint, pinocchio.Inertia.FromBox(mass, *SIZE), place.placement * POSE)
    return model


def ratio(model, q):
    """Return the greatest share of the effort limits that holds a posture, by Pinocchio."""
    still = np.zeros(PEPPER.n)
    return (np.abs(pinocchio.rnea(model, model.createData(), q, still, still)) / PEPPER.effort_limits).max()


def margin(model, q):
    """Return how far the center of mass is inside the wheels' triangle, by Pinocchio [m]."""
    data, still = model.createData(), model.inertias[0]
    moving = pinocchio.centerOfMass(model, data, q)
    center = (data.mass[0] * moving + still.mass * still.lever)[:2] / (data.mass[0] + still.mass)
    corners = np.array(pk.dynamics.WHEEL_CONTACTS)
    edges = np.roll(corners, -1, axis=0) - corners
    inward = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1)[:, None]
    return np.einsum("ki,ki->k", center - corners, inward).min()


def test_the_torque_that_is_certified_is_that_with_the_object():
    found = pk.base_placement.place_base(PEPPER, [TARGET], scene=held(0.5), candidates=48, keep=3)
    assert found.success, found.report()
    model = loaded_model(0.5)
    for placement in found.placements:
        use = placement.results[0].torque_use.ratio
        assert use == pytest.approx(ratio(model, placement.q[0]), rel=1e-6)
        assert use != pytest.approx(ratio(PEPPER.inner_model, placement.q[0]), rel=1e-3)


@pytest.mark.thorough
def test_places_where_the_robot_would_tip_with_the_object_do_not_serve():
    """With 4 kg in the hand, the robot balances by its trunk: a posture that balances without them tips."""
    tasks, model = [TARGET, ik.CenterOfMassOverWheels(0.06)], loaded_model(4.0)
    options = {"candidates": 48, "keep": 3}
    heavy = pk.base_placement.place_base(PEPPER, tasks, scene=held(4.0), **options)
    light = pk.base_placement.place_base(PEPPER, tasks, scene=CUP, **options)
    assert heavy.success
    assert light.success
    for placement in heavy.placements:
        assert margin(model, placement.q[0]) >= 0.06 - 1e-3
    for placement in light.placements:
        assert margin(PEPPER.inner_model, placement.q[0]) >= 0.06 - 1e-3
    assert min(margin(model, placement.q[0]) for placement in light.placements) < 0.055
