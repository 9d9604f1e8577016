"""Timing from a start in motion: toppra as the oracle, certificates, the greatest speed, refusals."""

import re

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.trajectory.path import CubicPath, as_cubic_path, start_rates

OPTIONS = {"velocity and acceleration": {"torque": False}, "torque": {}, "balance": {"balance": 0.0}}


def cases(pepper, count, **options):
    """Yield points after an instant of a motion, its position the first of them, and half of its velocity."""
    rng, found = np.random.default_rng(0), 0
    lower, upper = pepper.lower_limits, pepper.upper_limits
    middle, room = (lower + upper) / 2, (upper - lower) / 2
    room[:3] *= 0.06
    middle[:3] = 0.0
    while found < count:
        points = middle + 0.6 * room * rng.uniform(-1, 1, (3, pepper.n))
        try:
            motion = pk.retime(pepper, points, **options)
        except InfeasibleError:
            continue
        found += 1
        now = motion(0.3 * motion.duration)
        yield np.stack([now.position, *points[1:]]), 0.5 * now.velocity


@pytest.mark.parametrize("name", OPTIONS)
def test_a_motion_begins_with_the_velocity_and_keeps_limits(pepper, name):
    options = OPTIONS[name]
    for points, velocity in cases(pepper, 6, **options):
        motion = pk.retime(pepper, points, start_velocity=velocity, **options)
        state = motion([0.0, motion.duration])
        np.testing.assert_allclose(state.velocity, [velocity, 0 * velocity], rtol=0, atol=1e-9)
        np.testing.assert_allclose(state.position, points[[0, -1]], rtol=0, atol=1e-9)
        certificate = motion.check(pepper, collisions=False, balance=options.get("balance"))
        unasked = {"torque"} & set(options) | {"balance"} - set(options)
        assert set(certificate.failures) <= unasked, certificate.report()
        still = pk.retime(pepper, as_cubic_path(pepper, points, (velocity, None)), **options)
        assert motion.duration < still.duration


def test_toppra_is_as_fast_from_the_same_speed(pepper):
    toppra = pytest.importorskip("toppra")
    scheme = toppra.constraint.DiscretizationType.Interpolation
    velocities = np.stack([-pepper.velocity_limits, pepper.velocity_limits], axis=1)
    accelerations = np.stack([-pepper.acceleration_limits, pepper.acceleration_limits], axis=1)
    for points, velocity in cases(pepper, 6, torque=False):
        motion = pk.retime(pepper, points, start_velocity=velocity, torque=False, gridpoints=400)
        curve = as_cubic_path(pepper, points, (velocity, None))
        speed, _ = start_rates(curve, velocity, None)
        s = np.linspace(curve.breaks[0], curve.breaks[-1], 2000)
        segment = np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)
        path = toppra.SplineInterpolator(s, curve.at(segment, s - curve.breaks[segment]))
        limits = [
            toppra.constraint.JointVelocityConstraint(velocities),
            toppra.constraint.JointAccelerationConstraint(accelerations, discretization_scheme=scheme),
        ]
        grid = np.linspace(curve.breaks[0], curve.breaks[-1], 401)
        solver = toppra.algorithm.TOPPRA(limits, path, gridpoints=grid, solver_wrapper="seidel")
        _, rate, _ = solver.compute_parameterization(speed, 0.0)
        duration = float(np.sum(2 * np.diff(grid) / (rate[1:] + rate[:-1])))
        assert motion.duration == pytest.approx(duration, rel=0.01)


def test_the_greatest_speed_is_named_and_possible(pepper):
    for options in OPTIONS.values():
        for points, velocity in cases(pepper, 3, **options):
            with pytest.raises(InfeasibleError, match="at most") as error:
                pk.retime(pepper, points, start_velocity=100.0 * velocity, **options)
            share = float(re.search(r"at most ([\d.e-]+) times", str(error.value)).group(1))
            assert share < 1.0
            fastest = 100.0 * share * velocity
            motion = pk.retime(pepper, points, start_velocity=0.98 * fastest, **options)
            np.testing.assert_allclose(motion(0.0).velocity, 0.98 * fastest, rtol=0, atol=1e-8)
            with pytest.raises(InfeasibleError):
                pk.retime(pepper, points, start_velocity=1.001 * fastest, **options)


