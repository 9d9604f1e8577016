"""The paper's movements: data as printed, replay within a tenth of the paper's errors, plain notes."""

import json

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.paper import GESTURES, paper_gesture, paper_inconsistencies, replay
from pepper_kin.paper.gesture_replay import passing_times
from pepper_kin.twin import Twin


@pytest.fixture(scope="module", params=GESTURES)
def report(request, pepper):
    return replay(pepper, request.param)


def test_table_has_its_shape():
    sizes = {name: paper_gesture(name).plan.shape for name in GESTURES}
    assert sizes == {"left-arm": (5, 5), "right-arm": (5, 5), "head": (5, 2)}
    head = paper_gesture("head")
    assert head.joint_names == ("HeadYaw", "HeadPitch")
    np.testing.assert_array_equal(head.plan[:, 0], [0, 0.28, 0.57, 0.9, 2.05])
    np.testing.assert_array_equal(head.gazebo[:, 1], [0.01, -0.02, -0.04, -0.06, -0.14])
    right = paper_gesture("right-arm")
    assert right.joint_names[0] == "RShoulderPitch"
    assert right.printed_labels[0] == "LshoulderP"


def test_paper_errors_recompute():
    left = paper_gesture("left-arm")
    np.testing.assert_allclose(left.paper_error("gazebo"), [0.008, 0.01, 0, 0.01, 0], atol=1e-9)
    np.testing.assert_allclose(left.paper_error("reality"), [0, 0, 0.008, 0, 0.004], atol=1e-9)
    with pytest.raises(UnknownNameError, match="unknown column of table 5 'rviz'; available: plan, gazebo"):
        left.paper_error("rviz")


def test_inconsistencies_are_counted_from_the_data():
    text = " ".join(paper_inconsistencies())
    assert "5 right-arm rows with left labels (LshoulderP for RShoulderPitch" in text
    assert "equals its column Choregraphe in 60 of 60 numbers" in text
    assert "by exactly 0 or 0.01 rad in all 60 numbers" in text
    assert "T0 of 0.00 rad for ShoulderRoll and ElbowRoll" in text


def test_right_arm_rows_fit_right_limits_only(pepper):
    plan = paper_gesture("right-arm").plan[1:]
    for side, fits in (("R", True), ("L", False)):
        joints = [pepper.joint_index(side + k) for k in ("ShoulderRoll", "ElbowRoll")]
        inside = (plan[:, [1, 3]] >= pepper.lower_limits[joints]) & (
            plan[:, [1, 3]] <= pepper.upper_limits[joints]
        )
        assert inside.all() == fits


def test_replay_is_ten_times_nearer_than_the_paper(report):
    assert report.run.success
    assert report.mean_absolute_error.max() < 0.002
    assert report.rms_tracking_error.max() < 0.002


def test_replay_passes_the_key_frames_within_all_limits(report, pepper):
    gesture = report.gesture
    places = [pepper.joint_index(j) for j in gesture.joint_names]
    np.testing.assert_allclose(
        report.trajectory(report.key_times).position[:, places], report.commanded, atol=1e-9
    )
    assert report.key_times[0] == 0.0
    assert report.key_times[-1] == report.trajectory.duration
    assert np.all(np.diff(report.key_times) > 0)
    found = report.trajectory.check(pepper, pk.Scene())
    assert found.success, found.report()
    np.testing.assert_allclose(report.measured, report.run.position_at(report.key_times)[:, places])


def test_what_lies_outside_the_limits_is_stated_apart(report):
    outside = np.argwhere(report.limit_violation > 1e-9)
    expected = [] if report.gesture.name == "head" else [[0, 1], [0, 3]]
    assert outside.tolist() == expected
    np.testing.assert_allclose(report.limit_violation[tuple(outside.T)], 0.00872665, atol=1e-8)
    text = report.report()
    for _, joint in outside:
        name = report.gesture.joint_names[joint]
        assert f"T0 of {name}: the plan says 0.0000 rad, 0.0087 outside the joint's limits" in text
        assert report.plan_error[joint] == pytest.approx(0.00872665 / 5, abs=0.002)
    assert "paper: Gazebo" in text
    assert "paper: Reality" in text
    assert "60 of 60" in text


def test_dictionary_is_json(report):
    data = json.loads(json.dumps(report.as_dict()))
    assert data["gesture"] == report.gesture.name
    joint = data["joints"][report.gesture.joint_names[0]]
    errors = np.abs(np.array(joint["measured"]) - joint["commanded"])
    assert joint["mean_absolute_error"] == pytest.approx(errors.mean())


def test_a_twin_can_be_given(pepper):
    exact = replay(pepper, "head", twin=Twin(pepper, feedforward="inverse_dynamics"))
    assert exact.rms_tracking_error.max() < 1e-4


def test_unknown_gesture(pepper):
    with pytest.raises(
        UnknownNameError, match="unknown gesture 'wave'; available: left-arm, right-arm, head"
    ):
        replay(pepper, "wave")


def test_passing_times_of_a_path_that_comes_back(pepper):
    q = pepper.posture("Stand")
    out = q - 0.4 * (np.arange(15) == 5)
    other = out - 0.3 * (np.arange(15) == 10)
    points = np.array([q, out, other, out, q])
    trajectory = pk.retime(pepper, points)
    times = passing_times(trajectory, points)
    assert np.all(np.diff(times) > 0)
    assert times[-1] == trajectory.duration
    np.testing.assert_allclose(trajectory(times).position, points, atol=1e-9)
