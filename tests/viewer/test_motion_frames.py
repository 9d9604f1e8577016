"""Frames of a motion: which samples are kept, and that nothing of them is lost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.viewer.motion_frames import Curve, kept_samples, limited_series, motion_frames


def poses_about(axis, angles):
    poses = np.tile(np.eye(4), (len(angles), 1, 1, 1))
    poses[:, 0, :3, :3] = Rotation.from_rotvec(np.outer(angles, axis)).as_matrix()
    return poses


@settings(max_examples=60, deadline=None)
@given(
    steps=st.lists(st.floats(1e-4, 0.3), min_size=1, max_size=200),
    fps=st.floats(1.0, 200.0),
    start=st.floats(-5.0, 5.0),
)
def test_kept_samples_are_few_spread_and_hold_both_ends(steps, fps, start):
    times = start + np.cumsum(steps)
    kept = kept_samples(times, fps)
    assert (np.diff(kept) > 0).all()
    assert kept[0] == 0
    assert kept[-1] == times.size - 1
    assert kept.size <= (times[-1] - times[0]) * fps + 2
    gaps = np.diff(times[kept])
    assert gaps.size == 0 or gaps.max() <= 2 / fps + 2 * max(steps) + 1e-9


def test_a_slow_recording_is_kept_whole():
    times = np.array([0.0, 0.5, 0.7, 3.0])
    np.testing.assert_array_equal(kept_samples(times, 40.0), [0, 1, 2, 3])


def test_quaternions_give_the_rotations_back_and_never_jump():
    angles = np.linspace(0.0, 4 * np.pi, 400)
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    poses = poses_about(axis, angles)
    frames = motion_frames(np.linspace(0, 10, 400), poses, 1, {}, 1000.0)
    quaternions = frames.quaternions_xyzw[:, 0]
    np.testing.assert_allclose(Rotation.from_quat(quaternions).as_matrix(), poses[:, 0, :3, :3], atol=1e-12)
    assert (np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]) > 0.9).all()


def test_a_peak_between_two_frames_stays_visible():
    times = np.linspace(0.0, 1.0, 1001)
    torque = np.zeros(1001)
    torque[513], torque[518] = 7.0, -3.0
    frames = motion_frames(times, poses_about([0, 0, 1], times), 1, {"torque": Curve(torque)}, 10.0)
    (curve,) = frames.series
    assert curve.value.size == frames.times.size == 11
    assert (curve.high.max(), curve.low.min()) == (7.0, -3.0)
    assert (curve.low <= curve.value).all()
    assert (curve.value <= curve.high).all()


def test_bad_input_is_refused_by_name():
    for changes, message in [
        ({"times": [0.0, 1.0, 1.0]}, "times: got 1 s followed by 1 s, expected strictly increasing times"),
        ({"times": [0.0, np.nan, 1.0]}, "times: got nan"),
        ({"times": []}, "times: got no sample"),
        ({"times": [0.0, 1.0]}, r"link_poses: got shape \(3, 1, 4, 4\), expected shape \(2, 1, 4, 4\)"),
        ({"link_count": 2}, r"expected shape \(3, 2, 4, 4\)"),
        ({"link_poses": np.full((3, 1, 4, 4), np.inf)}, "link_poses: got inf"),
        (
            {"link_poses": np.zeros((3, 1, 4, 4))},
            r"link_poses: got a matrix that is not rigid at index \(0, 0\)",
        ),
        ({"series": {"torque": Curve([1.0])}}, r"series 'torque': got shape \(1,\), expected shape \(3,\)"),
        ({"series": {"torque": Curve([1.0, np.nan, 0.0])}}, "series 'torque': got nan"),
        ({"fps": 0.0}, "fps: got 0.0, expected a positive number"),
        ({"fps": float("nan")}, "fps: got nan"),
    ]:
        good = {
            "times": [0.0, 0.5, 1.0], "link_poses": poses_about([0, 0, 1], [0, 1, 2]), "link_count": 1,
            "series": {}, "fps": 40.0,
        }  # fmt: skip
        with pytest.raises(InvalidValueError, match=message):
            motion_frames(**(good | changes))


def test_a_limit_belongs_to_a_curve_and_is_above_zero():
    assert limited_series({"a": [0.0], "b": [1.0]}, {"b": 2.0}) == {
        "a": Curve([0.0]),
        "b": Curve([1.0], 2.0),
    }
    with pytest.raises(UnknownNameError, match="unknown curve 'c'; available: a"):
        limited_series({"a": [0.0]}, {"c": 2.0})
    with pytest.raises(InvalidValueError, match="limit of 'a': got 0"):
        limited_series({"a": [0.0]}, {"a": 0.0})
