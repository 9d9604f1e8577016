"""Rays against closed forms and against coal: the hit lies on the solid and nothing lies before it."""

import coal
import numpy as np
import pytest

from pepper_kin.collision import ConvexMesh, HalfSpace, PointCloud, TriangleMesh
from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.collision.solids import padding
from pepper_kin.core.ray_casting import DEPTH, box_tree
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, Sphere
from pepper_kin.model.shapes import transform
from pepper_kin.twin.sensors import RayCaster

RNG = np.random.default_rng(5)
TETRA = np.array([[0.3, 0, -0.2], [-0.2, 0.3, -0.2], [-0.2, -0.3, -0.2], [0, 0, 0.4]])
BUMPY = np.random.default_rng(1).normal(size=(40, 3)) * (0.2, 0.15, 0.25)
SHEET = TriangleMesh([[0, 0, 0], [0.4, 0, 0.1], [0.3, 0.5, 0], [-0.2, 0.3, 0.2]], [[0, 1, 2], [0, 2, 3]])
SOLIDS = {
    "box": Box((0.4, 0.3, 0.2)),
    "sphere": Sphere(0.25),
    "cylinder": Cylinder(0.15, 0.5),
    "capsule": Capsule(0.12, 0.4),
    "half space": HalfSpace(-0.1),
    "tetrahedron": ConvexMesh(TETRA),
    "hull": ConvexMesh(BUMPY),
    "padded hull": ConvexMesh(BUMPY, 0.03),
    "sheet": SHEET,
    "padded sheet": TriangleMesh(SHEET.vertices, SHEET.faces, 0.05),
    "cloud": PointCloud(RNG.uniform(-0.3, 0.3, (60, 3)), 0.03),
}


def distance_by_coal(geometry, pose, point):
    """Distance of a point from a solid by coal, exact outside."""
    place = coal.Transform3s(np.array(pose[:3, :3]), np.array(pose[:3, 3]))
    dot = coal.Sphere(1e-9)
    where = coal.Transform3s(np.eye(3), np.array(point))
    found = coal.distance(
        coal_geometry(geometry), place, dot, where, coal.DistanceRequest(), coal.DistanceResult()
    )
    return found - padding(geometry)


def rays_towards(center, count, rng):
    origins = center + 1.5 * (lambda x: x / np.linalg.norm(x, axis=1, keepdims=True))(
        rng.normal(size=(count, 3))
    )
    return origins, center + rng.uniform(-0.3, 0.3, (count, 3)) - origins


@pytest.mark.parametrize("name", SOLIDS)
def test_hits_lie_on_the_solid_and_nothing_lies_before_them(name):
    rng, geometry = np.random.default_rng(3), SOLIDS[name]
    pose = transform((0.7, -0.4, 0.9), (0.4, -0.7, 1.9))
    origins, directions = rays_towards(pose[:3, 3], 60, rng)
    if name == "half space":  # coal's distance is to the solid: begin outside
        outside = (origins - pose[:3, 3]) @ pose[:3, 2] > 0
        origins, directions = origins[outside], directions[outside]
    hits = RayCaster([geometry], pose[None]).cast(origins, directions)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    assert np.isfinite(hits.distance).sum() > 5
    for origin, way, far in zip(origins, unit, hits.distance, strict=True):
        if np.isfinite(far):
            # Just before the hit: at the hit itself coal may call a touch an overlap, of any depth.
            before = distance_by_coal(geometry, pose, origin + (far - 1e-4) * way)
            assert -1e-6 < before < 1.1e-4
        # March by sphere tracing: each step is no longer than the distance to the solid.
        t, end = 0.0, min(far, 4.0)
        for _ in range(60):
            if t >= end - 1e-4:
                break
            gap = distance_by_coal(geometry, pose, origin + t * way)
            assert gap > -1e-6, f"inside at {t} before the hit at {far}"
            t += max(gap, 1e-3)


