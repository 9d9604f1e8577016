"""Contact points of all pairs of shapes against coal's distances, and of boxes against plain geometry."""

import itertools

import coal
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pepper_kin.collision import ConvexMesh, PointCloud, Scene, TriangleMesh
from pepper_kin.collision.coal_shapes import coal_geometry
from pepper_kin.model import Box, Capsule, Cylinder, Sphere
from pepper_kin.twin.world import World

CORNERS = np.array(list(itertools.product((-0.08, 0.08), (-0.05, 0.05), (-0.03, 0.03))))
STANDING = {
    "box": Box((0.3, 0.2, 0.1)),
    "ball": Sphere(0.08),
    "capsule": Capsule(0.05, 0.2),
    "cylinder": Cylinder(0.06, 0.15),
    "hull": ConvexMesh(CORNERS),
    "padded hull": ConvexMesh(CORNERS, 0.01),
    "surface": TriangleMesh([[-0.2, -0.2, 0], [0.2, -0.2, 0], [0, 0.3, 0.05]], [[0, 1, 2]]),
    "cloud": PointCloud(0.1 * np.random.default_rng(0).normal(size=(20, 3)), 0.02),
}


def placed(shape, position, rotation):
    transform = coal.Transform3s()
    transform.setRotation(rotation)
    transform.setTranslation(np.asarray(position))
    return coal_geometry(shape), transform


def distance(a, b):
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.enable_signed_distance = True
    return coal.distance(*a, *b, request, result)


@pytest.mark.parametrize("free", ["box", "ball"])
@pytest.mark.parametrize("name", STANDING)
def test_the_nearest_point_is_at_coals_distance(name, free):
    """Bodies held apart by hundredths of a millimeter to millimeters, in random attitudes."""
    rng = np.random.default_rng(7)
    shape, own = STANDING[name], Box((0.12, 0.1, 0.08)) if free == "box" else Sphere(0.06)
    pad = getattr(shape, "padding", getattr(shape, "radius", 0.0) if name == "cloud" else 0.0)
    for _ in range(60):
        rpy, own_rpy = rng.uniform(-3, 3, 3), rng.uniform(-3, 3, 3)
        rotation = Rotation.from_euler("xyz", rpy).as_matrix()
        own_rotation = Rotation.from_euler("xyz", own_rpy).as_matrix()
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        target = rng.uniform(1e-5, 1.5e-3)
        standing = placed(shape, np.zeros(3), rotation)
        sharp = free == "box" or name == "cylinder"
        low, high = 0.0, 1.0
        for _ in range(50):  # how far along the way they are apart by the target
            middle = (low + high) / 2
            gap = distance(placed(own, middle * way, own_rotation), standing) - pad
            low, high = (low, middle) if gap > target else (middle, high)
        world = World(None, Scene().add("it", shape, rpy=rpy), gravity=(0, 0, 0))
        if free == "box":
            world.add_box("body", own.size, 1.0, high * way, own_rpy)
        else:
            world.add_ball("body", own.radius, 1.0, high * way)
        world.advance_alone(1e-3)
        assert world.contacts
        nearest = min(world.contacts, key=lambda contact: contact.gap)
        # corners that coal sees are rounded by 0.2 mm, so that gaps there are wider by up to 2 x 0.15 mm
        assert target - 2e-5 < nearest.gap < target + (3e-4 if sharp else 2e-5)
        assert np.linalg.norm(nearest.normal) == pytest.approx(1.0)
        # moving the body along the normal opens the gap by as much
        before = distance(placed(own, high * way, own_rotation), standing)
        place = high * way + 1e-4 * nearest.normal
        after = distance(placed(own, place, own_rotation), standing)
        assert after - before == pytest.approx(1e-4, abs=1e-5)


def test_a_box_on_a_larger_box_touches_at_its_four_corners():
    world = World(None, Scene().add_box("table", (1, 1, 0.1), (0, 0, 0)))
    world.add_box("box", (0.2, 0.1, 0.1), 1.0, (0.1, 0.0, 0.1), (0, 0, 0.3))
    world.advance_alone(1e-3)
    rotation = Rotation.from_euler("z", 0.3).as_matrix()
    corners = [rotation @ [x, y, 0] + [0.1, 0, 0.05] for x in (-0.1, 0.1) for y in (-0.05, 0.05)]
    found = np.array([contact.point for contact in world.contacts])
    assert len(found) == 4
    for corner in corners:
        assert np.linalg.norm(found - corner, axis=1).min() < 1e-12
    for contact in world.contacts:
        assert contact.normal == pytest.approx([0, 0, 1], abs=1e-12)
        assert contact.gap == pytest.approx(0.0, abs=1e-12)


def test_crossed_boxes_touch_where_their_faces_overlap():
    world = World(None, Scene().add_box("beam", (1, 0.1, 0.1), (0, 0, 0)))
    world.add_box("box", (0.06, 1, 0.1), 1.0, (0.2, 0.0, 0.1))
    world.advance_alone(1e-3)
    found = np.array(sorted(contact.point.round(9).tolist() for contact in world.contacts))
    wanted = [[0.17, -0.05, 0.05], [0.17, 0.05, 0.05], [0.23, -0.05, 0.05], [0.23, 0.05, 0.05]]
    assert found == pytest.approx(np.array(wanted))


def test_crossed_edges_touch_in_one_point_with_the_edges_normal():
    scene = Scene().add_box("ridge", (1, 0.1, 0.1), (0, 0, 0), (np.pi / 4, 0, 0))
    world = World(None, scene, gravity=(0, 0, 0))
    edge = 0.05 * np.sqrt(2)
    world.add_box("box", (0.1, 1, 0.1), 1.0, (0.2, 0.1, 2 * edge + 5e-4), (0, np.pi / 4, 0))
    world.advance_alone(1e-3)
    (contact,) = world.contacts
    assert contact.normal == pytest.approx([0, 0, 1], abs=1e-6)
    assert contact.point[:2] == pytest.approx([0.2, 0.0], abs=1e-6)
    # two corners of 90 degrees, each rounded by 0.2 mm: (sqrt 2 - 1) times that wider
    assert contact.gap == pytest.approx(5e-4 + 4e-4 * (np.sqrt(2) - 1), abs=1e-6)


def test_an_octagon_of_points_is_thinned_to_four_that_carry_the_box():
    world = World(None, Scene().add_box("table", (0.2, 0.2, 0.1), (0, 0, 0)))
    world.add_box("box", (0.2, 0.2, 0.1), 1.0, (0, 0, 0.1), (0, 0, np.pi / 4))
    for _ in range(300):
        world.advance_alone(1e-3)
    assert len(world.contacts) == 4
    assert world.bodies["box"].position == pytest.approx([0, 0, 0.1], abs=1e-6)
