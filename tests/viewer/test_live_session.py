"""The state behind the pages, without a browser: what moves what, and what is refused."""

import struct

import numpy as np
import pytest
import umsgpack
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError, LimitError, UnknownNameError
from pepper_kin.trajectory.balance import support_polygon
from pepper_kin.viewer import JointMotion
from pepper_kin.viewer.server.document import Document
from pepper_kin.viewer.server.layers import INERTIA, VISUAL, layers_of
from pepper_kin.viewer.server.planning import show_motion
from pepper_kin.viewer.server.playback import Playback
from pepper_kin.viewer.server.session import LiveSession
from pepper_kin.viewer.server.targets import GAZE_DISTANCE, SharedTargets
from pepper_kin.viewer.target_listener import TargetListener


class Tasks:
    """Remembers what it is asked to do."""

    def __init__(self):
        self.asked = []

    def warm_up(self, session):
        self.asked.append("warm up")

    def plan(self, session, tasks):
        self.asked.append([task.label for task in tasks])


@pytest.fixture
def session(pepper):
    sent = []
    session = LiveSession(pepper, sent.append, Tasks())
    session.sent = sent
    return session


def commands(session):
    return [umsgpack.unpackb(command) for command in session.sent]


def poses(session):
    packed = session.poses()
    values = np.frombuffer(packed, dtype="<f4", offset=8).reshape(-1, 7)
    return struct.unpack("<II", packed[:8]), dict(zip(session.document["bodies"], values, strict=True))


def test_poses_are_those_of_kinematics(session, pepper):
    session.set_joint("LShoulderPitch", -0.4)
    (kind, stamp), bodies = poses(session)
    assert (kind, stamp) == (1, 0)
    for name in ("l_wrist", "Head", "torso", "base_footprint"):
        pose = pk.kinematics.frame_pose(pepper, session.q, name)
        np.testing.assert_allclose(bodies[name][:3], pose[:3, 3], atol=1e-6)
        turn = Rotation.from_quat(bodies[name][3:]).inv() * Rotation.from_matrix(pose[:3, :3])
        assert turn.magnitude() < 1e-6


def test_targets_stay_with_hands_and_gaze_until_somebody_sets_them(session, pepper):
    session.set_joint("HeadYaw", 0.5)
    camera = pk.kinematics.frame_pose(pepper, session.q, "CameraTop_frame")
    gaze = camera[:3, 3] + GAZE_DISTANCE * camera[:3, 0]
    np.testing.assert_allclose(session.targets["gaze"].position, gaze, atol=1e-12)
    session.move_target("gaze", np.array([1.0, 0.2, 1.1]), stamp=5)
    session.refresh()
    assert session.document["targets"]["gaze"] == {"position": [1.0, 0.2, 1.1], "on": True}
    assert poses(session)[0][1] == 5
    assert session._tasks.asked == ["warm up"]
    session.release("gaze")
    np.testing.assert_allclose(session.targets["gaze"].position, gaze, atol=1e-12)


def test_what_is_wrong_is_refused_and_changes_nothing(session, pepper):
    before = session.q.copy()
    with pytest.raises(LimitError, match="joint position: HeadYaw = 9"):
        session.set_joint("HeadYaw", 9.0)
    with pytest.raises(UnknownNameError, match="unknown joint 'Tail'"):
        session.set_joint("Tail", 0.0)
    with pytest.raises(UnknownNameError, match="unknown layer 'soul'; available: visual, capsules"):
        session.show("soul", True)
    with pytest.raises(
        UnknownNameError, match="unknown target 'foot'; available: left hand, right hand, gaze"
    ):
        session.move_target("foot", np.zeros(3))
    with pytest.raises(UnknownNameError, match="unknown kind of obstacle 'cone'; available: box, ball, cyl"):
        session.add_obstacle("cone")
    with pytest.raises(UnknownNameError, match="unknown obstacle 'box 9'"):
        session.change_obstacle("box 9", position=np.zeros(3))
    with pytest.raises(InvalidValueError, match="motion: got none, expected a planned or loaded motion"):
        session.play()
    np.testing.assert_array_equal(session.q, before)


