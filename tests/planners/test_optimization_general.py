"""General solvers on the problems that the feasible interior-point method solves."""

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
    descend_by,
)

ONE = np.ones(2)
BOUNDS = Bounds(-2 * ONE, 2 * ONE, 1.5 * ONE, 4 * ONE)


class Disc:
    """Distance of a point to a disc, as a slack; without `kinked` its curvature counts."""

    per_interval, barrier_bound = 4, BarrierBound.ABOVE_ZERO

    def __init__(self, kinked):
        self.kinked = kinked

    def values(self, q, v, a):
        return (np.linalg.norm(q - (0.5, 0.05), axis=1) - 0.2)[:, None] / 0.3

    def rows(self, q, v, a):
        way = q - (0.5, 0.05)
        return Rows(self.values(q, v, a), (way / np.linalg.norm(way, axis=1)[:, None])[:, None] / 0.3)


class Push:
    """A force of position, velocity and acceleration, between -1 and 1."""

    per_interval, barrier_bound = 2, BarrierBound.WITHIN_ONE

    def values(self, q, v, a):
        return 0.4 * a + 0.1 * np.sin(q) + 0.05 * v

    def rows(self, q, v, a):
        eye = np.tile(np.eye(2), (len(q), 1, 1))
        return Rows(self.values(q, v, a), 0.1 * np.cos(q)[:, None, :] * eye, 0.05 * eye, 0.4 * eye)


def problem(kinked=False):
    spline = RestSpline([0.0, 0.0], [1.0, 0.2], 16)
    objective = Objective(spline, BOUNDS, Weights(1.0, 1e-3, ONE), [Disc(kinked), Push()], [(0.1, Push())])
    s = np.linspace(0, 1, 400)[:, None]
    way = spline.start + (3 * s**2 - 2 * s**3) * (spline.goal - spline.start)
    return objective, spline.fit(way - np.array([0, 0.4]) * np.sin(np.pi * s) ** 2)


@pytest.mark.thorough
@pytest.mark.parametrize("kinked", [False, True])
@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_both_find_the_motion_that_the_feasible_method_finds(solver, kinked):
    objective, start = problem(kinked)
    ours = descend(objective, start, 3.0, tolerance=1e-6, max_iterations=200)
    found = descend_by(objective, start, 3.0, solver=solver)
    assert ours.status is found.status is OptimizationStatus.CONVERGED
    assert found.cost == pytest.approx(ours.cost, rel=1e-3 if kinked else 3e-4)
    assert found.duration == pytest.approx(ours.duration, rel=1e-2 if kinked else 1e-3)
    np.testing.assert_allclose(found.unknowns, ours.unknowns, atol=0.02)
    control = objective.spline.control_points(found.unknowns)
    assert objective.least_slack(control, found.duration) > -1e-5
    for term in objective.constraints:
        values = term.values(*objective.states(term, control, found.duration))
        space = 1 - np.abs(values) if term.barrier_bound is BarrierBound.WITHIN_ONE else values
        assert -1e-4 < space.min() < 0.02  # each acts


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_a_given_duration_is_kept(solver):
    objective, start = problem()
    found = descend_by(objective, start, 3.0, solver=solver, free_duration=False)
    assert found.status is OptimizationStatus.CONVERGED
    assert found.duration == pytest.approx(3.0, abs=1e-9)
    ours = descend(objective, start, 3.0, free_duration=False, tolerance=1e-6, max_iterations=200)
    assert found.cost == pytest.approx(ours.cost, rel=1e-4)


def test_too_short_a_duration_is_infeasible():
    objective, start = problem()
    found = descend_by(objective, start, 0.3, free_duration=False, max_iterations=60)
    assert found.status is OptimizationStatus.START_INFEASIBLE
    np.testing.assert_array_equal(found.unknowns, start)
    assert found.duration == 0.3


def test_misuse_is_named():
    objective, start = problem()
    with pytest.raises(InvalidValueError, match="solver: got 'snopt', expected one of 'ipopt', 'fatrop'"):
        descend_by(objective, start, 1.0, solver="snopt")
    for timeout in (1e-3, 60.0):
        with pytest.raises(InvalidValueError, match=f"timeout: got {timeout}, expected none with"):
            descend_by(objective, start, 1.0, solver="fatrop", timeout=timeout)
    stiff = RestSpline([0.0, 0.0], [1.0, 0.2], 16, 5)
    with pytest.raises(InvalidValueError, match="degree: got 5"):
        descend_by(Objective(stiff, BOUNDS, Weights(1.0, 1e-3, ONE)), np.zeros((stiff.size, 2)), 1.0)
