"""Every operation against CasADi's own evaluation."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.kernels import SUPPORTED_OPERATIONS, UnsupportedInstructionError, compile_function

ANY, POSITIVE, UNIT, ABOVE_ONE = (-5.0, 5.0), (0.01, 5.0), (-0.99, 0.99), (1.01, 9.0)

# How to make CasADi emit the operation, and the range of x (y is in ANY).
CASES = {
    "add": (lambda x, y: x + y, ANY),
    "sub": (lambda x, y: x - y, ANY),
    "mul": (lambda x, y: x * y, ANY),
    "div": (lambda x, y: x / y, ANY),
    "neg": (lambda x, y: -x, ANY),
    "sq": (lambda x, y: x**2, ANY),
    "twice": (lambda x, y: 2 * x, ANY),
    "inv": (lambda x, y: 1 / x, ANY),
    "sqrt": (lambda x, y: ca.sqrt(x), POSITIVE),
    "fabs": (lambda x, y: ca.fabs(x), ANY),
    "floor": (lambda x, y: ca.floor(x), ANY),
    "ceil": (lambda x, y: ca.ceil(x), ANY),
    "sign": (lambda x, y: ca.sign(x), ANY),
    "copysign": (lambda x, y: ca.copysign(x, y), ANY),
    "fmin": (lambda x, y: ca.fmin(x, y), ANY),
    "fmax": (lambda x, y: ca.fmax(x, y), ANY),
    "fmod": (lambda x, y: ca.fmod(x, y), ANY),
    "remainder": (lambda x, y: ca.remainder(x, y), ANY),
    "hypot": (lambda x, y: ca.hypot(x, y), ANY),
    "lt": (lambda x, y: x < y, ANY),
    "le": (lambda x, y: x <= y, ANY),
    "eq": (lambda x, y: x == y, ANY),
    "ne": (lambda x, y: x != y, ANY),
    "not": (lambda x, y: ca.logic_not(x), ANY),
    "and": (lambda x, y: ca.logic_and(x, y), ANY),
    "or": (lambda x, y: ca.logic_or(x, y), ANY),
    "if_else_zero": (lambda x, y: ca.if_else(x, y, 0), ANY),
    "exp": (lambda x, y: ca.exp(x), ANY),
    "log": (lambda x, y: ca.log(x), POSITIVE),
    "log1p": (lambda x, y: ca.log1p(x), POSITIVE),
    "expm1": (lambda x, y: ca.expm1(x), ANY),
    "erf": (lambda x, y: ca.erf(x), ANY),
    "pow": (lambda x, y: x**y, POSITIVE),
    "constpow": (lambda x, y: x**2.5, POSITIVE),
    "sin": (lambda x, y: ca.sin(x), ANY),
    "cos": (lambda x, y: ca.cos(x), ANY),
    "tan": (lambda x, y: ca.tan(x), UNIT),
    "asin": (lambda x, y: ca.asin(x), UNIT),
    "acos": (lambda x, y: ca.acos(x), UNIT),
    "atan": (lambda x, y: ca.atan(x), ANY),
    "atan2": (lambda x, y: ca.atan2(x, y), ANY),
    "sinh": (lambda x, y: ca.sinh(x), ANY),
    "cosh": (lambda x, y: ca.cosh(x), ANY),
    "tanh": (lambda x, y: ca.tanh(x), ANY),
    "asinh": (lambda x, y: ca.asinh(x), ANY),
    "acosh": (lambda x, y: ca.acosh(x), ABOVE_ONE),
    "atanh": (lambda x, y: ca.atanh(x), UNIT),
}
SPECIAL = [0.0, -0.0, 1.0, -1.0, 2.5, -2.5, np.inf, -np.inf, np.nan, 5e-324, 1e300]


def function_of(name):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    function = ca.Function(name, [x, y], [CASES[name][0](x, y)], ["x", "y"], ["z"])
    codes = {function.instruction_id(k) for k in range(function.n_instructions())}
    assert getattr(ca, f"OP_{name.upper()}") in codes
    return function


def evaluate(function, *columns):
    return np.array(function(*(np.atleast_2d(c) for c in columns))).reshape(-1, 1)


@pytest.fixture(scope="module")
def kernels():
    return {
        (name, dtype): compile_function(function_of(name), dtype=dtype, cache=False)
        for name in CASES
        for dtype in ("float64", "float32")
    }


def test_every_supported_operation_is_tested():
    assert set(CASES) == set(SUPPORTED_OPERATIONS)


@pytest.mark.thorough
@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-14), ("float32", 2e-6)])
@pytest.mark.parametrize("name", sorted(CASES))
def test_operation_agrees_with_casadi(kernels, name, dtype, tolerance):
    rng = np.random.default_rng(1)
    x = rng.uniform(*CASES[name][1], 203).astype(dtype)
    y = rng.uniform(*ANY, 203).astype(dtype)
    y[::7] = x[::7]  # so that comparisons meet equal values
    x[3:200:50] = 1.0 if CASES[name][1] == ABOVE_ONE else 0.5
    got = kernels[name, dtype](x[:, None], y[:, None])
    want = evaluate(function_of(name), x.astype(float), y.astype(float))
    # Of x**y, a relative error of the float y * log(x) is an absolute one of the exponent.
    scale = 10 if name in ("pow", "exp", "fmod", "remainder") else 1
    np.testing.assert_allclose(got, want, rtol=scale * tolerance, atol=scale * tolerance)


@pytest.mark.thorough
@pytest.mark.parametrize("name", sorted(CASES))
def test_special_values_agree_with_casadi(kernels, name):
    x, y = (grid.ravel() for grid in np.meshgrid(SPECIAL, SPECIAL))
    got = kernels[name, "float64"](x[:, None], y[:, None], check_finite=False)
    want = evaluate(function_of(name), x, y)
    np.testing.assert_allclose(got, want, rtol=1e-13)
    if name not in ("fmin", "fmax"):  # of 0 and -0 either may be the smaller one
        zero = want == 0
        np.testing.assert_array_equal(np.signbit(got[zero]), np.signbit(want[zero]))


@settings(max_examples=60, deadline=None)
@given(
    name=st.sampled_from(sorted(set(CASES) - {"sin", "cos", "tan", "fmod", "remainder"})),
    x=st.floats(-1e6, 1e6),
    y=st.floats(-1e6, 1e6),
)
def test_any_numbers_agree_with_casadi(kernels, name, x, y):
    got = kernels[name, "float64"]([[x]], [[y]])
    want = evaluate(function_of(name), [x], [y])
    np.testing.assert_allclose(got, want, rtol=1e-13, atol=1e-300)


def test_conditional_does_not_let_the_other_branch_through():
    x = ca.SX.sym("x")
    kernel = compile_function(ca.Function("f", [x], [ca.if_else(x > 0, ca.sqrt(x), -1 / x)]), cache=False)
    np.testing.assert_allclose(kernel([[4.0], [-2.0]]), [[2.0], [0.5]])


def test_unsupported_instruction_is_named():
    x = ca.SX.sym("x")
    with pytest.raises(UnsupportedInstructionError) as caught:
        compile_function(ca.Function("half_normal", [x], [ca.erfinv(x)]))
    assert caught.value.operation == "erfinv"
    assert caught.value.function == "half_normal"
    assert "'half_normal' uses the instruction 'erfinv', which cannot be compiled" in str(caught.value)
    assert "atan2" in str(caught.value)


def test_other_kinds_of_function_are_refused():
    x = ca.MX.sym("x")
    function = ca.Function("f", [x], [ca.sin(x)])
    with pytest.raises(InvalidValueError, match=r"got MXFunction.*SX expressions; call \.expand\(\)"):
        compile_function(function)
    np.testing.assert_allclose(compile_function(function.expand())([[0.5]]), np.sin([[0.5]]))
    with pytest.raises(InvalidValueError, match=r"function: got int, expected a casadi\.Function of SX"):
        compile_function(3)


def test_free_variables_are_named():
    x, p = ca.SX.sym("x"), ca.SX.sym("payload")
    with pytest.raises(InvalidValueError, match="free variables payload"):
        compile_function(ca.Function("f", [x], [x * p], {"allow_free": True}))


def test_unknown_dtype_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(InvalidValueError, match="dtype: got 'float16', expected 'float64' or 'float32'"):
        compile_function(ca.Function("f", [x], [x]), dtype="float16")