def test_obstacles_keep_name_turn_and_color_when_moved_and_sized(session):
    scene = pk.Scene().add_box("shelf", (0.2, 0.3, 0.4), (1, 0, 1), rpy=(0, 0, 0.5))
    session.set_scene(scene)
    session.change_obstacle("shelf", position=np.array([0.9, 0.1, 1.0]), size=np.array([0.1, 0.2, 0.3]))
    thing = session.scene.objects["shelf"]
    np.testing.assert_allclose(
        thing.transform_object_to_world[:3, :3], scene.objects["shelf"].transform_object_to_world[:3, :3]
    )
    np.testing.assert_allclose(thing.transform_object_to_world[:3, 3], [0.9, 0.1, 1.0])
    assert thing.geometry.size == (0.1, 0.2, 0.3)
    assert thing.color == scene.objects["shelf"].color
    with pytest.raises(
        InvalidValueError, match=r"size of 'shelf': got \[0.1\], expected x and y and z, each in"
    ):
        session.change_obstacle("shelf", size=np.array([0.1]))
    with pytest.raises(
        InvalidValueError, match=r"color of 'shelf': got \[2.0, 0.0, 0.0\], expected red, green, blue"
    ):
        session.change_obstacle("shelf", color=np.array([2.0, 0.0, 0.0]))
    assert [session.add_obstacle("ball") for _ in range(2)] == ["ball 1", "ball 2"]
    session.remove_obstacle("ball 1")
    assert session.add_obstacle("ball") == "ball 1"


def test_only_what_changed_is_drawn_anew(session):
    session.set_scene(pk.Scene().add_sphere("a", 0.1, (1, 0, 1)).add_sphere("b", 0.1, (1, 1, 1)))
    session.sent.clear()
    session.change_obstacle("a", position=np.array([1.0, 0.0, 1.2]))
    assert {command["path"].split("/")[2] for command in commands(session)} == {"a"}
    session.sent.clear()
    session.remove_obstacle("b")
    assert commands(session) == [{"type": "delete", "path": "/obstacles/b"}]


def test_a_page_that_comes_later_is_drawn_what_is_there(session):
    session.show("spheres", True)
    session.add_obstacle("box")
    session.add_obstacle("ball")
    session.remove_obstacle("box 1")
    snapshot = [umsgpack.unpackb(command) for command in session.board.snapshot()]
    paths = [command["path"] for command in snapshot if command["type"] == "set_object"]
    assert any(path.startswith("/obstacles/ball 1/") for path in paths)
    assert not any("box 1" in path for path in paths)
    visible = {c["path"]: c["value"] for c in snapshot if c["type"] == "set_property"}
    assert visible["/robot/spheres"] is True
    assert visible["/robot/capsules"] is False


def test_what_the_robot_holds_moves_with_its_frame(session, pepper):
    scene = pk.Scene().add_cylinder("cup", 0.03, 0.1, (0, 0, 0)).attach("cup", "LFinger11_link", np.eye(4))
    session.set_scene(scene)
    pose = pk.kinematics.frame_pose(pepper, session.q, "LFinger11_link")
    np.testing.assert_allclose(poses(session)[1]["LFinger11_link"][:3], pose[:3, 3], atol=1e-6)
    with pytest.raises(UnknownNameError, match="unknown frame 'tail'"):
        session.set_scene(pk.Scene().add_sphere("x", 0.1, (0, 0, 0)).attach("x", "tail", np.eye(4)))


