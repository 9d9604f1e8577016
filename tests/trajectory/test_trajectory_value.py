"""The value type Trajectory: evaluation, sampling, equality, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.trajectory import Samples, Trajectory


def random_trajectory(seed, segments=4, order=5, n=3):
    rng = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.0, segments))])
    names = tuple(f"J{i}" for i in range(n))
    return Trajectory(names, breaks, rng.normal(size=(segments, order, n)))


@given(
    seed=st.integers(0, 10_000),
    segments=st.integers(1, 6),
    order=st.integers(1, 8),
    shares=st.lists(st.floats(0, 1), min_size=1, max_size=8),
)
@settings(max_examples=60, deadline=None)
def test_evaluation_agrees_with_scipy(seed, segments, order, shares):
    trajectory = random_trajectory(seed, segments, order)
    oracle = PPoly(np.moveaxis(trajectory.coefficients[:, ::-1], 1, 0), trajectory.breaks)
    t = np.array(shares) * trajectory.duration
    for ours, derivative in zip(trajectory(t), range(3), strict=True):
        np.testing.assert_allclose(ours, oracle(t, derivative), rtol=1e-10, atol=1e-10)


def test_batch_axes_are_kept():
    trajectory = random_trajectory(0)
    t = np.linspace(0, trajectory.duration, 6)
    assert trajectory(t.reshape(2, 3)).position.shape == (2, 3, 3)
    assert trajectory(0.1).velocity.shape == (3,)
    np.testing.assert_array_equal(trajectory(t.reshape(2, 3)).position[1, 2], trajectory(t[5]).position)


def test_both_sides_of_a_knot_can_be_distinguished():
    trajectory = Trajectory(("a",), [0, 1, 3], np.array([[[0.0], [1.0]], [[1.0], [-2.0]]]))
    assert trajectory(1.0).velocity == -2.0
    assert trajectory.at_segments(0, 1.0).velocity == 1.0
    assert trajectory.end == -3.0
    assert trajectory.start == 0.0
    np.testing.assert_array_equal(trajectory.knots, [0, 1, 3])


@pytest.mark.parametrize("dt", [0.001, 0.1, 0.25, 1.0, 7.0, 0.3])
def test_samples_end_exactly_at_the_duration(dt):
    trajectory = Trajectory(("a",), [0, 1.0], np.array([[[0.0], [1.0], [1.0]]]))
    samples = trajectory.sample(dt)
    assert samples.time[0] == 0.0
    assert samples.time[-1] == trajectory.duration
    steps = np.diff(samples.time)
    assert np.all(steps > 1e-9)
    assert np.all(steps <= dt + 1e-12)
    np.testing.assert_allclose(samples.position[:, 0], samples.time + samples.time**2)


def test_samples_return_through_a_quintic():
    trajectory = random_trajectory(3, segments=1, order=6)
    samples = trajectory.sample(0.05)
    again = samples.to_trajectory()
    assert again.is_close(trajectory, 1e-6)  # a quintic is met exactly, up to the conditioning of 1/h^5
    for ours, theirs in zip(
        again(samples.time), (samples.position, samples.velocity, samples.acceleration), strict=True
    ):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_equality_is_of_values_not_of_pieces():
    one = Trajectory(("a",), [0, 2], np.array([[[1.0], [2.0], [3.0]]]))
    # 1 + 2 t + 3 t^2 about t = 1 is 6 + 8 x + 3 x^2
    two = Trajectory(("a",), [0, 1, 2], np.array([[[1.0], [2.0], [3.0]], [[6.0], [8.0], [3.0]]]))
    assert one == two
    assert one != Trajectory(("b",), one.breaks, one.coefficients)
    assert one != Trajectory(("a",), one.breaks, one.coefficients, ("m",))
    assert one != Trajectory(("a",), one.breaks, one.coefficients + 1e-6)
    assert one == Trajectory(("a",), one.breaks, one.coefficients + 1e-11)
    assert one != Trajectory(("a",), [0, 2.1], one.coefficients)
    assert one != "trajectory"


def test_arrays_are_copied_in_and_read_only():
    coefficients = np.ones((1, 2, 1))
    trajectory = Trajectory(("a",), [0.0, 1.0], coefficients)
    coefficients[:] = 7.0
    assert trajectory.start == 1.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.coefficients[0, 0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.sample(0.5).position[0] = 1.0


def test_bad_fields_are_refused_by_name():
    for fields, message in [
        ((("a",), [0.0, 0.0], np.ones((1, 2, 1))), "breaks: .*increase from 0"),
        ((("a",), [0.0], np.ones((0, 2, 1))), "breaks: .*increase from 0"),
        ((("a",), [1.0, 2.0], np.ones((1, 2, 1))), "breaks: .*increase from 0"),
        ((("a",), [0.0, np.nan], np.ones((1, 2, 1))), "breaks: got nan"),
        ((("a",), [0.0, 1.0], np.full((1, 2, 1), np.inf)), "coefficients: got inf"),
        ((("a",), [0.0, 1.0], np.ones((2, 2, 1))), "coefficients: got shape"),
        ((("a", "a"), [0.0, 1.0], np.ones((1, 2, 2))), "joint_names"),
        (((), [0.0, 1.0], np.ones((1, 2, 0))), "joint_names"),
        ((("a",), [0.0, 1.0], np.ones((1, 0, 1))), "at least a constant"),
        ((("a",), [0.0, 1.0], np.ones((1, 2, 1)), ("deg",)), "joint_units: .*'rad' or 'm'"),
    ]:
        with pytest.raises(InvalidValueError, match=message):
            Trajectory(*fields)


def test_times_outside_are_refused():
    for t in [-1e-3, 1.1, np.nan, [0.5, 2.0]]:
        trajectory = Trajectory(("a",), [0.0, 1.0], np.ones((1, 2, 1)))
        with pytest.raises(InvalidValueError, match=r"t: got .* s, expected times within \[0, 1\] s"):
            trajectory(t)


def test_times_outside_by_rounding_are_taken_as_the_ends():
    trajectory = Trajectory(("a",), [0.0, 1.0], np.ones((1, 2, 1)))
    assert trajectory(1.0 + 1e-10).position == trajectory.end
    assert trajectory(-1e-10).position == trajectory.start


def test_bad_steps_are_refused():
    for dt in [0, -1, np.nan, "a", 1e-9]:
        with pytest.raises(InvalidValueError, match="dt"):
            Trajectory(("a",), [0.0, 1.0], np.ones((1, 2, 1))).sample(dt)


def test_samples_that_make_no_trajectory_are_refused():
    with pytest.raises(InvalidValueError, match="at least 2"):
        Samples(("a",), [0.0], [[0.0]], [[0.0]], [[0.0]]).to_trajectory()
    with pytest.raises(InvalidValueError, match="increase from 0"):
        Samples(("a",), [0.0, 0.0], *np.zeros((3, 2, 1))).to_trajectory()
    with pytest.raises(InvalidValueError, match="velocity: got shape"):
        Samples(("a",), [0.0, 1.0], [[0.0], [1.0]], [[0.0]], [[0.0], [0.0]])
