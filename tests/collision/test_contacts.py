"""Distances and contacts of every kind of shape against closed forms and brute force."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import Box, Capsule

BASE = ("Tibia", "WheelB_link", "WheelFL_link", "WheelFR_link")


def random_q(pepper, count, seed=0):
    return np.random.default_rng(seed).uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))


def distance_to_shape(points, shape, pose):
    """Distance of points from a robot's capsule, sphere or box (outside only for a box) [m]."""
    placed = pose @ shape.transform_shape_to_link
    local = (points - placed[:3, 3]) @ placed[:3, :3]
    g = shape.geometry
    if isinstance(g, Box):
        return np.linalg.norm(np.maximum(np.abs(local) - np.array(g.size) / 2, 0), axis=1)
    half = g.length / 2 if isinstance(g, Capsule) else 0.0
    along = np.clip(local[:, 2], -half, half)
    return np.linalg.norm(local - along[:, None] * [0, 0, 1], axis=1) - g.radius


def gaps_to(pepper, q, points):
    """Least distance of points from each link."""
    result = {}
    for shape in pepper.collision_shapes:
        pose = pk.kinematics.frame_pose(pepper, q, shape.link)
        gap = distance_to_shape(points, shape, pose).min()
        result[shape.link] = min(gap, result.get(shape.link, np.inf))
    return result


def test_cloud_distances_equal_brute_force():
    pepper = pk.load_pepper()
    points = np.random.default_rng(0).uniform([0.4, -0.6, 0.5], [0.9, 0.6, 0.9], (3000, 3))
    scene = pk.Scene().add_point_cloud("dust", points, 0.01, voxel=None)
    checked = 0
    for q in random_q(pepper, 20):
        found = {c.names[0]: c for c in pk.collision.contacts(pepper, q, scene, within=0.4)}
        for link, gap in gaps_to(pepper, q, points).items():
            if 0.001 < gap < 0.35 and found.get(link) and found[link].names[1] == "dust":
                contact = found[link]
                assert contact.distance == pytest.approx(gap - 0.01, abs=1e-5)
                if contact.distance > 1e-3:
                    apart = contact.points[1] - contact.points[0]
                    assert np.linalg.norm(apart) == pytest.approx(contact.distance, abs=1e-5)
                    np.testing.assert_allclose(apart / np.linalg.norm(apart), contact.normal, atol=1e-4)
                checked += 1
    assert checked > 20


def test_verdicts_on_clouds_equal_brute_force():
    pepper = pk.load_pepper()
    points = np.random.default_rng(1).uniform([0.35, -0.6, 0.5], [0.9, 0.6, 0.9], (400, 3))
    scene = pk.Scene().add_point_cloud("dust", points, 0.02, voxel=None)
    alone = pk.collision.checker_for(pepper)
    touched = []
    for q in random_q(pepper, 120, seed=2):
        if alone.in_collision(q):
            continue
        gap = min(gaps_to(pepper, q, points).values()) - 0.02
        if abs(gap) > 1e-5:
            assert bool(pk.collision.in_collision(pepper, q, scene)) == (gap < 0)
            assert bool(CollisionChecker(pepper, scene, 0.015).in_collision(q)) == (gap < 0.015)
            touched.append(gap < 0)
    assert 3 < sum(touched) < len(touched) - 3


