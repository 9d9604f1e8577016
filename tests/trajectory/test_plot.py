"""Pictures and the phase plane: what they show is so."""

import sys

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError, InvalidValueError, MissingDependencyError, UnknownNameError
from pepper_kin.trajectory import Samples, Trajectory, phase_plane, plot


def test_limits_on_a_circle_are_closed_forms(pepper):
    """Two joints on a circle of radius R: the one across the way needs sd^2 / R."""
    radius, turn = 0.2, np.linspace(0, np.pi, 400)
    joints = [pepper.joint_index("HeadYaw"), pepper.joint_index("LShoulderPitch")]
    q = np.tile(pepper.posture("Stand"), (turn.size, 1))
    v, a = np.zeros_like(q), np.zeros_like(q)
    speed = 0.5
    q[:, joints] = np.array([0.0, 1.0]) + radius * np.stack([np.cos(turn), np.sin(turn)], 1)
    v[:, joints] = speed * np.stack([-np.sin(turn), np.cos(turn)], 1)
    a[:, joints] = -(speed**2) / radius * np.stack([np.cos(turn), np.sin(turn)], 1)
    motion = Samples(pepper.joint_names, radius * turn / speed, q, v, a).to_trajectory()
    plane = phase_plane(pepper, motion, 401)
    np.testing.assert_allclose(plane.speed, speed, rtol=1e-4)
    assert plane.way[-1] == pytest.approx(np.pi * radius, rel=1e-4)
    angle = plane.way / radius
    limits = pepper.velocity_limits[joints]
    with np.errstate(divide="ignore"):
        wanted = np.min(limits[:, None] / np.abs([np.sin(angle), np.cos(angle)]), axis=0)
    np.testing.assert_allclose(plane.velocity_limit, wanted, rtol=1e-3)
    at_quarter = int(np.argmin(np.abs(angle - np.pi / 2)))  # only the shoulder is across the way there
    for place, joint in ((0, joints[0]), (at_quarter, joints[1])):
        wanted = np.sqrt(pepper.acceleration_limits[joint] * radius)
        assert plane.force_limit[place] == pytest.approx(wanted, rel=2e-2)


def test_a_retimed_trajectory_stays_below_both_curves(pepper, trajectory):
    rng = np.random.default_rng(1)
    middle = 0.5 * (pepper.lower_limits + pepper.upper_limits)
    points = middle + 0.2 * (rng.random((4, pepper.n)) - 0.5) * (pepper.upper_limits - pepper.lower_limits)
    for motion in (trajectory, pk.retime(pepper, points)):
        plane = phase_plane(pepper, motion)
        assert np.all(np.diff(plane.way) >= 0)
        assert np.all(plane.speed <= plane.velocity_limit * (1 + 1e-6))
        assert np.all(plane.speed <= plane.force_limit * (1 + 1e-3))
        assert np.all(plane.force_limit >= 0)
        with pytest.raises(ValueError, match="read-only"):
            plane.way[0] = 1.0


@pytest.mark.thorough
@pytest.mark.parametrize(("suffix", "head"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_pictures_are_written(pepper, trajectory, tmp_path, suffix, head):
    path = tmp_path / f"picture.{suffix}"
    trajectory.plot(pepper, path)
    assert path.read_bytes().startswith(head)
    assert path.stat().st_size > 10_000


def test_what_is_drawn_is_the_trajectory(pepper, trajectory):
    figure = plot(pepper, trajectory, title="reach")
    axes = {a.get_title() or a.get_title(loc="left"): a for a in figure.axes}
    assert {"position", "velocity", "acceleration", "torque", "phase plane"} <= set(axes)
    assert figure.get_suptitle() == "reach"
    j = pepper.joint_index("LShoulderPitch")
    time, share = next(
        line.get_data() for line in axes["velocity"].lines[:4] if np.min(line.get_ydata()) < -0.5
    )
    np.testing.assert_allclose(share, trajectory(time).velocity[:, j] / pepper.velocity_limits[j], atol=1e-12)
    legend = next(a.get_legend() for a in figure.axes if not a.axison)
    words = [text.get_text() for text in legend.get_texts()]
    moving = {"HipPitch", "HeadYaw", "LShoulderPitch", "LElbowYaw"}
    assert {word.split(":")[0] for word in words} >= moving
    assert any("of -7.34;" in word for word in words)


def test_a_violation_is_inside_the_picture(pepper, trajectory):
    fast = Trajectory(
        trajectory.joint_names,
        trajectory.breaks / 3,
        trajectory.coefficients * 3.0 ** np.arange(trajectory.coefficients.shape[1])[:, None],
    )
    figure = plot(pepper, fast)
    velocity = next(a for a in figure.axes if a.get_title() == "velocity")
    most = max(np.abs(line.get_ydata()).max() for line in velocity.lines)
    assert most > 1.5
    assert velocity.get_ylim()[1] > most


def test_joints_may_be_chosen(pepper, trajectory):
    figure = plot(pepper, trajectory, joints=["HeadYaw"])
    assert figure.get_suptitle().startswith("1 joints in")
    assert plot(pepper, trajectory, joints=["HeadYaw", "left_arm"]).get_suptitle().startswith("6 joints in")
    with pytest.raises(UnknownNameError, match="unknown joint or group 'Tail'"):
        plot(pepper, trajectory, joints=["Tail"])
    with pytest.raises(InvalidValueError, match="joints: got"):
        plot(pepper, trajectory, joints=[])


def test_wrong_requests(pepper, trajectory, tmp_path):
    with pytest.raises(UnknownNameError, match=r"unknown suffix '.gif'; available: .png, .pdf, .svg"):
        trajectory.plot(pepper, tmp_path / "a.gif")
    with pytest.raises(FileFormatError, match="cannot be written"):
        trajectory.plot(pepper, tmp_path / "no" / "a.png")
    with pytest.raises(InvalidValueError, match="joints of the trajectory"):
        plot(pepper, Trajectory(("A",), [0, 1], [[[0.0], [1.0]]]))
    with pytest.raises(InvalidValueError, match="trajectory: got one that does not move"):
        plot(pepper, Trajectory(pepper.joint_names, [0, 1], [[pepper.posture("Stand")]]))
    for points in (1, 2.5, True):
        with pytest.raises(InvalidValueError, match="points: got"):
            phase_plane(pepper, trajectory, points)


def test_without_matplotlib_it_says_how_to_install_it(pepper, trajectory, monkeypatch):
    for name in ("matplotlib", "matplotlib.figure", "matplotlib.backends.backend_agg"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingDependencyError, match=r"pip install \"pepper_kin\[plot\]\""):
        plot(pepper, trajectory)
