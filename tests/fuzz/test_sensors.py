"""Ray casting against sphere tracing in signed distance fields, and against all triangles of a mesh."""

import numpy as np
from scipy.spatial.transform import Rotation

from pepper_kin.collision import TriangleMesh
from pepper_kin.model import Box, Capsule, Cylinder, Sphere
from pepper_kin.twin.sensors import RayCaster

FAR = 30.0
TOUCH = 1e-10  # [m] at which sphere tracing ends on a surface


def signed_distance(shape, points):
    """Return the signed distance of points (..., 3) in a shape's frame (Quilez, 2008), exact outside."""
    match shape:
        case Sphere(radius=radius):
            return np.linalg.norm(points, axis=-1) - radius
        case Capsule(radius=radius, length=length):
            along = np.clip(points[..., 2], -length / 2, length / 2)
            return np.linalg.norm(points - along[..., None] * [0, 0, 1], axis=-1) - radius
        case Box(size=size):
            over = np.abs(points) - np.array(size) / 2
        case Cylinder(radius=radius, length=length):
            around = np.linalg.norm(points[..., :2], axis=-1) - radius
            over = np.stack([around, np.abs(points[..., 2]) - length / 2], axis=-1)
    return np.linalg.norm(np.maximum(over, 0.0), axis=-1) + np.minimum(over.max(axis=-1), 0.0)


def scene_distance(shapes, poses, points):
    """Return the signed distance of points (m, 3) in the world from the union of shapes."""
    local = [(points - pose[:3, 3]) @ pose[:3, :3] for pose in poses]
    return np.min([signed_distance(s, p) for s, p in zip(shapes, local, strict=True)], axis=0)


def random_shape(rng):
    a, b, c = np.exp(rng.uniform(np.log(0.02), np.log(2.0), 3)).tolist()
    return (Box((a, b, c)), Sphere(a), Capsule(a, b), Cylinder(a, b))[rng.integers(4)]


def random_poses(rng, count):
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
    poses[:, :3, 3] = rng.uniform(-3, 3, (count, 3))
    return poses


def test_rays_meet_what_sphere_tracing_meets(amount, rng, tried):
    goal, done, wrong, met = amount(20_000, 400_000, 20_000_000), 0, 0, 0
    while done < goal:
        shapes = [random_shape(rng) for _ in range(rng.integers(1, 12))]
        poses = random_poses(rng, len(shapes))
        origins = rng.uniform(-5, 5, (4000, 3))
        origins = origins[scene_distance(shapes, poses, origins) > 1e-3]
        aims = poses[rng.integers(len(shapes), size=len(origins)), :3, 3] + rng.normal(0, 0.5, origins.shape)
        directions = aims - origins
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        found = RayCaster(shapes, poses).distances(origins, directions)
        # March: no step passes a surface. What is left after many steps grazes, and tells a lower bound.
        way, left = np.zeros(len(origins)), np.arange(len(origins))
        for _ in range(200):
            gap = scene_distance(shapes, poses, origins[left] + way[left, None] * directions[left])
            way[left] += gap
            left = left[(gap > TOUCH) & (way[left] < FAR)]
            if not left.size:
                break
        marched = np.where(way < FAR, way, np.inf)
        grazing = np.zeros(len(origins), dtype=bool)
        grazing[left] = True
        same = np.isclose(found, marched, rtol=0, atol=1e-6) | (np.isinf(found) & np.isinf(marched))
        hit = np.isfinite(found)
        on = np.full(len(origins), 0.0)
        on[hit] = scene_distance(shapes, poses, origins[hit] + found[hit, None] * directions[hit])
        off = np.where(grazing, found < way - 1e-6, ~same) | (np.abs(on) > 1e-9)
        done, wrong, met = done + len(origins), wrong + int(off.sum()), met + int(hit.sum())
    tried("rays at primitives", done, wrong)
    assert wrong == 0
    assert 0.1 < met / done < 0.95


def test_rays_meet_the_nearest_of_all_triangles(amount, rng, tried):
    goal, done, wrong = amount(4_000, 100_000, 2_000_000), 0, 0
    while done < goal:
        count = int(rng.integers(1, 200))
        corners = rng.uniform(-1, 1, (count, 1, 3)) + rng.normal(0, 0.3, (count, 3, 3))
        mesh = TriangleMesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
        (pose,) = random_poses(rng, 1)
        origins, directions = rng.uniform(-5, 5, (1000, 3)), rng.normal(size=(1000, 3))
        directions = 0.5 * directions + (pose[:3, 3] - origins)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        found = RayCaster([mesh], pose[None]).distances(origins, directions)
        start, way = (origins - pose[:3, 3]) @ pose[:3, :3], directions @ pose[:3, :3]
        # Every triangle by determinants: o + t d = (1 - u - v) a + u b + v c.
        edges = corners[:, 1:] - corners[:, :1]
        system = np.empty((len(start), count, 3, 3))
        system[..., 0] = -way[:, None]
        system[..., 1:] = edges.transpose(0, 2, 1)[None]
        solved = np.linalg.solve(system, (start[:, None] - corners[None, :, 0])[..., None])[..., 0]
        t, u, v = np.moveaxis(solved, -1, 0)
        inside = np.minimum(np.minimum(u, v), 1 - u - v)
        edge = (np.abs(inside) < 1e-9).any(axis=1)
        nearest = np.where((inside >= 0) & (t >= 0), t, np.inf).min(axis=1)
        same = np.isclose(found, nearest, rtol=0, atol=1e-8) | (np.isinf(found) & np.isinf(nearest))
        done, wrong = done + len(origins), wrong + int((~same & ~edge).sum())
    tried("rays at meshes", done, wrong)
    assert wrong == 0
