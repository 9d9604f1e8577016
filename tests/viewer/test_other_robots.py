"""Robots that are not Pepper in the live page, with meshes of other formats."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.mesh_file import read_mesh
from pepper_kin.model import Mesh
from pepper_kin.viewer.server import ViewerServer
from pepper_kin.viewer.server.layers import VISUAL, layers_of
from pepper_kin.viewer.server.sketches import TRIANGLES, sketches_of
from pepper_kin.viewer.server.targets import Targets

SHARE = Path(importlib.metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share"))
ROBOTS = SHARE / "example-robot-data" / "robots"


@pytest.fixture(scope="module")
def panda():
    """An arm whose visual meshes are COLLADA files."""
    urdf = ROBOTS / "panda_description" / "urdf" / "panda.urdf"
    return pk.load_robot(urdf, package_dirs=[SHARE, ROBOTS])


def test_visuals_of_collada_files_hold_the_collision_shapes(panda):
    """The maker's hulls for collisions are drawn around the same bodies: both fill the same room."""
    layers = layers_of(panda, Targets(panda))
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
