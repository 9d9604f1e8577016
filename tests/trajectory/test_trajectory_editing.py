"""Cutting, joining, blending, reversing and slowing down of trajectories."""

import itertools

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.trajectory import Trajectory


def smooth(seed, segments=4, order=6, n=3):
    """A random trajectory, continuous in position and velocity."""
    rng = np.random.default_rng(seed)
    step = rng.uniform(0.1, 0.6, segments)
    table = rng.normal(size=(segments, order, n))
    for i in range(1, segments):
        powers = step[i - 1] ** np.arange(order)
        table[i, 0] = powers @ table[i - 1]
        table[i, 1] = (np.arange(1, order) * powers[:-1]) @ table[i - 1, 1:]
    return Trajectory(("a", "b", "c"), np.concatenate([[0.0], np.cumsum(step)]), table)


def resting(pepper, *goals):
    """Trajectories from rest to rest, each from where the last one ends."""
    points = [pepper.posture("Stand"), *(pepper.joint_vector(goal) for goal in goals)]
    return [pk.retime(pepper, [a, b]) for a, b in itertools.pairwise(points)]


@pytest.mark.parametrize("seed", range(5))
def test_scaling_keeps_the_path(seed):
    one = smooth(seed)
    slow = one.scaled(2.5)
    t = np.linspace(0, one.duration, 40)
    for power, (theirs, ours) in enumerate(zip(one(t), slow(2.5 * t), strict=True)):
        np.testing.assert_allclose(ours, theirs / 2.5**power, rtol=1e-9, atol=1e-9)
    assert one.with_duration(3.0).duration == pytest.approx(3.0, rel=1e-14)
    assert slow.with_duration(one.duration).is_close(one, 1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_reversal_twice_is_nothing(seed):
    one = smooth(seed)
    back = one.reversed()
    t = np.linspace(0, one.duration, 41)
    np.testing.assert_allclose(back(t).position, one(one.duration - t).position, atol=1e-8)
    np.testing.assert_allclose(back(t).velocity[1:-1], -one(one.duration - t).velocity[1:-1], atol=1e-7)
    assert back.reversed().is_close(one, 1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_parts_joined_again_are_the_whole(seed):
    one = smooth(seed)
    for share in (0.013, 0.5, 0.97):
        cut = share * one.duration
        first, second = one.between(0.0, cut), one.between(cut, one.duration)
        assert first.duration == pytest.approx(cut)
        np.testing.assert_allclose(second(0.0).acceleration, one(cut).acceleration, atol=1e-8)
        assert first.then(second).is_close(one, 1e-7)
    at_knot = one.knots[2]
    assert one.between(0, at_knot).then(one.between(at_knot, one.duration)).is_close(one, 1e-8)


def test_a_part_of_one_piece():
    one = smooth(1)
    part = one.between(one.knots[1] + 0.01, one.knots[2] - 0.01)
    assert part.knots.size == 2
    np.testing.assert_allclose(part(0.02).position, one(one.knots[1] + 0.03).position, atol=1e-10)


def test_joined_motions_pass_their_certificate(pepper):
    there, on = resting(pepper, {"HeadYaw": 0.5}, {"HeadYaw": -0.3, "LElbowYaw": -0.8})
    whole = there.then(on).then(on.reversed()).then(there.reversed())
    assert whole.duration == pytest.approx(2 * (there.duration + on.duration))
    assert whole.check(pepper, collisions=False).success, whole.check(pepper, collisions=False).report()
    np.testing.assert_allclose(whole.end, there.start, atol=1e-9)


def test_blending_cuts_the_via_point_and_saves_time(pepper):
    there, on = resting(pepper, {"HeadYaw": 0.5}, {"HeadYaw": 0.5, "LElbowYaw": -0.8})
    overlap = 0.2
    blend = there.blend(on, overlap)
    assert blend.duration == pytest.approx(there.duration + on.duration - overlap)
    t = np.linspace(0, blend.duration, 200)
    late = np.clip(t - there.duration + overlap, 0, on.duration)
    expected = there(np.minimum(t, there.duration)).position + on(late).position - on.start
    np.testing.assert_allclose(blend(t).position, expected, atol=1e-9)
    found = blend.check(pepper, collisions=False)
    assert found.position_continuity.success
    assert found.velocity_continuity.success
    assert found.velocity.success  # different joints move, so that the sum exceeds nothing
    via = np.abs(blend(there.duration - overlap / 2).velocity)
    assert via.max() > 0.05  # it does not stop


def test_blending_a_short_one_into_a_long_one(pepper):
    there, on = resting(pepper, {"HeadYaw": 1.0}, {"HeadYaw": 1.02})
    blend = there.blend(on, on.duration)
    assert blend.duration == pytest.approx(there.duration)
    np.testing.assert_allclose(blend.end, on.end, atol=1e-9)


def test_jerk_is_the_derivative_of_acceleration():
    one = smooth(3)
    t = np.linspace(0.01, one.duration - 0.01, 30)
    t = t[np.abs(t[:, None] - one.knots).min(axis=1) > 1e-3]
    difference = (one(t + 1e-6).acceleration - one(t - 1e-6).acceleration) / 2e-6
    np.testing.assert_allclose(one.jerk(t), difference, rtol=1e-5, atol=1e-4)


def test_many_states_at_once_are_those_one_by_one(pepper):
    """Many are evaluated in machine code once the fast solver is loaded."""
    trajectory = resting(pepper, {"HeadYaw": 0.5})[0]
    t = np.linspace(0, trajectory.duration, 1000)
    for many, ones in zip(trajectory(t), zip(*(trajectory(x) for x in t), strict=True), strict=True):
        np.testing.assert_allclose(many, np.array(ones), rtol=0, atol=1e-13)


def test_refusals_name_what_is_wrong(pepper):
    one = smooth(0)
    there, on = resting(pepper, {"HeadYaw": 0.5}, {"HeadYaw": -0.3})
    for call, message in [
        (lambda: one.scaled(0.0), "factor: got 0.0"),
        (lambda: one.scaled(float("nan")), "factor: got nan"),
        (lambda: one.with_duration(0.0), "duration: got 0.0"),
        (lambda: one.between(0.5, 0.5), "start and end: got 0.5 s and 0.5 s, expected 0 <= start < end"),
        (lambda: one.between(-1.0, 0.5), "start and end: got -1.0 s"),
        (lambda: one.between(float("nan"), 0.5), "start: got nan"),
        (lambda: one.then(one), "start of the second trajectory, position of"),
        (lambda: on.then(on), "position of HeadYaw: got 0.5, expected -0.3, where the first one ends"),
        (lambda: one.then(there), "joints of the second trajectory: got KneePitch"),
        (lambda: one.then("x"), "trajectory: got 'x'"),
        (lambda: there.blend(on, 99.0), "overlap: got 99.0 s, expected at most the shorter duration"),
        (lambda: there.blend(on, 0.0), "overlap: got 0.0"),
        (lambda: Trajectory(("a",), [0.0, 0.0], np.zeros((1, 2, 1))), "breaks: got .*increase from 0"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            call()
