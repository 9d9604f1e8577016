"""Clouds in the compiled check, against coal, k-d trees and plain NumPy."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker, PointCloud
from pepper_kin.collision.fast import FastChecker
from pepper_kin.collision.fast.cloud_block import box_around, cloud_block
from pepper_kin.core.collision.clouds import cloud_at, nearest_squared
from pepper_kin.exceptions import InvalidValueError

PEPPER = pk.load_pepper()


def surfaces(rng, count):
    """Points of a table, a wall and balls before the robot."""
    k = count // 3
    table = np.column_stack([rng.uniform(0.35, 1.2, k), rng.uniform(-0.8, 0.8, k), np.full(k, 0.7)])
    wall = np.column_stack([np.full(k, 1.0), rng.uniform(-1.2, 1.2, k), rng.uniform(0, 2, k)])
    ways = rng.normal(size=(count - 2 * k, 3))
    centers = rng.uniform([0.3, -0.6, 0.6], [0.9, 0.6, 1.3], (6, 3))[rng.integers(6, size=len(ways))]
    return np.concatenate([table, wall, centers + 0.07 * ways / np.linalg.norm(ways, axis=1)[:, None]])


def random_q(rng, count):
    return rng.uniform(PEPPER.lower_limits, PEPPER.upper_limits, (count, PEPPER.n))


@pytest.mark.parametrize("count", [1, 7, 300, 8000])
@pytest.mark.parametrize("margins", [(0.0, 0.0), (0.02, 0.005)])
def test_verdicts_are_those_of_coal(count, margins):
    rng = np.random.default_rng(count)
    turn = Rotation.random(random_state=np.random.RandomState(count)).as_euler("xyz")
    moved = Rotation.from_euler("xyz", turn).inv().apply(surfaces(rng, count) - [0.1, 0.2, 0.3])
    scene = pk.Scene().add_point_cloud("cloud", moved, 0.01, (0.1, 0.2, 0.3), turn, voxel=None)
    scene = scene.add_box("box", (0.1, 0.2, 0.3), (0.5, -0.5, 0.5))
    scene = scene.add_cylinder("cup", 0.04, 0.15, (1, 0, 1)).attach("cup", "l_gripper", np.eye(4))
    fast, q = FastChecker(PEPPER, scene, *margins), random_q(rng, 400)
    assert fast.alone
    np.testing.assert_array_equal(fast.in_collision(q), fast.exact.in_collision(q))
    bounds, distances = fast.lower_bound(q[:60]), fast.exact.clearance(q[:60])
    assert (bounds <= distances + 1e-6).all()
    free = distances > 0.01
    assert (bounds[free] > 0).mean() > 0.9


def test_a_mesh_of_the_robot_against_a_cloud():
    """What hangs on the hand is a hull, which is compared with points by GJK."""
    rng = np.random.default_rng(2)
    scene = pk.Scene().add_point_cloud("cloud", surfaces(rng, 3000), 0.005)
    scene = scene.add_convex_mesh("bag", rng.normal(size=(30, 3)) * 0.05)
    scene = scene.attach("bag", "r_gripper", np.eye(4))
    fast, q = FastChecker(PEPPER, scene), random_q(rng, 500)
    np.testing.assert_array_equal(fast.in_collision(q), fast.exact.in_collision(q))


def held_cloud(rng, count):
    """A shell of points around the left hand, seen from it."""
    ways = rng.normal(size=(count, 3))
    return ways / np.linalg.norm(ways, axis=1)[:, None] * [0.05, 0.09, 0.07] + [0.05, 0.0, 0.02]


@pytest.mark.parametrize("margins", [(0.0, 0.0), (0.02, 0.005)])
@pytest.mark.parametrize("count", [1, 3, 400])
def test_a_cloud_in_the_hand_has_the_verdicts_of_coal(count, margins):
    """It meets the robot, boxes, a hull, a floor and another cloud."""
    rng = np.random.default_rng(count)
    scene = pk.Scene().add_point_cloud("room", surfaces(rng, 2000), 0.01, voxel=None)
    scene = scene.add_box("box", (0.1, 0.2, 0.3), (0.5, 0.4, 0.8)).add_half_space("floor", (0, 0, 1))
    scene = scene.allow("floor", "Tibia", "WheelB_link", "WheelFL_link", "WheelFR_link")
    scene = scene.add_convex_mesh("stone", rng.normal(size=(30, 3)) * 0.1, (0.3, 0.5, 1.0))
    scene = scene.add_point_cloud("grapes", held_cloud(rng, count), 0.008, voxel=None)
    scene = scene.attach("grapes", "l_gripper", np.eye(4))
    fast, q = FastChecker(PEPPER, scene, *margins), random_q(rng, 400)
    assert fast.alone
    found = fast.in_collision(q)
    np.testing.assert_array_equal(found, fast.exact.in_collision(q))
    without = FastChecker(PEPPER, scene.remove("grapes"), *margins).in_collision(q)
    assert count < 400 or (found & ~without).sum() > 5
    bounds, distances = fast.lower_bound(q[:60]), fast.exact.clearance(q[:60])
    assert (bounds <= distances + 1e-6).all()


def test_points_near_a_cloud_in_the_hand_are_distinguished():
    rng = np.random.default_rng(3)
    held = held_cloud(rng, 300)
    scene = pk.Scene().add_point_cloud("grapes", held, 0.008, voxel=None)
    scene, q = scene.attach("grapes", "l_gripper", np.eye(4)), PEPPER.posture("Stand")
    hand = pk.kinematics.frame_pose(PEPPER, q, "l_gripper")
    placed = held @ hand[:3, :3].T + hand[:3, 3]
    points = hand[:3, 3] + rng.uniform(-0.2, 0.2, (2000, 3))
    bare = FastChecker(PEPPER).near(q, points, 0.01)
    near = cKDTree(placed).query(points)[0] < 0.018
    assert (near & ~bare).sum() > 20
    np.testing.assert_array_equal(FastChecker(PEPPER, scene).near(q, points, 0.01), near | bare)


@pytest.mark.thorough
@pytest.mark.parametrize("spread", [(1.0, 1.0, 1.0), (3.0, 0.001, 0.5), (0.01, 0.01, 0.01), (9.0, 7.0, 2.0)])
def test_nearest_points_are_those_of_a_tree(spread):
    rng = np.random.default_rng(3)
    points = rng.normal(size=(2000, 3)) * spread
    block, middle = cloud_block(PointCloud(points, 0.0)), box_around(points)[0]
    cloud, tree = cloud_at(block.ctypes.data), cKDTree(points - middle)
    for _ in range(300):
        place, reach = rng.normal(size=3) * spread + rng.normal(size=3) * 0.1, rng.uniform(0.01, 0.5)
        found = np.sqrt(nearest_squared(cloud, *place, reach, 0.0))
        assert found == pytest.approx(min(tree.query(place)[0], reach), abs=2e-6)


def test_a_cloud_around_the_base_is_a_contact_everywhere():
    base = pk.kinematics.frame_pose(PEPPER, PEPPER.neutral(), "Tibia")[:3, 3]
    scene = pk.Scene().add_point_cloud("dirt", [base - np.array([0.0, 0.0, 0.1])], 0.02)
    fast, q = FastChecker(PEPPER, scene), random_q(np.random.default_rng(4), 20)
    assert fast.exact.in_collision(q).all() == fast.in_collision(q).all()
    np.testing.assert_array_equal(fast.in_collision(q), fast.exact.in_collision(q))


def test_thinned_clouds_cover_every_ball_and_keep_one_point_a_cube():
    rng = np.random.default_rng(5)
    points = surfaces(rng, 6000) - 3.0
    thin = PointCloud.thinned(points, 0.01, 0.05)
    distance = cKDTree(thin.points).query(points)[0]
    assert (distance + 0.01 <= thin.radius + 1e-12).all()
    cubes = np.floor((points - points.min(axis=0)) / 0.05).astype(int)
    assert len(thin.points) == len(np.unique(cubes, axis=0))


@pytest.mark.thorough
@pytest.mark.parametrize("held", [False, True])
def test_points_of_the_robot_are_left_out(held):
    """Points around the robot: those left are as far from it as coal says."""
    rng = np.random.default_rng(6)
    q, scene = random_q(rng, 1)[0], pk.Scene()
    if held:
        scene = scene.add_convex_mesh("bag", rng.normal(size=(30, 3)) * 0.05)
        scene = scene.attach("bag", "r_gripper", np.eye(4))
    points = rng.uniform([-0.5, -0.8, 0.0], [0.8, 0.8, 1.5], (400, 3))
    left = pk.collision.without_robot(PEPPER, q, points, scene, margin=0.03)
    kept = {tuple(point) for point in left}
    assert 100 < len(kept) < 400
    for point in points:
        ball = scene.add_sphere("point", 1e-6, point)
        pairs = CollisionChecker(PEPPER, ball).contact_points(q, 5.0)  # which is not kept
        apart = min(pair.distance for pair in pairs if "point" in pair.names and pair.distance is not None)
        if abs(apart - 0.03) > 1e-4:
            assert (tuple(point) in kept) == (apart > 0.03)


def test_misuse_is_named():
    for change, message in [
        ({"points": [[0.0, np.nan, 0.0]]}, "points: got nan"),
        ({"points": [0.0, 0.0, 0.0]}, "points: got shape"),
        ({"margin": -1.0}, "margin: got -1.0"),
        ({"q": PEPPER.neutral()[None]}, "q: got shape"),
    ]:
        arguments = {"q": PEPPER.neutral(), "points": np.zeros((1, 3)), "margin": 0.02, **change}
        with pytest.raises(InvalidValueError, match=message):
            pk.collision.without_robot(
                PEPPER, arguments["q"], arguments["points"], margin=arguments["margin"]
            )
