import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline

import pepper_kin as pk
from pepper_kin.core.timing.kinks import find_kinks
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.trajectory.path import as_cubic_path
from pepper_kin.trajectory.time_optimal import TimingProblem

PEPPER = pk.load_pepper()


def random_path(seed, count=5):
    rng = np.random.default_rng(seed)
    low, high = PEPPER.lower_limits, PEPPER.upper_limits
    middle = (low + high) / 2
    points = middle + 0.3 * rng.uniform(low - middle, high - middle, (count, PEPPER.n))
    points[:, PEPPER.joint_index("KneePitch")] = 0.0
    points[:, PEPPER.joint_index("HipPitch")] *= 0.3
    return points


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("torque", [True, False])
def test_one_call_gives_what_its_parts_give(monkeypatch, seed, torque):
    """Loads, balance and speeds of hands go from part to part in Python; so can all the rest."""
    path = random_path(seed)
    quick = pk.retime(PEPPER, path, torque=torque)
    monkeypatch.setattr(TimingProblem, "plain", False)
    parts = pk.retime(PEPPER, path, torque=torque)
    np.testing.assert_allclose(quick.breaks, parts.breaks, rtol=1e-9)
    np.testing.assert_allclose(quick.coefficients, parts.coefficients, rtol=1e-6, atol=1e-6)


def test_tables_of_one_path_do_not_touch_another_motion():
    """They lie in the same memory, whatever their sizes."""
    first, second = random_path(1), random_path(2, 9)
    before = pk.retime(PEPPER, first)
    pk.retime(PEPPER, second, gridpoints=150, balance=0.0)
    pk.retime(PEPPER, second, gridpoints=600)
    again = pk.retime(PEPPER, first)
    np.testing.assert_array_equal(before.coefficients, again.coefficients)
    assert pk.trajectory.check(PEPPER, before).failures in ((), ("balance",))


def pieces_of(spline):
    return spline.x.copy(), np.ascontiguousarray(np.moveaxis(spline.c[::-1], 0, 1))


def kinks_of(spline):
    breaks, coefficients = pieces_of(spline)
    places = np.empty(len(coefficients), np.int64)
    return places[: find_kinks(breaks, coefficients, 1e-3, places)].tolist()


def test_kinks_are_where_the_derivative_jumps():
    rng = np.random.default_rng(0)
    x, y = np.cumsum(rng.uniform(0.5, 1.5, 8)), rng.normal(size=(8, 3))
    assert kinks_of(CubicSpline(x, y)) == []
    assert kinks_of(CubicHermiteSpline(x, y, rng.normal(size=(8, 3)))) == []
    left, right = CubicSpline(x[:4], y[:4]), CubicSpline(x[3:], y[3:])
    joined = left
    joined.x, joined.c = x, np.concatenate([left.c, right.c], axis=1)
    assert kinks_of(joined) == [3]


def test_a_curve_planned_for_one_robot_is_looked_at_for_another():
    start = PEPPER.posture("Stand")
    goal = start.copy()
    goal[PEPPER.joint_index("HeadYaw")] = 0.6
    plan = pk.plan(PEPPER, start, goal)
    assert as_cubic_path(PEPPER, plan) is plan.curve
    with pytest.raises(InvalidValueError, match="15 joints"):
        pk.retime(pk.load_pepper(base="planar"), plan)
