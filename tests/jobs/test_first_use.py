"""The first command on a new machine compiles nothing."""

import os
import subprocess
import sys

CODE = """
import sys
import pepper_kin as pk
from pepper_kin.jobs import run_demo

outcome = run_demo(pk.load_pepper())
print(outcome.success, "numba" in sys.modules, outcome.message)
"""


def test_the_demo_compiles_nothing(tmp_path):
    """What is compiled is kept: nothing is, and nothing is said."""
    environment = {**os.environ, "PEPPER_KIN_CACHE": str(tmp_path / "kernels")}
    command = [sys.executable, "-c", CODE]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.startswith("True False"), done.stdout
    assert not list(tmp_path.glob("kernels/*"))
    assert done.stderr == ""


ANSWER = """
import sys
import pepper_kin as pk

found = pk.ik.solve(pk.load_pepper(), pk.ik.HandPosition("left", (0.38, 0.22, 0.82)), collisions=False)
print(found.success, sorted({"pinocchio", "coal", "casadi", "numba"} & set(sys.modules)))
"""


def test_a_first_answer_without_collisions_does_not_wait_for_pinocchio():
    done = subprocess.run([sys.executable, "-c", ANSWER], capture_output=True, text=True, check=True)
    assert done.stdout == "True []\n"
