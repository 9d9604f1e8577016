"""The viewer on Pepper: what it draws is where kinematics says it is."""

import threading
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, UnknownNameError
from pepper_kin.viewer import JointMotion, Viewer, save_reach_html


@dataclass(frozen=True)
class Record:
    """Times, positions and torques, as a run has them."""

    time: np.ndarray
    position: np.ndarray
    torque: np.ndarray


@pytest.fixture(scope="module")
def waving(pepper):
    """Two seconds at 200 Hz: the left arm goes up, the head turns."""
    start = pepper.posture("Stand")
    goal = pepper.joint_vector({"LShoulderPitch": -1.2, "LElbowRoll": -1.0, "HeadYaw": 0.8})
    times = np.linspace(0.0, 2.0, 401)
    share = (0.5 - 0.5 * np.cos(np.pi * times / 2.0))[:, None]
    return JointMotion(times, start + share * (goal - start), {"effort [N m]": np.sin(times)})


def test_a_recording_has_every_link_where_kinematics_puts_it(pepper, waving, tmp_path, content_of):
    path = Viewer(pepper).save_html(tmp_path / "motion.html", waving, fps=20.0)
    motion = content_of(path)["motion"]
    assert motion["times"].size == 41
    names = [link["name"] for link in motion["links"]]
    assert set(names) == {shape.link for shape in pepper.visual_shapes}
    positions = motion["positions"].reshape(41, -1, 3)
    quaternions = motion["quaternions"].reshape(41, -1, 4)
    for frame in (0, 13, 40):
        q = waving.positions[np.argmin(np.abs(waving.times - motion["times"][frame]))]
        for index, name in enumerate(names):
            pose = pk.kinematics.frame_pose(pepper, q, name)
            np.testing.assert_allclose(positions[frame, index], pose[:3, 3], atol=1e-6)
            turn = Rotation.from_quat(quaternions[frame, index]).inv() * Rotation.from_matrix(pose[:3, :3])
            assert turn.magnitude() < 1e-6


def test_a_recording_shows_visuals_scene_targets_and_curves(pepper, waving, tmp_path, content_of):
    scene = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))
    viewer = Viewer(pepper).add_scene(scene).add_target("left hand", (0.4, 0.2, 0.9))
    path = viewer.save_html(tmp_path / "motion.html", waving, title="Over the table")
    content = content_of(path)
    paths = [command["path"] for command in content["commands"] if command["type"] == "set_object"]
    assert len(paths) == len(pepper.visual_shapes) + 3
    names = [p.split(" ", 1)[1] for p in paths if p.startswith("/world/")]
    assert names == ["table", "left hand", "left hand behind"]
    assert [entry["name"] for entry in content["markers"]] == ["left hand"]
    assert [curve["name"] for curve in content["motion"]["series"]] == ["effort [N m]"]
    assert content["title"] == "Over the table"
    table = next(c for c in content["commands"] if c["type"] == "set_transform" and "/world/" in c["path"])
    assert table["matrix"][12:15] == [0.55, 0.0, 0.70]


def test_collision_shapes_can_be_shown_instead(pepper, tmp_path, content_of):
    viewer = Viewer(pepper, geometry_type="collision")
    content = content_of(viewer.save_html(tmp_path / "shapes.html", pepper.posture("Stand")))
    assert len(content["commands"]) == 2 * len(pepper.collision_shapes)
    assert content["motion"]["times"].size == 1


def test_without_a_motion_pepper_stands(pepper, tmp_path, content_of):
    motion = content_of(Viewer(pepper).save_html(tmp_path / "stand.html"))["motion"]
    names = [link["name"] for link in motion["links"]]
    hand = motion["positions"].reshape(-1, 3)[names.index("l_wrist")]
    pose = pk.kinematics.frame_pose(pepper, pepper.posture("Ready"), "l_wrist")
    np.testing.assert_allclose(hand, pose[:3, 3], atol=1e-6)