def test_half_space_distance_is_the_lowest_point():
    """Of a capsule: the lower end less the radius; of a tilted plane: along its normal."""
    pepper = pk.load_pepper()
    normal, offset = np.array([0.2, -0.3, 1.0]), -0.4
    scene = pk.Scene().add_half_space("slope", normal, offset)
    unit = normal / np.linalg.norm(normal)
    for q in random_q(pepper, 10, seed=3):
        expected = {}
        for shape in pepper.collision_shapes:
            pose = pk.kinematics.frame_pose(pepper, q, shape.link) @ shape.transform_shape_to_link
            g = shape.geometry
            if isinstance(g, Box):
                reach = np.abs(pose[:3, :3].T @ unit) @ np.array(g.size) / 2
            else:
                reach = g.radius + abs(pose[:3, 2] @ unit) * getattr(g, "length", 0.0) / 2
            gap = pose[:3, 3] @ unit - offset - reach
            expected[shape.link] = min(gap, expected.get(shape.link, np.inf))
        found = {
            c.names[0]: c for c in pk.collision.contacts(pepper, q, scene, within=3.0) if "slope" in c.names
        }
        assert found.keys() == expected.keys()
        for link, contact in found.items():
            assert contact.distance == pytest.approx(expected[link], abs=1e-6)
            assert contact.points[1] @ unit == pytest.approx(offset, abs=1e-6)
            np.testing.assert_allclose(contact.normal, -unit, atol=1e-5)
        nearest = pk.collision.closest_pair(pepper, q, scene)
        own = pk.collision.closest_pair(pepper, q)
        assert nearest.distance == pytest.approx(min(own.distance, *expected.values()), abs=1e-6)


@pytest.mark.parametrize("kind", ["convex", "triangles"])
def test_a_box_as_a_mesh_is_as_near_as_the_box(kind):
    pepper = pk.load_pepper()
    half = np.array([0.1, 0.2, 0.15])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    pose = ((0.5, 0.2, 0.9), (0.3, -0.2, 1.0))
    box = pk.Scene().add_box("it", 2 * half, *pose)
    hull = pk.Scene().add_convex_mesh("it", corners, *pose)
    mesh = pk.Scene().add_mesh("it", corners, hull.objects["it"].geometry.faces, *pose)
    other = hull if kind == "convex" else mesh
    checked = 0
    for q in random_q(pepper, 30, seed=4):
        pairs = [
            {c.names: c for c in pk.collision.contacts(pepper, q, scene, within=0.5) if "it" in c.names}
            for scene in (box, other)
        ]
        for names, contact in pairs[0].items():
            if contact.distance > 0 or kind == "convex":
                assert pairs[1][names].distance == pytest.approx(contact.distance, abs=1e-4)
                checked += 1
        assert bool(pk.collision.in_collision(pepper, q, box)) == bool(
            pk.collision.in_collision(pepper, q, other)
        )
    assert checked > 50


def everything():
    rng = np.random.default_rng(6)
    flat = [[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0]]
    return (
        pk.Scene()
        .add_box("shelf", (0.3, 0.6, 0.05), (0.5, 0.2, 0.9), (0.2, 0.1, 0))
        .add_half_space("floor", (0, 0, 1), 0.5)
        .allow("floor", *BASE, "Pelvis", "Hip")
        .add_half_space("wall", (-1, 0.2, 0.1), -0.6)
        .add_mesh("sheet", flat, [[0, 1, 2]], (0.35, -0.5, 0.8))
        .add_convex_mesh("stone", rng.uniform(-0.15, 0.15, (20, 3)), (0.5, -0.3, 0.7))
        .add_point_cloud("dust", rng.uniform([0.3, -0.6, 0.6], [0.6, 0.6, 0.65], (200, 3)), 0.01)
        .add_point_cloud("grain", [[0.4, 0.4, 1.0]], 0.05)
        .add_cylinder("cup", 0.04, 0.1, (0, 0, 0))
        .attach("cup", "l_gripper", np.eye(4))
        .padded(0.01)
    )


@pytest.mark.parametrize("margins", [(0.0, 0.0), (0.03, 0.0), (0.02, 0.005)])
def test_the_broad_phase_misses_nothing(margins):
    """The same verdict as over all pairs, flat and boundless things included."""
    pepper = pk.load_pepper()
    checker = CollisionChecker(pepper, everything(), *margins)
    data, geometry = checker._data[0], checker._data[1]._kept
    verdicts = []
    for q in random_q(pepper, 400, seed=5):
        full = pinocchio.computeCollisions(
            pepper.pinocchio_model, data, checker._shapes.model, geometry, q, True
        )
        assert checker._touches(q) == full
        verdicts.append(full)
    assert 0.2 < np.mean(verdicts) < 1.0


