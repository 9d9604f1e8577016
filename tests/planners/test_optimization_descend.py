"""Motions of points, whose best is known."""

import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners.optimization import (
    BarrierBound,
    Bounds,
    Objective,
    OptimizationStatus,
    RestSpline,
    Rows,
    Weights,
    descend,
)
from pepper_kin.planners.optimization.system import fill_system, solve_system
from pepper_kin.planners.optimization.tables import CORNER, FALL, SLOPE, STEP

FREE = np.full(2, np.inf)
ONE = np.ones(2)
NO_BOUNDS = Bounds(-FREE, FREE, FREE, FREE)


class Disc:
    """Distance of a point to a disc, as a slack."""

    per_interval, barrier_bound = 4, BarrierBound.ABOVE_ZERO

    def __init__(self, center, radius):
        self.center, self.radius = np.array(center), radius

    def values(self, q, v, a):
        return (np.linalg.norm(q - self.center, axis=1) - self.radius)[:, None] / 0.3

    def rows(self, q, v, a):
        way = q - self.center
        return Rows(self.values(q, v, a), (way / np.linalg.norm(way, axis=1)[:, None])[:, None] / 0.3)


class Pull:
    """Some nonlinear function of position, velocity and acceleration, to check derivatives with."""

    per_interval = 2

    def __init__(self, barrier_bound):
        self.barrier_bound = barrier_bound

    def values(self, q, v, a):
        wave = np.sin(q[:, :1]) * v[:, 1:] * 0.05 + 0.02 * a[:, :1] * q[:, 1:]
        return np.hstack([wave, 0.01 * a[:, 1:]]) + (
            0.5 if self.barrier_bound is BarrierBound.ABOVE_ZERO else 0.0
        )

    def rows(self, q, v, a):
        by_q, by_v, by_a = np.zeros((3, len(q), 2, 2))
        by_q[:, 0, 0] = np.cos(q[:, 0]) * v[:, 1] * 0.05
        by_q[:, 0, 1] = 0.02 * a[:, 0]
        by_v[:, 0, 1] = np.sin(q[:, 0]) * 0.05
        by_a[:, 0, 0], by_a[:, 1, 1] = 0.02 * q[:, 1], 0.01
        return Rows(self.values(q, v, a), by_q, by_v, by_a)


def smooth(s):
    return 3 * s**2 - 2 * s**3


def straight(spline):
    return spline.fit(spline.start + smooth(np.linspace(0, 1, 400)[:, None]) * (spline.goal - spline.start))


def test_least_jerk_is_the_polynomial_of_degree_five():
    """Of all motions from rest to rest 10 s^3 - 15 s^4 + 6 s^5 has the least jerk: 720 d^2 / T^5."""
    spline = RestSpline([0.0, 1.0], [1.0, -1.0], 12, 5)
    objective = Objective(spline, NO_BOUNDS, Weights(0.0, 1.0, ONE))
    found = descend(objective, straight(spline), 2.0, free_duration=False)
    assert found.status is OptimizationStatus.CONVERGED
    assert found.duration == 2.0
    assert found.cost == pytest.approx(720 * (1 + 4) / 2**5, rel=1e-6)
    s = np.linspace(0, 1, 50)
    expected = spline.start + (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None] * (spline.goal - spline.start)
    np.testing.assert_allclose(spline.basis(s) @ spline.control_points(found.unknowns), expected, atol=1e-5)


def test_cubic_splines_approach_the_least_jerk_with_the_square_of_their_spacing():
    violation = []
    for intervals in (8, 16, 32):
        spline = RestSpline([0.0], [1.0], intervals)
        bounds = Bounds(*(s * np.full(1, np.inf) for s in (-1, 1, 1, 1)))
        objective = Objective(spline, bounds, Weights(0.0, 1.0, np.ones(1)))
        violation.append(descend(objective, straight(spline), 1.0, free_duration=False).cost / 720 - 1)
    order = np.log2(np.divide(violation[:-1], violation[1:]))
    assert np.all(np.abs(order - 2) < 0.3), order


