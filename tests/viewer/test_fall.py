"""A fall in a page: the robot out of the level, with its tilt as a curve."""

from __future__ import annotations

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.twin.base import BalanceMonitor, simulate_tipping
from pepper_kin.viewer import JointMotion, Viewer


@pytest.fixture(scope="module")
def fall(pepper):
    """A robot that was pushed over its front wheels while an arm moves."""
    time = np.linspace(0.0, 2.0, 201)
    q = np.tile(pepper.posture("Stand"), (201, 1))
    v, a = np.zeros_like(q), np.zeros_like(q)
    q[:, pepper.joint_index("LShoulderPitch")] -= 0.2 * time
    v[:, pepper.joint_index("LShoulderPitch")] = -0.2
    monitor = BalanceMonitor(pepper)
    return simulate_tipping(monitor, monitor.assess(time, q, v, a), q, start=(0, 0.0, 1.5))


def test_the_page_has_the_robot_as_it_falls(pepper, fall, tmp_path, content_of):
    scene = pk.Scene().add_box("wall", (0.1, 4, 2), (0.9, 0, 1))
    content = content_of(Viewer(pepper).add_scene(scene).save_html(tmp_path / "fall.html", fall))
    motion = content["motion"]
    names = [link["name"] for link in motion["links"]]
    frames = motion["times"].size
    places = motion["positions"].reshape(frames, len(names), 3)
    at = np.array([int(np.argmin(abs(fall.time - time))) for time in motion["times"]])
    head = names.index("Head")
    level = pk.kinematics.frame_pose(pepper, fall.position[at], "Head")
    expected = np.einsum("tij,tj->ti", fall.tilt[at], level[:, :, 3])[:, :3]
    np.testing.assert_allclose(places[:, head], expected, atol=1e-6)
    assert places[-1, head, 2] < 0.7 < level[-1, 2, 3]  # the head has come down from 1.1 m
    (curve,) = motion["series"]
    assert curve["name"] == "tilt [rad]"
    np.testing.assert_allclose(curve["value"], fall.angle[at], atol=1e-6)
    assert [note["text"] for note in content["notes"]] == [fall.message]
    assert content["touches"] == []


def test_a_live_page_refuses_what_it_cannot_show(pepper, fall):
    with pytest.raises(InvalidValueError, match="save_html shows a fall"):
        Viewer(pepper).play(fall)


def test_tilts_are_rigid_and_one_for_each_time(pepper):
    q = np.tile(pepper.posture("Stand"), (2, 1))
    for tilts in (np.eye(4)[None], 2 * np.tile(np.eye(4), (2, 1, 1))):
        with pytest.raises(InvalidValueError, match="tilts"):
            JointMotion([0.0, 1.0], q, tilts=tilts)
