"""Public functions and methods with one wrong argument: an error of the library, or a result without NaN.

NaN, infinities, huge and negative numbers, texts, bytes, wrong shapes and types, None, objects of another
robot or of another number of coordinates, for each argument.
A TypeError or an AttributeError is right only about an object of another type.  Children make the calls
(`misuse_job.py`), so that a crash or a call without end is a finding too.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
METHODS = ("of_models_and_scenes", "of_motions", "of_planners", "of_twins")
"""Groups of public objects whose methods are called (`misuse_calls.py`)."""
PACKAGES = (
    "base_placement", "batch", "collision", "dynamics", "files", "ik", "kernels", "kinematics", "model",
    "motion", "planners", "servo", "trajectory", "twin", "twin.base", "twin.sensors", "twin.world",
)  # fmt: skip
IN_SMALL = ("kinematics", "kernels", "of_models_and_scenes")


@pytest.mark.parametrize("package", PACKAGES + METHODS)
def test_wrong_arguments_are_refused_by_name(package, amount, rng, tried, request, tmp_path):
    size = request.config.getoption("--fuzz-size")
    if size == "small" and package not in IN_SMALL:
        pytest.skip("in a larger size")
    options = {"package": package, "count": amount(10, 12, 2000), "seed": int(rng.integers(2**31))}
    command = [sys.executable, str(HERE / "misuse_job.py"), json.dumps(options)]
    repeat = f"PYTHONPATH=. python tests/fuzz/misuse_job.py '{json.dumps(options)}'"
    # A text in the place of a file's name makes a file, in the folder where the child runs.
    paths = os.pathsep.join([str(HERE.parents[1]), os.environ.get("PYTHONPATH", "")])
    found = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=4 * 3600,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": paths},
    )
    last = found.stderr.strip().rpartition("\n")[2]
    assert found.returncode == 0, f"{repeat}\nended with {found.returncode} at {last}\n{found.stderr[-3000:]}"
    lines = [json.loads(line) for line in found.stdout.splitlines()]
    unknown = [line for line in lines if "no call that works" in line]
    assert not unknown, f"{repeat}: {unknown}"
    findings = [line for line in lines if "wrong" in line]
    tried("calls with one wrong argument", lines[-1]["tried"], len(findings))
    assert not findings, "\n".join(
        [repeat, *(f"{f['call']}: {f['wrong']} {f['error']} {f['where']}" for f in findings)]
    )
