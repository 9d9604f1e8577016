"""Batches give what single calls give: verdicts and solutions to the bit, whatever stands beside a state."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.fast import FastChecker

PEPPER = pk.load_pepper()


def scene():
    rng = np.random.default_rng(0)
    made = pk.Scene().add_box("box", (0.2, 0.3, 0.2), (0.45, 0.2, 0.8), (0.3, 0.1, 0.2))
    made = made.add_cylinder("can", 0.08, 0.3, (0.4, -0.3, 0.9), (0.5, 0.0, 0.0))
    made = made.add_convex_mesh("stone", rng.normal(0.0, 0.08, (16, 3)), (0.3, 0.4, 1.0))
    return made.add_point_cloud("cloud", rng.uniform(-0.15, 0.15, (300, 3)), 0.01, (0.4, 0.0, 1.1))


@pytest.fixture(scope="module")
def states():
    rng = np.random.default_rng(1)
    return rng.uniform(PEPPER.lower_limits, PEPPER.upper_limits, (203, PEPPER.n))


@pytest.mark.parametrize("margins", [(0.0, 0.0), (0.013, 0.005)])
def test_verdicts_of_batches_are_those_of_single_states(states, margins):
    checker = FastChecker(PEPPER, scene(), *margins)
    together = checker.in_collision(states)
    assert 20 < together.sum() < 180
    assert [bool(checker.in_collision(q)) for q in states] == together.tolist()
    order = np.random.default_rng(2).permutation(len(states))
    np.testing.assert_array_equal(checker.in_collision(states[order]), together[order])


def test_distances_of_batches_are_those_of_single_states(states):
    """To rounding: coal begins where it ended with the state before."""
    together = pk.collision.clearance(PEPPER, states[:20], scene())
    alone = [pk.collision.clearance(PEPPER, q, scene()) for q in states[:20]]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-14)


def test_inverse_kinematics_in_a_scene_gives_the_same_rows():
    points = np.random.default_rng(3).uniform((0.25, 0.0, 0.7), (0.45, 0.4, 1.1), (24, 3))
    batch = pk.ik.solve_batch(PEPPER, pk.ik.HandPosition("left", points), scene=scene(), seed=5)
    for row, point in enumerate(points):
        one = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point), scene=scene(), seed=5)
        np.testing.assert_array_equal(batch.q[row], one.q)
        assert batch.status(row) is one.status
    assert batch.success.sum() > 0
