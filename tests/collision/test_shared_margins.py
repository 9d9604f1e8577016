"""Checkers of the same shapes with other margins, which share what margins do not touch."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker, checker_for
from pepper_kin.collision.fast import fast_checker_for
from pepper_kin.exceptions import InvalidValueError

PEPPER = pk.load_pepper()
SCENE = (
    pk.Scene().add_box("table", (0.6, 1.0, 0.04), (0.55, 0.0, 0.70)).add_sphere("ball", 0.1, (0.3, 0.4, 0.9))
)


def test_verdicts_are_those_of_a_checker_made_anew():
    rng = np.random.default_rng(0)
    q = rng.uniform(PEPPER.lower_limits, PEPPER.upper_limits, (300, PEPPER.n))
    for margins in ((0.01, 0.0), (0.0, 0.004), (0.02, 0.01), (0.0, 0.0)):
        anew = CollisionChecker(PEPPER, SCENE, *margins)
        shared = checker_for(PEPPER, SCENE, *margins)
        assert (shared.margin, shared.self_margin) == margins
        assert shared.shapes_of is checker_for(PEPPER, SCENE)
        expected = anew.in_collision(q)
        np.testing.assert_array_equal(shared.in_collision(q), expected)
        np.testing.assert_array_equal(fast_checker_for(PEPPER, SCENE, *margins).in_collision(q), expected)
        np.testing.assert_allclose(shared.clearance(q[:20]), anew.clearance(q[:20]), atol=1e-9)


@pytest.mark.parametrize("gap", [0.002, 0.008, 0.03])
def test_what_rests_near_the_base_is_judged_by_each_margin(gap):
    """A low wall before the base, which never moves against it: only the margins differ."""

    def wall(x):
        return pk.Scene().add_box("wall", (0.02, 2.0, 0.2), (x, 0.0, 0.1))

    def distance(scene):
        found = pk.collision.contacts(PEPPER, stand, scene, within=2.0)
        return min(one.distance for one in found if "wall" in one.names)

    stand = PEPPER.posture("Stand")
    scene = wall(1.5 - distance(wall(1.5)) + gap)
    assert distance(scene) == pytest.approx(gap, abs=1e-5)
    for margin in (0.0, 0.004, 0.01, 0.05):
        expected = margin > gap
        assert bool(fast_checker_for(PEPPER, scene, margin).in_collision(stand)) == expected
        assert bool(checker_for(PEPPER, scene, margin).in_collision(stand)) == expected


def test_a_margin_that_is_no_distance_is_refused():
    with pytest.raises(InvalidValueError, match="margin: got nan"):
        checker_for(PEPPER, SCENE).with_margins(float("nan"), 0.0)
