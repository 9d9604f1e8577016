import csv
import json

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, InvalidValueError, LimitError, UnknownNameError
from pepper_kin.jobs import demo_scene, reach, run_demo, save_outcome
from pepper_kin.jobs.demo import GAZE, TARGET
from pepper_kin.jobs.result_files import summary


@pytest.fixture(scope="module")
def demo():
    pepper = pk.load_pepper()
    return pepper, run_demo(pepper)


def test_the_straight_way_would_hit_the_table(demo):
    pepper, outcome = demo
    start, goal = outcome.plan.path[0], outcome.plan.goal
    straight = start + np.linspace(0, 1, 300)[:, None] * (goal - start)
    assert pk.collision.in_collision(pepper, straight, demo_scene()).any()


def test_hand_and_gaze_arrive(demo):
    pepper, outcome = demo
    assert outcome.success, outcome.message
    q = outcome.run.position[-1]
    palm = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3]
    assert np.linalg.norm(palm - TARGET) < 1e-3
    camera = pk.kinematics.frame_pose(pepper, q, "CameraTop_frame")
    direction = np.subtract(GAZE, camera[:3, 3])
    cosine = camera[:3, 0] @ direction / np.linalg.norm(direction)
    assert np.degrees(np.arccos(cosine)) < 0.5


def test_limits_hold_at_every_millisecond_by_other_code(demo):
    """Position, velocity, acceleration by finite differences of the positions; torque by Newton-Euler."""
    pepper, outcome = demo
    samples = outcome.trajectory.sample(0.001)
    q, v, a = samples.position, samples.velocity, samples.acceleration
    assert np.all(q >= pepper.lower_limits - 1e-9)
    assert np.all(q <= pepper.upper_limits + 1e-9)
    assert np.all(np.abs(v) <= pepper.velocity_limits * (1 + 1e-9))
    assert np.all(np.abs(a) <= pepper.acceleration_limits * (1 + 1e-9))
    torque = pk.dynamics.newton_euler(pepper, q, v, a)
    assert np.all(np.abs(torque) <= pepper.effort_limits * (1 + 1e-9))
    step = np.diff(samples.time)[:-1, None]
    difference = np.diff(q, axis=0)[:-1] / step
    assert np.all(np.abs(difference) <= pepper.velocity_limits * (1 + 1e-6))
    np.testing.assert_allclose(difference, (v[1:-1] + v[:-2]) / 2, atol=0.02)


def test_nothing_is_touched_at_every_millisecond(demo):
    pepper, outcome = demo
    samples = outcome.trajectory.sample(0.001)
    assert not pk.collision.in_collision(pepper, samples.position, outcome.scene).any()
    assert not pk.collision.in_collision(pepper, outcome.run.position, outcome.scene).any()
    assert pk.collision.clearance(pepper, samples.position[::4], outcome.scene).min() > 0


def test_figures_are_those_of_the_run(demo):
    pepper, outcome = demo
    figures, run = outcome.figures, outcome.run
    error = np.abs(run.position - run.reference_position)
    assert figures["tracking_error_max"] == pytest.approx(error.max())
    assert figures["tracking_error_max"] < 0.01
    use = np.abs(run.torque).max(axis=0) / pepper.effort_limits
    np.testing.assert_allclose(list(figures["peak_torque_use"].values()), use)
    assert use.max() <= 1 + 1e-9
    assert figures["duration_s"] == outcome.trajectory.duration
    assert figures["clearance_planned_m"]["obstacles"] > 0
    assert 0.2 < figures["hand_path_length_m"] < 3