def test_a_curve_is_followed_as_it_is(pepper):
    goal = pepper.joint_vector({"LShoulderPitch": 0.2, "LElbowRoll": -1.0})
    plan = pk.plan(pepper, pepper.posture("Stand"), goal)
    direction = plan.curve.coefficients[0, 1]
    motion = pk.retime(pepper, plan, start_velocity=0.3 * direction)
    np.testing.assert_allclose(motion(0.0).velocity, 0.3 * direction, rtol=0, atol=1e-9)
    np.testing.assert_allclose(motion.end, pk.retime(pepper, plan).end, rtol=0, atol=1e-9)
    across = direction + 0.01 * pepper.joint_vector({"HeadYaw": 1.0}, rest=0.0 * direction)
    for velocity in (-direction, across):
        with pytest.raises(InvalidValueError, match="replan"):
            pk.retime(pepper, plan, start_velocity=velocity)


def test_a_kinked_curve_stops_at_its_kinks(pepper):
    start = pepper.posture("Stand")
    turn = pepper.joint_vector({"HeadYaw": 0.5})
    end = pepper.joint_vector({"HeadYaw": 0.5, "HeadPitch": 0.3})
    pieces = np.zeros((2, 4, pepper.n))
    pieces[:, 0], pieces[:, 1] = [start, turn], [turn - start, end - turn]
    curve = CubicPath(np.arange(3.0), pieces)
    motion = pk.retime(pepper, curve, start_velocity=0.8 * (turn - start), torque=False)
    np.testing.assert_allclose(motion(0.0).velocity, 0.8 * (turn - start), rtol=0, atol=1e-9)
    assert np.abs(motion(motion.knots).velocity[1:-1]).max(axis=1).min() < 1e-6


def test_rest_is_the_usual_start_and_what_is_refused(pepper):
    points, velocity = next(cases(pepper, 1, torque=False))
    plain = pk.retime(pepper, points, torque=False)
    assert pk.retime(pepper, points, torque=False, start_velocity=0.0 * velocity).is_close(plain)
    for option in ({"duration": 10.0}, {"solver": "toppra"}):
        with pytest.raises(InvalidValueError, match="start_velocity"):
            pk.retime(pepper, points, start_velocity=velocity, **option)
    with pytest.raises(InvalidValueError, match=r"start_acceleration.* without jerk"):
        pk.retime(pepper, points, start_acceleration=velocity)
    for wrong in (velocity[:3], np.full(pepper.n, np.nan)):
        with pytest.raises(InvalidValueError, match="start_velocity"):
            pk.retime(pepper, points, start_velocity=wrong)


def split(curve, s):
    """Return what is left of a curve from a parameter on."""
    i = int(np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2))
    x, (c0, c1, c2, c3) = s - curve.breaks[i], curve.coefficients[i]
    first = [c0 + x * (c1 + x * (c2 + x * c3)), c1 + x * (2 * c2 + 3 * x * c3), c2 + 3 * x * c3, c3]
    return CubicPath(
        np.array([s, *curve.breaks[i + 1 :]]), np.stack([np.stack(first), *curve.coefficients[i + 1 :]])
    )


