"""Results that go to memory past the caches, and memory that results share one after the other."""

import casadi as ca
import numpy as np
import pytest

from pepper_kin.kernels import compile_function, memory, release_memory, streaming

COUNTS = [0, 1, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 1000, 1003]
GUARD = -12345.0


def function_of(*sizes):
    x = ca.SX.sym("x", 5)
    outputs = [
        ca.vertcat(*(ca.sin(x[k % 5]) + k * x[(k + i) % 5] for k in range(n))) for i, n in enumerate(sizes)
    ]
    return ca.Function("f", [x], outputs)


def in_numpy(x, sizes):
    results = []
    for i, n in enumerate(sizes):
        k = np.arange(n)
        results.append(np.sin(x[:, k % 5]) + k * x[:, (k + i) % 5])
    return results


def guarded(shape, dtype, offset):
    """An array between numbers that nobody may touch, starting `offset` elements after a cache line."""
    size = int(np.prod(shape))
    raw = np.full(size + 64, GUARD, dtype)
    begin = (-raw.ctypes.data % 64) // raw.itemsize + offset
    return raw, raw[begin : begin + size].reshape(shape), begin


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("sizes", [(19,), (3,), (1, 40), (40, 1), (7, 16, 2), (9, 8)])
def test_past_the_caches_comes_the_same(monkeypatch, dtype, sizes):
    monkeypatch.setattr(streaming, "STREAM_FROM", 0)
    kernel = compile_function(function_of(*sizes), dtype=dtype, cache=False)
    tolerance = 1e-12 if dtype == "float64" else 1e-4
    for count in COUNTS:
        for offset in (0, 1, 2):
            x = np.random.default_rng(count).normal(size=(count, 5)).astype(dtype)
            places = [guarded((count, size), dtype, offset) for size in sizes]
            kernel(x, out=[array for _, array, _ in places])
            for (raw, array, begin), want in zip(places, in_numpy(x, sizes), strict=True):
                np.testing.assert_allclose(array, want, rtol=tolerance, atol=tolerance)
                assert (raw[:begin] == GUARD).all()
                assert (raw[begin + array.size :] == GUARD).all()


@pytest.mark.thorough
def test_so_many_that_they_go_past_the_caches_unasked():
    sizes = (19, 12)
    count = streaming.STREAM_FROM // (31 * 8) + 2
    x = np.random.default_rng(0).normal(size=(count, 5))
    for threads in (1, 2):
        for got, want in zip(
            compile_function(function_of(*sizes))(x, threads=threads), in_numpy(x, sizes), strict=True
        ):
            np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-12)


def test_memory_serves_again_only_once_nobody_holds_the_result():
    release_memory()
    shape, dtype = (memory.KEEP_FROM // 8, 1), np.dtype(np.float64)
    first = memory.empty(shape, dtype)
    address = first.ctypes.data
    assert address % memory.ALIGNMENT == 0
    part = first[5:7]
    part[:] = 7.0
    second = memory.empty(shape, dtype)
    assert second.ctypes.data != address
    del first
    third = memory.empty(shape, dtype)
    assert third.ctypes.data != address, "a view still shows the first result"
    third[:] = 0.0
    assert (part == 7.0).all()
    del part
    assert memory.empty(shape, dtype).ctypes.data == address
    release_memory()


def test_memory_kept_is_bounded(monkeypatch):
    release_memory()
    monkeypatch.setattr(memory, "KEEP_AT_MOST", 3 * memory.KEEP_FROM)
    held = [memory.empty((memory.KEEP_FROM,), np.dtype(np.uint8)) for _ in range(6)]
    assert sum(raw.size for raw in memory._kept) <= 3 * memory.KEEP_FROM
    for k, array in enumerate(held):
        array[:] = k
    assert all((array == k).all() for k, array in enumerate(held))
    release_memory()
