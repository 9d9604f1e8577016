"""Memory: flat over many scenes, whatever they hold."""

import ctypes
import gc
import os
from pathlib import Path

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin import collision, ik
from pepper_kin.collision import PointCloud, TriangleMesh
from pepper_kin.twin.sensors import RayCaster

STATM = Path("/proc/self/statm")
ALLOWED = 40e6
"""Growth that is not more than the allocator's [bytes]."""


def resident():
    """Return the memory that this process holds, without what is free in its heap [bytes]."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    return int(STATM.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def boxes(rng):
    scene = pk.Scene()
    for k in range(8):
        scene = scene.add_box(
            f"box {k}", rng.uniform(0.02, 0.3, 3), rng.uniform((0.6, -1.0, 0.0), (2.0, 1.0, 1.5))
        )
    return scene


def cloud(rng):
    points = rng.uniform((0.8, -1.0, 0.0), (2.0, 1.0, 1.5), (4000, 3))
    return boxes(rng).add("cloud", PointCloud(points, 0.01))


def mesh(rng):
    vertices = rng.uniform((0.8, -1.0, 0.0), (2.0, 1.0, 1.5), (300, 3))
    return boxes(rng).add("mesh", TriangleMesh(vertices, rng.permutation(300).reshape(-1, 3)))


def use(pepper, scene, rng):
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (4, pepper.n))
    collision.in_collision(pepper, q, scene)
    collision.clearance(pepper, q[0], scene)
    ik.solve(pepper, ik.HandPosition("left", (0.38, 0.22, 0.82)), scene=scene, restarts=1)
    pk.plan(pepper, pepper.posture("Stand"), pepper.joint_vector({"HeadYaw": 0.1}), scene, timeout=5.0)


@pytest.mark.skipif(not STATM.exists(), reason="reads Linux's account of memory")
@pytest.mark.parametrize("make", [boxes, cloud, mesh])
def test_memory_is_flat_over_many_scenes(pepper, rng, amount, tried, make):
    """The first part fills what is kept; what follows takes no more."""
    first, rest = amount(80, 100, 400), amount(80, 400, 3000)
    for _ in range(first):
        use(pepper, make(rng), rng)
    before = resident()
    for _ in range(rest):
        use(pepper, make(rng), rng)
    grown = resident() - before
    tried("scenes", first + rest, int(grown > ALLOWED))
    assert grown <= ALLOWED, f"{grown / 1e6:.0f} MB more after {rest} scenes"


@pytest.mark.skipif(not STATM.exists(), reason="reads Linux's account of memory")
def test_memory_is_flat_over_many_meshes_at_which_rays_are_cast(rng, amount, tried):
    """Each has 2 MB of triangles and their tree; 256 MB are kept, around which the heap settles slowly."""
    first, rest = amount(200, 400, 400), amount(40, 200, 3000)

    def cast():
        vertices = rng.uniform((0.8, -1.0, 0.0), (2.0, 1.0, 1.5), (30_000, 3))
        shape = TriangleMesh(vertices, rng.permutation(30_000).reshape(-1, 3))
        RayCaster([shape], np.eye(4)[None]).distances(np.zeros(3), (1.0, 0.0, 0.5))

    for _ in range(first):
        cast()
    before = resident()
    for _ in range(rest):
        cast()
    grown = resident() - before
    tried("meshes at which rays are cast", first + rest, int(grown > ALLOWED))
    assert grown <= ALLOWED, f"{grown / 1e6:.0f} MB more after {rest} meshes"
