"""Functions that become machine code: right answers, refused arguments, no compiler where code is kept."""

import os
import shutil
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest

from pepper_kin.kernels import compiled
from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.signatures import Flags1, Floats1, Floats2, Ints1, parse_signature
from pepper_kin.kernels.target import host_target


class Table(NamedTuple):
    """A table of all kinds of fields."""

    values: Floats1
    matrix: Floats2
    count: int
    factor: float
    on: bool


class Nested(NamedTuple):
    """A table in a table."""

    places: Ints1
    inner: Table


@compiled
def _square(x):
    return x * x


@compiled("float64(float64[::1], Nested, boolean)")
def weigh(x, nested, doubled):
    """Return a sum over all fields."""
    total, table = 0.0, nested.inner
    for k in range(nested.places.size):
        total += _square(x[nested.places[k]]) * table.factor
    for i in range(table.count):
        total += table.matrix[i, 1] + table.values[i]
    if table.on:
        total += 1000.0
    return 2.0 * total if doubled else total


@compiled("Tuple(float64, int64)(float64[:, :, ::1], int64)")
def largest(cube, least):
    """Return the largest number and its place; makes an array inside."""
    flat = np.empty(cube.size)
    for i in range(cube.shape[0]):
        flat[i * cube[i].size : (i + 1) * cube[i].size] = cube[i].reshape(-1)
    best = least
    for i in range(flat.size):
        if flat[i] > flat[best]:
            best = i
    return flat[best], best


@compiled("void(float64[::1], boolean[::1], uint64)")
def mark(x: Floats1, flags: Flags1, word: int) -> None:
    """Write whether numbers are above zero, and a word's lowest bits."""
    for i in range(x.size):
        flags[i] = x[i] > 0.0
        x[i] = float(word & np.uint64(0xFF))


@compiled("boolean(float64[::1])")
def rises(x):
    """Return whether numbers rise."""
    least = np.inf
    for i in range(1, x.size):
        least = min(least, x[i] - x[i - 1])
    return least > 0.0


@compiled("int64(float64[::1], float64[::1])")
def assign(x, y):
    """Assign a slice, which fails for other lengths."""
    x[:] = y
    return x.size


@compiled("float64(int64, int64, float64)", by_address=True)
def sum_at(address, count, start):
    """Return the sum of the numbers at an address."""
    total, x = start, floats_at(address, count)
    for i in range(count):
        total += x[i]
    return total


def make_nested(on=True):
    table = Table(np.arange(4.0), np.ones((4, 2)), 3, 0.5, on)
    return Nested(np.array([0, 2]), table)


@pytest.mark.thorough
def test_all_kinds_of_arguments_arrive():
    x = np.array([1.0, 2.0, 3.0])
    expected = 0.5 * (1 + 9) + 3 * 1 + 3
    assert weigh(x, make_nested(False), False) == expected
    assert weigh(x, make_nested(True), True) == 2 * (expected + 1000)
    assert weigh(x, make_nested(np.bool_(True)), 1) == 2 * (expected + 1000)


@pytest.mark.thorough
def test_results_of_all_kinds_come_back():
    cube = np.random.default_rng(0).random((2, 3, 4))
    assert largest(cube, 0) == (cube.max(), cube.argmax())
    assert rises(np.arange(3.0)) is True
    assert rises(np.zeros(3)) is False
    x, flags = np.array([1.0, -1.0]), np.empty(2, bool)
    assert mark(x, flags, np.uint64(2**64 - 1)) is None
    assert flags.tolist() == [True, False]
    assert x.tolist() == [255.0, 255.0]


def test_what_does_not_fit_is_refused_by_name():
    for arguments, message in [
        ((np.arange(3.0),), "takes 3 arguments"),
        ((np.arange(6.0)[::2], make_nested(), True), "x must be a C-contiguous float64 array with 1 axes"),
        ((np.arange(3), make_nested(), True), "x must be a C-contiguous float64 array"),
        ((np.zeros((3, 1)), make_nested(), True), "x must be a C-contiguous float64 array with 1 axes"),
        (([1.0], make_nested(), True), "x must be a C-contiguous float64 array"),
        ((np.zeros(3), tuple(make_nested()), True), "nested must be a Nested"),
        (
            (np.zeros(3), Nested(np.zeros(2), make_nested().inner), True),
            "nested.places must be a C-contiguous int64 array",
        ),
        ((np.zeros(3), Nested(np.zeros(2, int), make_nested().inner._replace(count=1.5)), True), "integer"),
        (
            (np.zeros(3), Nested(np.zeros(2, int), make_nested().inner._replace(factor="a")), True),
            "real number",
        ),
    ]:
        with pytest.raises(TypeError, match=message):
            weigh(*arguments)


