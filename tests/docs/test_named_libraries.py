"""Where a check, or a row of the page on verification, names a library, that library computes."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from broken_library import FUNCTIONS, LibraryCalled, places_of, raising
from typer.main import get_command

from pepper_kin.cli.check import app

ROOT = Path(__file__).parents[2]
REPORTS = ROOT / "docs" / "verification"
NAMES = re.compile(rf"(?<!no code with )\b({'|'.join(FUNCTIONS)})\b", re.IGNORECASE)
ARM = """<robot name="arm"><link name="floor"/><link name="upper"><inertial><origin xyz="0.1 0 -0.2"/>
  <mass value="2"/><inertia ixx="0.025" ixy="0.001" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="floor"/><child link="upper"/><axis xyz="0 1 0.3"/>
  <limit lower="-2" upper="2" effort="9" velocity="9"/></joint></robot>"""
CHECKS = [
    *(("dynamics", "Pinocchio", name) for name in (
        "rnea", "crba", "aba", "computeFrameJacobian", "getFrameJacobianTimeVariation",
        "jacobianCenterOfMass", "computeRNEADerivatives", "computeABADerivatives",
    )),
    ("dynamics", "CasADi", "Function.__call__"),
    ("physics", "MuJoCo", "mj_step"), ("physics", "MuJoCo", "mj_applyFT"),
]  # fmt: skip
"""Command of `pepper-kin check`, library, and each function behind what the command prints of it."""
CALLERS = {
    "toppra": "",
    "placo": "",
    "proxsuite": "",
    "test_servo": "pair_queries",
    "test_motion_files": "pair_queries",
}
"""Library or file of tests -> whose calls raise, where it is not code of the test: a solver that is asked for
by its name, and the library's exact check of collisions."""


def callers_of(library, test):
    """Return whose calls of a library raise for a test."""
    return CALLERS.get(Path(test.partition("::")[0]).stem, CALLERS.get(library, "tests/fuzz"))


def named(text):
    """Return the libraries that a text names."""
    spelled = {name.lower(): name for name in FUNCTIONS}
    return {spelled[name.lower()] for name in NAMES.findall(text)}


@pytest.mark.thorough
@pytest.mark.parametrize(("command", "library", "function"), CHECKS)
def test_a_check_fails_where_a_library_that_it_names_raises(
    monkeypatch, run, tmp_path, command, library, function
):
    (tmp_path / "arm.urdf").write_text(ARM)
    arguments = ["arm.urdf", "--states", "2"] if command == "dynamics" else []
    broken = raising(library, function)
    for owner, name in places_of(library, function):
        monkeypatch.setattr(owner, name, broken)
    with pytest.raises(LibraryCalled, match=f"{library}: {function} was called"):
        run("check", command, *arguments, cwd=tmp_path)


def test_all_libraries_that_checks_name_are_tried(run, tmp_path):
    """By their help, by what the page shows of them, and by what those print that it does not show."""
    page = (ROOT / "docs" / "validation.md").read_text("utf-8")
    sections = dict(
        re.findall(r"^## `pepper-kin check (\w+)`$(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
    )
    group = get_command(app)
    commands = {name: group.get_command(None, name) for name in group.list_commands(None)}
    assert sections.keys() < commands.keys()
    joints = ("RShoulderPitch", "HeadYaw")
    header = "time," + ",".join(f"{joint}_{end}" for joint in joints for end in ("command", "measured"))
    time = np.arange(0.0, 4.0, 0.02)
    rows = np.column_stack([time, np.tile(0.1 * np.sin(time)[:, None], 4)])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=header, comments="")
    calls = {"model": [], "limits": [], "log": ["log.csv"]}
    assert sections.keys() | calls.keys() == commands.keys()
    printed = {name: run("check", name, *files, cwd=tmp_path).stdout for name, files in calls.items()}
    assert all(printed.values())
    names = {
        (name, library)
        for name, command in commands.items()
        for library in named(
            f"{command.help} {' '.join(p.help or '' for p in command.params if hasattr(p, 'help'))} "
            f"{sections.get(name) or printed[name]}"
        )
    }
    assert {("dynamics", "Pinocchio"), ("physics", "MuJoCo")} <= names
    assert names <= {check[:2] for check in CHECKS}


def rows():
    """Return {(library, callers): tests}, a test for each row of the page that names a library."""
    report = json.loads((REPORTS / "middle.json").read_text("utf-8"))
    tests, found = {}, {}
    for test in report["tests"]:
        for what, *_ in test["counts"]:
            for library in named(f"{what} {test['oracle']}"):
                tests.setdefault((library, what), test["test"])
    for (library, _), test in tests.items():
        found.setdefault((library, callers_of(library, test)), set()).add(test)
    return found


@pytest.mark.thorough
@pytest.mark.parametrize(("library", "callers"), sorted(rows()))
def test_a_row_of_the_page_fails_where_the_library_that_it_names_raises(library, callers, tmp_path):
    """In a process of its own, since tests take functions from a library as they are imported."""
    tests = rows()[library, callers]
    report = tmp_path / "report.json"
    command = ["-n", "0", "-p", "broken_library", "--fuzz-report", report, "--fuzz-keep", tmp_path, *tests]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *command], cwd=ROOT, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parent), "BROKEN_LIBRARY": library,
             "BROKEN_FOR": callers},
    )  # fmt: skip
    outcomes = {test["test"]: test["outcome"] for test in json.loads(report.read_text("utf-8"))["tests"]}
    assert outcomes == dict.fromkeys(tests, "failed"), done.stdout[-3000:]
    assert done.stdout.count(f"LibraryCalled: {library}: ") >= len(tests)
