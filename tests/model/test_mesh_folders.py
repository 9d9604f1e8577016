"""Where the mesh files of a description are found."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import FileFormatError

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
URDF = """<robot name="r"><link name="base"><collision><geometry><mesh filename="{}"/></geometry></collision>
  </link><link name="arm"/>
  <joint name="j" type="continuous"><parent link="base"/><child link="arm"/></joint></robot>"""
BALL = pk.Scene().add_sphere("ball", 0.1, (3.0, 0.0, 0.0))
GAP = 3.0 - 0.1 - 1.0  # [m] from the corner at (1, 0, 0)


def package(tmp_path, name):
    """A package with its URDF and its mesh in folders of their own."""
    for folder in ("urdf", "meshes"):
        (tmp_path / "my_robot" / folder).mkdir(parents=True)
    (tmp_path / "my_robot" / "meshes" / "body.obj").write_text(TETRAHEDRON)
    (tmp_path / "my_robot" / "urdf" / "body.obj").write_text(TETRAHEDRON)
    (tmp_path / "my_robot" / "urdf" / "robot.urdf").write_text(URDF.format(name))
    return tmp_path / "my_robot" / "urdf" / "robot.urdf"


@pytest.mark.parametrize(
    "name", ["package://my_robot/meshes/body.obj", "../meshes/body.obj", "body.obj", "file://body.obj"]
)
@pytest.mark.parametrize("kind", [str, lambda path: path], ids=["text", "path"])
def test_meshes_beside_the_urdf_file_are_found(tmp_path, name, kind):
    path = package(tmp_path, name)
    robot = pk.load_robot(kind(path))
    assert pk.collision.clearance(robot, robot.neutral(), BALL) == pytest.approx(GAP, abs=1e-6)
    assert not [fault for fault in pk.model.audit(kind(path)).faults if "body.obj" in fault.message]


def test_folders_that_are_given_come_first(tmp_path):
    path = package(tmp_path, "package://my_robot/meshes/body.obj")
    other = tmp_path / "other" / "my_robot" / "meshes"
    other.mkdir(parents=True)
    (other / "body.obj").write_text(TETRAHEDRON.replace("v 1 0 0", "v 2 0 0"))
    robot = pk.load_robot(path, package_dirs=[tmp_path / "other"])
    assert pk.collision.clearance(robot, np.zeros(1), BALL) == pytest.approx(GAP - 1.0, abs=1e-6)


@pytest.mark.parametrize("suffix", ["obj", "stl", "dae"])
def test_a_mesh_that_is_nowhere_says_where_to_name_its_folder(suffix):
    robot = pk.load_robot(URDF.format(f"package://no_such_package/body.{suffix}"))
    message = (
        rf"no_such_package/body.{suffix}: cannot be read as a mesh: there is no such file; .*package_dirs"
    )
    with pytest.raises(FileFormatError, match=message):
        pk.collision.in_collision(robot, np.zeros(1), BALL)
