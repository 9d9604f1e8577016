"""Sine and cosine against extended precision, in units in the last place."""

import dataclasses

import casadi as ca
import numpy as np
import pytest

from pepper_kin.kernels import compile_function, host_target
from pepper_kin.kernels.trigonometry import range_limit

pytestmark = pytest.mark.skipif(
    np.finfo(np.longdouble).nmant < 60, reason="needs a long double wider than a double"
)
WITHOUT_FMA = dataclasses.replace(host_target(), cpu="x86-64", features="", vector_bytes=16, has_fma=False)
TARGETS = [host_target()] + ([WITHOUT_FMA] if host_target().triple.startswith("x86_64") else [])


def sine_cosine(dtype, target, *, of_input=True):
    """A kernel of (sin x, cos x, tan x), by the loop over inputs or inside the straight-line code."""
    x = ca.SX.sym("x")
    angle = x if of_input else ca.fabs(x) * ca.sign(x)
    return compile_function(
        ca.Function("f", [x], [ca.sin(angle), ca.cos(angle), ca.tan(angle)]),
        dtype=dtype,
        target=target,
        cache=False,
    )


def samples(dtype):
    """Angles within 1e4 rad: everywhere, small ones, and the numbers next to multiples of pi / 4."""
    rng = np.random.default_rng(0)
    near = np.arange(-12732, 12733) * (np.pi / 4)
    steps = [near.astype(dtype)]
    for _ in range(3):
        steps += [np.nextafter(steps[-1], dtype(np.inf)), np.nextafter(steps[-1], dtype(-np.inf))]
    wide = rng.uniform(-1e4, 1e4, 100_000)
    narrow = rng.uniform(-4, 4, 50_000)
    small = 10.0 ** rng.uniform(-30, 0, 5_000)
    angles = np.concatenate([*steps, wide, narrow, small, [0.0, -0.0, 1e4, -1e4]]).astype(dtype)
    return angles[np.abs(angles) <= 1e4]


def error_in_ulp(got, exact):
    unit = np.spacing(np.abs(exact).astype(got.dtype)).astype(np.longdouble)
    return float(np.max(np.abs(got.astype(np.longdouble) - exact) / unit))


@pytest.mark.parametrize("of_input", [True, False])
@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.cpu)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_two_units_in_the_last_place_within_ten_thousand_radians(dtype, target, of_input):
    angles = samples(np.dtype(dtype).type)
    sine, cosine, _ = sine_cosine(dtype, target, of_input=of_input)(angles[:, None])
    exact = angles.astype(np.longdouble)
    assert error_in_ulp(sine[:, 0], np.sin(exact)) < 2.0
    assert error_in_ulp(cosine[:, 0], np.cos(exact)) < 2.0


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.cpu)
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_beyond_the_fast_range_the_result_is_still_right(dtype, target):
    limit = range_limit(dtype, target.has_fma)
    rng = np.random.default_rng(2)
    angles = np.concatenate([limit * rng.uniform(0.9, 1.1, 400), 10.0 ** rng.uniform(3, 30, 400)]).astype(
        dtype
    )
    sine, cosine, _ = sine_cosine(dtype, target)(angles[:, None])
    exact = angles.astype(np.longdouble)
    assert error_in_ulp(sine[:, 0], np.sin(exact)) < 2.0
    assert error_in_ulp(cosine[:, 0], np.cos(exact)) < 2.0


def test_not_finite_gives_nan_and_leaves_neighbors_alone():
    angles = np.array([0.5, np.nan, np.inf, -0.5, 0.25])
    sine, cosine, tangent = sine_cosine("float64", host_target())(angles[:, None], check_finite=False)
    finite = np.isfinite(angles)
    for got, law in ((sine, np.sin), (cosine, np.cos), (tangent, np.tan)):
        np.testing.assert_allclose(got[finite, 0], law(angles[finite]), rtol=1e-15)
        assert np.isnan(got[~finite]).all()


def test_sine_of_minus_zero_keeps_its_sign():
    sine, cosine, _ = sine_cosine("float64", host_target())(np.array([[-0.0], [0.0]]))
    np.testing.assert_array_equal(np.signbit(sine[:, 0]), [True, False])
    np.testing.assert_array_equal(cosine[:, 0], [1.0, 1.0])