def test_best_duration_balances_time_and_jerk():
    """w_t T + w_j 720 / T^5 is least at T = (3600 w_j / w_t)^(1/6)."""
    spline = RestSpline([0.0, 0.0], [1.0, 0.0], 12, 5)
    objective = Objective(spline, NO_BOUNDS, Weights(1.0, 1e-3, ONE))
    found = descend(objective, straight(spline), 5.0)
    assert found.duration == pytest.approx((3600 * 1e-3) ** (1 / 6), rel=2e-3)


@pytest.mark.parametrize(("intervals", "violation"), [(20, 0.08), (40, 0.045)])
def test_shortest_motion_approaches_full_acceleration_and_braking(intervals, violation):
    """With |a| <= 1 a way of 2 takes 2 sqrt(2) s; ramps of the acceleration cost about one interval."""
    spline = RestSpline([0.0, 0.0], [1.0, 2.0], intervals)
    objective = Objective(spline, Bounds(-FREE, FREE, FREE, ONE), Weights(1.0, 1e-9, ONE))
    found = descend(objective, straight(spline), 12.0, max_iterations=300, tolerance=1e-6)
    best = 2 * np.sqrt(2)
    assert best < found.duration < best * (1 + violation)


def test_limits_hold_at_every_time():
    spline = RestSpline([0.0, 0.0], [1.0, 2.0], 16)
    bounds = Bounds(np.array([-0.1, -0.1]), np.array([1.1, 2.05]), 0.9 * ONE, 1.5 * ONE)
    found = descend(Objective(spline, bounds, Weights(1.0, 1e-6, ONE)), straight(spline), 20.0)
    control, s = spline.control_points(found.unknowns), np.linspace(0, 1, 5001)
    q, v, a = (spline.basis(s, k) @ control / found.duration**k for k in range(3))
    assert np.all((q > bounds.lower) & (q < bounds.upper))
    assert 0.85 < np.abs(v).max() <= 0.9
    assert 1.4 < np.abs(a).max() <= 1.5


def test_goes_round_a_disc_on_the_shortest_way():
    """Tangents and an arc: with speed 1 and hardly any jerk cost the duration is near that length."""
    center, radius = (1.0, 0.0), 0.4
    spline = RestSpline([0.0, 0.0], [2.0, 0.0], 40)
    bounds = Bounds(-FREE, FREE, FREE, 10 * ONE)

    class Speed:
        """|v|^2 <= 1, as a share."""

        per_interval, barrier_bound = 2, BarrierBound.WITHIN_ONE

        def values(self, q, v, a):
            return (v**2).sum(axis=1, keepdims=True)

        def rows(self, q, v, a):
            return Rows(self.values(q, v, a), np.zeros((len(q), 1, 2)), 2 * v[:, None])

    objective = Objective(spline, bounds, Weights(1.0, 1e-9, ONE), [Speed(), Disc(center, radius)])
    s = np.linspace(0, 1, 400)[:, None]
    arch = spline.fit(s * spline.goal + np.sin(np.pi * s) * [0.0, 0.7])
    found = descend(objective, arch, 8.0, max_iterations=200, tolerance=1e-5)
    path = spline.basis(np.linspace(0, 1, 4001)) @ spline.control_points(found.unknowns)
    assert np.linalg.norm(path - center, axis=1).min() > radius - 2e-3  # between samples
    tangent, wrapped = np.sqrt(1 - radius**2), np.pi - 2 * np.arccos(radius)
    best = 2 * tangent + radius * wrapped
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert best - 4e-3 < length < 1.03 * best  # it also has to brake and to bend
    assert found.duration < 1.25 * best  # speeding up and braking included