def test_a_trajectory_plays_with_its_velocities(pepper, tmp_path, content_of):
    start, goal = pepper.posture("Stand"), pepper.joint_vector({"LShoulderPitch": 0.2, "HeadYaw": 0.5})
    cubic = np.stack([start, 0 * start, 3 * (goal - start), -2 * (goal - start)])
    trajectory = pk.Trajectory(pepper.joint_names, [0.0, 1.0], cubic[None])
    motion = content_of(Viewer(pepper).save_html(tmp_path / "a.html", trajectory))["motion"]
    assert (motion["times"][0], motion["times"][-1]) == (0.0, 1.0)
    curves = {curve["name"]: curve["value"] for curve in motion["series"]}
    assert len(curves) == pepper.n
    times = motion["times"]
    expected = (6 * times - 6 * times**2) * (0.5 - start[pepper.joint_index("HeadYaw")])
    np.testing.assert_allclose(curves["HeadYaw velocity [rad/s]"], expected, atol=1e-6)
    names = [link["name"] for link in motion["links"]]
    hand = motion["positions"].reshape(times.size, -1, 3)[-1, names.index("l_wrist")]
    np.testing.assert_allclose(hand, pk.kinematics.frame_pose(pepper, goal, "l_wrist")[:3, 3], atol=1e-6)


def test_a_run_plays_with_its_torques(pepper, waving, tmp_path, content_of):
    torque = np.outer(np.sin(waving.times), np.arange(1.0, pepper.n + 1))
    path = Viewer(pepper).save_html(tmp_path / "a.html", Record(waving.times, waving.positions, torque))
    motion = content_of(path)["motion"]
    curves = {curve["name"]: curve for curve in motion["series"]}
    assert list(curves) == [f"{joint} torque [N m]" for joint in pepper.joint_names]
    np.testing.assert_allclose(curves["HeadYaw torque [N m]"]["high"].max(), 4.0, atol=1e-3)
    limits = [curve["limit"] for curve in motion["series"]]
    np.testing.assert_allclose(limits, pepper.effort_limits, rtol=1e-12)


def test_a_reach_shows_its_targets_and_its_world(pepper, waving, tmp_path, content_of):
    scene = pk.Scene().add_box("table", size=(0.6, 1.0, 0.04), position=(0.55, 0.0, 0.70))
    run = Record(waving.times, waving.positions, np.zeros_like(waving.positions))
    outcome = SimpleNamespace(
        hand="left", target=np.array([0.4, 0.2, 0.9]), gaze=np.array([1.0, 0, 1]), scene=scene, run=run
    )
    content = content_of(save_reach_html(pepper, outcome, tmp_path / "a.html"))
    assert content["title"] == "Pepper reaches with the left hand"
    assert [entry["name"] for entry in content["markers"]] == ["left hand", "gaze"]
    over = [
        command["path"]
        for command in content["commands"]
        if command["type"] == "set_object" and not command["object"]["materials"][0].get("depthTest", True)
    ]
    assert [path.split(" ", 1)[1] for path in over] == ["left hand behind", "gaze behind"]  # in a cup, too
    assert "table" in " ".join(command["path"] for command in content["commands"])
    with pytest.raises(InvalidValueError, match="outcome: got a reach without a run"):
        save_reach_html(pepper, SimpleNamespace(run=None), tmp_path / "b.html")


def test_a_trajectory_of_another_robot_is_refused(pepper, tmp_path):
    other = pk.Trajectory(("Elbow",), [0.0, 1.0], np.zeros((1, 2, 1)))
    with pytest.raises(InvalidValueError, match="joints of the trajectory: got Elbow, expected KneePitch"):
        Viewer(pepper).save_html(tmp_path / "a.html", other)


def test_a_motion_is_copied_and_read_only(pepper):
    positions = np.zeros((2, pepper.n))
    motion = JointMotion(np.array([0.0, 1.0]), positions)
    positions[:] = 9.0
    assert (motion.positions == 0.0).all()
    with pytest.raises(ValueError, match="read-only"):
        motion.positions[0, 0] = 1.0


@pytest.mark.parametrize(
    ("motion", "message"),
    [
        (object(), "motion: got object, expected a run, a trajectory, a JointMotion or joint positions"),
        (
            Record(np.zeros(1), np.zeros((1, 3)), np.zeros((1, 3))),
            r"positions of the run: got shape \(1, 3\)",
        ),
        (np.zeros(3), r"q: got shape \(3,\), expected shape \(\.\.\., 15\)"),
        (np.full(15, np.nan), "q: got nan at joint"),
        (np.zeros((2, 15)), r"q: got shape \(2, 15\), expected shape \(15,\)"),
        (JointMotion(np.array([0.0, 1.0]), np.zeros((2, 4))), r"positions: got shape \(2, 4\)"),
        (JointMotion(np.array([1.0, 0.0]), np.zeros((2, 15))), "times: got 1 s followed by 0 s"),
    ],
)
def test_motions_that_do_not_fit_are_refused_by_name(pepper, tmp_path, motion, message):
    with pytest.raises(InvalidValueError, match=message):
        Viewer(pepper).save_html(tmp_path / "a.html", motion)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("at_time", [-0.1, 99.0, float("nan")])
