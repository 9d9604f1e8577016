"""Rows on tabulated joint ranges: slopes by finite differences, ways by sampling the tables themselves."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.core.braking import brake_path, stopping_place, ticks_to_rest
from pepper_kin.core.velocity_dampers import ANGLE_KEPT
from pepper_kin.servo.range_rows import RangeRows

PEPPER = pk.load_pepper()
TABLES = dependent_ranges(PEPPER)


def postures(count, seed):
    return np.random.default_rng(seed).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (count, PEPPER.n))


def test_ways_that_enter_a_range_are_reported_and_no_others():
    ranges, met = RangeRows(PEPPER), {True: 0, False: 0}
    starts, ends = postures(1500, 0), postures(1500, 1)
    for q, end, share in zip(starts, ends, np.linspace(0.02, 1.0, 1500), strict=True):
        path = q + share * np.linspace(0.0, 1.0, 60)[1:, None] * (end - q)
        found = ranges.entered(q, path)
        entered = [t for t in TABLES if t.violated(path).any() and not t.violated(q)]
        assert (found is not None) == bool(entered)
        if found is not None:
            expected = [((t.first, t.second), f"clearance of {t.links[0]} and {t.links[1]}") for t in entered]
            assert found in expected
        met[bool(entered)] += 1
    assert min(met.values()) > 100


def test_rows_are_the_slopes_of_the_angle_left():
    """least = -gain (h - kept) gives h, whose central differences are the rows."""
    ranges, gain, step, compared = RangeRows(PEPPER), 3.0, 1e-7, 0
    for q in postures(60, 2):
        rows = ranges.rows(q, q, gain)
        left = ANGLE_KEPT - rows.least / gain
        for table in TABLES:
            if table.violated(q):
                name = f"clearance of {table.links[0]} and {table.links[1]}"
                assert min(h for h, n in zip(left, rows.names, strict=True) if n == name) == ANGLE_KEPT
        for joint in sorted({t.first for t in TABLES} | {t.second for t in TABLES}):
            change = step * np.eye(PEPPER.n)[joint]
            ahead, behind = (ranges.rows(x, x, gain).least / -gain for x in (q + change, q - change))
            slopes = (ahead - behind) / (2 * step)
            # Two rows share one angle: one row for each of its joints.
            both = rows.matrix[::2, joint] + rows.matrix[1::2, joint]
            free = (rows.least[::2] < -1e-4) & (np.abs(ahead + behind - 2 * (left - ANGLE_KEPT))[::2] < 1e-12)
            assert slopes[::2][free] == pytest.approx(both[free], abs=1e-6)
            assert np.array_equal(rows.least[::2], rows.least[1::2])
            compared += int(np.count_nonzero(free & (np.abs(both) > 0.01)))
    assert compared > 200


def test_brake_path_is_that_of_joints_that_brake_tick_by_tick():
    generator, dt = np.random.default_rng(3), 0.01
    for _ in range(30):
        v, a = generator.normal(size=6) * generator.choice([0.01, 1.0, 10.0]), generator.uniform(0.5, 60, 6)
        a[0] = np.inf
        speed, place, path = v.copy(), np.zeros(6), [np.zeros(6)]
        while np.any(speed != 0):
            place = place + dt * speed
            path.append(place)
            speed = np.sign(speed) * np.maximum(np.abs(speed) - a * dt, 0.0)
        end = ticks_to_rest(v, a, dt)
        assert end in (len(path) - 1, len(path))  # a last tick may be one of rounding
        made = brake_path(v, a, dt, np.arange(len(path)))
        assert made == pytest.approx(np.array(path), abs=1e-12)
        assert stopping_place(np.ones(6), v, a, dt) == pytest.approx(1.0 + place, abs=1e-12)
