"""Limits hold between milliseconds too: extremes by roots of polynomials, torques sampled densely."""

import numpy as np
import pinocchio
import pytest

import pepper_kin as pk
from pepper_kin.collision import load_torque
from pepper_kin.dynamics.load import Load
from pepper_kin.trajectory import Trajectory, find_limit_violations
from pepper_kin.trajectory.balance import balance_margin, support_polygon
from pepper_kin.trajectory.examined_states import extremes_of
from pepper_kin.trajectory.limits import jerk_limits


def random_points(pepper, seed, count=5):
    rng = np.random.default_rng(seed)
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    middle = (lower + upper) / 2
    return middle + 0.8 * (rng.uniform(lower, upper, (count, pepper.n)) - middle)


def greatest_by_roots(trajectory, order):
    """Greatest and least value of each joint's derivative, by the roots of the next one (`numpy`)."""
    high, low = np.full(trajectory.n, -np.inf), np.full(trajectory.n, np.inf)
    for powers, length in zip(trajectory.coefficients, np.diff(trajectory.breaks), strict=True):
        for j in range(trajectory.n):
            curve = np.polynomial.Polynomial(powers[:, j])
            curve = curve.deriv(order) if order else curve
            turns = curve.deriv().roots()
            turns = turns[np.abs(turns.imag) < 1e-6 * length].real
            at = np.concatenate([[0.0, length], turns[(turns > 0) & (turns < length)]])
            high[j], low[j] = max(high[j], curve(at).max()), min(low[j], curve(at).min())
    return high, low


@pytest.mark.parametrize("order", range(4))
def test_extremes_are_those_that_roots_find(pepper, order):
    trajectory = pk.retime(pepper, random_points(pepper, 0))
    high, low = greatest_by_roots(trajectory, order)
    scale = np.maximum(np.abs(high), np.abs(low))
    found = extremes_of(trajectory.breaks, trajectory.coefficients, order)
    for value, time, expected in ((found.high, found.high_time, high), (found.low, found.low_time, low)):
        assert np.all(np.abs(value - expected) <= 1e-11 * scale + 1e-300)
        if order < 2:  # later derivatives jump at knots
            at = trajectory(time)[order][np.arange(pepper.n), np.arange(pepper.n)]
            np.testing.assert_allclose(at, value, atol=1e-10)


@pytest.mark.thorough
@pytest.mark.parametrize("options", [{}, {"solver": "toppra"}, {"jerk": "gentle"}, {"jerk": "brisk"}])
@pytest.mark.parametrize("seed", range(2))
def test_certified_motions_keep_limits_at_their_extremes(pepper, options, seed):
    """Jerk was exceeded by up to 4 % between milliseconds, and certified."""
    trajectory = pk.retime(pepper, random_points(pepper, seed), **options)
    jerk = {"jerk": options["jerk"]} if "jerk" in options else {}
    assert set(trajectory.check(pepper, collisions=False, **jerk).failures) <= {"balance"}
    limits = [pepper.upper_limits, pepper.velocity_limits, pepper.acceleration_limits]
    limits += [jerk_limits(pepper, options["jerk"])] if jerk else []
    lower = [pepper.lower_limits, *(-limit for limit in limits[1:])]
    for order, (below, above) in enumerate(zip(lower, limits, strict=True)):
        high, low = greatest_by_roots(trajectory, order)
        slack = 1e-9 * np.abs(above - below)
        assert np.all(high <= above + slack), order
        assert np.all(low >= below - slack), order


