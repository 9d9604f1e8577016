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


def _all_distances(pepper, q):
    """Distance of every pair of shapes, in the checker's order."""
    import pinocchio

    checker = pk.collision.checker_for(pepper, SCENE)
    data, geometry = checker._data
    full = pepper.to_full(q)
    pinocchio.updateGeometryPlacements(pepper.pinocchio_model, data, checker._model, geometry, full)
    pinocchio.computeDistances(checker._model, geometry)
    return np.array([result.min_distance for result in geometry.distanceResults])


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
    with pytest.raises(InvalidValueError, match="distance: got 0"):
        pk.collision.near_pairs(pepper, q, 0)
    with pytest.raises(InvalidValueError, match=r"q: got shape \(1, 15\)"):
        pk.collision.near_pairs(pepper, q[None], 0.1)
    assert len(pk.collision.near_pairs(pepper, q, 1e-4)) == 0
