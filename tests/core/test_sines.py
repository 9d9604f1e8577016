"""Sines and cosines in vectors against those of a wider number format."""

import numpy as np
import pytest

from pepper_kin.core.sines import FAR, sines_and_cosines


@pytest.mark.parametrize("reach", [1e-8, 1.0, 10.0, 1e3, FAR, 1e9])
@pytest.mark.parametrize("count", [0, 1, 3, 4, 1001])
def test_both_are_right_to_the_last_place(reach, count):
    rng = np.random.default_rng(0)
    angles = rng.uniform(-reach, reach, count)
    # Beside multiples of pi / 2 nearly all digits cancel.
    angles[::2] = np.round(angles[::2] / (np.pi / 2)) * (np.pi / 2) + rng.normal(size=len(angles[::2])) * 1e-7
    sines, cosines = np.full((2, count), np.nan)
    sines_and_cosines(angles, sines, cosines)
    for found, expected in ((sines, np.sin), (cosines, np.cos)):
        exact = expected(angles.astype(np.longdouble))
        error = np.abs(found - exact) / np.spacing(np.abs(exact).astype(float))
        assert error.max(initial=0.0) < 1.5
