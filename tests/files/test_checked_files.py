"""Files that robots play hold motions that pass their certificate, unless a user says otherwise."""

import re

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.files import load, naoqi_arguments, ros_points, save
from pepper_kin.files.certified import SLOWED
from pepper_kin.trajectory import Trajectory

SUFFIXES = (".yaml", ".py", ".mcap", ".csv", ".parquet", ".npz", ".json")
TABLE = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))


@pytest.fixture(scope="module")
def reach(pepper):
    """The README's, which uses acceleration and balance to the full, and the same with distance to them."""
    point = (0.38, 0.22, 0.82)
    goal = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
    plan = pk.plan(pepper, pepper.posture("Stand"), goal, TABLE, seed=0)
    gentle = pk.retime(pepper, plan, balance=0.02, velocity_scale=0.7, acceleration_scale=0.6)
    return pk.retime(pepper, plan, balance=0.01), gentle


@pytest.fixture(scope="module")
def nod(pepper):
    return pk.motion.gesture(pepper, "nod")


@pytest.mark.parametrize("suffix", SUFFIXES)
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


@pytest.mark.parametrize("export", [naoqi_arguments, ros_points])
def test_what_robots_are_sent_passes(nod, export):
    with pytest.raises(InvalidValueError, match="one that fails"):
        export(nod.scaled(0.2))
    assert tuple(export(nod)[0]) == nod.joint_names
    with pytest.raises(TypeError, match=r"no argument 'blance' .did you mean 'balance'"):
        export(nod, blance=0.01, unchecked=True)


@pytest.mark.parametrize(("balance", "suffix"), [*((0.01, suffix) for suffix in SUFFIXES), (0.0, ".py")])
def test_the_curve_in_a_file_passes_the_certificate_of_its_motion(reach, pepper, tmp_path, balance, suffix):
    """The files' own interpolation broke acceleration by a tenth, that of scripts balance, too."""
    fast = reach[0]
    again = load(save(fast, tmp_path / f"a{suffix}", scene=TABLE, balance=balance), pepper=pepper)
    assert again.check(pepper, TABLE, balance=balance).success
    assert fast.duration - 1e-9 <= again.duration <= fast.duration * (1 + SLOWED)
    time = np.linspace(0.0, fast.duration, 2000)
    slower = again.duration / fast.duration
    for got, wanted, off in zip(again(slower * time)[:2], fast(time)[:2], (5e-5, 5e-4), strict=True):
        np.testing.assert_allclose(got, wanted, atol=off)


@pytest.mark.parametrize("suffix", [".yaml", ".py"])
def test_a_step_whose_curve_fails_is_refused_with_the_largest_that_passes(reach, pepper, tmp_path, suffix):
    """At 1 s the hand was 5.6 cm deep in the table, without a word."""
    path = tmp_path / f"a{suffix}"
    words = (
        r"dt: got 1 s, whose curve fails .*clearance.*, expected ([\d.]+) s, the largest found that passes, "
        r"None .* unchecked=True; .*clearance: VIOLATED: -.* between .* and table, at [\d.]+ s"
    )
    with pytest.raises(InvalidValueError, match=words) as caught:
        save(reach[1], path, scene=TABLE, dt=1.0)
    assert not path.exists()
    largest = float(re.search(words, str(caught.value))[1])
    assert 0.1 < largest < 1.0
    save(reach[1], path, scene=TABLE, dt=largest)
    again = load(path, pepper=pepper)
    assert again.check(pepper, TABLE).success
    np.testing.assert_allclose(np.diff(again.breaks)[:-1], largest, atol=1e-9)
    with pytest.raises(InvalidValueError, match=r"expected a motion with more .* as no dt was found"):
        save(reach[0], path, scene=TABLE, dt=0.02)
    save(reach[1], path, dt=1.0, unchecked=True)
    assert not load(path, pepper=pepper).check(pepper, TABLE).success


def test_a_motion_of_which_no_curve_passes_is_refused(pepper, tmp_path):
    """A line of constant speed begins with a jump of the velocity for NAOqi, which begins at rest."""
    q = pepper.posture("Stand")
    moving = Trajectory(pepper.joint_names, [0, 1], np.array([[q, 1.5 * (np.arange(15) == 3)]]))
    assert moving.check(pepper).success
    save(moving, tmp_path / "a.yaml")
    with pytest.raises(
        InvalidValueError, match="one of which no curve through points was found that passes acc"
    ):
        save(moving, tmp_path / "a.py")


def test_the_conditions_of_the_certificate_are_those_given(reach, tmp_path):
    for name, value in (
        ("balance", 0.05),
        ("hand_speed", 0.1),
        ("jerk", "gentle"),
        ("payload", {"left": 9.0}),
    ):
        with pytest.raises(InvalidValueError, match=f"one that fails .*{name.replace('payload', 'torque')}"):
            save(reach[1], tmp_path / "a.npz", **{name: value})
    below = pk.Scene().add_box("block", size=(0.2, 0.2, 0.2), position=(0.0, 0.0, 0.8))
    with pytest.raises(InvalidValueError, match="one that fails obstacle_clearance"):
        save(reach[1], tmp_path / "a.csv", scene=below)


def test_what_is_around_the_robot_and_what_it_holds_count(pepper, nod, tmp_path):
    head = pk.kinematics.frame_pose(pepper, nod.start, "Head")[:3, 3]
    scene = pk.Scene().add_sphere("ball", radius=0.1, position=head)
    with pytest.raises(InvalidValueError, match="one that fails obstacle_clearance"):
        save(nod, tmp_path / "nod.yaml", scene=scene)
    with pytest.raises(InvalidValueError, match="one that fails torque"):
        save(nod, tmp_path / "nod.yaml", payload={"left": 5.0})


def test_the_robot_is_named_where_it_is_not_pepper(tmp_path):
    other = Trajectory(("A",), [0, 1], np.zeros((1, 1, 1)))
    with pytest.raises(InvalidValueError, match=r"pepper: got None, expected the robot .* or unchecked=True"):
        save(other, tmp_path / "a.yaml")
    save(other, tmp_path / "a.csv")  # no robot plays it


@pytest.mark.thorough
def test_pepper_with_another_base_is_known_by_its_joints(tmp_path):
    robot = pk.load_pepper(base="planar")
    points = np.tile(robot.posture("Stand"), (2, 1))
    points[1, 0] = 0.3
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


@pytest.mark.parametrize("suffix", [".yaml", ".mcap", ".csv"])
def test_a_motion_with_jerk_limits_keeps_them_in_a_file(pepper, tmp_path, suffix):
    """Between quintics at its own knots; those of even times exceeded the limit by a fifth."""
    stand = pepper.posture("Stand")
    motion = pk.retime(pepper, [stand, pepper.joint_vector({"HeadYaw": 0.5})], jerk="brisk")
    again = load(save(motion, tmp_path / f"a{suffix}", jerk="brisk"), pepper=pepper)
    assert again.check(pepper, jerk="brisk").success
    with pytest.raises(InvalidValueError, match=r"no curve .* passes acceleration_conti"):
        save(motion, tmp_path / "a.py", jerk="brisk")