def test_an_exception_inside_is_an_error_and_not_a_wrong_answer():
    assert assign(np.zeros(3), np.ones(3)) == 3
    with pytest.raises(RuntimeError, match="machine code"):
        assign(np.zeros(3), np.ones(2))


def test_a_function_by_address_is_a_c_function():
    import ctypes

    x = np.arange(5.0)
    function = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_int64, ctypes.c_int64, ctypes.c_double)(
        sum_at.address
    )
    assert function(x.ctypes.data, 5, 1.0) == sum_at(x.ctypes.data, 5, 1.0) == 11.0


def test_threads_run_side_by_side():
    from concurrent.futures import ThreadPoolExecutor

    cube = np.random.default_rng(1).random((30, 30, 30))
    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(lambda _: largest(cube, 0), range(64))) == {(cube.max(), int(cube.argmax()))}


def test_the_key_changes_with_sources_constants_and_signatures():
    unit, key = unit_of(__name__), unit_of(__name__).key()
    assert unit.key() == key
    text, weigh.text, weigh._signature = weigh.text, "float64(float64[::1], Nested, int64)", None
    assert unit.key() != key
    weigh.text, weigh._signature = text, None
    assert unit.key() == key
    scope = {"compiled": compiled, "FACTOR": 2.0, "__name__": __name__}
    exec("def f(x):\n    return FACTOR * x", scope)
    described = dict(unit_ingredients(scope["f"]))
    scope["FACTOR"] = 3.0
    assert dict(unit_ingredients(scope["f"])) != described


def unit_ingredients(function):
    from pepper_kin.kernels.compiled_function import _described, _named_values

    return [(name, _described(value)) for name, value in _named_values(function)]


def test_functions_that_come_after_the_first_call_run_as_well():
    """As in a notebook, whose cells are run, changed, and run again; what was there goes on as it was."""
    scope = {"compiled": compiled, "__name__": "cells"}

    def define(name, factor):
        exec(f'@compiled("float64(float64)")\ndef {name}(x):\n    return {factor} * x', scope)
        return scope[name]

    first = define("f", 2.0)
    assert first(3.0) == 6.0
    assert define("g", 5.0)(3.0) == 15.0
    again, unused = define("f", 7.0), define("h", 3.0)
    assert define("h", 4.0)(3.0) == 12.0
    assert (again(3.0), first(3.0), unused(3.0)) == (21.0, 6.0, 9.0)


def test_a_signature_that_is_none_is_refused():
    for text, message in [
        ("int64(complex128)", "complex128"),
        ("int64[::1](int64)", r"result 'int64\[::1\]'"),
        ("void(float64[:])", "C-contiguous"),
        ("void(Unknown)", "Unknown"),
    ]:
        with pytest.raises(TypeError, match=message):
            parse_signature(text, globals())


MODULE = """
import numpy as np
from pepper_kin.kernels import compiled

FACTOR = 2.0

@compiled("float64(float64[::1])")
def total(x):
    s = 0.0
    for i in range(x.size):
        s += FACTOR * x[i]
    return s
"""


@pytest.fixture(scope="module")
def run_module(child):
    """Run a program that uses a module of a compiled function in a process of its own."""

    def run(folder, **environment):
        (folder / "own.py").write_text(MODULE)
        use = "import sys, numpy as np, own; assert own.total(np.arange(4.0)) == 12.0"
        variables = {"PYTHONPATH": folder, "PEPPER_KIN_CACHE": folder / "cache", **environment}
        done = child(use + "; print('numba' in sys.modules)", **variables)
        return done.stdout.strip(), done.stderr

    return run


@pytest.fixture(scope="module")
def first_run(run_module, tmp_path_factory):
    """The folder of a first run, and what it printed."""
    folder = tmp_path_factory.mktemp("first")
    return folder, run_module(folder)[0]