@pytest.mark.parametrize("name", SOLIDS)
def test_normals_are_the_slope_of_the_distance(name):
    rng, geometry = np.random.default_rng(4), SOLIDS[name]
    pose = transform((0.2, 0.3, -0.4), (1.0, 0.2, -0.8))
    origins, directions = rays_towards(pose[:3, 3], 25, rng)
    if name == "half space":
        outside = (origins - pose[:3, 3]) @ pose[:3, 2] > 0
        origins, directions = origins[outside], directions[outside]
    hits = RayCaster([geometry], pose[None]).cast(origins, directions)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    agreeing = 0
    for way, origin, far, normal in zip(unit, origins, hits.distance, hits.normal, strict=True):
        if not np.isfinite(far):
            assert (normal == 0).all()
            continue
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        assert normal @ way <= 1e-12
        step = 1e-3
        if abs(distance_by_coal(geometry, pose, origin + far * way + step * normal) - step) < 2e-5:
            agreeing += 1  # at edges seen from inside, or under another ball, the slope is another one
    assert agreeing >= 0.7 * np.isfinite(hits.distance).sum() > 0


def test_closed_forms():
    caster = RayCaster(
        [Sphere(0.5), Box((2, 2, 2)), HalfSpace(0.25), Cylinder(1.0, 2.0), Capsule(0.5, 1.0)],
        [transform((k * 10.0, 0, 0)) if k != 2 else transform((0, 0, -5)) for k in range(5)],
    )
    origins = np.array([[-3, 0.3, 0], [10, 0, 5], [3, 3, 0], [30, 0, 9], [40.3, 0, 9.0], [10, 0, 0.0]])
    directions = np.array([[2, 0, 0], [0, 0, -1], [0, 0, -3], [0, 0, -1], [0, 0, -1], [0, 1, 0.0]])
    hits = caster.cast(origins, directions)
    expected = [3 - 0.4, 4.0, 4.75, 8.0, 9 - 0.5 - 0.4, 1.0]
    np.testing.assert_allclose(hits.distance, expected, rtol=1e-12)
    assert hits.solid.tolist() == [0, 1, 2, 3, 4, 1]
    np.testing.assert_allclose(hits.normal[0], [-0.8, 0.6, 0], atol=1e-12)
    np.testing.assert_allclose(hits.normal[5], [0, -1, 0], atol=1e-12)  # from inside: against the ray


def test_nearest_of_many_is_that_of_each_alone():
    rng = np.random.default_rng(8)
    geometries = [list(SOLIDS.values())[k] for k in rng.integers(0, len(SOLIDS), 40)]
    geometries = [g for g in geometries if not isinstance(g, HalfSpace)]
    poses = np.array([transform(rng.uniform(-2, 2, 3), rng.uniform(-3, 3, 3)) for _ in geometries])
    origins = rng.uniform(-3, 3, (400, 3))
    directions = rng.normal(size=(400, 3)) - origins
    together = RayCaster(geometries, poses).cast(origins, directions)
    alone = np.array(
        [
            RayCaster([g], p[None]).distances(origins, directions)
            for g, p in zip(geometries, poses, strict=True)
        ]
    )
    np.testing.assert_array_equal(together.distance, alone.min(axis=0))
    hit = np.isfinite(together.distance)
    assert hit.sum() > 50
    np.testing.assert_array_equal(together.solid[hit], alone.argmin(axis=0)[hit])


def test_moved_solids_are_hit_where_they_are_and_maximum_ends_a_ray():
    caster = RayCaster([Sphere(0.1)], np.eye(4)[None])
    caster.place(transform((2, 0, 0))[None])
    assert caster.distances([0, 0, 0], [1, 0, 0]) == pytest.approx(1.9)
    assert caster.distances([0, 0, 0], [1, 0, 0], 1.8) == np.inf
    grid = caster.distances(np.zeros((4, 1, 3)), np.broadcast_to([1.0, 0, 0], (5, 3)))
    assert grid.shape == (4, 5)


