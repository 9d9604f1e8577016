"""Kernels of certificates: polynomials and their bounds against NumPy's."""

import numpy as np
import pytest

from pepper_kin.core.certificates.polynomials import derivative_bounds, evaluate


def curve(seed, pieces=6, size=7, joints=3):
    """Coefficients, constant term first, and lengths of pieces."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(pieces, size, joints)), rng.uniform(0.01, 2.0, pieces)


@pytest.mark.parametrize("size", [1, 2, 7])
def test_values_are_those_of_numpy(size):
    coefficients, width = curve(0, size=size)
    rng = np.random.default_rng(1)
    segment = rng.integers(0, len(width), 50)
    local = rng.uniform(0, width[segment])
    state = np.empty((4, 50, 3))
    evaluate(coefficients, segment, local, state)
    for t, (piece, x) in enumerate(zip(segment, local, strict=True)):
        for j in range(3):
            polynomial = np.polynomial.Polynomial(coefficients[piece, :, j])
            expected = [polynomial(x), *(polynomial.deriv(k)(x) for k in (1, 2, 3))]
            np.testing.assert_allclose(state[:, t, j], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("size", [1, 3, 7])
def test_bounds_of_parts_hold_and_are_near(size):
    """Nowhere on a part is a derivative greater, and the shorter the part, the nearer the bound."""
    coefficients, width = curve(2, size=size)
    rng = np.random.default_rng(3)
    segment = np.repeat(np.arange(len(width)), 4)
    start = rng.uniform(0, width[segment]) * (rng.random(segment.size) < 0.7)
    length = (width[segment] - start) * rng.choice([1.0, 1e-3], segment.size)
    bounds = np.empty((5, segment.size, 3))
    derivative_bounds(coefficients, segment, np.stack([start, length], axis=1), bounds)
    for c, (piece, begin, step) in enumerate(zip(segment, start, length, strict=True)):
        for j in range(3):
            for order in range(5):
                polynomial = np.polynomial.Polynomial(coefficients[piece, :, j])
                polynomial = polynomial.deriv(order) if order else polynomial
                most = np.abs(polynomial(begin + step * np.linspace(0, 1, 101))).max()
                assert most <= bounds[order, c, j] * (1 + 1e-12) + 1e-12
                if order < 4:  # a Bernstein coefficient is a value at most k steps away
                    assert bounds[order, c, j] <= most + size * step * bounds[order + 1, c, j] + 1e-12