@pytest.fixture
def after_first_run(first_run, tmp_path):
    """A folder of our own with the cache that a first run leaves."""
    shutil.copytree(first_run[0], tmp_path, dirs_exist_ok=True)
    return tmp_path


@pytest.mark.thorough
def test_numba_is_imported_to_compile_and_never_again(first_run, run_module):
    folder, said = first_run
    assert said == "True"
    assert run_module(folder)[0] == "False"


def test_the_same_source_runs_interpreted(tmp_path, run_module):
    assert run_module(tmp_path, NUMBA_DISABLE_JIT="1")[0] == "False"
    assert not (tmp_path / "cache").exists()


@pytest.mark.thorough
@pytest.mark.parametrize("damage", [b"", b"\x00" * 100, None], ids=["empty", "zeros", "flipped bit"])
def test_damaged_code_is_made_again_and_said_so(after_first_run, run_module, damage):
    tmp_path = after_first_run
    (path,) = [p for p in (tmp_path / "cache").glob("*.code") if b"own_total\0" in p.read_bytes()]
    whole = path.read_bytes()
    path.write_bytes(damage if damage is not None else whole[:200] + bytes([whole[200] ^ 4]) + whole[201:])
    out, error = run_module(tmp_path)
    assert out == "True"
    assert "is damaged; it is made again" in error
    assert run_module(tmp_path)[0] == "False"


@pytest.mark.thorough
def test_folders_that_cannot_be_written_leave_code_in_memory(tmp_path, run_module):
    (tmp_path / "file").write_text("not a folder")
    for _ in range(2):
        out, _ = run_module(tmp_path, PEPPER_KIN_CACHE=str(tmp_path / "file" / "cache"), HOME="/nonexistent")
        assert out == "True"


@pytest.mark.thorough
def test_code_for_a_processor_of_another_name_is_another_part(after_first_run, run_module):
    tmp_path = after_first_run
    count = len(list((tmp_path / "cache").glob("*.code")))
    out, _ = run_module(tmp_path, PEPPER_KIN_CPU="x86-64")
    if host_target().triple.startswith("x86_64"):
        assert out == "True"
        assert len(list((tmp_path / "cache").glob("*.code"))) > count


@pytest.mark.thorough
def test_of_two_processes_one_is_killed_and_the_other_ends_well(tmp_path, run_module):
    (tmp_path / "own.py").write_text(MODULE)
    variables = {**os.environ, "PYTHONPATH": str(tmp_path), "PEPPER_KIN_CACHE": str(tmp_path / "cache")}
    first = subprocess.Popen([sys.executable, "-c", "import own; own.total.load()"], env=variables)
    second = subprocess.Popen([sys.executable, "-c", "import own; own.total.load()"], env=variables)
    try:
        first.wait(1.0)
    except subprocess.TimeoutExpired:
        first.kill()
    first.wait()
    assert second.wait(120) == 0
    assert run_module(tmp_path)[0] == "False"


@pytest.mark.thorough
def test_code_for_a_record_that_has_moved_to_another_module_is_made_again(tmp_path, child):
    (tmp_path / "kept.py").write_text(
        "from pepper_kin.kernels import compiled\n\n"
        "@compiled\ndef half(pair):\n    return 0.5 * pair.a\n\n"
        "@compiled\ndef sum_of(pair):\n    return half(pair) + pair.b\n"
    )
    for module in ["first", "second"]:
        (tmp_path / f"{module}.py").write_text(
            "from typing import NamedTuple\nclass Pair(NamedTuple):\n    a: float\n    b: float\n"
        )
        (tmp_path / "own.py").write_text(
            f"from kept import sum_of\nfrom {module} import Pair\nfrom pepper_kin.kernels import compiled\n\n"
            "@compiled('float64(float64)')\ndef call(x):\n    return sum_of(Pair(x, 1.0))\n"
        )
        variables = {"PYTHONPATH": tmp_path, "PEPPER_KIN_CACHE": tmp_path / "cache"}
        assert child("import own; print(own.call(3.0))", **variables).stdout.strip() == "2.5"
        (tmp_path / f"{module}.py").unlink()
