"""Rows on tabulated joint ranges: slopes by finite differences, ways by sampling the tables themselves."""

import numpy as np
import pytest

import pepper_kin as pk
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.core.braking import brake_path
from pepper_kin.core.velocity_dampers import ANGLE_KEPT, entered_range, write_range_rows
from pepper_kin.servo.range_curves import range_curves

PEPPER = pk.load_pepper()
TABLES = dependent_ranges(PEPPER)


def postures(count, seed):
    return np.random.default_rng(seed).uniform(PEPPER.lower_limits, PEPPER.upper_limits, (count, PEPPER.n))


def test_ways_that_enter_a_range_are_reported_and_no_others():
    curves, met = range_curves(PEPPER), {True: 0, False: 0}
    starts, ends = postures(1500, 0), postures(1500, 1)
    for q, end, share in zip(starts, ends, np.linspace(0.02, 1.0, 1500), strict=True):
        shifts = share * np.linspace(0.0, 1.0, 60)[:, None] * (end - q)
        found = entered_range(curves.table, q, shifts)
        entered = [t for t in TABLES if t.violated(q + shifts).any() and not t.violated(q)]
        assert (found >= 0) == bool(entered)
        if found >= 0:
            expected = [((t.first, t.second), f"clearance of {t.links[0]} and {t.links[1]}") for t in entered]
            assert (tuple(curves.table.heads[found, :2]), curves.names[found]) in expected
        met[bool(entered)] += 1
    assert min(met.values()) > 100


def test_rows_are_the_slopes_of_the_angle_left():
    """least = -gain (h - kept) gives h, whose central differences are the rows."""
    curves, gain, step, compared = range_curves(PEPPER), 3.0, 1e-7, 0
    names = [name for name in curves.names for _ in range(2)]

    def rows_at(q):
        matrix, least = np.zeros((len(names), PEPPER.n)), np.empty(len(names))
        write_range_rows(curves.table, q, q, gain, matrix, least)
        return matrix, least

    for q in postures(60, 2):
        matrix, least = rows_at(q)
        left = ANGLE_KEPT - least / gain
        for table in TABLES:
            if table.violated(q):
                name = f"clearance of {table.links[0]} and {table.links[1]}"
                assert min(h for h, n in zip(left, names, strict=True) if n == name) == ANGLE_KEPT
        for joint in sorted({t.first for t in TABLES} | {t.second for t in TABLES}):
            change = step * np.eye(PEPPER.n)[joint]
            ahead, behind = (rows_at(x)[1] / -gain for x in (q + change, q - change))
            slopes = (ahead - behind) / (2 * step)
            # Two rows share one angle: one row for each of its joints.
            both = matrix[::2, joint] + matrix[1::2, joint]
            free = (least[::2] < -1e-4) & (np.abs(ahead + behind - 2 * (left - ANGLE_KEPT))[::2] < 1e-12)
            assert slopes[::2][free] == pytest.approx(both[free], abs=1e-6)
            assert np.array_equal(least[::2], least[1::2])
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
        made = brake_path(v, a, dt)
        assert len(made) in (len(path), len(path) + 1)  # a last tick may be one of rounding
        assert made[: len(path)] == pytest.approx(np.array(path), abs=1e-12)
        assert made[-1] == pytest.approx(place, abs=1e-12)
