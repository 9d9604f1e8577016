"""Results that are kept within bounds of bytes."""

import gc
import weakref

import numpy as np

from pepper_kin.collision import PointCloud, TriangleMesh
from pepper_kin.collision.fast import structure
from pepper_kin.collision.fast.solids import Solid
from pepper_kin.collision.kept_size import MOST_BYTES, bytes_of, kept_within
from pepper_kin.core.collision.layout import HULL
from pepper_kin.twin.sensors import RayCaster, raycast


def test_what_was_asked_for_longest_ago_is_forgotten_first():
    made = []

    @kept_within(20_000, bytes_of)
    def zeros(count):
        made.append(count)
        return np.zeros(count)

    for count in (500, 600, 500, 700, 500):  # of 8 bytes each, and 1000 for the entry
        assert zeros(count).size == count
    assert made == [500, 600, 700]
    assert zeros.kept_bytes() == 3 * 1000 + 8 * 1800
    zeros(300)  # makes the 600 forgotten, which the others were asked for after
    zeros(500), zeros(700)
    assert made == [500, 600, 700, 300]
    zeros(600)
    assert made[-1] == 600


def test_one_result_is_kept_however_large():
    @kept_within(10, bytes_of)
    def zeros(count):
        return np.zeros(count)

    assert zeros(1000) is zeros(1000)
    zeros(2000)
    assert zeros.kept_bytes() == 1000 + 8 * 2000


def test_sizes_of_arrays_in_tuples_and_objects():
    cloud = PointCloud(np.ones((5, 3)), 0.01)
    assert bytes_of(cloud, (np.zeros(2), [b"abc"]), "text", 1.0) == 5 * 3 * 8 + 16 + 3


def test_balls_around_solids_are_kept_within_bounds():
    """96 MB of points in solids, one after the other, of which 64 MB may be kept."""
    rng, last = np.random.default_rng(0), None
    for _ in range(20):
        points = rng.random((200_000, 3))
        solid = Solid("held", 1, np.eye(3), np.zeros(3), HULL, np.ones(3), 0.0, points)
        structure.bounding_ball((solid,))
        last = last or weakref.ref(solid)
    assert points.nbytes < structure.bounding_ball.kept_bytes() <= MOST_BYTES / 4
    assert last() is None


def test_trees_of_rays_are_forgotten_with_their_meshes(monkeypatch):
    """430 MB of meshes of 2 MB each, of which 256 MB may be kept."""
    rng = np.random.default_rng(0)
    before, first = raycast._kept_tree.kept_bytes(), None
    for _ in range(200):
        vertices = rng.random((30_000, 3))
        mesh = TriangleMesh(vertices, np.arange(30_000).reshape(-1, 3))
        assert len(RayCaster([mesh], np.eye(4)[None])) == 1
        first = first or weakref.ref(mesh)
    kept = raycast._kept_tree.kept_bytes()
    assert before < kept <= raycast.MOST_BYTES
    del mesh
    gc.collect()
    assert first() is None
