"""Files that robots play hold motions that pass their certificate, unless a user says otherwise."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.files import load, naoqi_arguments, save
from pepper_kin.trajectory import Trajectory


@pytest.fixture(scope="module")
def nod(pepper):
    return pk.motion.gesture(pepper, "nod")


@pytest.mark.parametrize("suffix", [".yaml", ".py"])
def test_a_motion_that_fails_its_certificate_is_refused(nod, tmp_path, suffix):
    """Such files were written without a word."""
    path = tmp_path / f"nod{suffix}"
    with pytest.raises(InvalidValueError, match=r"one that fails .*unchecked=True; .* OUTSIDE"):
        save(nod.scaled(0.2), path)
    assert not path.exists()
    save(nod.scaled(0.2), path, unchecked=True)
    again = load(path)
    np.testing.assert_allclose(again.end, nod.end, atol=1e-9)
    save(nod, path)
    assert load(path).duration == pytest.approx(nod.duration)


def test_arguments_for_naoqi_are_of_motions_that_pass(nod):
    with pytest.raises(InvalidValueError, match="one that fails"):
        naoqi_arguments(nod.scaled(0.2))
    assert naoqi_arguments(nod).names == list(nod.joint_names)


def test_what_is_around_the_robot_and_what_it_holds_count(pepper, nod, tmp_path):
    head = pk.kinematics.frame_pose(pepper, nod.start, "Head")[:3, 3]
    scene = pk.Scene().add_sphere("ball", radius=0.1, position=head)
    with pytest.raises(InvalidValueError, match="one that fails clearance"):
        save(nod, tmp_path / "nod.yaml", scene=scene)
    with pytest.raises(InvalidValueError, match="one that fails torque"):
        save(nod, tmp_path / "nod.yaml", payload={"left": 5.0})


def test_the_robot_is_named_where_it_is_not_pepper(tmp_path):
    other = Trajectory(("A",), [0, 1], np.zeros((1, 1, 1)))
    with pytest.raises(InvalidValueError, match=r"pepper: got None, expected the robot .* or unchecked=True"):
        save(other, tmp_path / "a.yaml")
    save(other, tmp_path / "a.csv")  # a table is no command


def test_pepper_with_another_base_is_known_by_its_joints(tmp_path):
    robot = pk.load_pepper(base="planar")
    points = np.tile(robot.posture("Stand"), (2, 1))
    points[1, 0] = 0.5
    drive = pk.retime(robot, points)
    save(drive, tmp_path / "drive.yaml")
    with pytest.raises(InvalidValueError, match="base_speed"):
        save(drive.scaled(0.8), tmp_path / "fast.yaml")


def test_only_true_writes_what_is_not_checked(pepper, tmp_path):
    """Any text did, "no" among them."""
    stand = pepper.posture("Stand")
    fast = pk.retime(pepper, [stand, pepper.joint_vector({"HeadYaw": 0.5})]).scaled(0.2)
    with pytest.raises(InvalidValueError, match="unchecked: got 'no', expected True or False"):
        save(fast, tmp_path / "fast.yaml", unchecked="no")
    assert not list(tmp_path.iterdir())


def test_a_plan_is_no_trajectory(pepper, tmp_path):
    """It ended in an AttributeError: a plan has no times."""
    stand = pepper.posture("Stand")
    plan = pk.plan(pepper, stand, pepper.joint_vector({"HeadYaw": 0.5}))
    words = r"trajectory: got a Plan, expected a Trajectory: of a plan that of retime\(\)"
    for name in ("a.csv", "a.npz", "a.yaml"):
        with pytest.raises(InvalidValueError, match=words):
            save(plan, tmp_path / name)
    for twin in (pk.Twin(pepper), pk.TwinBatch(pepper, 2)):
        with pytest.raises(InvalidValueError, match=words):
            twin.execute(plan)
