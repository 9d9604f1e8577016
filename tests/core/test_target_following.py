"""The interpolation of `setAngles`, lag and backlash, against closed forms."""

import numpy as np
import pytest

from pepper_kin.core.simulation.target_following import (
    Following,
    follow_targets,
    read_path,
    respond,
    time_to_target,
    way_to_target,
)


def path_of(times, targets, seconds, **changed):
    following = Following(
        **{"cycle": 0.02, "fastest": 1.0, "strongest": 20.0, "lag": 0.0, "backlash": 0.0, **changed}
    )
    path = np.empty(round(seconds / following.cycle))
    follow_targets(np.asarray(times, float), np.asarray(targets, float), following, 0.0, 0.0, path)
    respond(following, 0.0, path)
    return path


def test_a_step_is_a_cubic_with_the_speed_in_its_middle():
    path = path_of([0.0], [1.0], 2.0)
    t = np.minimum(0.02 * np.arange(1, 101) / 1.5, 1.0)
    np.testing.assert_allclose(path, t * t * (3 - 2 * t), atol=1e-12)
    assert (np.diff(path, prepend=0.0) / 0.02).max() == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(("way", "speed"), [(0.4, 0.0), (-0.4, 0.7), (0.02, 0.9), (0.0, -0.5)])
def test_the_way_to_a_target_is_the_cubic_of_its_ends(way, speed):
    """Hermite's cubic by its four conditions, solved as equations; times by what they are to keep."""
    total = time_to_target(way, speed, 1.0, 5.0)
    assert total == pytest.approx(max(1.5 * abs(way), np.sqrt(0.6 * abs(way)), abs(speed) / 5.0))
    ends = np.vander([0.0, total], 4)
    slopes = np.column_stack([3 * ends[:, 1], 2 * ends[:, 2], ends[:, 3], np.zeros(2)])
    powers = np.linalg.solve(np.vstack([ends, slopes]), [0.0, way, speed, 0.0])
    for t in np.linspace(0.0, total, 7):
        assert way_to_target(way, speed, total, t) == pytest.approx(np.polyval(powers, t), abs=1e-12)
    assert way_to_target(way, speed, total, 2 * total) == way


def test_each_target_begins_anew_with_the_speed_of_now():
    """The same far target, sent again and again, makes a joint start more slowly, without jumps."""
    once, again = path_of([0.0], [3.0], 2.0), path_of(0.1 * np.arange(20), np.full(20, 3.0), 2.0)
    assert 0.8 * once[20] < again[20] < once[20]
    assert np.abs(np.diff(again, 2)).max() / 0.02**2 < 2 * 20.0


def test_a_lag_follows_a_ramp_late_by_its_time_constant():
    ramp = 0.02 * np.arange(1.0, 251.0)
    path = ramp.copy()
    respond(Following(0.02, 1.0, 20.0, 0.1, 0.0), 0.0, path)
    assert ramp[-1] - path[-1] == pytest.approx(0.1 - 0.01, abs=1e-3)  # held for a cycle


def test_backlash_keeps_half_its_play_behind_on_either_side():
    path = path_of([0.0, 2.0], [1.0, 0.0], 4.0, backlash=0.01)
    assert path[95] == pytest.approx(0.99)
    assert path[-1] == pytest.approx(0.01)


def test_a_target_counts_from_the_cycle_after_it_was_given():
    early, late = path_of([0.0], [1.0], 1.0), path_of([0.05], [1.0], 1.0)
    np.testing.assert_allclose(late[3:], early[:-3], atol=1e-12)
    assert not late[:3].any()


def test_readings_lie_on_lines_and_ranges_hold_what_is_passed_meanwhile():
    path = np.arange(1.0, 51.0) ** 2
    readings = np.empty((3, 4))
    times = np.array([-1.0, 0.02, 0.5, 9.0])
    read_path(path, 0.0, 0.02, times, 0.06, readings)
    np.testing.assert_allclose(readings[0], [1.0, 1.0, 25.0**2, 2500.0])
    np.testing.assert_allclose(readings[:, 2], [25.0**2, 22.0**2, 28.0**2])
    assert readings[2, 3] == 2500.0
