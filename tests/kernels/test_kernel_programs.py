"""Whole programs: random expressions, long ones in chunks, other processors, and the addresses."""

import ctypes
import dataclasses

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pepper_kin.kernels import compile_function, host_target, kernel_ir, make_target
from pepper_kin.kernels.codegen import module_ir
from pepper_kin.kernels.compiler import assembly, compile_ir
from pepper_kin.kernels.image import KernelImage
from pepper_kin.kernels.instructions import read_program
from pepper_kin.kernels.kernel import Kernel
from pepper_kin.kernels.partition import partition
from pepper_kin.kernels.streaming import staging_size

SAFE = [
    lambda a, b: a + b,
    lambda a, b: a - b,
    lambda a, b: a * b,
    lambda a, b: a / (1 + b**2),
    lambda a, b: ca.sin(a),
    lambda a, b: ca.cos(a) * b,
    lambda a, b: ca.sqrt(1 + a**2),
    lambda a, b: ca.fmin(a, b),
    lambda a, b: ca.if_else(a > b, a, 0.3),
    lambda a, b: ca.tanh(a),
    lambda a, b: ca.atan2(a, 2 + ca.fabs(b)),
    lambda a, b: 0.5 * a,
]


def random_function(rng, length):
    """A function of five inputs; every step is bounded, so that errors do not grow without limit."""
    x, y = ca.SX.sym("x", 4), ca.SX.sym("y")
    values = [*ca.vertsplit(x), y, ca.SX(1.5)]
    for _ in range(length):
        a, b = (values[k] for k in rng.integers(max(0, len(values) - 40), len(values), 2))
        values.append(
            ca.atan(SAFE[rng.integers(len(SAFE))](a, b)) if rng.random() < 0.3 else ca.sin(a + b) * 0.7
        )
    picks = rng.integers(len(values), size=6)
    return ca.Function("f", [x, y], [ca.vertcat(*(values[k] for k in picks)), ca.vertcat(*values[-9:])])


def by_casadi(function, x, y):
    return [np.array(result).T for result in function.map(len(x))(x.T, y.T)]


def in_chunks(function, chunk_length, dtype="float64", target=None):
    """Compile with another chunk length than the default one."""
    target = target or host_target()
    program = read_program(function)
    parts = partition(program, chunk_length)
    code = compile_ir(module_ir(program, parts, target, dtype), target)
    lanes, signature = target.lanes(dtype), program.signature
    elements = sum(signature.input_sizes) + sum(signature.output_sizes)
    work_size = (elements + staging_size(signature) + parts.slot_count) * lanes
    image = KernelImage(signature, dtype, lanes, work_size, program.flop_count, code)
    return Kernel(image, target), parts


@pytest.mark.thorough
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), length=st.integers(1, 120))
def test_random_expressions_agree_with_casadi(seed, length):
    rng = np.random.default_rng(seed)
    function = random_function(rng, length)
    x, y = rng.normal(size=(13, 4)), rng.normal(size=(13, 1))
    for got, want in zip(
        compile_function(function, cache=False)(x, y), by_casadi(function, x, y), strict=True
    ):
        np.testing.assert_allclose(got, want, rtol=1e-10, atol=1e-12)


@pytest.mark.thorough
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), chunk_length=st.integers(1, 60))
def test_chunks_do_not_change_the_result(seed, chunk_length):
    rng = np.random.default_rng(seed)
    function = random_function(rng, 80)
    x, y = rng.normal(size=(9, 4)), rng.normal(size=(9, 1))
    # Fused products differ at the edges of chunks, so equality holds to rounding.
    cut, parts = in_chunks(function, chunk_length)
    assert len(parts.chunks) > 1 or chunk_length > 20
    for got, want in zip(cut(x, y), compile_function(function, cache=False)(x, y), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-10, atol=1e-12)


@pytest.mark.thorough
def test_long_function_is_cut_into_chunks_and_reuses_work_space():
    rng = np.random.default_rng(5)
    function = random_function(rng, 3000)
    kernel, parts = in_chunks(function, 1500)
    sizes = [len(chunk.values) for chunk in parts.chunks]
    assert sum(sizes) > 5000
    assert len(sizes) > 3
    assert max(sizes) <= 1500
    assert parts.slot_count < 200
    x, y = rng.normal(size=(5, 4)), rng.normal(size=(5, 1))
    for got, want in zip(kernel(x, y), by_casadi(function, x, y), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-9)


def test_equal_operations_are_done_once():
    x = ca.SX.sym("x", 2)
    products = [x[0] * x[1], x[1] * x[0], ca.sin(x[0]), ca.sin(x[0])]
    program = read_program(ca.Function("f", [x], [ca.vertcat(*products)]))
    assert [operation.name for operation in program.operations].count("mul") == 1
    assert [operation.name for operation in program.operations].count("sin") == 1
    assert program.flop_count == 2


def test_no_arithmetic_flag_but_contraction():
    """Flags that assume finite numbers or reorder sums would break comparisons and the sine's reduction."""
    ir = kernel_ir(random_function(np.random.default_rng(0), 60))
    for flag in (" fast ", " nnan ", " ninf ", " nsz ", " arcp ", " afn ", " reassoc "):
        assert flag not in ir
    assert "fadd contract" in ir


