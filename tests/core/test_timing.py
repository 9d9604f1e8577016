"""Time-optimal parameterization on tables alone: closed forms, repeated passes, interpreted runs."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.batch import kernel
from pepper_kin.core.kernel_batch import evaluate, linear_speed_share, matrix_product
from pepper_kin.core.timing import parameterization as timing
from pepper_kin.core.timing.grid import fill_grid, interval_count
from pepper_kin.core.timing.reachability import fastest_profile, repeat_passes
from pepper_kin.core.timing.tables import PathEffects, PathGrid, PathLimits, PathRows, ProfileSpace


def make_grid(size, nodes, n):
    return PathGrid(
        np.empty(size), np.empty(size, np.int64), np.empty(size + 1), np.empty((3, nodes, n)), np.empty((size,
        4, n))
    )  # fmt: skip


def make_rows(size, nodes, n, r):
    by_node, by_interval = (lambda: np.empty((nodes, r))), (lambda: np.empty((size, r)))
    return PathRows(
        by_node(), by_node(), by_node(), np.empty((3, size, r - n)), by_interval(), by_interval(),
        np.empty(size + 1)
    )  # fmt: skip


def make_space(size, r):
    return ProfileSpace(
        np.empty((size, 3, 2 * r + 1)), np.empty((size, 3)), np.empty((size + 1, 2)), np.ones(size, bool),
        np.zeros(size + 1), np.empty(size + 1),
    )  # fmt: skip


def uniform_grid(step):
    """A grid of which the passes read no more than lengths and nodes."""
    size = len(step)
    grid = make_grid(size, size + 1, 1)
    grid.step[:], grid.first[:] = step, np.arange(size)
    return grid


def time_rows(a, b, c, bound, x_most):
    size, r = bound.shape
    rows = make_rows(size, size + 1, r, r)
    rows.a[:], rows.b[:], rows.c[:], rows.low[:], rows.high[:], rows.x_most[:] = (
        a,
        b,
        c,
        -bound,
        bound,
        x_most,
    )
    return rows


def test_a_double_integrator_goes_at_its_closed_form():
    """Unit length and |u| <= 2: x = min(4 s, 4 (1 - s)), or the bound on x."""
    size = 40
    grid, space = uniform_grid(np.full(size, 1 / size)), make_space(size, 1)
    one, zero, bound = np.ones((size + 1, 1)), np.zeros((size + 1, 1)), np.full((size, 1), 2.0)
    s = np.linspace(0, 1, size + 1)
    for x_most in (1e6, 0.5):
        assert fastest_profile(grid, time_rows(one, zero, zero, bound, x_most), space) == -1
        expected = np.minimum(x_most, np.minimum(4 * s, 4 * (1 - s)))
        np.testing.assert_allclose(space.x, expected, atol=1e-12)


def test_passes_say_where_there_is_no_way():
    size = 10
    a, c = np.ones((size + 1, 1)), np.zeros((size + 1, 1))
    c[6] = 5.0  # there the row asks for u <= -3 on one side and u >= -1 just before
    b = -1.0 * (np.arange(size + 1) == 6)[:, None]
    rows = time_rows(a, b, c, np.full((size, 1), 2.0), 0.1)
    assert fastest_profile(uniform_grid(np.full(size, 1e-3)), rows, make_space(size, 1)) >= 0


@pytest.mark.parametrize("seed", range(6))
def test_repeated_passes_are_passes_from_the_start(seed):
    """Constraints are tightened at random places; only what follows from that is computed anew."""
    rng = np.random.default_rng(seed)
    size, r = 60, 7
    grid = uniform_grid(rng.uniform(0.01, 0.03, size))
    a, b, c = rng.normal(size=(3, size + 1, r))
    a[:, 0], c = 1.0, 0.3 * c
    b[20:25, 3] = a[20:25, 3] = 0.0  # a row without u
    rows = time_rows(a, b, c, np.full((size, r), 3.0), rng.uniform(2.0, 20.0, size + 1))
    space, anew = make_space(size, r), make_space(size, r)
    space.reach[:], space.x[:] = 0.0, 0.0
    for _ in range(5):
        assert repeat_passes(grid, rows, space) == fastest_profile(grid, rows, anew) == -1
        np.testing.assert_allclose(space.x, anew.x, rtol=1e-12, atol=1e-14)
        space.changed[:] = changed = rng.random(size) < 0.1
        rows.high[changed] *= 0.97
        rows.low[changed] *= 0.97
        rows.x_most[:-1][changed] *= 0.95


def straight_line(intervals=200):
    """One joint over a way of 2, |dq/dt| <= 1 and |d2q/dt2| <= 2, on a path parameter of its own."""
    breaks, coefficients = np.array([0.0, 0.5]), np.array([[[1.0], [4.0], [0.0], [0.0]]])
    size = interval_count(breaks, intervals)
    grid = make_grid(size, size + 1, 1)
    fill_grid(breaks, coefficients, intervals, grid)
    none = np.empty((3, size + 1, 0))
    effects = PathEffects(none, none, np.empty((size + 1, 0)), np.empty((size, 0)))
    limits = PathLimits(np.array([1.0]), np.array([2.0]), np.empty(0), 1e12)
    return grid, effects, limits, make_rows(size, size + 1, 1, 1), make_space(size, 1)


def test_a_straight_line_takes_the_time_of_a_trapezoid():
    """To v = 1 in 0.5 s over 0.25, 1.5 s at v, and down: 2.5 s."""
    tables = straight_line()
    assert timing.optimal_profile(*tables) == pytest.approx((timing.FOUND, -1, 1.0))
    grid, best = tables[0], tables[-1].best
    assert timing.profile_duration(grid, best) == pytest.approx(2.5, abs=1e-2)
    breaks, coefficients = np.empty(201), np.empty((200, 7, 1))
    timing.motion_polynomials(grid, best, 2.0, breaks, coefficients)
    assert breaks[-1] == pytest.approx(2 * timing.profile_duration(grid, best))
    np.testing.assert_allclose(coefficients[:, 0, 0], 1.0 + 4.0 * grid.s[:-1], atol=1e-12)


def test_kernels_by_address_give_what_they_give():
    pepper = pk.load_pepper()
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 50, pepper.n))
    torque, speed = kernel(pepper, "inverse_dynamics"), kernel(pepper, "frame_velocity", "LArm_effector")
    np.testing.assert_array_equal(evaluate(torque, q, v, a), torque(q, v, a))
    np.testing.assert_array_equal(evaluate(speed, q, v), speed(q, v))
    wrench, gain, shares = rng.normal(size=(50, 6)), rng.normal(size=(6, 3)), np.zeros((50, 2))
    product = np.empty((50, 3))
    matrix_product(wrench, gain, product)
    np.testing.assert_allclose(product, wrench @ gain, atol=1e-12)
    linear_speed_share(wrench, 2.0, 1, shares)
    np.testing.assert_allclose(shares[:, 1], np.linalg.norm(wrench[:, :3], axis=1) / 2)
    assert not shares[:, 0].any()
