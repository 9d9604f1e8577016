"""Mistakes that numbers alone do not show: each is refused with what to do."""

import numpy as np
import pandas as pd
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError

PEPPER = pk.load_pepper()
STAND = PEPPER.posture("Stand")


def test_degrees_are_suspected():
    with pytest.raises(InvalidValueError, match=r"LShoulderPitch: got 45 rad.*degrees\? use numpy.radians"):
        PEPPER.joint_vector({"LShoulderPitch": 45})
    with pytest.raises(LimitError, match=r"degrees\? use numpy.radians"):
        pk.plan(PEPPER, STAND, np.degrees(STAND))
    with pytest.raises(InvalidValueError, match=r"rpy.*90 rad.*degrees\? use numpy.radians"):
        pk.pose(rpy=(0, 0, 90))
    with pytest.raises(LimitError) as outside:
        pk.plan(PEPPER, STAND, STAND + 3.0)
    assert "degrees" not in str(outside.value)
    assert pk.pose(rpy=(0, 0, -2 * np.pi)).shape == (4, 4)


def test_labeled_positions_go_by_their_names():
    series = pd.Series(STAND, index=PEPPER.joint_names).sort_index()
    frame = pd.DataFrame([STAND, STAND], columns=PEPPER.joint_names)[sorted(PEPPER.joint_names)]
    expected = pk.kinematics.frame_pose(PEPPER, STAND, "LArm_effector")
    np.testing.assert_array_equal(pk.kinematics.frame_pose(PEPPER, series, "LArm_effector"), expected)
    found = pk.kinematics.frame_pose(PEPPER, frame, "LArm_effector")
    np.testing.assert_allclose(found, [expected, expected], atol=1e-12)
    unnamed = pd.Series(STAND)
    np.testing.assert_array_equal(pk.kinematics.frame_pose(PEPPER, unnamed, "LArm_effector"), expected)
    with pytest.raises(InvalidValueError, match=r"labels of q: got .*nose.*KneePitch"):
        pk.kinematics.frame_pose(PEPPER, series.rename({"HeadYaw": "nose"}), "LArm_effector")


def test_a_tensor_with_gradient_is_refused_with_what_to_do():

    class Tensor:
        """What torch's tensors do: NumPy cannot have one that requires a gradient."""

        requires_grad = True

        def __array__(self, dtype=None, copy=None):
            raise RuntimeError("Can't call numpy() on Tensor that requires grad. Use tensor.detach().numpy()")

    tensor = Tensor()
    with pytest.raises(InvalidValueError, match=r"detach\(\)"):
        pk.kinematics.frame_pose(PEPPER, tensor, "LArm_effector")


def test_the_robot_comes_first():
    motion = pk.retime(PEPPER, [STAND, PEPPER.joint_vector({"HeadYaw": 0.3})])
    with pytest.raises(InvalidValueError, match=r"got a Scene, expected a robot, which comes first"):
        motion.check(pk.Scene())


def test_equal_way_points_and_a_dropped_scene_get_a_word():
    with pytest.raises(InvalidValueError, match=r"rows 0 and 1 are equal.*leave one out"):
        pk.retime(PEPPER, [STAND, STAND, PEPPER.joint_vector({"HeadYaw": 0.3})])
    scene = pk.Scene()
    scene.add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
    goal = PEPPER.joint_vector({"HeadYaw": 0.3})
    assert "The scene is empty: `add_box`" in pk.plan(PEPPER, STAND, goal, scene).report()
    assert "empty" not in pk.plan(PEPPER, STAND, goal).report()