@pytest.mark.thorough
@pytest.mark.parametrize("vector_bytes", [16, 32, 64])
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_every_vector_width_gives_the_same(dtype, vector_bytes):
    """Vectors wider than the processor's registers are split, so this runs on any processor."""
    target = dataclasses.replace(host_target(), vector_bytes=vector_bytes)
    rng = np.random.default_rng(9)
    function = random_function(rng, 60)
    x, y = rng.normal(size=(41, 4)), rng.normal(size=(41, 1))
    kernel = compile_function(function, dtype=dtype, target=target, cache=False)
    reference = compile_function(function, dtype=dtype, cache=False)
    assert kernel.lanes == vector_bytes // kernel.dtype.itemsize
    for got, want in zip(kernel(x, y), reference(x, y), strict=True):
        np.testing.assert_array_equal(got, want)


@pytest.mark.skipif(not host_target().triple.startswith("x86_64"), reason="x86 instructions")
@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_plain_processor_gives_the_same(dtype):
    plain = dataclasses.replace(host_target(), cpu="x86-64", features="", vector_bytes=16, has_fma=False)
    rng = np.random.default_rng(8)
    function = random_function(rng, 60)
    x, y = rng.normal(size=(13, 4)), rng.normal(size=(13, 1))
    kernel = compile_function(function, dtype=dtype, target=plain, cache=False)
    assert kernel.lanes == (2 if dtype == "float64" else 4)
    tolerance = 1e-10 if dtype == "float64" else 1e-3
    for got, want in zip(kernel(x, y), by_casadi(function, x, y), strict=True):
        np.testing.assert_allclose(got, want, rtol=tolerance, atol=tolerance)


@pytest.mark.skipif(not host_target().triple.startswith("x86_64"), reason="x86 instructions")
def test_wide_vectors_are_used_where_the_processor_has_them():
    x = ca.SX.sym("x", 3)
    program = read_program(ca.Function("f", [x], [ca.sin(x) * x[0]]))
    wide = make_target(host_target().triple, "skylake-avx512", "+avx512f,+avx512dq,+avx512vl,+avx2,+avx,+fma")
    assert (wide.lanes("float64"), wide.lanes("float32"), wide.has_fma) == (8, 16, True)
    for dtype in ("float64", "float32"):
        text = assembly(module_ir(program, partition(program, 6000), wide, dtype), wide)
        assert "%zmm" in text
        assert "vfmadd" in text or "vfnmadd" in text


def pointer(array):
    return ctypes.c_void_p(array.ctypes.data)


@pytest.fixture(params=["float64", "float32"])
def small(request):
    x, m = ca.SX.sym("x", 3), ca.SX.sym("m", 2, 2)
    function = ca.Function("f", [x, m], [ca.mtimes(m, ca.sin(x[:2])), m.T * x[2]])
    return compile_function(function, dtype=request.param)


def small_in_numpy(x, m):
    return np.concatenate([m @ np.sin(x[:2]), (m.T * x[2]).ravel()])


def test_single_state_by_address(small):
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)(small.single_address)
    state = np.random.default_rng(0).normal(size=7).astype(small.dtype)
    result, work = np.empty(6, small.dtype), np.empty(small.work_size, small.dtype)
    call(pointer(state), pointer(result), pointer(work))
    want = small_in_numpy(state[:3], state[3:].reshape(2, 2))
    np.testing.assert_allclose(result, want, rtol=1e-13 if small.dtype == np.float64 else 1e-5)


def test_block_of_states_by_address(small):
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)(small.block_address)
    columns = np.random.default_rng(0).normal(size=(7, small.lanes)).astype(small.dtype)
    results, work = np.empty((6, small.lanes), small.dtype), np.empty(small.work_size, small.dtype)
    call(pointer(columns), pointer(results), pointer(work))
    for state, result in zip(columns.T, results.T, strict=True):
        want = small_in_numpy(state[:3], state[3:].reshape(2, 2))
        np.testing.assert_allclose(result, want, rtol=1e-13 if small.dtype == np.float64 else 1e-5)


@pytest.mark.thorough
def test_address_can_be_called_from_numba():
    import numba  # 100 MB, which few workers need

    x = ca.SX.sym("x", 2)
    kernel = compile_function(ca.Function("step", [x], [x + 0.1 * ca.vertcat(x[1], -ca.sin(x[0]))]))
    step = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)(kernel.single_address)

    @numba.njit
    def roll_out(state, count, work):
        following = np.empty_like(state)
        for _ in range(count):
            step(state.ctypes.data, following.ctypes.data, work.ctypes.data)
            state[:] = following
        return state

    state = np.array([0.4, 0.0])
    for _ in range(25):
        state = state + 0.1 * np.array([state[1], -np.sin(state[0])])
    got = roll_out(np.array([0.4, 0.0]), 25, np.empty(kernel.work_size))
    np.testing.assert_allclose(got, state, rtol=1e-13)
