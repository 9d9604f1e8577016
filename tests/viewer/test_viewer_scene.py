"""All kinds of scene objects are drawn, and what hangs on the robot moves with it."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import UnknownNameError
from pepper_kin.model.shapes import Box, Cylinder, Sphere
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.drawing import _Y_TO_Z, PLATE, draw_commands
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
    """Return the geometry that is drawn, its vertices and faces, and its pose."""
    set_object, set_transform = draw_commands([Drawable("it", None, geometry, np.eye(4), (1, 1, 1, 1))])
    (solid,) = set_object["object"]["geometries"]
    data = solid.get("data")
    vertices = data and np.frombuffer(data["attributes"]["position"]["array"].data, "<f4").reshape(-1, 3)
    faces = data and np.frombuffer(data["index"]["array"].data, "<u4").reshape(-1, 3)
    return solid, vertices, faces, np.reshape(set_transform["matrix"], (4, 4)).T


def test_each_kind_becomes_a_solid_of_its_extent():
    objects = scene().objects
    plate, _, _, pose = drawn(pk.collision.HalfSpace(0.3))
    assert [plate[name] for name in ("width", "height", "depth")] == list(PLATE)
    assert pose[2, 3] + PLATE[2] / 2 == pytest.approx(0.3)
    _, stone, _, _ = drawn(objects["stone"].geometry)
    np.testing.assert_allclose(np.ptp(stone, axis=0), 0.2, atol=1e-6)
    _, dust, _, _ = drawn(objects["dust"].geometry)
    assert len(dust) == 600
    np.testing.assert_allclose(
        dust.reshape(100, 6, 3).mean(axis=1), objects["dust"].geometry.points, atol=1e-6
    )
    assert len(drawn(objects["nothing"].geometry)[2]) == 1


@pytest.mark.parametrize("opacity", [1.0, 0.4])
@pytest.mark.parametrize("kind", ["box", "ball", "cylinder", "triangles"])
def test_commands_are_those_of_meshcat_itself(kind, opacity):
    from meshcat import commands, geometry
    from meshcat.path import Path

    sheet = scene().objects["sheet"].geometry
    shape, theirs = {
        "box": (Box((0.1, 0.2, 0.3)), geometry.Box([0.1, 0.2, 0.3])),
        "ball": (Sphere(0.2), geometry.Sphere(0.2)),
        "cylinder": (Cylinder(0.1, 0.4), geometry.Cylinder(0.4, 0.1)),
        "triangles": (sheet, geometry.TriangularMeshGeometry(sheet.vertices, sheet.faces)),
    }[kind]
    pose = np.eye(4)
    pose[:3, 3] = 1.0, 2.0, 3.0
    ours = list(draw_commands([Drawable("a/b", "Head", shape, pose, (1.0, 0.5, 0.0, opacity))], ("top",)))
    material = geometry.MeshPhongMaterial(
        color=0xFF8000, opacity=opacity, specular=0x2A2A2A, shininess=45, reflectivity=0.2
    )
    body = geometry.Mesh(theirs, material)
    theirs.uuid, material.uuid, body.uuid = "geometry-0", "material-0", "object-0"
    path = Path(("top", "links", "Head", "0 a_b"))
    turned = pose if kind != "cylinder" else pose @ _Y_TO_Z
    assert ours == [
        commands.SetObject(body, path=path).lower(),
        commands.SetTransform(turned, path).lower(),
    ]


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
