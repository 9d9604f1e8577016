"""First commands: by the interpreter where nothing is compiled yet; nothing is compiled twice."""

import json
import os
import subprocess
import sys

import pytest

CODE = """
import sys
import pepper_kin as pk
from pepper_kin.jobs import run_demo

outcome = run_demo(pk.load_pepper())
print(outcome.success, "numba" in sys.modules, outcome.message)
"""


@pytest.mark.thorough
def test_the_demo_compiles_nothing_twice(child):
    """What has been made is found: nothing is made, and nothing is said."""
    done = child(CODE)
    assert done.stdout.startswith("True False"), done.stdout
    assert done.stderr == ""


@pytest.mark.thorough
def test_a_demo_without_machine_code_is_interpreted_with_the_same_numbers(run, tmp_path):
    """The independent reference is the same command by machine code."""
    empty = tmp_path / "cache"
    command = [sys.executable, "-c", "from pepper_kin.cli import main; main()", "demo", "-o", "first"]
    first = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, "PEPPER_KIN_CACHE": str(empty)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert first.returncode == 0, first.stderr
    assert "Python's interpreter computes this" in first.stderr
    assert "The next program makes the machine code that it needs" in first.stderr
    assert run("demo", "-o", "second", cwd=tmp_path).returncode == 0
    interpreted, compiled = (
        json.loads((tmp_path / name / "summary.json").read_text()) for name in ("first", "second")
    )
    assert (interpreted["interpreted"], compiled["interpreted"]) == (True, False)
    for name in ("duration_s", "path_length_joint"):
        # The same to all digits on an idle machine; where the interpreter is slowed down, the time budget of
        # the search ends it elsewhere.
        assert interpreted[name] == pytest.approx(compiled[name], rel=0.2), name
    assert interpreted["certificate"]["success"]
    assert interpreted["hand_error_m"] < 1e-3


ANSWERS = """
import pickle
import sys
import pepper_kin as pk

HEAVY = {"pinocchio", "coal", "hppfcl", "casadi", "numba", "scipy", "placo", "toppra", "xacro", "numpy.ma"}
def light(what):
    assert not HEAVY & set(sys.modules), (what, HEAVY & set(sys.modules))

pepper = pickle.loads(pickle.dumps(pk.load_pepper().with_requirements("limits")))  # balance is Pinocchio's
pepper.posture("Stand"), pepper.frame_id("Head"), pepper.joint_group("left_arm")
light("a model")
target = (0.38, 0.22, 0.82)
tasks = [pk.ik.HandPosition("left", target), pk.ik.LookAt(target)]
assert pk.ik.solve(pepper, tasks[0], collisions=False).success
light("IK")
HEAVY.remove("numpy.ma")
assert pk.ik.solve(pepper, tasks).success
light("IK with collisions")
pk.retime(pepper, [pepper.posture("Stand"), pepper.posture("Stand") * 0.9])
light("timing")
table = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.47, 0.05, 0.715))
assert pk.plan(pepper, pepper.posture("Stand"), tasks, table, timeout=60.0).success
light("a plan")
"""


@pytest.mark.thorough
def test_first_answers_load_no_compiler_and_no_other_library(child):
    child(ANSWERS)
