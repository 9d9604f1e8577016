"""All kinds of scene objects are drawn, and what hangs on the robot moves with it."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.drawing import PLATE, draw_commands
from pepper_kin.viewer.surface import balls_surface


def scene():
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.1
    return (
        pk.Scene()
        .add_half_space("floor", (0, 0, 1), -0.01)
        .add_convex_mesh("stone", corners, (1, 0, 0.1))
        .add_mesh("sheet", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        .add_point_cloud("dust", np.random.default_rng(0).normal(size=(100, 3)), 0.0)
        .add_point_cloud("nothing", [], 0.0)
        .add_cylinder("cup", 0.03, 0.1, (0, 0, 0))
    )


def drawn(geometry):
    set_object, set_transform = draw_commands([Drawable("it", None, geometry, np.eye(4), (1, 1, 1, 1))])
    return set_object.object.geometry, np.array(set_transform.matrix)


def test_each_kind_becomes_a_solid_of_its_extent():
    objects = scene().objects
    plate, pose = drawn(pk.collision.HalfSpace(0.3))
    assert plate.lengths == list(PLATE)
    assert pose[2, 3] + PLATE[2] / 2 == pytest.approx(0.3)
    stone, _ = drawn(objects["stone"].geometry)
    np.testing.assert_allclose(np.ptp(stone.vertices, axis=0), 0.2, atol=1e-6)
    dust, _ = drawn(objects["dust"].geometry)
    assert len(dust.vertices) == 600
    np.testing.assert_allclose(
        dust.vertices.reshape(100, 6, 3).mean(axis=1), objects["dust"].geometry.points, atol=1e-6
    )
    assert len(drawn(objects["nothing"].geometry)[0].faces) == 1


def test_octahedra_face_outward_and_large_clouds_are_thinned():
    surface = balls_surface(np.array([[1.0, 2.0, 3.0]]), 0.5)
    a, b, c = (surface.vertices[surface.faces[:, k]] - [1, 2, 3] for k in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a) > 0).all()
    assert len(balls_surface(np.zeros((100, 3)), 0.1, most=30).faces) == 8 * 25


def test_a_recording_carries_a_held_object_on_its_frame(tmp_path, content_of):
    pepper = pk.load_pepper()
    held = scene().attach("cup", "l_gripper", np.eye(4))
    viewer = pk.Viewer(pepper).add_scene(held)
    content = content_of(viewer.save_html(tmp_path / "scene.html", pepper.posture("StandZero")))
    paths = [command["path"] for command in content["commands"]]
    assert any("l_gripper" in path and "cup" in path for path in paths)
    assert any("world" in path and "floor" in path for path in paths)
    motion = content["motion"]
    index = [link["name"] for link in motion["links"]].index("l_gripper")
    expected = pk.kinematics.frame_pose(pepper, pepper.posture("StandZero"), "l_gripper")[:3, 3]
    np.testing.assert_allclose(motion["positions"].reshape(-1, 3)[index], expected, atol=1e-6)


def test_a_frame_that_the_robot_lacks_is_named():
    with pytest.raises(UnknownNameError, match="unknown frame 'tail'"):
        pk.Viewer(pk.load_pepper()).add_scene(scene().attach("cup", "tail", np.eye(4)))
