"""The parts of the compiled check against independent oracles."""

import coal
import numpy as np
import pinocchio
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.collision.bodies import moving_bodies
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.collision.fast.ball_cover import ball_cover
from pepper_kin.collision.fast.solids import BOX, CYLINDER, HULL, Solid, solid_of
from pepper_kin.collision.fast.structure import bounding_ball
from pepper_kin.collision.fast.tables import pack_tables
from pepper_kin.core.collision.gjk import CONTACT, FREE, GJK_WORKSPACE_SIZE, TIE, ConvexCore, nearer_than
from pepper_kin.core.collision.joint_ranges import curve_keeps_ranges, edge_keeps_ranges, violations
from pepper_kin.core.collision.segments import segment_to_box, segment_to_segment

NO_VERTICES = np.zeros((3, 0))


def random_pose(rng, spread=0.3):
    turn = Rotation.random(random_state=np.random.RandomState(rng.integers(2**31))).as_matrix()
    return np.concatenate([rng.uniform(-spread, spread, 3), turn.T.ravel()])


def least_over_box(function, half):
    """Least value of a convex function over a box by a general minimizer, from several starts."""
    bounds = [(-h, h) for h in half]
    starts = [np.zeros(len(half)), np.array(half) * 0.9, -np.array(half) * 0.9]
    return min(minimize(function, x, bounds=bounds, method="L-BFGS-B", tol=1e-14).fun for x in starts)


def point_of(pose, local):
    return pose[:3] + pose[3:].reshape(3, 3).T @ local


def test_segments_against_a_general_minimizer():
    rng = np.random.default_rng(0)
    for _ in range(30):
        a, b = random_pose(rng), random_pose(rng)
        ha, hb = rng.uniform(0, 0.3, 2)

        def square(x, a=a, b=b):
            return np.sum((point_of(a, [0, 0, x[0]]) - point_of(b, [0, 0, x[1]])) ** 2)

        expected = np.sqrt(least_over_box(square, (ha, hb)))
        assert segment_to_segment(a, ha, b, hb) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("shift", [(0, 0, 0), (0.3, 0, 0), (0.1, 0, 0.5), (0.1, 0.2, -0.37)])
def test_parallel_segments(shift):
    a = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    b = np.concatenate([shift, np.eye(3).ravel()])
    apart = max(abs(shift[2]) - 0.2 - 0.1, 0.0)
    assert segment_to_segment(a, 0.2, b, 0.1) == pytest.approx(
        np.hypot(np.hypot(*shift[:2]), apart), abs=1e-12
    )


def test_segment_and_box_against_a_general_minimizer():
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(60):
        a, b = random_pose(rng), random_pose(rng)
        ha, half = rng.uniform(0, 0.3), rng.uniform(0.01, 0.3, 3)
        turn = b[3:].reshape(3, 3)

        def square(x, a=a, b=b, turn=turn, half=half):
            local = np.abs(turn @ (point_of(a, [0, 0, x[0]]) - b[:3])) - half
            return np.sum(np.maximum(local, 0.0) ** 2)

        expected = np.sqrt(least_over_box(square, (ha,)))
        assert segment_to_box(a, ha, b, half) == pytest.approx(expected, abs=2e-6)
        inside += expected < 1e-9
    assert 5 < inside < 55


def shape_of(kind, half, vertices):
    if kind == BOX:
        return coal.Box(*(2 * half))
    return coal.Cylinder(half[0], 2 * half[2])


def core_of(kind, half, pose, corners=NO_VERTICES):
    """A core of arrays that the caller keeps; corners have shape (3, 8 k)."""
    singles = KEPT.setdefault(id(corners), (corners, corners.astype(np.float32)))[1]
    places = half.ctypes.data, pose.ctypes.data, corners.shape[1], corners.ctypes.data, singles.ctypes.data
    return ConvexCore(kind, *places, float(np.linalg.norm(half)))


def verdict_of(first, second, threshold, axis):
    scratch = np.zeros(GJK_WORKSPACE_SIZE)
    return nearer_than(first, second, threshold, 3e-6, axis.ctypes.data, scratch.ctypes.data)


KEPT = {}


@pytest.mark.parametrize("kinds", [(BOX, BOX), (BOX, CYLINDER), (CYLINDER, CYLINDER)])
def test_convex_cores_against_coal(kinds):
    rng = np.random.default_rng(2)
    verdicts = []
    for _ in range(300):
        poses = [random_pose(rng), random_pose(rng)]
        halves = [rng.uniform(0.02, 0.25, 3) for _ in kinds]
        for kind, half in zip(kinds, halves, strict=True):
            if kind == CYLINDER:
                half[1] = half[0]
        placed = [coal.Transform3s(p[3:].reshape(3, 3).T.copy(), p[:3].copy()) for p in poses]
        shapes = [shape_of(k, h, None) for k, h in zip(kinds, halves, strict=True)]
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        distance = coal.distance(shapes[0], placed[0], shapes[1], placed[1], request, result)
        axis = np.zeros(3)
        for threshold in (0.1, 0.02, 0.0, 0.02, 0.1):  # the axis that parted them is tried first
            cores = [core_of(*which) for which in zip(kinds, halves, poses, strict=True)]
            found = verdict_of(*cores, threshold, axis)
            verdicts.append(found)
            if abs(distance - threshold) > 1e-5:
                assert found == (CONTACT if distance < threshold else FREE)
    assert verdicts.count(TIE) <= 3
    assert min(verdicts.count(FREE), verdicts.count(CONTACT)) > 50


