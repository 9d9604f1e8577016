"""Ways along a path into another motion: derivatives of composed polynomials as the oracle."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from pepper_kin.core.timing.joining import next_way


@pytest.mark.thorough
def test_ways_are_kept_that_keep_limits_at_every_instant():
    rng = np.random.default_rng(0)
    n, breaks = 3, np.array([0.0, 0.4, 1.0, 1.5])
    path = [Polynomial(rng.normal(size=4)) for _ in range(n)]
    shifted = [[joint(Polynomial([a, 1.0])).coef for joint in path] for a in breaks[:-1]]
    coefficients = np.ascontiguousarray(np.array(shifted).transpose(0, 2, 1))  # one cubic, in three pieces
    times = rng.uniform(0.5, 2.0, 400)
    ways = np.zeros((400, 6))
    ways[:, 1] = rng.uniform(0.0, 0.7, 400)
    ways[:, 2:] = rng.normal(size=(400, 4)) * 0.05
    limits = np.array([[1.5], [3.0], [12.0]]) * rng.uniform(0.5, 1.5, (3, n))
    limits[1, 0] = np.inf
    expected = []
    for k, (way, time) in enumerate(zip(ways, times, strict=True)):
        t, s = time * np.arange(65) / 64, Polynomial(way)
        if s(t).min() < 0 or s(t).max() > breaks[-1]:
            times[k] = 0.0  # an instant at the start is all that is looked at
            t = np.zeros(1)
        motion = [[joint(s).deriv(order)(t) for joint in path] for order in (1, 2, 3)]
        inside = (np.abs(motion) <= limits[:, :, None]).all()
        if inside and s.deriv()(t).min() >= 0:
            expected.append(k)
    found, k = [], -1
    while (k := next_way(breaks, coefficients, ways, times, limits, k + 1)) >= 0:
        found.append(k)
    assert found == expected
    assert 40 < len(expected) < 360