def test_files(demo, tmp_path):
    pepper, outcome = demo
    files = save_outcome(pepper, outcome, tmp_path / "new" / "folder")
    assert sorted(path.name for path in (tmp_path / "new" / "folder").iterdir()) == [
        "columns.json", "run.csv", "scene.json", "summary.json", "trajectory.csv",
    ]  # fmt: skip
    assert pk.Scene.load(files["scene.json"]).equals(outcome.scene)
    columns = json.loads(files["columns.json"].read_text())
    for name, quantities in (
        ("trajectory.csv", ("position", "velocity", "acceleration")),
        ("run.csv", ("position", "velocity", "torque", "reference", "reference_velocity")),
    ):
        with files[name].open() as file:
            header = next(csv.reader(file))
        joints = [f"{j}.{x}" for x in quantities for j in pepper.joint_names]
        assert header[: 1 + len(joints)] == ["time", *joints]
        outer = [f"robot.external_{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz"]
        outer.append("robot.external_known")
        assert header[1 + len(joints) :] == ([] if name == "trajectory.csv" else outer)
        assert set(header) <= set(columns)
    assert columns["HeadYaw.torque"] == {"unit": "N m", "quantity": "torque", "joint": "HeadYaw"}
    written = json.loads(files["summary.json"].read_text())
    assert written["success"] is True
    assert written["certificate"]["success"] is True
    assert written["target_m"] == list(TARGET)
    assert written["versions"]["pin"].startswith("3.8")


def test_same_seed_same_motion(demo):
    pepper, outcome = demo
    again = run_demo(pepper)
    assert again.trajectory.duration == pytest.approx(outcome.trajectory.duration, abs=1e-9)
    np.testing.assert_allclose(again.plan.path, outcome.plan.path, atol=1e-9)
    np.testing.assert_allclose(again.run.position, outcome.run.position, atol=1e-6)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("far", [1e6, 1e300, 1.7e308])
def test_targets_far_out_are_said_in_few_digits(far):
    """Three hundred digits were printed, and "inf cm away"."""
    message = reach(pk.load_pepper(), "left", (far, -far, 0.0), timeout=2.0).message
    assert f"cannot reach ({far:.4g}, {-far:.4g}, 0.000)" in message
    assert message.endswith(" m away.")
    assert "inf" not in message
    assert len(message) < 150


def test_out_of_reach_says_how_near_it_gets():
    pepper = pk.load_pepper()
    outcome = reach(pepper, "left", (1.0, 0.2, 1.0), (1.0, 0.0, 1.0))
    assert not outcome.success
    assert outcome.run is None
    assert "cannot reach (1.000, 0.200, 1.000)" in outcome.message
    assert "\n" not in outcome.message
    number = float(outcome.message.split(" cm away")[0].split()[-1])
    nearest = [float(x) for x in outcome.message.split("point found is (")[1].split(")")[0].split(",")]
    assert number == pytest.approx(100 * np.linalg.norm(np.subtract(nearest, (1.0, 0.2, 1.0))), abs=0.11)
    assert 15 < number < 30
    assert summary(pepper, outcome)["success"] is False


def test_start_may_be_given_and_is_checked():
    pepper = pk.load_pepper()
    with pytest.raises(LimitError, match="start: HeadYaw = 3 rad"):
        reach(pepper, "left", TARGET, start=pepper.joint_vector({"HeadYaw": 3.0}))


def test_bad_input_is_named():
    for arguments, error, message in [
        ({"hand": "middle"}, UnknownNameError, "unknown hand 'middle'; available: left, right"),
        ({"at": (0.1, float("nan"), 0)}, InvalidValueError, "at: got nan"),
        ({"at": (0.1, 0.2)}, InvalidValueError, r"at: got shape \(2,\), expected shape \(3,\)"),
        ({"look_at": (0.1, float("inf"), 1)}, InvalidValueError, "look_at: got inf"),
        ({"timestep": -0.001}, InvalidValueError, "timestep: got -0.001"),
    ]:
        with pytest.raises(error, match=message):
            reach(pk.load_pepper(), **{"hand": "left", "at": TARGET, **arguments})


def test_nothing_is_left_where_writing_fails(demo, tmp_path):
    pepper, outcome = demo
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    with pytest.raises(FileFormatError, match="cannot be made a folder"):
        save_outcome(pepper, outcome, blocked)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