def test_each_object_alone_is_found_by_the_broad_phase():
    pepper = pk.load_pepper()
    found = set()
    for name in everything().objects:
        alone = everything()
        for other in alone.names:
            alone = alone if other == name else alone.remove(other)
        checker = CollisionChecker(pepper, alone)
        for q in random_q(pepper, 150, seed=7):
            if not pk.collision.checker_for(pepper)._touches(q):
                touching = any(name in pair for pair in checker.contacts(q))
                assert checker._touches(q) == touching, name
                found |= {name} if touching else set()
    assert found == set(everything().objects)


def test_contacts_end_where_they_say():
    """Moving the second thing away by the depth along the normal leaves both just touching."""
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    hand = pk.kinematics.frame_pose(pepper, q, "l_wrist")[:3, 3]
    position = hand + np.array([0.05, 0.05, 0.0])
    scene = pk.Scene().add_box("brick", (0.1, 0.1, 0.1), position, (0.3, 0.2, 0.1))
    contact = pk.collision.contacts(pepper, q, scene)[0]
    assert "brick" in contact.names
    assert contact.distance < -0.005
    assert contact.depth == -contact.distance
    assert np.linalg.norm(contact.normal) == pytest.approx(1)
    np.testing.assert_allclose(
        contact.points[1] - contact.points[0], contact.distance * contact.normal, atol=1e-6
    )
    away = scene.move("brick", position + contact.normal * (contact.depth + 1e-4), (0.3, 0.2, 0.1))
    left = [c for c in pk.collision.contacts(pepper, q, away) if c.names == contact.names]
    assert not left or left[0].depth < contact.depth / 2
    assert contact.links == (contact.names[0], None)


def test_contacts_are_sorted_and_agree_with_the_names():
    pepper, scene = pk.load_pepper(), everything()
    for q in random_q(pepper, 60, seed=8):
        found = pk.collision.contacts(pepper, q, scene)
        names = pk.collision.checker_for(pepper, scene).contacts(q)
        assert {c.names for c in found} == set(names)
        depths = [c.distance for c in found if c.distance is not None]
        assert depths == sorted(depths)
        for contact in found:
            if contact.distance is None:
                assert contact.points is contact.normal is contact.depth is None
                assert tuple(sorted(contact.names)) in pepper.semantics.disabled_pairs


def test_contacts_refuse_nonsense():
    pepper = pk.load_pepper()
    with pytest.raises(InvalidValueError, match="within: got -1"):
        pk.collision.contacts(pepper, pepper.neutral(), within=-1)
    with pytest.raises(InvalidValueError, match=r"q: got shape \(2, 15\), expected one configuration"):
        pk.collision.contacts(pepper, np.zeros((2, 15)))
    with pytest.raises(InvalidValueError, match="margin: got nan"):
        CollisionChecker(pepper, None, np.nan)
    with pytest.raises(
        InvalidValueError, match="geometry_type: got 'nice', expected one of 'collision', 'visual'"
    ):
        CollisionChecker(pepper, geometry_type="nice")


@pytest.mark.thorough
def test_surfaces_are_thinner_than_what_contains_them():
    """With the drawn surfaces for shapes: nothing touches in Stand or in Crouch."""
    pepper = pk.load_pepper()
    assert pk.collision.contacts(pepper, pepper.posture("Stand"), geometry_type="visual") == ()
    assert pk.collision.contacts(pepper, pepper.posture("Crouch"), geometry_type="visual") == ()
    head = pk.kinematics.frame_pose(pepper, pepper.posture("Stand"), "Head")[:3, 3]
    scene = pk.Scene().add_box("beam", (0.1, 1.0, 0.02), head + np.array([0.0, 0.0, 0.1]))
    found = pk.collision.contacts(pepper, pepper.posture("Stand"), scene, geometry_type="visual")
    assert {c.names for c in found} == {("Head", "beam")}
