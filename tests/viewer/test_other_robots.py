"""Robots that are not Pepper in the live page, with meshes of other formats."""

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.mesh_file import read_mesh
from pepper_kin.model import Mesh
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.server import ViewerServer
from pepper_kin.viewer.server.layers import VISUAL, layers_of
from pepper_kin.viewer.server.merging import merged
from pepper_kin.viewer.server.sketches import TRIANGLES, sketches_of
from pepper_kin.viewer.server.targets import SharedTargets

SHARE = Path(importlib.metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share"))
ROBOTS = SHARE / "example-robot-data" / "robots"


@pytest.fixture(scope="module")
def panda():
    """An arm whose visual meshes are COLLADA files."""
    urdf = ROBOTS / "panda_description" / "urdf" / "panda.urdf"
    return pk.load_robot(urdf, package_dirs=[SHARE, ROBOTS])


@pytest.mark.thorough
def test_visuals_of_collada_files_hold_the_collision_shapes(panda):
    """The maker's hulls for collisions are drawn around the same bodies: both fill the same room."""
    layers = layers_of(panda, SharedTargets(panda))
    visuals, sketch = layers[VISUAL], sketches_of(panda, layers)[VISUAL]
    hulls: dict[str, list] = {}
    for shape in panda.collision_shapes:
        if not isinstance(shape.geometry, Mesh):
            continue
        pose = shape.transform_shape_to_link
        vertices, _ = read_mesh(shape.geometry.path, shape.geometry.scale)
        hulls.setdefault(shape.link, []).append(vertices @ pose[:3, :3].T + pose[:3, 3])
    for link in ("panda_link0", "panda_link3", "panda_link5"):
        boxes = []
        for drawables in (visuals, sketch):
            points = [
                d.geometry.vertices @ d.transform_shape_to_link[:3, :3].T + d.transform_shape_to_link[:3, 3]
                for d in drawables
                if d.link == link
            ]
            boxes.append(np.stack([np.concatenate(points).min(0), np.concatenate(points).max(0)]))
        hull = np.stack([np.concatenate(hulls[link]).min(0), np.concatenate(hulls[link]).max(0)])
        np.testing.assert_allclose(boxes[0], hull, atol=0.02)
        np.testing.assert_allclose(boxes[1], boxes[0], atol=0.01)
    assert sum(len(d.geometry.faces) for d in sketch) <= 1.1 * TRIANGLES


@pytest.mark.thorough
@pytest.mark.browser
def test_another_robot_is_shown_and_moved(open_live, until, panda):
    server = ViewerServer(panda, port=0)
    try:
        page = open_live(server.url)
        until(page, "pepperKin.quality.settled && !pepperKin.viewer.needs_render")
        pose = pk.kinematics.frame_pose(panda, panda.neutral(), "panda_link5")
        np.testing.assert_allclose(
            page.evaluate("pepperKin.parts.scene.place('panda_link5')"), pose[:3, 3], atol=1e-5
        )
        q = panda.neutral()
        q[1] += 0.5

        server.call(lambda session: session.set_joints(q))
        pose = pk.kinematics.frame_pose(panda, q, "panda_link5")
        until(page, f"Math.abs(pepperKin.parts.scene.place('panda_link5')[0] - {pose[0, 3]}) < 1e-5")
    finally:
        server.close()


def test_a_mesh_file_is_drawn_in_its_colors(tmp_path):
    """Where the description names no color; one that it names counts for the whole mesh, as in RViz."""
    half = (
        "<triangles count='1' material='{0}'><input semantic='VERTEX' source='#v' offset='0'/>"
        "<p>{1}</p></triangles>"
    )
    paint = (
        "<effect id='e{0}'><profile_COMMON><technique sid='c'><lambert><diffuse><color>{1}</color></diffuse>"
        "</lambert></technique></profile_COMMON></effect>"
    )
    material = "<material id='m{0}'><instance_effect url='#e{0}'/></material>"
    bound = "<instance_material symbol='{0}' target='#m{0}'/>"
    (tmp_path / "two.dae").write_text(
        "<COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' version='1.4.1'><asset/>"
        f"<library_effects>{paint.format('a', '1 0 0 1')}{paint.format('b', '0 0 1 1')}</library_effects>"
        f"<library_materials>{material.format('a')}{material.format('b')}</library_materials>"
        "<library_geometries><geometry id='g'><mesh><source id='p'><float_array id='pa' count='12'>"
        "0 0 0 1 0 0 0 1 0 0 0 1</float_array><technique_common><accessor source='#pa' count='4' stride='3'>"
        "<param name='X' type='float'/><param name='Y' type='float'/><param name='Z' type='float'/>"
        "</accessor></technique_common></source>"
        "<vertices id='v'><input semantic='POSITION' source='#p'/></vertices>"
        f"{half.format('a', '0 1 2')}{half.format('b', '0 1 3')}</mesh></geometry></library_geometries>"
        "<library_visual_scenes><visual_scene id='s'><node><instance_geometry url='#g'><bind_material>"
        f"<technique_common>{bound.format('a')}{bound.format('b')}</technique_common></bind_material>"
        "</instance_geometry></node></visual_scene></library_visual_scenes>"
        "<scene><instance_visual_scene url='#s'/></scene></COLLADA>"
    )

    def drawn(material: str) -> dict[tuple[float, ...], int]:
        urdf = (
            "<robot name='r'><link name='base'><visual><geometry><mesh filename='two.dae' scale='2 2 2'/>"
            f"</geometry>{material}</visual></link><link name='tip'/><joint name='j' type='continuous'>"
            "<parent link='base'/><child link='tip'/></joint></robot>"
        )
        robot = pk.load_robot(urdf, package_dirs=[tmp_path])
        parts = [part for shape in robot.visual_shapes for part in Drawable.all_of_shape(shape)]
        together = merged(robot, robot.visual_shapes)
        assert sorted(part.color for part in together) == sorted(part.color for part in parts)
        assert max(part.geometry.vertices.max() for part in together) == 2.0
        return {part.color: index for index, part in enumerate(parts)}

    assert set(drawn("")) == {(1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0)}
    assert set(drawn("<material name='g'><color rgba='0 1 0 1'/></material>")) == {(0.0, 1.0, 0.0, 1.0)}
