"""Motions of least effort whose best is a polynomial."""

import casadi
import numpy as np
import pytest

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.planners.optimization import Bounds, EffortStatus, minimum_effort

FREE = np.full(2, np.inf)
NO_BOUNDS = Bounds(-FREE, FREE, FREE, FREE)


def mass(weight=1.0, gravity=0.0):
    q, v, a = (casadi.SX.sym(name, 2) for name in "qva")
    return casadi.Function("force", [q, v, a], [weight * a + gravity])


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_double_integrator_follows_the_cubic(solver):
    """The least integral of a^2 between two states belongs to the cubic that joins them."""
    start, goal = ([0.0, 1.0], [0.0, -0.3]), ([1.0, -1.0], [0.2, 0.5])
    found = minimum_effort(
        mass(), start, goal, 2.0, NO_BOUNDS, FREE, scale=np.ones(2), intervals=8, solver=solver
    )
    assert found.status is EffortStatus.SOLVED, found.message
    q0, v0, q1, v1 = map(np.array, (*start, *goal))
    square = (3 * (q1 - q0) - 2.0 * (2 * v0 + v1)) / 4.0
    cube = (2 * (q0 - q1) + 2.0 * (v0 + v1)) / 8.0
    t = found.time[:, None]
    np.testing.assert_allclose(found.position, q0 + v0 * t + square * t**2 + cube * t**3, atol=1e-6)
    np.testing.assert_allclose(found.acceleration, 2 * square + 6 * cube * t, atol=1e-6)
    fine = np.linspace(0, 2, 20001)[:, None]
    effort = np.trapezoid(((2 * square + 6 * cube * fine) ** 2).sum(axis=1), dx=1e-4)
    assert found.effort == pytest.approx(effort, rel=1e-6)


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_force_limits_hold_and_act(solver):
    rest = ([0.0, 0.0], [0.0, 0.0])
    free = minimum_effort(
        mass(2.0), rest, ([1.0, 0.5], [0, 0]), 1.0, NO_BOUNDS, FREE, scale=np.ones(2), solver=solver
    )
    assert np.abs(2 * free.acceleration).max() == pytest.approx(12.0, rel=1e-6)  # 6 d m / T^2
    found = minimum_effort(
        mass(2.0), rest, ([1.0, 0.5], [0, 0]), 1.0, NO_BOUNDS, np.array([9.5, 9.5]), scale=np.ones(2),
        intervals=40, solver=solver,
    )  # fmt: skip
    assert found.status is EffortStatus.SOLVED
    assert found.effort > free.effort
    points = found.acceleration[:-1] + (0.5 - 3**0.5 / 6) * np.diff(found.acceleration, axis=0)
    assert np.abs(2 * points).max() == pytest.approx(9.5, rel=1e-4)


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
def test_impossible_swing_is_not_called_solved(solver):
    rest, goal = ([0.0, 0.0], [0.0, 0.0]), ([1.0, 1.0], [0.0, 0.0])
    found = minimum_effort(
        mass(), rest, goal, 1.0, NO_BOUNDS, np.ones(2), solver=solver, max_iterations=60
    )  # a way of 1 in 1 s takes an acceleration of 4
    assert found.status is not EffortStatus.SOLVED
    assert found.status.advice


def test_misuse_is_named():
    rest = ([0.0, 0.0], [0.0, 0.0])
    with pytest.raises(InvalidValueError, match="solver: got 'snopt', expected one of 'ipopt', 'fatrop'"):
        minimum_effort(mass(), rest, rest, 1.0, NO_BOUNDS, np.ones(2), solver="snopt")
    with pytest.raises(InvalidValueError, match="scale: got"):
        minimum_effort(mass(), rest, rest, 1.0, NO_BOUNDS, FREE)
    with pytest.raises(InvalidValueError, match="intervals: got 1, expected a whole number of at least 2"):
        minimum_effort(mass(), rest, rest, 1.0, NO_BOUNDS, np.ones(2), intervals=1)