def test_what_is_outside_between_milliseconds_fails(pepper):
    """A bump of 0.5 ms, zero at both of its ends, that no sample at a millisecond sees."""
    trajectory = pk.retime(pepper, random_points(pepper, 1), velocity_scale=0.5, acceleration_scale=0.5)
    joint, h = pepper.joint_index("HeadYaw"), 0.0005
    rest = trajectory.end
    bump = np.zeros((3, 5, pepper.n))
    bump[:, 0] = rest
    # position d (u (1 - u))^2 with u = t / h: at rest at both ends, fastest at u = 0.21 with 0.19 d / h
    height = 1.1 * pepper.velocity_limits[joint] * h / 0.19245
    bump[1, 2:5, joint] = height * np.array([1.0, -2.0, 1.0]) / h ** np.arange(2, 5)
    hidden = Trajectory(pepper.joint_names, [0.0, 0.01025, 0.01025 + h, 0.02], bump, pepper.joint_units)
    found = hidden.check(pepper, collisions=False)
    assert "velocity" in found.failures
    assert found.velocity.use.max() == pytest.approx(1.1, rel=1e-3)
    assert 0.01025 < found.velocity.time[joint] < 0.01025 + h
    quantities = {
        (violation.joint, violation.quantity) for violation in find_limit_violations(pepper, hidden)
    }
    assert {("HeadYaw", "velocity"), ("HeadYaw", "acceleration")} <= quantities


@pytest.mark.parametrize("options", [{}, {"jerk": "brisk"}])
def test_torques_between_states_are_within_the_stated_bound(pepper, options):
    trajectory = pk.retime(pepper, random_points(pepper, 3), **options)
    found = trajectory.check(pepper, collisions=False).torque
    model = pepper.pinocchio_model
    data = model.createData()
    dense = trajectory(np.linspace(0.0, trajectory.duration, 60_001))
    torque = np.array([np.abs(pinocchio.rnea(model, data, *state)) for state in zip(*dense, strict=True)])
    highest = torque.max(axis=0)
    assert np.all(highest <= np.abs(found.value) + found.resolution)
    assert np.any(highest > np.abs(found.value)) or not options
    assert np.all(found.resolution <= 0.02 * pepper.effort_limits)  # and the bound says something
    assert "between the states examined at most" in found.sentence()


def test_bounds_hold_where_motion_is_violent(pepper):
    """On polynomials of large coefficients, whose pieces are long: every bound against dense samples."""
    rng = np.random.default_rng(5)
    coefficients = rng.normal(size=(3, 6, pepper.n)) * np.array([0.3, 2, 5, 20, 60, 100])[:, None]
    trajectory = Trajectory(pepper.joint_names, [0, 0.1, 0.15, 0.3], coefficients, pepper.joint_units)
    options = {"payload": {"left": 0.4}, "hand_speed": {"left": 1.0}}
    found = trajectory.check(pepper, collisions=False, **options)
    assert found.torque.resolution.min() > 0
    for segment in range(3):
        local = np.linspace(0, np.diff(trajectory.breaks)[segment], 4001)
        state = trajectory.at_segments(np.full(local.size, segment), local)
        torque = np.abs(
            pk.dynamics.inverse_dynamics(pepper, *state)
            + load_torque(pepper, (Load("LArm_effector", 0.4),), *state)
        )
        assert np.all(torque.max(axis=0) <= np.abs(found.torque.value) + found.torque.resolution + 1e-9)
        velocity = pk.kinematics.frame_velocity(pepper, *state[:2], "LArm_effector")
        speed = np.linalg.norm(velocity[:, :3], axis=1).max()
        assert speed <= found.hand_speed.value + found.hand_speed.resolution + 1e-9


def test_the_zero_moment_point_and_distances_between_states_are_within_their_bounds(pepper):
    trajectory = pk.retime(pepper, random_points(pepper, 6))
    scene = pk.Scene().add_sphere("ball", radius=0.05, position=(0.4, 0.3, 0.8))
    found = trajectory.check(pepper, scene)
    dense = trajectory(np.linspace(0.0, trajectory.duration, 40_001))
    margin = balance_margin(pepper, support_polygon(pepper), *dense)
    assert margin.min() >= found.balance.value - found.balance.resolution
    assert found.balance.resolution < 0.002
    near = trajectory(
        np.clip(found.obstacle_clearance.time + np.linspace(-0.001, 0.001, 201), 0.0, trajectory.duration)
    )
    distance = pk.collision.clearance(pepper, near.position, scene, to="obstacles")
    assert distance.min() >= found.obstacle_clearance.value - found.obstacle_clearance.resolution - 2e-6
    assert 0 < found.obstacle_clearance.resolution < 0.02
