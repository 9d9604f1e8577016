"""The array interface: shapes, formats, layouts, threads, and what is refused."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from pepper_kin.exceptions import InvalidValueError, PepperKinError
from pepper_kin.kernels import compile_function

COUNTS = [0, 1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 1000]


def mixed_function():
    """A wide vector, a matrix and a scalar in; a vector, a sparse matrix, and a scalar out."""
    x, m, s = ca.SX.sym("x", 19), ca.SX.sym("m", 2, 3), ca.SX.sym("s")
    sparse = ca.SX(3, 4)
    sparse[0, 1], sparse[2, 0], sparse[2, 3] = x[0] * s, m[1, 2], 7.0
    vector = ca.vertcat(*(ca.sin(x[k]) + m[k % 2, k % 3] * s for k in range(19)))
    return ca.Function("mixed", [x, m, s], [vector, sparse, ca.sumsqr(x)], ["x", "m", "s"], ["v", "p", "e"])


def mixed_in_numpy(x, m, s):
    k = np.arange(19)
    sparse = np.zeros((*x.shape[:-1], 3, 4))
    sparse[..., 0, 1], sparse[..., 2, 0], sparse[..., 2, 3] = x[..., 0] * s[..., 0], m[..., 1, 2], 7.0
    return np.sin(x) + m[..., k % 2, k % 3] * s, sparse, np.sum(x**2, axis=-1, keepdims=True)


def arguments(shape, seed=0):
    rng = np.random.default_rng(seed)
    return tuple(rng.normal(size=(*shape, *core)) for core in ((19,), (2, 3), (1,)))


@pytest.fixture(scope="module")
def kernel():
    return compile_function(mixed_function())


@pytest.fixture(scope="module")
def kernel32():
    return compile_function(mixed_function(), dtype="float32")


@pytest.mark.parametrize("count", COUNTS)
def test_any_number_of_states(kernel, kernel32, count):
    inputs = arguments((count,))
    for got, want in zip(kernel(*inputs), mixed_in_numpy(*inputs), strict=True):
        assert got.dtype == np.float64
        np.testing.assert_allclose(got, want, rtol=1e-13, atol=1e-13)
    for got, want in zip(kernel32(*inputs), mixed_in_numpy(*inputs), strict=True):
        assert got.dtype == np.float32
        np.testing.assert_allclose(got, want, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("count", COUNTS)
def test_nothing_is_written_or_read_beyond_the_arrays(kernel, count):
    """Inputs end in NaN, outputs in a mark: neither is touched."""
    inputs, guarded = arguments((count,)), []
    for array in inputs:
        memory = np.full(array.size + 64, np.nan)
        memory[32 : 32 + array.size] = array.ravel()
        guarded.append(memory[32 : 32 + array.size].reshape(array.shape))
    want = mixed_in_numpy(*inputs)
    memories = [np.full(array.size + 64, 1234.5) for array in want]
    out = [m[32 : 32 + w.size].reshape(w.shape) for m, w in zip(memories, want, strict=True)]
    kernel(*guarded, out=out)
    for got, expected, memory in zip(out, want, memories, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-13, atol=1e-13)
        assert (memory[:32] == 1234.5).all()
        assert (memory[32 + expected.size :] == 1234.5).all()


@pytest.mark.parametrize("shape", [(), (1,), (3, 5), (2, 0, 3), (2, 1, 4)])
def test_leading_axes_are_kept(kernel, shape):
    inputs = arguments(shape)
    for got, want in zip(kernel(*inputs), mixed_in_numpy(*inputs), strict=True):
        assert got.shape == want.shape
        np.testing.assert_allclose(got, want, rtol=1e-13, atol=1e-13)


def test_an_input_without_leading_axes_goes_with_every_state(kernel):
    x, _, s = arguments((21,))
    _, m, _ = arguments(())
    got = kernel(x, m, s)
    want = kernel(x, np.broadcast_to(m, (21, 2, 3)).copy(), s)
    for a, b in zip(got, want, strict=True):
        np.testing.assert_array_equal(a, b)


def test_structural_zeros_are_exact_zeros(kernel):
    out = [np.full((50, *core), np.nan) for core in ((19,), (3, 4), (1,))]
    _, sparse, _ = kernel(*arguments((50,)), out=out)
    mask = np.ones((3, 4), bool)
    mask[0, 1] = mask[2, 0] = mask[2, 3] = False
    assert (sparse[:, mask] == 0).all()
    assert not np.signbit(sparse[:, mask]).any()


@pytest.mark.parametrize("count", [1, 9, 1000, 5003])
def test_result_does_not_depend_on_threads(kernel, count):
    inputs = arguments((count,))
    alone = kernel(*inputs)
    for threads in (2, 3, np.int64(4)):
        for got, want in zip(kernel(*inputs, threads=threads), alone, strict=True):
            np.testing.assert_array_equal(got, want)


def test_result_of_a_state_does_not_depend_on_its_neighbors(kernel):
    inputs = arguments((37,))
    together = kernel(*inputs)
    for k in range(37):
        for got, want in zip(kernel(*(a[k] for a in inputs)), together, strict=True):
            np.testing.assert_array_equal(got, want[k])


LAYOUTS = {
    "float32": lambda a: a.astype(np.float32),
    "integer": lambda a: np.round(10 * a).astype(np.int16),
    "boolean": lambda a: a > 0,
    "list": lambda a: a.tolist(),
    "fortran": np.asfortranarray,
    "reversed rows": lambda a: a[::-1],
    "every other row": lambda a: np.repeat(a, 2, axis=0)[::2],
    "every other element": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    "columns of a wider array": lambda a: np.concatenate([a, a], axis=-1)[..., : a.shape[-1]],
    "reversed elements": lambda a: a[..., ::-1],
    "big endian": lambda a: a.astype(">f8"),
    "misaligned": lambda a: np.frombuffer(b"x" + a.tobytes(), np.uint8)[1:].view(float).reshape(a.shape),
    "same row": lambda a: np.broadcast_to(a[:1], a.shape),
    "long double": lambda a: a.astype(np.longdouble),
}


@pytest.mark.parametrize("layout", sorted(LAYOUTS))
def test_other_layouts_and_formats_are_accepted(kernel, layout):
    inputs = [LAYOUTS[layout](array) for array in arguments((11,))]
    for array in inputs:
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    want = mixed_in_numpy(*(np.array(array, float) for array in inputs))
    for got, expected in zip(kernel(*inputs), want, strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-13, atol=1e-13)


def test_out_receives_the_result():
    x = ca.SX.sym("x", 3)
    kernel = compile_function(ca.Function("f", [x], [2 * x]))
    out = np.zeros((5, 3))
    assert kernel(np.ones((5, 3)), out=out) is out
    np.testing.assert_array_equal(out, np.full((5, 3), 2.0))


def refused(match, call):
    with pytest.raises(InvalidValueError, match=match) as caught:
        call()
    assert isinstance(caught.value, PepperKinError)


def test_wrong_inputs_are_named(kernel):
    x, m, s = arguments((4,))
    refused(r"arguments of mixed: got 2, expected 3 \(x, m, s\)", lambda: kernel(x, m))
    refused(r"x: got shape \(4, 18\), expected shape \(\.\.\., 19\)", lambda: kernel(x[:, :18], m, s))
    refused(
        r"m: got shape \(4, 3, 2\), expected shape \(\.\.\., 2, 3\)", lambda: kernel(x, m.swapaxes(1, 2), s)
    )
    refused(r"s: got leading axes \(3,\), expected \(4,\) as in x, or none", lambda: kernel(x, m, s[:3]))
    refused(r"s: got shape \(\), expected shape \(\.\.\., 1\)", lambda: kernel(x, m, 1.0))
    refused("x: got an array of complex128, expected real numbers", lambda: kernel(x + 0j, m, s))
    refused("x: got an array of <U3, expected real numbers", lambda: kernel("abc", m, s))
    refused("x: got list, expected an array of real numbers", lambda: kernel([[1.0], [1.0, 2.0]], m, s))
    refused("threads: got 0, expected an integer of at least 1", lambda: kernel(x, m, s, threads=0))
    refused("threads: got True", lambda: kernel(x, m, s, threads=True))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("state", [0, 3, 8])
def test_not_finite_is_refused_by_name_and_place(kernel, value, state):
    x, m, s = arguments((9,))
    m[state, 1, 2] = value
    refused(rf"m: got {value} \(state {state}, element 1, 2\), expected finite", lambda: kernel(x, m, s))
    x[state, 18] = value
    refused(rf"x: got {value} \(state {state}, element 18\)", lambda: kernel(x, m, s, threads=2))
    got = kernel(x, m, s, check_finite=False)[1]
    good = np.arange(9) != state
    np.testing.assert_array_equal(got[good], mixed_in_numpy(x[good], m[good], s[good])[1])


def test_extremes_count_as_finite(kernel):
    x, m, s = arguments((3,))
    x[1, :2], m[0, 0, 0], s[2] = (1.7e308, -1.7e308), 5e-324, -0.0
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(kernel(x, m, s)[2], mixed_in_numpy(x, m, s)[2], rtol=1e-14)


@pytest.mark.parametrize("value", [np.nan, -np.inf, 1.001e9, -1e300, 1e8])
@pytest.mark.parametrize(("count", "state"), [(1, 0), (9, 8), (1000, 500)])
def test_the_caller_looks_at_large_numbers(kernel, value, count, state):
    """Each number beyond 1e9, and no few that are smaller."""
    x, m, s = arguments((count,))
    m[state, 0, 2] = value
    looked = []
    found = kernel(x, m, s, check_large=lambda: looked.append(True))
    assert bool(looked) == (value != 1e8)
    good = np.arange(count) != state
    np.testing.assert_array_equal(found[1][good], mixed_in_numpy(x[good], m[good], s[good])[1])


def test_double_that_overflows_a_float_is_refused(kernel32):
    x, m, s = arguments((3,))
    x[1, 4] = 1e39
    refused(r"x: got inf \(state 1, element 4\)", lambda: kernel32(x, m, s))


def test_wrong_out_is_refused(kernel):
    inputs = arguments((4,))
    good = [np.empty((4, 19)), np.empty((4, 3, 4)), np.empty((4, 1))]
    refused("out: got 1 arrays, expected 3", lambda: kernel(*inputs, out=good[0]))
    bad = {
        r"out \(v\): got float64 \(5, 19\), expected a NumPy array of float64 \(4, 19\)": np.empty((5, 19)),
        r"out \(v\): got float32 \(4, 19\)": np.empty((4, 19), np.float32),
        r"out \(v\): got list, expected a NumPy array": [0.0],
        r"out \(v\): got a read-only or non-contiguous array": np.empty((19, 4)).T,
        r"out \(v\): got memory shared with an input": inputs[0],
    }
    for message, array in bad.items():
        refused(message, lambda array=array: kernel(*inputs, out=[array, *good[1:]]))
    good[0].flags.writeable = False
    refused("read-only", lambda: kernel(*inputs, out=good))


@pytest.mark.thorough
@settings(max_examples=80, deadline=None)
@given(
    shape=hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4),
    dtype=st.sampled_from(["f8", "f4", "f2", "i8", "u1", "?", "c8", "U2", "S1", "M8[s]", "m8[s]", "O"]),
)
def test_fuzzed_arrays_give_a_result_or_a_named_error(shape, dtype):
    array = np.zeros(shape, dtype)
    x = ca.SX.sym("x", 3)
    kernel = compile_function(ca.Function("f", [x], [x + 1], ["x"], ["y"]))
    if array.dtype.kind in "biuf" and array.shape[-1:] == (3,):
        np.testing.assert_array_equal(kernel(array), np.ones(array.shape))
    else:
        with pytest.raises(InvalidValueError, match=r"^x: got"):
            kernel(array)


def test_functions_without_inputs_or_outputs():
    constant = compile_function(ca.Function("c", [], [ca.SX([1.0, 2.0])]))
    np.testing.assert_array_equal(constant(), [1.0, 2.0])
    x = ca.SX.sym("x", 2)
    assert compile_function(ca.Function("n", [x], []))(np.ones((3, 2))) == ()
    empty = compile_function(ca.Function("e", [x, ca.SX(0, 1)], [x, ca.SX(0, 1)]))
    got, nothing = empty(np.ones((3, 2)), np.ones((3, 0)))
    assert got.shape == (3, 2)
    assert nothing.shape == (3, 0)


def test_inputs_and_constants_can_be_outputs_themselves():
    x = ca.SX.sym("x", 2)
    kernel = compile_function(ca.Function("f", [x], [ca.vertcat(x[1], x[0], 3, x[1], ca.sin(x[0]))]))
    want = [[2.0, 1.0, 3.0, 2.0, np.sin(1.0)]]
    np.testing.assert_allclose(kernel([[1.0, 2.0]]), want, rtol=1e-15)


def test_floating_point_state_of_the_process_is_left_alone(kernel):
    """No flush-to-zero: the smallest numbers are still there after, and inside, a kernel."""
    x, m, s = arguments((20,))
    kernel(x, m, s, threads=2)
    tiny = np.array([5e-324, 1e-310])
    np.testing.assert_array_equal(tiny * 1.0 > 0, True)
    np.testing.assert_array_equal(np.array([2.0**-1022]) / 4 > 0, True)
    y = ca.SX.sym("y")
    halve = compile_function(ca.Function("f", [y], [y / 4]))
    np.testing.assert_array_equal(halve([[2.0**-1022]]), [[2.0**-1024]])