def system_of(objective, control, duration, mu):
    """Band, right-hand side, border, corner and slope of Newton's equations."""
    work = objective.workspace
    assert fill_system(objective.tables, work, np.ascontiguousarray(control), duration, (mu, mu))
    numbers = work.numbers[CORNER], work.numbers[SLOPE]
    return work.band[: work.right.size].copy(), work.right.copy(), work.border.copy(), *numbers


@pytest.mark.parametrize("barrier_bound", list(BarrierBound))
def test_gradient_agrees_with_finite_differences(barrier_bound):
    spline = RestSpline([0.0, 0.3], [1.0, -0.2], 7)
    bounds = Bounds(-3 * ONE, 3 * ONE, 9 * ONE, 90 * ONE)
    weights = Weights(1.3, 1e-4, np.array([1.0, 2.0]))
    objective = Objective(spline, bounds, weights, [Pull(barrier_bound)], [(0.7, Pull(barrier_bound))])
    rng = np.random.default_rng(3)
    control = spline.control_points(straight(spline) + 0.02 * rng.normal(size=(spline.size, 2)))
    mu, t, step = 0.3, 1.7, 1e-6

    def value(control, t):
        cost, walls = objective.measure(control, t)
        assert cost == pytest.approx(objective.cost(control, t), rel=1e-12)
        return cost + mu * walls

    _, gradient, _, _, of_duration = system_of(objective, control, t, mu)
    assert of_duration == pytest.approx((value(control, t + step) - value(control, t - step)) / 2 / step)
    for i in range(3, len(control) - 3):
        for j in range(2):
            move = np.zeros_like(control)
            move[i, j] = step
            slope = (value(control + move, t) - value(control - move, t)) / 2 / step
            assert gradient[2 * (i - 3) + j] == pytest.approx(slope, rel=1e-5, abs=1e-6)


def test_banded_solution_agrees_with_a_dense_one():
    spline = RestSpline([0.0, 0.3], [1.0, -0.2], 9)
    bounds = Bounds(-3 * ONE, 3 * ONE, 9 * ONE, 90 * ONE)
    objective = Objective(spline, bounds, Weights(1.0, 1e-4, ONE), [Pull(BarrierBound.WITHIN_ONE)])
    control = spline.control_points(straight(spline))
    band, gradient, border, corner, slope = system_of(objective, control, 1.7, 0.1)
    size, width = len(band), 8
    assert size == 2 * spline.size
    dense = np.zeros((size + 1, size + 1))
    for row in range(size):
        for column in range(row, min(row + width, size)):
            dense[row, column] = dense[column, row] = band[row, column - row]
    dense[:-1, -1] = dense[-1, :-1] = border
    dense[-1, -1] = corner
    right = np.append(gradient, slope)
    expected = -np.linalg.solve(dense, right)
    work = objective.workspace
    assert solve_system(work, 0.0, True)
    np.testing.assert_allclose(np.append(work.step, work.numbers[STEP]), expected, rtol=1e-6, atol=1e-9)
    assert work.numbers[FALL] == pytest.approx(right @ expected)


