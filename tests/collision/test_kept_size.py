"""Results that are kept within bounds of bytes."""

import gc
import weakref

import numpy as np
import pytest

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


@pytest.mark.thorough
def test_balls_around_solids_and_trees_of_rays_are_forgotten_with_their_shapes(monkeypatch):
    """Of 30 solids and 30 meshes of 1 MB each 5 MB may be kept, where usually 64 and 256 MB may."""
    few = 5e6
    balls = kept_within(few, bytes_of)(structure.bounding_ball.__wrapped__)
    trees = kept_within(few, bytes_of)(raycast._kept_tree.__wrapped__)
    monkeypatch.setattr(raycast, "_kept_tree", trees)
    rng, first = np.random.default_rng(0), []
    for _ in range(30):
        points = rng.random((40_000, 3))
        solid = Solid("held", 1, np.eye(3), np.zeros(3), HULL, np.ones(3), 0.0, points)
        balls((solid,))
        mesh = TriangleMesh(points[:15_000], np.arange(15_000).reshape(-1, 3))
        assert len(RayCaster([mesh], np.eye(4)[None])) == 1
        first = first or [weakref.ref(solid), weakref.ref(mesh)]
        assert points.nbytes < balls.kept_bytes() <= few
        assert points.nbytes / 3 < trees.kept_bytes() <= few
    del mesh, solid
    gc.collect()
    assert [shape() for shape in first] == [None, None]
    assert MOST_BYTES == 256e6
