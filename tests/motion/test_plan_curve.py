"""The curve that a plan returns is the one that was examined and the one that is timed."""

import numpy as np
import pytest
from scipy.optimize import brentq

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.trajectory.path import as_cubic_path


@pytest.fixture(scope="module")
def scene(pepper):
    return pk.Scene().add_box("table", size=(0.5, 0.8, 0.05), position=(0.55, 0.0, 0.6))


@pytest.fixture(scope="module")
def plan(pepper, scene):
    goal = pepper.joint_vector({"RShoulderPitch": 0.4, "RElbowRoll": 0.9, "HipPitch": -0.15})
    found = pk.plan(pepper, pepper.posture("Stand"), goal, scene)
    assert found.success, found.report()
    return found


def distance(curve, q):
    """Return the least distance of a configuration from a curve: where the difference is normal to it."""

    def at(s, derivative=0):
        segment = min(max(int(np.searchsorted(curve.breaks, s, side="right")) - 1, 0), len(curve.breaks) - 2)
        return curve.at(segment, s - curve.breaks[segment], derivative)

    grid = np.linspace(curve.breaks[0], curve.breaks[-1], 400)
    nearest = int(np.argmin([np.linalg.norm(at(s) - q) for s in grid]))
    ends = grid[max(nearest - 1, 0)], grid[min(nearest + 1, 399)]

    def along(s):
        return float((at(s) - q) @ at(s, 1))

    places = [*ends, grid[nearest]]
    if along(ends[0]) * along(ends[1]) < 0:
        places.append(brentq(along, *ends, xtol=1e-15))
    return min(float(np.linalg.norm(at(s) - q)) for s in places)


@pytest.mark.parametrize("options", [{}, {"balance": 0.01}, {"jerk": "brisk"}, {"solver": "toppra"}])
def test_the_timed_path_is_the_curve(pepper, plan, options):
    for path in (plan, plan.curve):
        trajectory = pk.retime(pepper, path, **options)
        tolerance = 1e-5 if "jerk" in options else 1e-9  # with jerk, quintics between close samples
        for t in np.linspace(0.0, trajectory.duration, 23):
            assert distance(plan.curve, trajectory(t).position) < tolerance
    np.testing.assert_array_equal(trajectory.start, plan.path[0])
    np.testing.assert_allclose(trajectory.end, plan.path[-1], atol=1e-12)


def test_pieces_begin_on_the_curve_to_the_bit(pepper, plan):
    """Where the curve's pieces meet, a piece of the trajectory begins."""
    starts = pk.retime(pepper, plan).coefficients[:, 0]
    for knot in plan.curve.coefficients[:, 0]:
        assert (starts == knot).all(axis=1).any()


def test_curve_and_way_points_say_the_same(pepper, plan):
    again = as_cubic_path(pepper, plan.path)
    np.testing.assert_array_equal(plan.curve.breaks, again.breaks)
    np.testing.assert_array_equal(plan.curve.coefficients, again.coefficients)
    assert pk.retime(pepper, plan) == pk.retime(pepper, plan.curve) == pk.retime(pepper, plan.path)


def test_the_curve_keeps_its_distance_everywhere(pepper, scene, plan):
    curve = plan.curve
    segments = np.repeat(np.arange(len(curve.breaks) - 1), 201)
    local = np.tile(np.arange(201) / 200, len(curve.breaks) - 1) * np.diff(curve.breaks)[segments]
    clearance = pk.collision.CollisionChecker(pepper, scene).clearance(curve.at(segments, local))
    assert clearance.min() > 0
    assert clearance.min() <= plan.clearance.least + 1e-9


def test_a_failed_plan_gives_its_reason(pepper):
    failed = Plan(PlanStatus.NO_PATH_IN_TIME, "No path: 12 configurations were checked.", pepper.joint_names)
    assert failed.curve is None
    with pytest.raises(InfeasibleError) as caught:
        pk.retime(pepper, failed)
    assert str(caught.value) == (
        "no trajectory: planning failed: No path: 12 configurations were checked; "
        "Raise the timeout, try another seed, or free more joints."
    )
    assert caught.value.advice == failed.advice
