"""All near pairs: the same distances as the checker's, gradients by finite differences, bounds that hold."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError

SCENE = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
KINDS = [{}, {"base": "planar", "hands": "mimic"}]


def postures(pepper, count, seed):
    low, high = np.clip(pepper.lower_limits, -1, 1), np.clip(pepper.upper_limits, -1, 1)
    return np.random.default_rng(seed).uniform(low, high, (count, pepper.n))


@pytest.mark.parametrize("kind", KINDS)
def test_nearest_pair_is_the_clearance(kind):
    pepper = pk.load_pepper(**kind)
    for q in postures(pepper, 6, 0):
        near = pk.collision.near_pairs(pepper, q, 2.0, SCENE)
        assert near.distances[0] == pytest.approx(float(pk.collision.clearance(pepper, q, SCENE)), abs=1e-9)
        assert set(near.names[0]) == set(pk.collision.closest_pair(pepper, q, SCENE).names)
        assert np.all(np.diff(near.distances) >= 0)
        few = pk.collision.near_pairs(pepper, q, 0.1, SCENE)
        assert len(few) == np.sum(near.distances < 0.1)
        assert few.within == 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_the_slopes_of_the_distances(kind):
    """Central differences of the distance of every near pair; coal's distances are good to 1e-6 m only."""
    pepper, step = pk.load_pepper(**kind), 1e-4
    off = []
    for q in postures(pepper, 2, 1):
        near = pk.collision.near_pairs(pepper, q, 0.2, SCENE)
        here = _all_distances(pepper, q)
        places = [int(np.argmin(np.abs(here - distance))) for distance in near.distances]
        slopes = np.empty_like(near.gradients)
        for joint in range(pepper.n):
            change = step * np.eye(pepper.n)[joint]
            ahead, behind = _all_distances(pepper, q + change), _all_distances(pepper, q - change)
            slopes[:, joint] = (ahead - behind)[places] / (2 * step)
        assert np.all(np.abs(near.gradients[~near.movers]) < 1e-12)
        assert np.all(np.abs(slopes[~near.movers]) < 0.01)
        off.append(np.abs(slopes - near.gradients)[near.distances > 0.01].ravel())
    off = np.concatenate(off)
    assert off.size > 100
    # Where capsules are parallel or a corner takes over, the slope itself jumps.
    assert np.mean(off < 0.01) > 0.9
    assert np.median(off) < 1e-3


def _all_distances(pepper, q, scene=SCENE):
    """Distance of every pair of shapes by coal, in the checker's order."""
    return (
        np.array([result.min_distance for result in _by_coal(pepper, q, scene)])
        - _checker(pepper, scene)._shapes.paddings
    )


def _checker(pepper, scene):
    return pk.collision.checker_for(pepper, scene)


def _by_coal(pepper, q, scene):
    import pinocchio

    checker = _checker(pepper, scene)
    data, geometry = checker._data[0], checker._data[1]._kept
    full = pepper.to_full(q)
    pinocchio.updateGeometryPlacements(pepper.pinocchio_model, data, checker._shapes.model, geometry, full)
    pinocchio.computeDistances(checker._shapes.model, geometry)
    return geometry.distanceResults


def _agree_with_coal(pepper, q, distance, scene):
    """Compare everything with coal; coal's distances from boxes are good to 1e-6 m."""
    near, every = pk.collision.near_pairs(pepper, q, distance, scene), _all_distances(pepper, q, scene)
    assert set(near.indices.tolist()) == set(np.flatnonzero(every < distance).tolist())
    assert near.distances == pytest.approx(every[near.indices], abs=3e-6)
    results, checker = _by_coal(pepper, q, scene), _checker(pepper, scene)
    for place, index in enumerate(near.indices.tolist()):
        first, second = (checker._shapes.bodies[pairs[index]] for pairs in checker._shapes.pairs)
        assert near.names[place] == (first.owner, second.owner)
        # The nearest points need not be the only ones, but the direction is.
        if abs(every[index]) > 2e-3:
            assert near.normals[place] == pytest.approx(-np.array(results[index].normal), abs=2e-2)
    pads = checker._shapes.paddings[near.indices]
    gap = near.points[:, 0] - near.points[:, 1]
    assert np.einsum("ij,ij->i", near.normals, gap) == pytest.approx(near.distances + pads, abs=1e-5)
    return len(near)