def test_matrix_agrees_with_finite_differences_of_the_gradient():
    """Where terms are linear the matrix of Gauss and Newton is the Hessian."""
    spline = RestSpline([0.0, 0.3], [1.0, -0.2], 7)

    class Linear:
        per_interval, barrier_bound = 2, BarrierBound.WITHIN_ONE

        def values(self, q, v, a):
            return 0.1 * q[:, :1] - 0.05 * v[:, 1:] + 0.02 * a[:, :1] + 0.01 * a[:, 1:]

        def rows(self, q, v, a):
            ones = np.ones((len(q), 1, 1))
            parts = ([0.1, 0.0], [0.0, -0.05], [0.02, 0.01])
            return Rows(self.values(q, v, a), *(ones * np.array(part) for part in parts))

    bounds = Bounds(-3 * ONE, 3 * ONE, 9 * ONE, 90 * ONE, 900 * ONE)
    objective = Objective(spline, bounds, Weights(1.0, 1e-4, ONE), [Linear()], [(0.3, Linear())])
    control, t, step = spline.control_points(straight(spline)), 1.7, 1e-6
    band, *_ = system_of(objective, control, t, 0.1)
    size, width = len(band), 8
    for column in range(size):
        move = np.zeros_like(control)
        move[3 + column // 2, column % 2] = step
        ends = [system_of(objective, control + sign * move, t, 0.1)[1] for sign in (1, -1)]
        numeric = (ends[0] - ends[1]) / (2 * step)
        for row in range(column, min(column + width, size)):
            entry = band[column, row - column]
            assert entry == pytest.approx(numeric[row], rel=1e-5, abs=1e-5)
        assert np.all(np.abs(numeric[column + width :]) < 1e-6)


def test_jerk_limits_hold_at_every_time():
    """From rest to rest with jerk bounded alone, a way of d takes (32 d / j)^(1/3)."""
    spline = RestSpline([0.0, 0.0], [1.0, 0.0], 32)
    bounds = Bounds(-FREE, FREE, FREE, FREE, 2.0 * ONE)
    objective = Objective(spline, bounds, Weights(1.0, 1e-9, ONE))
    found = descend(objective, straight(spline), 9.0, max_iterations=200, tolerance=1e-6)
    jerk = spline.difference(3) @ spline.control_points(found.unknowns) / found.duration**3
    assert np.abs(jerk).max() <= 2.0
    best = (32 / 2.0) ** (1 / 3)
    assert best < found.duration < 1.05 * best


def test_infeasible_start_is_a_status():
    spline = RestSpline([0.0, 0.0], [1.0, 2.0], 10)
    objective = Objective(spline, Bounds(-FREE, FREE, ONE, ONE), Weights(1.0, 1e-6, ONE))
    found = descend(objective, straight(spline), 0.1)
    assert found.status is OptimizationStatus.START_INFEASIBLE
    assert "slower motion" in found.status.advice
    assert found.iterations == 0


def test_limits_of_time_and_iterations_are_statuses():
    spline = RestSpline([0.0, 0.0], [1.0, 2.0], 10)
    objective = Objective(spline, Bounds(-FREE, FREE, ONE, ONE), Weights(1.0, 1e-6, ONE))
    few = descend(objective, straight(spline), 20.0, max_iterations=2)
    assert (few.status, few.iterations) == (OptimizationStatus.OUT_OF_ITERATIONS, 2)
    assert few.cost < few.first_cost
    late = descend(objective, straight(spline), 20.0, timeout=0.0)
    assert late.status is OptimizationStatus.OUT_OF_TIME
    reported = descend(objective, straight(spline), 20.0, stop_below=10.0)
    assert reported.status is OptimizationStatus.STOPPED
    assert reported.duration < 10


def test_what_a_term_raises_is_raised():
    spline = RestSpline([0.0, 0.0], [1.0, 2.0], 10)

    class Broken(Disc):
        calls = 0

        def values(self, q, v, a):
            Broken.calls += 1
            if Broken.calls > 5:
                raise KeyError("broken")
            return super().values(q, v, a)

    objective = Objective(spline, NO_BOUNDS, Weights(1.0, 1e-6, ONE), [Broken((0.5, -3.0), 0.1)])
    with pytest.raises(KeyError, match="broken"):
        descend(objective, straight(spline), 20.0)


def test_misuse_is_named():
    spline = RestSpline([0.0, 0.0], [1.0, 2.0], 10)
    objective = Objective(spline, NO_BOUNDS, Weights(1.0, 1e-6, ONE))
    with pytest.raises(InvalidValueError, match="unknowns: got 3 control points, expected 7 control points"):
        descend(objective, np.zeros((3, 2)), 1.0)
    with pytest.raises(InvalidValueError, match="duration"):
        descend(objective, straight(spline), 0.0)
