"""The rate along a time law: sequential linear programs by HiGHS as the oracle, a closed form, limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

import pepper_kin as pk
from pepper_kin.core.timing.rate_program import POINTS, RateProgram, fastest_rate, greatest_even_rate
from pepper_kin.trajectory.limits import jerk_limits, motion_limits
from pepper_kin.trajectory.path import as_cubic_path
from pepper_kin.trajectory.retiming import grid_parameters
from pepper_kin.trajectory.smooth_time import rate_program, smooth_time, to_powers


def program_of(pepper, seed, jerk, window, **options):
    """Return the program of a random path and a moving average over so many seconds."""
    rng = np.random.default_rng(seed)
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    middle = (lower + upper) / 2
    curve = as_cubic_path(pepper, middle + 0.7 * (rng.uniform(lower, upper, (4, pepper.n)) - middle))
    fastest = pk.retime(pepper, curve, **options)
    limits = motion_limits(pepper, **options).of(pepper, pepper.acceleration_limits, drives=False)
    base = smooth_time(curve, fastest.breaks, grid_parameters(curve, 200), window)
    return rate_program(pepper, curve, base, replace(limits, jerk=jerk_limits(pepper, jerk)))


def at_points(program, y):
    """Return Y at the points, shape (P, 3), and which coefficients act there, shape (P, 3)."""
    columns = (np.arange(len(program.weight)) // POINTS)[:, None] + np.arange(3)
    return np.einsum("pdc,pc->pd", program.basis, y[columns]), columns


def excess(program, y):
    """Return by how much y exceeds the limits at most."""
    at, _ = at_points(program, y)
    value = np.einsum("rdp,pd->rp", program.rows[:, :3], at) + program.rows[:, 3]
    bound = np.ones_like(value)
    bound[: program.jerk] = at[:, 0] ** -0.5
    return max((value - bound).max(), (-value - bound)[: program.both].max())


def by_linear_programs(program, trust=2.0):
    """Return the duration after as many linear programs, each with tangents at the last y, as it takes."""
    size = len(program.weight) // POINTS + 2
    y = np.full(size, 0.9 * greatest_even_rate(program))
    duration = np.inf
    for _ in range(60):
        at, columns = at_points(program, y)
        before, duration = duration, float(np.sum(program.weight / np.sqrt(at[:, 0])))
        if duration > before * (1 - 1e-5):
            return min(duration, before)
        rows = np.einsum("rdp,pdc->prc", program.rows[:, :3], program.basis)
        upper = 1 - program.rows[:, 3].T
        lower = 1 + program.rows[: program.both, 3].T
        tangent = (0.5 * at[:, 0] ** -1.5)[:, None, None] * program.basis[:, None, 0]
        high, low = rows.copy(), -rows[:, : program.both]
        high[:, : program.jerk] += tangent
        low[:, : program.jerk] += tangent
        upper[:, : program.jerk] = lower[:, : program.jerk] = 1.5 * at[:, :1] ** -0.5
        table, bound = np.concatenate([high, low], axis=1), np.concatenate([upper, lower], axis=1)
        place = np.repeat(columns[:, None], table.shape[1], axis=1)
        near = np.einsum("prc,prc->pr", np.abs(table), y[place]) > 0.2 * bound  # others cannot be reached
        start = np.arange(0, 3 * near.sum() + 1, 3)
        matrix = csr_matrix((table[near].ravel(), place[near].ravel(), start), shape=(near.sum(), size))
        cost = np.zeros(size)
        np.add.at(cost, columns, -(program.weight * at[:, 0] ** -1.5)[:, None] * program.basis[:, 0])
        box = np.stack([y / trust, y * trust], axis=1)
        found = linprog(cost, A_ub=matrix, b_ub=bound[near], bounds=box, method="highs")
        assert found.status == 0, found.message
        y = found.x
        assert excess(program, y) < 1e-6
    raise AssertionError("linear programs do not converge")


@pytest.mark.parametrize(
    ("seed", "jerk", "window", "options"),
    [(0, "gentle", 0.3, {}), (1, "brisk", 0.1, {"torque": False}), (2, "moderate", 0.5, {"balance": 0.005})],
)
def test_it_is_as_fast_as_linear_programs(pepper, seed, jerk, window, options):
    program = program_of(pepper, seed, jerk, window, **options)
    y = np.empty(len(program.weight) // POINTS + 2)
    found, least = fastest_rate(program, y, 1e-3, 60), by_linear_programs(program)
    assert found == pytest.approx(np.sum(program.weight / np.sqrt(at_points(program, y)[0][:, 0])))
    assert found == pytest.approx(least, rel=2e-3)
    assert excess(program, y) < 0


def test_every_iterate_keeps_all_limits_and_is_positive(pepper):
    program = program_of(pepper, 3, "moderate", 0.2)
    y = np.empty(len(program.weight) // POINTS + 2)
    durations = []
    for steps in range(40):
        durations.append(fastest_rate(program, y, 1e-4, steps))
        assert excess(program, y) < 0
        assert y.min() > 0
    even = np.sum(program.weight) / np.sqrt(0.9 * greatest_even_rate(program))
    assert durations[0] == pytest.approx(even)
    assert durations[-1] == durations[-2]  # it has stopped


def plain_program(knots, bound, rest=0.0):
    """Return the program of y <= bound(tau), which no other limit acts on."""
    step = np.diff(knots)
    powers = np.repeat(to_powers(knots), POINTS, axis=0)
    local = (step[:, None] * np.linspace(0, 1, POINTS)).ravel()[:, None]
    slope = powers[:, 1] + local * powers[:, 2]
    basis = np.stack([powers[:, 0] + local * (powers[:, 1] + slope) / 2, slope, powers[:, 2]], axis=1)
    rows = np.zeros((2, 4, len(local)))
    rows[0, 3] = rest
    rows[1, 0] = 1 / bound(np.repeat(knots[:-1], POINTS) + local[:, 0])
    return RateProgram(basis, (step[:, None] * np.array([1, 4, 1]) / 6).ravel(), rows, 0, 1)


def test_a_parabola_below_which_y_must_stay_is_reached():
    knots = np.cumsum(np.random.default_rng(0).uniform(0.5, 1.5, 13))
    program = plain_program(knots, lambda tau: 1 + 0.1 * (tau - 4) ** 2)
    y = np.empty(14)
    found = fastest_rate(program, y, 1e-8, 60)
    dense = np.linspace(knots[0], knots[-1], 100_001)
    np.testing.assert_allclose(at_points(program, y)[0][:, 0] * program.rows[1, 0], 1.0, rtol=1e-5)
    assert found == pytest.approx(np.trapezoid((1 + 0.1 * (dense - 4) ** 2) ** -0.5, dense), rel=1e-3)


@pytest.mark.parametrize("rest", [1.0, -1.0, 2.0])
def test_where_the_robot_cannot_rest_there_is_no_rate(rest):
    program = plain_program(np.arange(5.0), np.ones_like, rest)
    assert greatest_even_rate(program) == 0.0
    assert fastest_rate(program, np.empty(6), 1e-3, 60) == np.inf
