"""Distances and ranges that the optimizer sees, against coal, tables and finite differences."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.dynamics.load import Load
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.motion.optimization.balance_term import INFLUENCE as BALANCE_INFLUENCE
from pepper_kin.motion.optimization.balance_term import BalanceTerm
from pepper_kin.motion.optimization.clearance_term import INFLUENCE, ClearanceTerm
from pepper_kin.motion.optimization.moving import Moving
from pepper_kin.motion.optimization.range_term import RangeTerm
from pepper_kin.motion.optimization.torque_term import TorqueTerm
from pepper_kin.trajectory.balance import edge_moments, support_polygon

SCENE = (
    pk.Scene()
    .add_box("table", size=(0.6, 1.2, 0.04), position=(0.53, 0.0, 0.72))
    .add_cylinder("can", 0.04, 0.2, (0.5, 0.1, 0.85), (0.3, 0.2, 0.0))
    .add_capsule("bar", 0.04, 0.2, (0.5, 0.4, 0.95), (0.3, 0.2, 0.0))
    .add_sphere("ball", 0.1, (0.4, -0.6, 1.0))
)


def moving_of(pepper):
    return Moving(pepper, np.arange(pepper.n), pepper.neutral())


def random_states(pepper, count, seed=0):
    lower, upper = np.clip(pepper.lower_limits, -2, 2), np.clip(pepper.upper_limits, -2, 2)
    return np.random.default_rng(seed).uniform(lower, upper, (count, pepper.n))


@pytest.mark.parametrize("hands", ["locked", "mimic"])
def test_distances_agree_with_coal(hands):
    pepper = pk.load_pepper(hands=hands)
    q = random_states(pepper, 250)
    term = ClearanceTerm(moving_of(pepper), SCENE, 0.0, 1)
    found = np.array([term.least_distance(state[None]) for state in q])
    assert term.least_distance(q) == pytest.approx(found.min(), abs=1e-12)
    clear = q[found > 0.0]
    assert term.least_distance(clear) == pytest.approx(found[found > 0.0].min(), abs=1e-12)
    exact = pk.collision.clearance(pepper, q, SCENE)
    near = (exact > 0) & (exact < INFLUENCE)
    assert near.sum() > 40
    np.testing.assert_allclose(found[near], exact[near], atol=1e-5)
    assert np.median(np.abs(found[near] - exact[near])) < 1e-6
    assert np.all(found[exact >= INFLUENCE] > INFLUENCE - 1e-3)
    assert np.all(found[exact < 0] < 5e-3)


def differences(function, q, step=1e-6):
    columns = []
    for j in range(q.shape[1]):
        move = np.zeros(q.shape[1])
        move[j] = step
        columns.append((function(q + move) - function(q - move)) / (2 * step))
    return np.stack(columns, axis=-1)


def test_derivatives_of_distances_agree_with_finite_differences():
    pepper = pk.load_pepper()
    term, q = ClearanceTerm(moving_of(pepper), SCENE, 0.01, 1), random_states(pepper, 60, seed=2)
    rows = term.rows(q, q, q)
    np.testing.assert_array_equal(rows.value, term.values(q, q, q))
    numeric = differences(lambda x: term.values(x, x, x)[:, 0], q)
    # Not where the nearest pair is about to change, or bodies overlap.
    clear = (rows.value[:, 0] > 0) & (rows.value[:, 0] < 0.99) & (np.diff(rows.value[:, :2])[:, 0] > 1e-3)
    assert clear.sum() > 10
    error = np.abs(rows.by_position[clear, 0] - numeric[clear]).max(axis=1)
    assert np.quantile(error, 0.9) < 1e-4
    assert np.abs(numeric[clear]).max() > 1.0


def assert_rows(term, expected, q, v, a):
    """Values are as expected, and slopes those of differences."""
    rows = term.rows(q, v, a)
    np.testing.assert_allclose(rows.value, expected, atol=1e-9)
    for part, numeric in (
        (rows.by_position, differences(lambda x: term.values(x, v, a), q)),
        (rows.by_velocity, differences(lambda x: term.values(q, x, a), v)),
        (rows.by_acceleration, differences(lambda x: term.values(q, v, x), a)),
    ):
        np.testing.assert_allclose(part, numeric, atol=1e-5)


LOADS = (
    Load("LArm_effector", 0.7, (0.02, -0.01, 0.05), (2e-3, 1e-4, 0.0, 3e-3, -1e-4, 2.5e-3)),
    Load("RArm_effector", 0.2),
)


@pytest.mark.thorough
@pytest.mark.parametrize("loads", [(), LOADS], ids=["empty hands", "loads"])
def test_torques_and_their_derivatives(loads):
    pepper = pk.load_pepper()
    q, v, a = (random_states(pepper, 12, seed=s) for s in (13, 14, 15))
    model = pepper.inner_model.copy()
    for load in loads:
        frame = model.frames[pepper.frame_id(load.frame)]
        body = pinocchio.Inertia(load.mass, np.array(load.center), load.tensor)
        model.appendBodyToJoint(frame.parentJoint, body, frame.placement)
    data = model.createData()
    expected = np.array([pinocchio.rnea(model, data, *state) for state in zip(q, v, a, strict=True)])
    term = TorqueTerm(moving_of(pepper), pepper.effort_limits, 1, loads)
    assert_rows(term, expected / pepper.effort_limits, q, v, a)


@pytest.mark.thorough
@pytest.mark.parametrize("loads", [(), LOADS], ids=["empty hands", "loads"])
def test_balance_and_its_derivatives(loads):
    pepper = pk.load_pepper()
    q, v, a = (random_states(pepper, 12, seed=s) for s in (3, 4, 5))
    weight = 9.81 * pk.dynamics.total_mass(pepper) * BALANCE_INFLUENCE
    expected = edge_moments(pepper, support_polygon(pepper), q, v, a, 0.01, loads) / weight
    assert_rows(BalanceTerm(moving_of(pepper), 0.01, 1, loads), expected, q, v, a)


def test_balance_of_a_moving_base_is_refused():
    with pytest.raises(InvalidValueError, match="expected None for a robot without wheels"):
        BalanceTerm(moving_of(pk.load_pepper(base="planar")), 0.0, 1)


def test_ranges_lie_inside_the_tables():
    """Where the term sees room no table is violated, and it sees room almost wherever none is."""
    pepper = pk.load_pepper()
    q = random_states(pepper, 4000, seed=6)
    term = RangeTerm(moving_of(pepper), 0.0, 1)
    free = (term.values(q, q, q) > 0).all(axis=1)
    exact = ~np.any([table.violated(q) for table in dependent_ranges(pepper)], axis=0)
    assert np.all(exact[free])
    assert free.sum() > 0.9 * exact.sum()


def test_derivatives_of_ranges_agree_with_finite_differences():
    pepper = pk.load_pepper()
    q, term = random_states(pepper, 200, seed=7), RangeTerm(moving_of(pepper), 0.0, 1)
    rows = term.rows(q, q, q)
    numeric = differences(lambda x: term.values(x, x, x), q, 1e-7)
    assert np.mean(np.abs(rows.by_position - numeric) < 1e-5) > 0.999  # not at corners


def test_floors_admit_a_start_that_is_too_near_and_rise_behind_it():
    pepper = pk.load_pepper()
    q = random_states(pepper, 100, seed=8)
    term = ClearanceTerm(moving_of(pepper), SCENE, 0.05, 1)
    assert term.values(q, q, q).min() < 0
    term.start_from(q)
    slack = term.values(q, q, q)
    assert slack.min() > 0
    exact = pk.collision.clearance(pepper, q, SCENE)
    apart = exact > 1e-3
    floor = 0.05 + term.floor
    assert np.all(floor[apart] > 0)  # no floor lets bodies touch that are apart
    before, clearest = term.floor.copy(), np.tile(q[np.argmax(exact)], (100, 1))
    assert exact.max() > 0.06
    term.tighten(clearest)
    assert np.all(term.floor == 0.0)
    assert np.any(before < 0)
