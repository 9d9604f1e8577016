"""The core with NUMBA_BOUNDSCHECK=1: no index outside an array, in jobs of the core.

The code is made anew with a test before every access, by Numba, under other keys, and kept in the cache.  A
wrong index raises a RuntimeError, or ends the process where machine code called the function.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pepper_kin.core import splines  # noqa: F401  a unit
from pepper_kin.kernels import units

HERE = Path(__file__).parent
JOBS = ("ik", "placing", "plans", "searches", "sensors", "servo", "timings", "twin", "verdicts")
TASKS = 12
"""Cases in one child."""

WRONG_INDEX = """
import ctypes
import sys
import numpy as np
from pepper_kin.kernels import compiled
from pepper_kin.kernels.intrinsics import floats_at

@compiled("float64(float64[::1], int64)")
def from_python(x, place):
    return x[place]

@compiled("int64(int64, int64)", by_address=True)
def from_machine_code(address, place):
    return int(floats_at(address, 3)[place])

x = np.arange(3.0)
print(from_python(x, 2), from_machine_code(x.ctypes.data, 2))
try:
    from_python(x, 3)
except RuntimeError:
    print("refused", flush=True)
ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_int64)(from_machine_code.address)(x.ctypes.data, 3)
"""


def child(*words: str) -> subprocess.CompletedProcess[str]:
    """Run Python with checks of bounds."""
    environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1"}
    return subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, cwd=HERE.parents[1], env=environment
    )


def test_code_with_checks_has_other_keys():
    keys = [unit.key() for unit in units()]
    modules = ", ".join(unit.module for unit in units())
    found = child("-c", f"import {modules}\nfor u in pepper_kin.kernels.units(): print(u.module, u.key())")
    checked = dict(line.split() for line in found.stdout.splitlines())
    assert keys
    assert all(unit.module in checked and checked[unit.module] not in keys for unit in units()), found.stderr


def test_a_wrong_index_is_noticed(amount, tried, request):
    if request.config.getoption("--fuzz-size") == "small":
        pytest.skip("in a larger size")
    found = child("-c", WRONG_INDEX)
    assert found.stdout.split() == ["2.0", "2", "refused"], found.stderr[-2000:]
    assert found.returncode == -signal.SIGABRT
    tried("deliberate wrong indices, noticed", 2)


@pytest.mark.parametrize("job", JOBS)
def test_no_index_is_outside_an_array(job, amount, rng, tried, request):
    size = request.config.getoption("--fuzz-size")
    if size == "small" or (size == "middle" and job != "timings"):
        pytest.skip("in the long size: the code of the core is compiled for minutes")
    left = amount(0, 6, 1200)
    while left > 0:
        options = {"jobs": [job], "count": min(left, TASKS), "seed": int(rng.integers(2**31))}
        found = child(str(HERE / "core_job.py"), json.dumps(options))
        repeat = f"NUMBA_BOUNDSCHECK=1 python tests/fuzz/core_job.py '{json.dumps(options)}'"
        assert found.returncode == 0, f"{repeat}\nended with {found.returncode}:\n{found.stderr[-3000:]}"
        said = json.loads(found.stdout.splitlines()[-1])
        tried("results of machine code with checks of bounds", said["jobs"][job]["results"])
        left -= TASKS
