"""Parts of the compiled solver: samples, kernels by address, repeated passes, looks between grid points."""

import threading

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.batch import kernel
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.trajectory import Trajectory, retime
from pepper_kin.trajectory.fast_kernel import edge_products, evaluate, linear_speed
from pepper_kin.trajectory.fast_passes import passes, repeat_passes
from pepper_kin.trajectory.fast_samples import states_at_times, states_on_pieces


@pytest.fixture(scope="module")
def pepper():
    return pk.load_pepper()


def random_path(pepper, seed):
    rng = np.random.default_rng(seed)
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.05 * lower[:3], 0.05 * upper[:3]
    return rng.uniform(lower, upper, (4, pepper.n))


@pytest.mark.parametrize("order", [1, 3, 6, 7, 8])
def test_states_are_those_of_numpy_in_any_order_of_times(order):
    rng = np.random.default_rng(order)
    breaks = np.concatenate([[0.0], np.cumsum(rng.uniform(0.01, 1.0, 40))])
    trajectory = Trajectory(("a", "b", "c"), breaks, rng.normal(size=(40, order, 3)))
    times = np.concatenate([rng.uniform(0, breaks[-1], 300), breaks, np.linspace(0, breaks[-1], 300)])
    expected = [np.array(part) for part in zip(*(trajectory(t) for t in times), strict=True)]
    np.testing.assert_allclose(states_at_times(trajectory.breaks, trajectory.coefficients, times), expected)
    piece = np.minimum(np.searchsorted(breaks, times, side="right") - 1, 39)
    found = states_on_pieces(trajectory.coefficients, piece, times - breaks[piece])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_many_times_are_checked_as_few_are():
    trajectory = Trajectory(("a",), [0.0, 1.0], np.ones((1, 2, 1)))
    for wrong in (np.nan, 1.1, -0.1):
        times = np.linspace(0, 1, 400)
        times[200] = wrong
        with pytest.raises(InvalidValueError, match=rf"t: got {wrong} s, expected times within \[0, 1\] s"):
            trajectory(times)
    with pytest.raises(IndexError):
        trajectory.at_pieces(np.full(400, 1), np.zeros(400))


def test_results_are_new_and_read_only(pepper):
    path = random_path(pepper, 0)
    first = retime(pepper, path)
    coefficients, samples = first.coefficients.copy(), first.sample(0.001)
    position = samples.position.copy()
    retime(pepper, random_path(pepper, 1)).sample(0.001)  # memory that is kept is not theirs
    np.testing.assert_array_equal(first.coefficients, coefficients)
    np.testing.assert_array_equal(samples.position, position)
    for array in (first.coefficients, first.breaks, samples.time, samples.position, samples.acceleration):
        assert not array.flags.writeable
    again = Trajectory(first.joint_names, first.breaks, first.coefficients, first.joint_units)
    assert again == first
    assert samples.time[-1] == first.duration


def test_threads_do_not_share_memory(pepper):
    paths = [random_path(pepper, seed) for seed in range(4)]
    alone = [retime(pepper, path, torque=False) for path in paths]
    together = [[] for _ in paths]

    def work(i):
        for _ in range(20):
            together[i].append(retime(pepper, paths[i], torque=False))

    threads = [threading.Thread(target=work, args=(i,)) for i in range(len(paths))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one, many in zip(alone, together, strict=True):
        assert len(many) == 20
        assert all(np.array_equal(one.coefficients, other.coefficients) for other in many)


def test_kernels_by_address_give_what_they_give(pepper):
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 50, pepper.n))
    torque, speed = kernel(pepper, "inverse_dynamics"), kernel(pepper, "frame_velocity", "LArm_effector")
    np.testing.assert_array_equal(evaluate(torque, q, v, a), torque(q, v, a))
    np.testing.assert_array_equal(evaluate(speed, q, v), speed(q, v))
    wrench, gain, shares = rng.normal(size=(50, 6)), rng.normal(size=(6, 3)), np.zeros((50, 2))
    np.testing.assert_allclose(edge_products(wrench, gain), wrench @ gain, atol=1e-12)
    linear_speed(wrench, 2.0, 1, shares)
    np.testing.assert_allclose(shares[:, 1], np.linalg.norm(wrench[:, :3], axis=1) / 2)
    assert not shares[:, 0].any()


@pytest.mark.parametrize("seed", range(6))
def test_repeated_passes_are_passes_from_the_start(seed):
    """Limits are tightened at random places; only what follows from that is computed anew."""
    rng = np.random.default_rng(seed)
    size, rows = 60, 7
    step, first = rng.uniform(0.01, 0.03, size), np.arange(size)
    a, b, c = rng.normal(size=(3, size + 1, rows))
    a[:, 0], c = 1.0, 0.3 * c
    b[20:25, 3] = a[20:25, 3] = 0.0  # a row without u
    low, high = np.full((size, rows), -3.0), np.full((size, rows), 3.0)
    x_most = rng.uniform(2.0, 20.0, size + 1)
    lines, span = np.empty((size, 3, 2 * rows + 1)), np.empty((size, 3))
    reach, x, changed = np.zeros((size + 1, 2)), np.zeros(size + 1), np.ones(size, bool)
    for _ in range(5):
        failed = repeat_passes(step, first, a, b, c, low, high, x_most, changed, lines, span, reach, x)
        expected, expected_failed = passes(step, first, a, b, c, low, high, x_most)
        assert failed == expected_failed == -1
        np.testing.assert_allclose(x, expected, rtol=1e-12, atol=1e-14)
        changed[:] = rng.random(size) < 0.1
        high[changed] *= 0.97
        low[changed] *= 0.97
        x_most[:-1][changed] *= 0.95


@pytest.mark.parametrize("gridpoints", [10, 40, 400])
@pytest.mark.parametrize("seed", range(3))
def test_limits_hold_on_coarse_grids_too(pepper, gridpoints, seed):
    """Where a limit is near, one has to look between the grid points; the check looks everywhere."""
    limits = {"balance": 0.005, "hand_speed": {"left": 0.5, "right": 0.4}, "payload": {"left": 0.1}}
    middle = pepper.posture("Stand")
    points = middle + 0.5 * (random_path(pepper, 40 + seed) - middle)
    trajectory = retime(pepper, points, gridpoints=gridpoints, **limits)
    found = trajectory.check(pepper, **limits)
    assert found.ok, found.report()


def test_hand_speed_is_used_up(pepper):
    """The bound that stands for the speed between grid points costs next to nothing."""
    points = random_path(pepper, 3)
    trajectory = retime(pepper, points, hand_speed={"left": 0.3}, gridpoints=200)
    speed = trajectory.check(pepper, hand_speed={"left": 0.3}).hand_speed
    assert 0.2995 < speed.value <= 0.3 * (1 + 1e-7)