def test_hull_of_a_box_is_the_box():
    rng = np.random.default_rng(3)
    signs = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, -1).T
    for _ in range(100):
        a, b = random_pose(rng), random_pose(rng)
        half, other = rng.uniform(0.02, 0.3, 3), rng.uniform(0.02, 0.3, 3)
        corners = np.ascontiguousarray((signs * half).T)
        block = core_of(BOX, other, b)
        found = [
            verdict_of(core, block, 0.03, np.zeros(3))
            for core in (core_of(HULL, half, a, corners), core_of(BOX, half, a))
        ]
        assert found[0] == found[1]


def surface_points(solid, rng, count=400):
    """Points of a solid's surface, in the frame of its joint."""
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    core = (
        np.where(rng.random((count, 3)) < 0.5, np.sign(directions), rng.uniform(-1, 1, (count, 3)))
        * solid.half
    )
    return (core + solid.radius * directions) @ solid.rotation.T + solid.position


def test_spheres_cover_and_fill_every_solid_of_the_robot():
    rng = np.random.default_rng(4)
    for body in moving_bodies(pk.load_pepper(), ()):
        solid = solid_of(body.owner, body.geometry, body.joint, body.pose)
        spheres = ball_cover(solid)
        points = surface_points(solid, rng)
        gaps = np.linalg.norm(points[:, None] - spheres.centers, axis=2) - spheres.outer
        assert gaps.min(axis=1).max() <= 1e-12
        directions = rng.normal(size=(50, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        for center, radius in zip(spheres.centers, spheres.inner, strict=True):
            local = (center + radius * directions - solid.position) @ solid.rotation
            beyond = np.maximum(np.abs(local) - solid.half, 0.0)
            assert np.linalg.norm(beyond, axis=1).max() <= solid.radius + 1e-12
        center, radius = bounding_ball((solid,))
        assert np.linalg.norm(points - center, axis=1).max() <= radius + 1e-12


def test_a_cylinder_is_covered():
    rng = np.random.default_rng(5)
    half = np.array([0.15, 0.15, 0.3])
    solid = Solid("", 1, np.eye(3), np.zeros(3), CYLINDER, half, 0.0, NO_VERTICES.T)
    spheres = ball_cover(solid)
    angle, height = rng.uniform(-np.pi, np.pi, 500), rng.uniform(-0.3, 0.3, 500)
    points = np.column_stack([0.15 * np.cos(angle), 0.15 * np.sin(angle), height])
    gaps = np.linalg.norm(points[:, None] - spheres.centers, axis=2) - spheres.outer
    assert gaps.min(axis=1).max() <= 0
    inside = spheres.inner > 0
    assert inside.sum() > 10
    depth = np.minimum(0.15 - np.hypot(*spheres.centers[:, :2].T), 0.3 - np.abs(spheres.centers[:, 2]))
    assert (spheres.inner[inside] <= depth[inside] + 1e-12).all()


@pytest.mark.parametrize("count", [4, 12, 200])
def test_a_hull_is_covered_and_filled(count):
    """Points of the hull are in an outer ball; inner balls stay behind the planes that scipy's hull has."""
    from scipy.spatial import ConvexHull

    rng = np.random.default_rng(count)
    vertices = rng.normal(size=(count, 3)) * [0.05, 0.08, 0.2]
    turn = random_pose(rng)[3:].reshape(3, 3).T
    solid = Solid("", 1, turn, np.array([0.1, 0.2, 0.3]), HULL, np.abs(vertices).max(axis=0), 0.01, vertices)
    cover, hull = ball_cover(solid), ConvexHull(vertices)
    points = rng.dirichlet(np.ones(count), 3000) @ vertices  # in the hull, and its corners and edges
    edges = vertices[rng.choice(hull.simplices[:, :2], 2000)]
    points = np.vstack([points, vertices, edges[:, 0] + rng.random((2000, 1)) * (edges[:, 1] - edges[:, 0])])
    away = rng.normal(size=points.shape)
    points = (points + 0.01 * away / np.linalg.norm(away, axis=1)[:, None]) @ turn.T + solid.position
    gaps = np.linalg.norm(points[:, None] - cover.centers, axis=2) - cover.outer
    assert gaps.min(axis=1).max() <= 0
    local = (cover.centers - solid.position) @ turn
    depth = -(local @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
    assert (cover.inner <= depth + 0.01 + 1e-12).all()
    assert (cover.inner > 0.01).any()
    assert len(cover.outer) <= 24


@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_compiled_tables_are_those_of_python(margin):
    pepper = pk.load_pepper()
    tables = dependent_ranges(pepper)
    rng = np.random.default_rng(6)
    q = rng.uniform(1.3 * pepper.lower_limits, 1.3 * pepper.upper_limits, (4000, pepper.n))
    for k, table in enumerate(tables):  # at rows and bounds exactly
        rows = rng.integers(len(table.positions), size=400)
        q[400 * k : 400 * (k + 1), table.first] = table.positions[rows]
        near = np.where(np.isfinite(table.upper[rows]), table.upper[rows], 0.0) - margin
        q[400 * k : 400 * (k + 1), table.second] = near + rng.choice([-1e-12, 0.0, 1e-12], 400)
    left = np.zeros(len(q), np.int64)
    violations(*pack_tables(tables), margin, q.ravel(), pepper.n, left)
    expected = np.any([table.violated(q, margin) for table in tables], axis=0)
    np.testing.assert_array_equal(left.astype(bool), expected)
    assert 0.2 < expected.mean() < 0.9


def leaves_a_range(tables, curve, ends):
    """Whether a cubic curve, shape (4, n), constant first, leaves a table between two parameters: it is
    looked at at its ends, where the second joint turns back, and on both sides of each row it passes."""
    for table in tables:
        x, y = (np.polynomial.Polynomial(curve[:, joint]) for joint in (table.first, table.second))
        hull = [[1, 0, 0, 0], [1, 1 / 3, 0, 0], [1, 2 / 3, 1 / 3, 0], [1, 1, 1, 1]] @ curve[:, table.first]
        met = table.positions[(table.positions >= hull.min()) & (table.positions <= hull.max())]
        passes = np.concatenate([[], *((x - position).roots() for position in met)])
        special = np.concatenate([passes, y.deriv().roots() if curve[1:, table.second].any() else []])
        s = np.real(special[np.abs(np.imag(special)) < 1e-9])
        s = np.concatenate([s - 1e-8, s, s + 1e-8, ends])
        s = s[(s >= ends[0]) & (s <= ends[1])]
        states = np.stack([np.polynomial.polynomial.polyval(s, curve[:, j]) for j in range(curve.shape[1])])
        if table.violated(states.T, margin=-1e-6).any():
            return True
    return False


@pytest.mark.thorough
@pytest.mark.parametrize("cubic", [False, True])
def test_ranges_are_kept_at_every_point_of_a_line_and_of_a_curve(cubic):
    pepper = pk.load_pepper()
    tables = dependent_ranges(pepper)
    heads, rows, _ = pack_tables(tables)
    rng, counts, between = np.random.default_rng(8), [0, 0], 0
    for _ in range(800):
        a, b = rng.uniform(pepper.lower_limits, pepper.upper_limits, (2, pepper.n))
        b = a + rng.choice([0.02, 0.1, 0.5]) * (b - a)
        chosen = [table for table in tables if rng.uniform() < 0.5]
        for table in tables:
            if table not in chosen:  # away from it
                a[[table.first, table.second]] = b[[table.first, table.second]] = 0.0
        for table in chosen:  # near the steps
            row = int(rng.integers(len(table.positions)))
            a[table.first] = table.positions[row] - rng.uniform(0.0, 0.01)
            near = [bound[row] for bound in (table.lower, table.upper) if np.isfinite(bound[row])]
            if near:
                a[table.second] = rng.choice(near) + rng.normal(0.0, 0.02)
        curve = np.array([a, b - a, *(rng.normal(0.0, 0.05, (2, pepper.n)) * cubic)])
        if cubic:
            answer = curve_keeps_ranges(heads, rows, np.array([0.0, 1.0]), curve[None].copy())
        else:
            answer = edge_keeps_ranges(heads, rows, 0.0, a, b)
            assert answer == edge_keeps_ranges(heads, rows, 0.0, b, a)
        assert answer != leaves_a_range(tables, curve, (0.0, 1.0))
        counts[answer] += 1
        looked = np.polynomial.polynomial.polyval(np.linspace(0.0, 1.0, 9), curve).T
        between += not answer and not any(table.violated(looked).any() for table in tables)
    assert min(counts) > 80
    assert between > 0  # what a look at nine states would have missed


def test_a_half_space_is_a_vast_box():
    rng = np.random.default_rng(7)
    for _ in range(20):
        pose, offset = random_pose(rng), rng.uniform(-1, 1)
        placement = pinocchio.SE3(pose[3:].reshape(3, 3).T.copy(), pose[:3].copy())
        solid = solid_of("floor", pk.collision.HalfSpace(offset), 0, placement.homogeneous)
        points = rng.uniform(-3, 3, (200, 3))
        local = np.array([placement.inverse().act(p) for p in points])
        inside = (np.abs((points - solid.position) @ solid.rotation) <= solid.half).all(axis=1)
        np.testing.assert_array_equal(inside, local[:, 2] <= offset)
