"""The interpolation of `setAngles`, lag and backlash, against closed forms."""

import numpy as np
import pytest

from pepper_kin.core.simulation.target_following import Following, follow_targets, read_path, speed_step


def path_of(times, targets, seconds, **changed):
    following = Following(
        **{"cycle": 0.02, "fastest": 1.0, "strongest": 20.0, "lag": 0.0, "backlash": 0.0, **changed}
    )
    path = np.empty(round(seconds / following.cycle))
    follow_targets(np.asarray(times, float), np.asarray(targets, float), following, 0.0, 0.0, path)
    return path


def test_a_step_rises_with_the_acceleration_runs_at_the_speed_and_ends_at_the_target():
    path = path_of([0.0], [1.0], 2.0)
    speed = np.diff(path, prepend=0.0) / 0.02
    assert speed[0] == pytest.approx(0.4)  # 20 rad/s^2 for 20 ms
    assert speed.max() == pytest.approx(1.0)
    assert np.abs(np.diff(speed)).max() <= 0.8 + 1e-9  # the last move may end from twice the acceleration
    assert path[-1] == 1.0
    assert (speed >= 0).all()


def test_a_lag_follows_a_ramp_late_by_its_time_constant():
    path = path_of([0.0], [10.0], 5.0, lag=0.1)
    ideal = path_of([0.0], [10.0], 5.0)
    assert ideal[-1] - path[-1] == pytest.approx(
        0.1 - 0.01, abs=2e-3
    )  # the cycle's hold is half a cycle early


def test_backlash_keeps_half_its_play_behind_on_either_side():
    path = path_of([0.0, 2.0], [1.0, 0.0], 4.0, backlash=0.01)
    assert path[95] == pytest.approx(0.99)
    assert path[-1] == pytest.approx(0.01)


def test_a_target_counts_from_the_cycle_after_it_was_given():
    early, late = path_of([0.0], [1.0], 1.0), path_of([0.05], [1.0], 1.0)
    np.testing.assert_allclose(late[3:], early[:-3], atol=1e-12)
    assert not late[:3].any()


def test_one_step_is_that_of_the_path():
    move, speed, ahead = speed_step(1.0, 0.0, 1.0, 20.0, 0.02)
    assert (move, speed, bool(ahead)) == (pytest.approx(0.008), pytest.approx(0.4), True)
    assert speed_step(0.0, 0.0, 1.0, 20.0, 0.02) == (0.0, 0.0, False)


def test_readings_lie_on_lines_and_ranges_hold_what_is_passed_meanwhile():
    path = np.arange(1.0, 51.0) ** 2
    readings = np.empty((3, 4))
    times = np.array([-1.0, 0.02, 0.5, 9.0])
    read_path(path, 0.0, 0.02, times, 0.06, readings)
    np.testing.assert_allclose(readings[0], [1.0, 1.0, 25.0**2, 2500.0])
    np.testing.assert_allclose(readings[:, 2], [25.0**2, 22.0**2, 28.0**2])
    assert readings[2, 3] == 2500.0