def test_nothing_is_hit_in_an_empty_world():
    assert RayCaster([], np.empty((0, 4, 4))).distances([0, 0, 0], [1, 0, 0]) == np.inf
    empty = RayCaster([PointCloud(np.empty((0, 3)), 0.1)], np.eye(4)[None])
    assert empty.cast([0, 0, 0], [1, 0, 0]).solid == -1


def test_a_mesh_file_is_hit_like_its_triangles(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
    (tmp_path / "corner.obj").write_text(text)
    mesh = Mesh(tmp_path / "corner.obj", (0.5, 0.5, 0.5))
    caster = RayCaster([mesh, mesh], [np.eye(4), transform((5, 0, 0))])
    np.testing.assert_allclose(caster.distances([[1, 1, 1], [6, 1, 1]], [-1, -1, -1]), 5 / 6 * np.sqrt(3))


def test_rays_along_the_axes_meet_corners_and_edges():
    """Exactly through the corners of a mesh, also at its outline, where they run along faces of the trees."""
    x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9))
    vertices = np.column_stack([x.ravel(), y.ravel(), 0.1 * np.sin(3 * x + y).ravel()])
    at = np.arange(81).reshape(9, 9)
    faces = np.concatenate(
        [
            np.column_stack([at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, 1:].ravel()]),
            np.column_stack([at[:-1, :-1].ravel(), at[1:, 1:].ravel(), at[1:, :-1].ravel()]),
        ]
    )
    caster = RayCaster([TriangleMesh(vertices, faces)], np.eye(4)[None])
    for side in (1.0, -1.0):
        origins = vertices * [1, 1, 0] + [0, 0, 2 * side]
        found = caster.distances(origins, [0, 0, -side])
        np.testing.assert_allclose(found, 2 - side * vertices[:, 2], atol=1e-12)


def test_tree_holds_everything_once_and_stays_shallow():
    rng = np.random.default_rng(2)
    middle = np.concatenate([0.5 ** np.arange(400.0)[:, None] * [1, 1, 1], np.zeros((300, 3))])
    middle[:100] += rng.normal(size=(100, 3))
    boxes = np.hstack([middle - 1e-3, middle + 1e-3])
    node_box, link, order = box_tree(boxes, 3)
    assert sorted(order) == list(range(700))
    depth = np.zeros(len(link), dtype=int)
    for node, (first, count) in enumerate(link):
        if count == 0:
            for child in (first, first + 1):
                depth[child] = depth[node] + 1
                assert (node_box[child, :3] >= node_box[node, :3]).all()
                assert (node_box[child, 3:] <= node_box[node, 3:]).all()
        else:
            inside = boxes[order[first : first + count]]
            np.testing.assert_allclose(node_box[node, :3], inside[:, :3].min(axis=0), atol=1e-11)
            assert count <= 3
    assert depth.max() < DEPTH


def test_misuse_is_named():
    for change, words in [
        ({"origins": [0, np.nan, 0]}, "origins"),
        ({"directions": [0, 0, 0]}, "length 0"),
        ({"directions": np.ones((3, 3)), "origins": np.ones((2, 3))}, "broadcast"),
        ({"maximum": np.nan}, "maximum"),
        ({"maximum": -1.0}, "at least 0"),
    ]:
        caster = RayCaster([Sphere(0.1)], np.eye(4)[None])
        arguments = {"origins": [0, 0, 0], "directions": [1, 0, 0], **change}
        with pytest.raises(InvalidValueError, match=words):
            caster.cast(**arguments)
        with pytest.raises(InvalidValueError, match="geometry"):
            RayCaster(["ball"], np.eye(4)[None])
        with pytest.raises(InvalidValueError, match="poses"):
            RayCaster([Sphere(0.1)], np.full((1, 4, 4), np.nan))
