"""Slowing down only where it must be: limits hold, the way and the rhythm stay."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.trajectory import Trajectory, enforce_limits


def lines(pepper, *points):
    """Straight lines at constant speed between (time, joints) from the posture Stand."""
    q = [pepper.joint_vector({**dict(zip(pepper.joint_names, pepper.posture("Stand"), strict=True)), **j})
         for _, j in points]  # fmt: skip
    times = np.array([t for t, _ in points])
    rates = np.diff(q, axis=0) / np.diff(times)[:, None]
    return Trajectory(pepper.joint_names, times, np.stack([q[:-1], rates], axis=1), pepper.joint_units)


def test_unsafe_motions_become_safe(pepper):
    original = lines(
        pepper,
        (0.0, {}),
        (0.2, {"RShoulderPitch": 0.2, "RShoulderRoll": -0.5, "HeadYaw": 1.0}),
        (0.3, {"RShoulderPitch": 1.2, "RShoulderRoll": -0.9, "HeadYaw": -1.0, "HipPitch": -0.2}),
        (1.5, {"RShoulderRoll": -0.3}),
    )
    assert not original.check(pepper, collisions=False).success
    found = enforce_limits(pepper, original)
    certificate = found.check(pepper, collisions=False)
    assert certificate.success, certificate.report()
    assert certificate.acceleration.use.max() > 0.8  # not slower than need be by far
    np.testing.assert_allclose(found.start, original.start, atol=1e-12)
    np.testing.assert_allclose(found.end, original.end, atol=1e-12)
    for t in (0.0, found.duration):
        assert np.abs(found(t).velocity).max() < 1e-9
        assert np.abs(found(t).acceleration).max() < 1e-6
    before, after = found.at_segments(np.arange(found.breaks.size - 2), np.diff(found.breaks)[:-1]), found
    np.testing.assert_allclose(before.acceleration, after(found.breaks[1:-1]).acceleration, atol=1e-6)


def test_safe_motions_keep_their_pace(pepper):
    q = pepper.posture("Stand")
    goal = pepper.joint_vector({"HeadYaw": 0.6, "LShoulderPitch": 1.0})
    ends = np.array([q, goal])
    original = pk.trajectory.Samples(pepper.joint_names, [0, 3.0], ends, 0 * ends, 0 * ends).to_trajectory()
    for h in (0.01, 0.04):
        found = enforce_limits(pepper, original, rounding=h)
        assert found.duration == pytest.approx(3.0 + 2 * h, abs=1e-9)
        at = np.linspace(0, 3, 200)
        most = np.abs(original(at).acceleration).max(axis=0) * h**2 / 6
        error = np.abs(found(at + h).position - original(at).position).max(axis=0)
        assert np.all(error <= 1.05 * most + 1e-9)
        assert error.max() > 0.5 * most.max()  # the stated deviation is not an idle bound


def test_pauses_stay(pepper):
    original = lines(pepper, (0.0, {}), (0.02, {"HeadYaw": 0.5}), (2.02, {"HeadYaw": 0.5}), (2.5, {}))
    found = enforce_limits(pepper, original)
    time = np.arange(0, found.duration, 0.001)
    still = np.abs(found(time).velocity).max(axis=1) < 1e-9
    assert 1.8 < 0.001 * still.sum() < 2.2


def test_positions_outside_limits_are_moved_in(pepper):
    original = lines(pepper, (0.0, {}), (2.0, {"HeadYaw": 0.0}))
    j = pepper.joint_index("HeadYaw")
    coefficients = original.coefficients.copy()
    coefficients[:, 1, j] = 1.5
    found = enforce_limits(pepper, Trajectory(original.joint_names, original.breaks, coefficients))
    assert found.end[j] == pytest.approx(pepper.upper_limits[j], abs=1e-12)
    assert found.check(pepper, collisions=False).success


def test_jumps_become_swings_in_little_time(pepper):
    q = pepper.posture("Stand")
    coefficients = np.tile(q, (2, 1, 1))
    j = pepper.joint_index("HeadYaw")
    coefficients[1, 0, j] = 1.0
    found = enforce_limits(pepper, Trajectory(pepper.joint_names, [0.0, 0.5, 1.0], coefficients))
    fastest = 2 * np.sqrt(abs(1.0 - q[j]) / pepper.acceleration_limits[j])  # at full and at least push
    assert 1.0 + fastest < found.duration < 1.0 + 2.5 * fastest
    assert found.check(pepper, collisions=False).success


def test_tipping_is_slowed_down(pepper):
    original = lines(
        pepper, (0.0, {}), (0.3, {"HipPitch": -0.35}), (0.6, {}), (0.9, {"HipPitch": -0.35}), (1.2, {})
    )
    found = enforce_limits(pepper, original).check(pepper, collisions=False)
    assert found.success, found.report()


def test_what_cannot_be_held_is_refused(pepper):
    lean = lines(pepper, (0.0, {}), (3.0, {"HipPitch": -1.03, "KneePitch": -0.5}))
    with pytest.raises(InfeasibleError, match=r"no safe motion: (KneePitch|HipPitch) needs .* to hold"):
        enforce_limits(pepper, lean)


def test_wrong_arguments(pepper):
    original = lines(pepper, (0.0, {}), (1.0, {"HeadYaw": 0.1}))
    for rounding, message in [
        (0.0, "rounding: got 0"), (np.nan, "rounding: got nan"), (2.0, "at most the duration"),
    ]:  # fmt: skip
        with pytest.raises(InvalidValueError, match=message):
            enforce_limits(pepper, original, rounding=rounding)
    with pytest.raises(InvalidValueError, match="joints of the trajectory"):
        enforce_limits(pepper, Trajectory(("A",), [0, 1], [[[0.0]]]))