@pytest.mark.parametrize("jerk", ["moderate", "brisk"])
@pytest.mark.parametrize("name", OPTIONS)
def test_with_jerk_limits_the_acceleration_is_met_too(pepper, name, jerk):
    """From velocity and acceleration at 0.9 of the speed that a motion along the same curve has there."""
    options = {**OPTIONS[name], "jerk": jerk}
    for points, _ in cases(pepper, 3, **options):
        curve = as_cubic_path(pepper, points)
        left = split(curve, curve.breaks[0] + 0.3 * np.ptp(curve.breaks))
        q, tangent, bend, _ = left.coefficients[0]
        whole = pk.retime(pepper, points, **options)
        times = np.linspace(0.0, whole.duration, 20_000)
        now = whole(times[np.linalg.norm(whole(times).position - q, axis=1).argmin()])
        rate = 0.9 * (now.velocity @ tangent) / (tangent @ tangent)
        change = 0.81 * (now.acceleration - 2 * bend * (rate / 0.9) ** 2) @ tangent / (tangent @ tangent)
        velocity, acceleration = rate * tangent, change * tangent + 2 * bend * rate**2
        motion = pk.retime(pepper, left, start_velocity=velocity, start_acceleration=acceleration, **options)
        begin, end = motion(0.0), motion(motion.duration)
        for value, asked in zip(begin, (q, velocity, acceleration), strict=True):
            np.testing.assert_allclose(value, asked, rtol=0, atol=1e-8)
        for value, asked in zip(end, (points[-1], 0 * q, 0 * q), strict=True):
            np.testing.assert_allclose(value, asked, rtol=0, atol=1e-8)
        balance = options.get("balance")
        certificate = motion.check(pepper, collisions=False, jerk=jerk, balance=balance)
        unasked = {"torque"} & set(options) | {"balance"} - set(options)
        assert set(certificate.failures) <= unasked, certificate.report()
        assert motion.duration < pk.retime(pepper, left, **options).duration


@pytest.mark.parametrize("jerk", ["gentle", "brisk"])
def test_with_jerk_limits_a_slow_start_is_little_slower_than_rest(pepper, jerk):
    for points, _ in cases(pepper, 3, torque=False):
        curve = as_cubic_path(pepper, points)
        tangent = curve.coefficients[0, 1]
        rest = pk.retime(pepper, curve, jerk=jerk, torque=False)
        for share in (0.02, 0.2):
            velocity = share * (pepper.velocity_limits / np.abs(tangent)).min() * tangent
            motion = pk.retime(pepper, curve, jerk=jerk, torque=False, start_velocity=velocity)
            assert motion.duration < 1.2 * rest.duration


def test_way_points_are_joined_by_a_spline_that_bends_as_the_acceleration_asks(pepper):
    points, velocity = next(cases(pepper, 1, torque=False))
    rng = np.random.default_rng(3)
    for scale in (0.0, 0.01, 0.1):
        acceleration = scale * (velocity @ velocity) * rng.normal(size=pepper.n)
        curve = as_cubic_path(pepper, points, (velocity, acceleration))
        rate, change = start_rates(curve, velocity, acceleration)
        _, tangent, bend, _ = curve.coefficients[0]
        np.testing.assert_allclose(rate * tangent, velocity, atol=1e-10)
        np.testing.assert_allclose(change * tangent + 2 * bend * rate**2, acceleration, atol=1e-9)
        step = np.diff(curve.breaks)[:, None]
        c = np.moveaxis(curve.coefficients, 1, 0)
        place = c[0] + step * (c[1] + step * (c[2] + step * c[3]))
        ends = place, c[1] + step * (2 * c[2] + 3 * step * c[3]), c[2] + 3 * step * c[3]
        for value, following in zip(ends, c[:3], strict=True):
            np.testing.assert_allclose(value[:-1], following[1:], atol=1e-8)
    motion = pk.retime(pepper, points, jerk="gentle", start_acceleration=0.1 * velocity, torque=False)
    np.testing.assert_allclose(motion(0.0).acceleration, 0.1 * velocity, atol=1e-8)
    curve = as_cubic_path(pepper, points)
    tangent = curve.coefficients[0, 1]
    with pytest.raises(InvalidValueError, match="start_acceleration"):
        start_rates(curve, 0.1 * tangent, np.roll(tangent, 1))
    with pytest.raises(InfeasibleError, match="from rest"):
        pk.retime(pepper, points, jerk="gentle", start_velocity=20.0 * velocity, torque=False)
