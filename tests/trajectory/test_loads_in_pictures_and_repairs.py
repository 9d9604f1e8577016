"""What is carried counts in `enforce_limits`, gestures, plots and phase planes: against Pinocchio.

The reference is Pinocchio's model with the object's inertia appended to the joint that carries its frame.
"""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.trajectory import Trajectory, enforce_limits, phase_plane, plot

PEPPER = pk.load_pepper()
SIZE, MASS = (0.12, 0.04, 0.05), 0.6
POSE = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -0.1, 0.2), np.array([0.0, 0.004, 0.0]))
CUP = pk.Scene().add_box("cup", SIZE, (2.0, 2.0, 0.5))
HELD = CUP.attach("cup", "l_gripper", POSE.homogeneous, mass=MASS)


def loaded(mass=MASS):
    """Return a robot with the object as part of a link."""
    model = PEPPER.pinocchio_model
    place = model.frames[PEPPER.frame_id("l_gripper")]
    model.appendBodyToJoint(place.parentJoint, pinocchio.Inertia.FromBox(mass, *SIZE), place.placement * POSE)
    return PEPPER.with_pinocchio_model(model)


def lines(*points):
    """Straight lines at constant speed between (time, joints) from the posture Stand."""
    stand = dict(zip(PEPPER.joint_names, PEPPER.posture("Stand"), strict=True))
    q = [PEPPER.joint_vector({**stand, **joints}) for _, joints in points]
    times = np.array([t for t, _ in points])
    rates = np.diff(q, axis=0) / np.diff(times)[:, None]
    return Trajectory(PEPPER.joint_names, times, np.stack([q[:-1], rates], axis=1), PEPPER.joint_units)


RAISED = {"LShoulderPitch": 0.6, "LElbowRoll": -1.4}
FAST = lines((0.0, {}), (0.25, RAISED), (0.5, {}), (0.75, RAISED), (1.0, {}))


def use(pepper, trajectory):
    """Return the greatest share of the effort limits that a motion takes, by Pinocchio."""
    model, data = pepper.inner_model, pepper.inner_model.createData()
    state = trajectory(np.linspace(0.0, trajectory.duration, 2001))
    torque = np.array([pinocchio.rnea(model, data, *row) for row in zip(*state, strict=True)])
    return float((np.abs(torque) / PEPPER.effort_limits).max())


def test_a_motion_is_slowed_down_for_what_is_carried():
    light, heavy = enforce_limits(PEPPER, FAST), enforce_limits(PEPPER, FAST, scene=HELD)
    assert use(loaded(), light) > 1.01
    assert use(loaded(), heavy) <= 1.0
    assert heavy.duration > light.duration
    assert heavy.check(PEPPER, HELD).torque.success
    assert not light.check(PEPPER, HELD).torque.success
    assert heavy.is_close(enforce_limits(loaded(), FAST), 1e-6)
    both = enforce_limits(PEPPER, FAST, scene=HELD, payload={"left": 0.1})
    assert both.duration > heavy.duration


def test_what_cannot_be_held_with_an_object_is_refused_by_it():
    out = lines((0.0, {}), (3.0, {"LShoulderPitch": 0.0, "LElbowRoll": -0.1}))
    enforce_limits(PEPPER, out)
    heavy = CUP.attach("cup", "l_gripper", POSE.homogeneous, mass=3.0)
    with pytest.raises(
        InfeasibleError, match=r"to hold a position on the way with 3 kg of 'cup' at l_gripper"
    ):
        enforce_limits(PEPPER, out, scene=heavy)
    with pytest.raises(
        InfeasibleError, match=r"with 90 kg at BumperB_frame would stand .* from tipping over"
    ):
        enforce_limits(PEPPER, lines((0.0, {}), (9.0, {"HipPitch": -0.1})), payload={"BumperB_frame": 90.0})


def test_gestures_are_slower_with_an_object_in_the_hand():
    alone = pk.motion.gesture(PEPPER, "wave", side="left", tempo=2.0)
    with_it = pk.motion.gesture(PEPPER, "wave", side="left", tempo=2.0, payload={"left": 0.35})
    assert with_it.duration > alone.duration
    assert with_it.check(PEPPER, payload={"left": 0.35}).torque.success


def test_the_phase_plane_is_that_of_the_loaded_robot():
    motion = pk.retime(PEPPER, [FAST.start, FAST(0.25).position], scene=HELD)
    found, expected = phase_plane(PEPPER, motion, scene=HELD), phase_plane(loaded(), motion)
    np.testing.assert_allclose(found.force_limit, expected.force_limit, rtol=1e-6)
    alone = phase_plane(PEPPER, motion)
    assert np.abs(alone.force_limit / found.force_limit - 1.0).max() > 0.02


def test_the_torque_that_is_drawn_is_that_of_the_loaded_robot():
    motion = pk.retime(PEPPER, [FAST.start, FAST(0.25).position], scene=HELD)
    j = PEPPER.joint_index("LShoulderPitch")
    figure = plot(PEPPER, motion, joints=["LShoulderPitch"], scene=HELD)
    assert "with 0.6 kg of 'cup' at l_gripper" in figure.get_suptitle()
    (axes,) = (one for one in figure.axes if one.get_title() == "torque")
    time, share = axes.lines[0].get_data()
    model, data = loaded().inner_model, loaded().inner_model.createData()
    torque = [pinocchio.rnea(model, data, *row)[j] for row in zip(*motion(time), strict=True)]
    np.testing.assert_allclose(share, np.array(torque) / PEPPER.effort_limits[j], atol=1e-9)
