"""Meshes squashed to a plane, a line or a point, mirrored, or with parts that count for nothing."""

import numpy as np
import pytest
from scipy.optimize import nnls

import pepper_kin as pk
from pepper_kin.collision.fast import FastChecker

CORNERS = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.1]])
FACES = "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
ODD = {
    "plain": ("", FACES),
    "unused": ("v 3 3 3\n", FACES),
    "repeated": ("v 0 0 0\nv 0.3 0 0\n", FACES.replace("f 1 2 4", "f 5 6 4")),
    "no area": ("v 0.15 0 0\n", FACES + "f 1 1 2\nf 1 5 2\nf 3 3 3\n"),
}


def distance_to_hull(points, place):
    """Return the distance from a place to the hull of points [m], as a least-squares problem."""
    heavy = 1e4
    rows = np.vstack([(points - place).T, np.full(len(points), heavy)])
    weights = nnls(rows, np.r_[np.zeros(3), heavy])[0]
    return np.linalg.norm(weights @ (points - place) / weights.sum())


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize(
    "scale",
    [(1, 1, 0), (1, 0, 1), (0, 1, 0), (0, 0, 0), (1, 1, 1e-10), (1, 1, 1e-6), (-1, 1, 1), (-1, -1, 0)],
)
def test_distances_to_a_squashed_mesh_are_those_to_its_hull(tmp_path, odd, scale):
    corners, faces = ODD[odd]
    text = "".join("v {} {} {}\n".format(*corner) for corner in CORNERS)
    (tmp_path / "mesh.obj").write_text(text + corners + faces)
    (tmp_path / "robot.urdf").write_text(
        '<robot name="r"><link name="b"/><link name="a"><inertial><mass value="1"/><inertia '
        'ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<collision><geometry><mesh filename="mesh.obj" '
        f'scale="{scale[0]} {scale[1]} {scale[2]}"/></geometry></collision></link><joint name="j" '
        'type="continuous"><parent link="b"/><child link="a"/><axis xyz="0 0 1"/></joint></robot>'
    )
    robot = pk.load_robot(tmp_path / "robot.urdf", acceleration_limits=1.0)
    rng, q = np.random.default_rng(0), np.zeros(1)
    radius, hull = 0.01, CORNERS * scale
    touching = 0
    for reach in (0.02, 0.02, 0.3, 0.3, 8.0):
        place = hull.mean(axis=0) + rng.uniform(-reach, reach, 3)
        apart = distance_to_hull(hull, place) - radius
        scene = pk.Scene().add_sphere("ball", radius, place)
        assert pk.collision.in_collision(robot, q, scene) == (apart < 0.0)
        found = pk.collision.clearance(robot, q, scene)
        contact = pk.collision.contacts(robot, q, scene, within=20.0)[0]
        if apart > 0.0:
            assert found == pytest.approx(apart, abs=2e-6)
            assert contact.distance == pytest.approx(apart, abs=2e-6)
        else:
            touching += 1
            assert found <= 0.0
            assert contact.distance <= 0.0
        assert FastChecker(robot, scene).lower_bound(q) <= found + 2e-6
    assert touching < 5