CLOUD = np.random.default_rng(5).uniform((0.1, 0.1, 0.8), (0.3, 0.3, 1.0), (20, 3))
CROWD = (
    SCENE.add_sphere("ball", 0.1, (0.35, 0.2, 1.0))
    .add_cylinder("post", 0.05, 1.0, (0.1, -0.35, 0.8))
    .add_capsule("bar", 0.03, 0.5, (0.2, 0.4, 0.9))
    .add_half_space("slope", (0.1, 0.0, 1.0), 0.1)
    .add_point_cloud("cloud", CLOUD, 0.01)
)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scene", [pk.Scene(), CROWD])
def test_same_pairs_as_coal_finds(kind, scene):
    pepper, found = pk.load_pepper(**kind), 0
    for place, q in enumerate(postures(pepper, 25, 3)):
        found += _agree_with_coal(pepper, q, (0.02, 0.08, 0.3)[place % 3], scene)
    assert found > 300


def test_same_pairs_as_coal_finds_all_along_the_way_of_a_servo():
    pepper, generator = pk.load_pepper(), np.random.default_rng(7)
    servo = pk.servo.Servo(pepper, pepper.posture("Stand"), scene=SCENE)
    for tick in range(600):
        if tick % 30 == 0:
            left, right = generator.uniform((0.0, -0.2, 0.5), (0.6, 0.5, 1.3), (2, 3))
            servo.set_target([pk.ik.HandPosition("left", left), pk.ik.HandPosition("right", right)])
        state = servo.step()
        if tick % 3 == 0:
            _agree_with_coal(pepper, state.q, 0.08, SCENE)


def test_shapes_that_overlap_are_parted_the_shortest_way():
    """A box around a forearm: coal alone knows how deep, and moving along the normal by that parts them."""
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    arm = pk.kinematics.frame_pose(pepper, q, "LForeArm")[:3, 3]
    scene = pk.Scene().add_box("block", (0.2, 0.2, 0.2), arm)
    near = pk.collision.near_pairs(pepper, q, 0.01, scene)
    assert near.distances[0] == pytest.approx(float(pk.collision.clearance(pepper, q, scene)), abs=1e-6)
    assert near.distances[0] < -0.05
    moved = pk.Scene().add_box("block", (0.2, 0.2, 0.2), arm + near.distances[0] * near.normals[0])
    assert _all_distances(pepper, q, moved)[near.indices[0]] == pytest.approx(0.0, abs=1e-5)


def test_normals_and_points_belong_together():
    pepper = pk.load_pepper()
    for q in postures(pepper, 5, 2):
        near = pk.collision.near_pairs(pepper, q, 0.3, SCENE)
        gap = near.points[:, 0] - near.points[:, 1]
        assert near.normals * near.distances[:, None] == pytest.approx(gap, abs=1e-6)
        assert np.linalg.norm(near.normals, axis=1) == pytest.approx(1, abs=1e-9)
        with pytest.raises(ValueError, match="read-only"):
            near.distances[0] = 1.0


def test_misuse_is_refused_by_name():
    pepper = pk.load_pepper()
    q = pepper.posture("Stand")
    with pytest.raises(InvalidValueError, match="within: got 0"):
        pk.collision.near_pairs(pepper, q, 0)
    with pytest.raises(InvalidValueError, match=r"q: got shape \(1, 15\)"):
        pk.collision.near_pairs(pepper, q[None], 0.1)
    assert len(pk.collision.near_pairs(pepper, q, 1e-4)) == 0