def test_pictures_outside_the_motion_are_refused(pepper, waving, tmp_path, at_time):
    with pytest.raises(InvalidValueError, match=r"at_time: got .*expected a time from 0 to .* s"):
        Viewer(pepper).save_image(tmp_path / "a.png", waving, at_time=at_time)
    assert not any(tmp_path.iterdir())


def test_bad_series_targets_and_geometry_types_are_refused_by_name(pepper, waving, tmp_path):
    with pytest.raises(InvalidValueError, match=r"series 'x': got shape \(2,\), expected shape \(401,\)"):
        Viewer(pepper).save_html(tmp_path / "a.html", waving, series={"x": [1.0, 2.0]})
    with pytest.raises(InvalidValueError, match="position of 'hand': got inf"):
        Viewer(pepper).add_target("hand", (np.inf, 0, 0))
    with pytest.raises(UnknownNameError, match="unknown geometry_type 'shiny'; available: visual, collision"):
        Viewer(pepper, geometry_type="shiny")


@pytest.mark.thorough
@pytest.mark.browser
def test_a_picture_shows_a_white_robot_in_the_middle(chromium_path, pepper, tmp_path):
    path = Viewer(pepper).save_image(tmp_path / "pepper.png", size=(240, 300), view="front")
    pixels = np.asarray(Image.open(path).convert("RGB")).astype(int)
    assert pixels.shape == (300, 240, 3)
    middle, edge = pixels[60:250, 100:140], pixels[60:250, :15]
    assert np.ptp(middle) > 150  # white shell and dark tablet, neck and waist
    assert np.ptp(edge) < 120  # floor and sky alone
    columns = np.nonzero((pixels.max(axis=2) < 40).any(axis=0))[0]  # tablet, neck, elbows, waist
    assert abs(columns.min() + columns.max() - 239) < 10  # from the front it is symmetric


def test_a_target_is_moved_from_python_as_by_dragging(pepper):
    moved, called = [], threading.Event()

    def hear(name, position):
        moved.append((name, position))
        called.set()

    with Viewer(pepper, port=0) as viewer:
        viewer.show(pepper.posture("Stand"))
        viewer.on_target(hear).follow(False)
        assert viewer.move_target("left hand", [0.4, 0.2, 0.9]) is viewer
        assert called.wait(60.0)
        name, position = moved[-1]
        assert name == "left hand"
        np.testing.assert_array_equal(position, [0.4, 0.2, 0.9])
        np.testing.assert_array_equal(viewer.q, pepper.posture("Stand"))  # nobody follows
        with pytest.raises(UnknownNameError, match=r"left foot.*left hand, right hand, gaze"):
            viewer.move_target("left foot", [0.4, 0.2, 0.9])
        with pytest.raises(InvalidValueError, match="position of target 'gaze'"):
            viewer.move_target("gaze", [0.4, np.nan, 0.9])


@pytest.mark.thorough
def test_threads_that_show_while_another_closes_go_on(pepper):
    """A call whose turn came after the server's end was answered by nobody, and hung."""
    q = pepper.posture("Stand")
    for _ in range(5):
        viewer, ended = Viewer(pepper, port=0), []
        viewer.show(q)
        server = viewer._server

        def call(server=server, ended=ended):
            try:
                while True:
                    server.call(lambda session: session.q)
            except InfeasibleError as error:
                ended.append(str(error))

        threads = [threading.Thread(target=call, daemon=True) for _ in range(4)]
        for thread in threads:
            thread.start()
        viewer.close()
        for thread in threads:
            thread.join(60.0)
        assert ended == ["no live page: its server has ended; make a new viewer"] * 4


def test_threads_share_one_server_and_any_may_close_it(pepper):
    viewer, urls = Viewer(pepper, port=0), set()
    q = pepper.posture("Stand")
    threads = [threading.Thread(target=lambda: urls.add(viewer.show(q))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert len(urls) == 1
    server = viewer._server
    threads = [threading.Thread(target=server.close) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert not server._thread.is_alive()


def test_what_draws_may_call_the_viewer(pepper):
    """It runs in the server's thread, which would wait for itself."""
    with Viewer(pepper, port=0) as viewer:
        done = threading.Event()

        def draw():
            viewer.draw(lambda board: viewer.show(pepper.posture("Crouch")))
            done.set()

        threading.Thread(target=draw, daemon=True).start()
        assert done.wait(60.0)
        assert viewer.q == pytest.approx(pepper.posture("Crouch"))
