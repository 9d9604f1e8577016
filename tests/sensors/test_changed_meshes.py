"""Meshes that change on disk, or that relative names find elsewhere: rays see the file of now."""

from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker
from pepper_kin.model import Mesh
from pepper_kin.twin.sensors import RayCaster, RobotRays

TETRAHEDRON = "v 0 0 0\nv {0} 0 0\nv 0 {0} 0\nv 0 0 {0}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
URDF = """<robot name="one"><link name="base"/><link name="arm">
<visual><geometry><mesh filename="{mesh}"/></geometry>
</visual><collision><geometry><mesh filename="{mesh}"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
AIM = ((5.0, 0.1, 0.1), (-1.0, 0.0, 0.0))


def distance_to(mesh):
    return float(RayCaster([mesh], np.eye(4)[None]).cast(*AIM).distance)


def test_a_mesh_that_was_written_anew_is_read_anew(tmp_path):
    path, distances = tmp_path / "part.obj", []
    for size in ("1.0", "2.0", "3.0"):  # of one length: the size of the file stays
        path.write_text(TETRAHEDRON.format(size))
        distances.append(distance_to(Mesh(path)))
    assert distances == pytest.approx([5 - 0.8, 5 - 1.8, 5 - 2.8])


def test_a_relative_name_is_that_of_the_folder_of_now(tmp_path, monkeypatch):
    distances = []
    for size in ("1.0", "2.0"):
        folder = tmp_path / size
        folder.mkdir()
        (folder / "part.obj").write_text(TETRAHEDRON.format(size))
        monkeypatch.chdir(folder)
        distances.append(distance_to(Mesh(Path("part.obj"))))
    assert distances == pytest.approx([5 - 0.8, 5 - 1.8])


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_a_robot_loaded_again_is_seen_as_it_is_now(tmp_path, kind):
    path, distances, gaps = tmp_path / "part.obj", [], []
    for size in ("1.0", "2.0"):
        path.write_text(TETRAHEDRON.format(size))
        robot = pk.load_robot(URDF.format(mesh=path))
        rays = RobotRays(robot, kind, floor=False)
        distances.append(float(rays.distances([0.0], None, *AIM)))
        scene = pk.Scene().add_sphere("ball", 0.1, (5.0, 0.0, 0.0))
        gaps.append(CollisionChecker(robot, scene).clearance([0.0]))
    assert distances == pytest.approx([5 - 0.8, 5 - 1.8])
    assert gaps == pytest.approx([4.9 - 1.0, 4.9 - 2.0], abs=1e-6)
