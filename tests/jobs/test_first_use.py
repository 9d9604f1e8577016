"""The first command on a new machine compiles nothing that takes long."""

import os
import subprocess
import sys

CODE = """
import pepper_kin as pk
from pepper_kin.jobs import run_demo

outcome = run_demo(pk.load_pepper())
print(outcome.success, outcome.message)
"""


def test_the_demo_compiles_no_loop_of_numba(tmp_path):
    """Whatever numba compiles for keeps is written to its folder: none of it for the demonstration."""
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(tmp_path / "numba"),
        "PEPPER_KIN_CACHE": str(tmp_path / "kernels"),
    }
    command = [sys.executable, "-c", CODE]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.startswith("True"), done.stdout
    assert list((tmp_path / "kernels").glob("*.kernel")), "the folders are not where it looks"
    assert not list((tmp_path / "numba").rglob("*.nbi"))
    assert "once on this machine" not in done.stderr