def test_inertia_ellipsoids_have_the_mass_distribution_of_their_links(pepper):
    """Of a solid ellipsoid with semi-axes a: I_x = m (a_y^2 + a_z^2) / 5."""
    drawn = {d.name: d for d in layers_of(pepper, SharedTargets(pepper))[INERTIA]}
    model = pepper.pinocchio_model
    for name in ("LElbowRoll", "HipRoll", "HeadPitch"):
        drawable = drawn[f"ellipsoid {name}"]
        semi = np.abs(drawable.geometry.vertices).max(axis=0)
        inertia = model.inertias[model.getJointId(name)]
        own = (
            inertia.mass
            / 5
            * np.array(
                [semi[1] ** 2 + semi[2] ** 2, semi[0] ** 2 + semi[2] ** 2, semi[0] ** 2 + semi[1] ** 2]
            )
        )
        turn = drawable.transform_shape_to_link[:3, :3]
        np.testing.assert_allclose(turn @ np.diag(own) @ turn.T, inertia.inertia, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(drawable.transform_shape_to_link[:3, 3], inertia.lever, atol=1e-9)


def test_merged_visuals_fill_the_bounds_of_their_parts(pepper):
    from pepper_kin.viewer.surface import read_surface

    drawn = layers_of(pepper, SharedTargets(pepper))[VISUAL]
    q = pepper.posture("Stand")

    def corners(link, vertices, pose):
        placed = pk.kinematics.frame_pose(pepper, q, link) @ pose
        return vertices @ placed[:3, :3].T + placed[:3, 3]

    parts = [
        corners(s.link, read_surface(s.geometry.path).vertices * s.geometry.scale, s.transform_shape_to_link)
        for s in pepper.visual_shapes
    ]
    whole = [corners(d.link, d.geometry.vertices, d.transform_shape_to_link) for d in drawn]
    np.testing.assert_allclose(np.concatenate(whole).min(0), np.concatenate(parts).min(0), atol=1e-5)
    np.testing.assert_allclose(np.concatenate(whole).max(0), np.concatenate(parts).max(0), atol=1e-5)
    assert len(drawn) < len(pepper.visual_shapes) / 2


def test_playback_keeps_time_and_stops_or_starts_again(pepper):
    q = pepper.posture("Stand")
    motion = JointMotion(np.array([0.0, 1.0, 2.0]), np.stack([q, q + 0.1, q]))
    playback = Playback(motion)
    playback.play()
    playback.set_speed(0.5)
    playback.advance(1.0)
    np.testing.assert_allclose(playback.state()[0], q + 0.05, atol=1e-12)
    playback.advance(10.0)
    assert (playback.time, playback.playing) == (2.0, False)
    playback.loop = True
    playback.play()
    assert playback.time == 0.0
    playback.advance(5.0)
    assert (playback.time, playback.playing) == (0.5, True)
    with pytest.raises(InvalidValueError, match=r"speed: got 100, expected a factor in 0\.05"):
        playback.set_speed(100)


def test_a_motions_curves_are_those_of_dynamics_and_distance(pepper):
    q = pepper.posture("Stand")
    goal = pepper.joint_vector({"LShoulderPitch": 0.2, "HipPitch": -0.3})
    trajectory = pk.retime(pepper, np.stack([q, (q + goal) / 2, goal]), solver="toppra")
    curves = show_motion(pepper, trajectory, pk.Scene(), "x").curves
    k = len(curves.times) // 3
    position, velocity, acceleration = trajectory(curves.times[k])
    torque = pk.dynamics.newton_euler(pepper, position, velocity, acceleration)
    np.testing.assert_allclose(curves.torque[k], np.abs(torque) / pepper.effort_limits, atol=1e-6)
    np.testing.assert_allclose(curves.speed[k], np.abs(velocity) / pepper.velocity_limits, atol=1e-9)
    point = pk.dynamics.zero_moment_point(pepper, position, velocity, acceleration)
    corners = support_polygon(pepper)
    sides = np.roll(corners, -1, axis=0) - corners
    inside = (sides[:, 0] * (point - corners)[:, 1] - sides[:, 1] * (point - corners)[:, 0]) / np.hypot(
        *sides.T
    )
    assert curves.balance[k] == pytest.approx(inside.min(), abs=1e-6)
    assert curves.clearance["itself"][k] == pytest.approx(float(pk.collision.clearance(pepper, position)))


def test_time_passes_only_while_something_moves(session, pepper):
    session.tick(0.1)
    session.tick(0.1)
    assert session.resting
    q = pepper.posture("Stand")
    motion = JointMotion(np.array([0.0, 1.0]), np.stack([q, pepper.posture("Crouch")]))
    session.load(show_motion(pepper, motion, pk.Scene(), "x"), play=True)
    assert not session.resting
    for _ in range(3):
        session.tick(0.5)
    session.tick(0.1)
    np.testing.assert_allclose(session.q, pepper.posture("Crouch"), atol=1e-12)
    assert session.resting
    session.set_joint("HeadYaw", 0.1)
    assert session.mode == "free"
    session.seek(0.0)
    session.tick(0.1)
    np.testing.assert_allclose(session.q, q, atol=1e-12)


def test_a_document_tells_what_changed_since():
    document = Document()
    document.set("a", 1)
    revision = document.count
    document.set("b", [2])
    document.set("a", 1)
    assert document.changes_since(revision) == {"b": [2]}
    assert document.changes_since(-1) == {"a": 1, "b": [2]}
    assert document.changes_since(document.count) == {}


def test_a_slow_listener_hears_the_last_and_survives_its_errors(capsys):
    import threading

    gate, heard, done = threading.Event(), [], threading.Event()

    def callback(name, position):
        gate.wait(60)
        heard.append(position[0])
        if position[0] == 9.0:
            done.set()
        raise RuntimeError("mine")

    listener = TargetListener(callback)
    for x in range(10):
        listener.hear("gaze", np.array([x, 0.0, 0.0]))
    gate.set()
    assert done.wait(60)
    listener.stop()
    assert len(heard) <= 3
    assert heard[-1] == 9.0
