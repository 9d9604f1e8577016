"""Interpreter options, locales, folders and system libraries that differ from a developer's machine."""

import os
import subprocess
import sys
import tomllib
from importlib.metadata import distribution, requires, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement


def run(*arguments, cwd=None, drop=(), **environment):
    """Run Python in another process and return what it printed; a failure shows its errors."""
    inherited = {name: value for name, value in os.environ.items() if name not in drop}
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        check=False,
        cwd=cwd,
        env={**inherited, **environment},
    )
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    return done.stdout.decode("utf-8", errors="replace")


PROXSUITE = """
import pepper_kin as pk
from pepper_kin.twin.world.world import World

pepper = pk.load_pepper()
task = pk.ik.HandPosition("left", (0.38, 0.22, 0.82))
world = World(pepper)
for call in (
    lambda: pk.ik.solve(pepper, task, solver="proxsuite"),
    lambda: World(pepper, solver="proxsuite"),
    lambda: setattr(world, "solver", "proxsuite"),
):
    try:
        call()
    except pk.exceptions.MissingDependencyError as error:
        print(error.package, "|", error)
print(pk.ik.solve(pepper, task, solver="placo").success, world.solver)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the loader of Linux")
def test_proxsuite_without_libgomp_names_the_system_package(tmp_path):
    """The loader finds an empty file in the library's place; the wheel brings none (D1)."""
    (tmp_path / "libgomp.so.1").touch()
    lines = run("-c", PROXSUITE, LD_LIBRARY_PATH=str(tmp_path)).splitlines()
    assert len(lines) == 4
    for line in lines[:3]:
        assert line.startswith("libgomp1 | the solver 'proxsuite' (")
        assert "apt-get install libgomp1" in line
    assert lines[3] == "True compiled"


def requirement(name, **environment):
    """The requirement of a package for an environment, such as an extra and a version of Python."""
    found = [Requirement(text) for text in requires("pepper_kin")]
    return [r for r in found if r.name == name and (r.marker is None or r.marker.evaluate(environment))]


@pytest.mark.parametrize("extra", ["test", "naoqi"])
def test_scripts_of_python_2_have_their_translator(extra):
    """lib2to3 came with Python until 3.12 (D2)."""
    assert requirement("fissix", extra=extra, python_version="3.13")
    assert not requirement("fissix", extra=extra, python_version="3.11")


def test_the_mujoco_that_computes_wrong_accelerations_is_excluded():
    """D3."""
    (found,) = requirement("mujoco", extra="mujoco")
    assert "4.0.0" not in found.specifier
    assert version("mujoco") in found.specifier


@pytest.mark.parametrize("name", ["numba", "llvmlite"])
def test_what_machine_code_depends_on_has_an_upper_bound(name):
    """D4."""
    (found,) = requirement(name, extra="")
    assert "999.0" not in found.specifier
    assert version(name) in found.specifier


def test_the_environment_has_the_entry_points_of_pyproject():
    """Those of an editable installation are as old as the installation: `pip install -e .` renews them."""
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text("utf-8"))["project"]
    groups = {"console_scripts": project["scripts"], **project["entry-points"]}
    expected = {(group, name, value) for group, rows in groups.items() for name, value in rows.items()}
    assert {(e.group, e.name, e.value) for e in distribution("pepper_kin").entry_points} == expected


PROGRAM = """
import pepper_kin as pk

pepper = pk.load_pepper()
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
tasks = [pk.ik.HandPosition("left", (0.38, 0.22, 0.82)), pk.ik.LookAt((0.38, 0.22, 0.82))]
trajectory = pk.retime(pepper, pk.plan(pepper, pepper.posture("Stand"), tasks, scene, seed=0), balance=0.01)
assert trajectory.check(pepper, scene=scene).success or print("fails")
pk.files.save(trajectory, "reach.yaml", scene=scene)
print(pk.Twin(pepper, timestep=0.001).execute(trajectory).status.value, f"{trajectory.duration:.9f}")
"""

WITHOUT = """
import sys

for name in ("placo", "toppra", "ruckig", "matplotlib", "casadi", "numba"):
    sys.modules[name] = None
"""

REFUSED = """
from pepper_kin.paper import replay

print(pk.jobs.reach(pepper, "left", (2.0, 0.3, 1.0)).message[:20], replay(pepper, "head").run.success)
calls = {
    "placo": lambda: pk.ik.solve(pepper, tasks, solver="placo"),
    "toppra": lambda: pk.retime(pepper, trajectory.coefficients[[0, -1], 0], solver="toppra"),
    "ruckig": lambda: pk.trajectory.OnlineMotion(pepper, pepper.posture("Stand")),
    "matplotlib": lambda: trajectory.plot(pepper),
}
for name, call in calls.items():
    try:
        call()
    except pk.exceptions.MissingDependencyError as error:
        print(error.package, "|", error.command)
"""


@pytest.mark.thorough
def test_the_program_needs_no_extra_and_each_is_named_where_it_is_missing(tmp_path, made_code):
    """Machine code is there: neither CasADi nor Numba is loaded, nor what only compares."""
    lines = run("-c", WITHOUT + PROGRAM + REFUSED, cwd=tmp_path).splitlines()
    assert lines[0].startswith("completed ")
    assert lines[1] == "The hand cannot reac True"
    assert lines[2:] == [
        'placo | pip install "pepper_kin[reference]"',
        'toppra | pip install "pepper_kin[reference]"',
        "ruckig | pip install 'ruckig>=0.14'",
        'matplotlib | pip install "pepper_kin[plot]"',
    ]


LOCALE_NAMES = """
import pepper_kin as pk
from pepper_kin.file_access.atomic_file import write_text

try:
    write_text("f\\u00fc\\u00df.txt", "x")
except pk.exceptions.FileFormatError as error:
    print(error)
"""

C_LOCALE = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.mark.thorough
def test_the_main_job_is_the_same_wherever_it_runs(tmp_path, made_code):
    """With -O, in a locale of ASCII, without a home, and in folders with a space (D5)."""
    odd = tmp_path / "a folder of my own"
    odd.mkdir()
    made_code(odd / "cache of code")
    made_code(tmp_path / "session" / "pepper_kin")  # where code is kept without a home of one's own
    expected = run("-c", PROGRAM, cwd=tmp_path)
    assert expected.startswith("completed ")
    drop = ("HOME", "XDG_CACHE_HOME", "PEPPER_KIN_CACHE")
    for options, dropped, environment in (
        (["-O"], (), C_LOCALE),
        (["-OO"], (), {"PEPPER_KIN_CACHE": str(odd / "cache of code")}),
        ([], ("HOME",), {}),
        ([], drop, {"HOME": "/dev/null", "XDG_RUNTIME_DIR": str(tmp_path / "session")}),  # nothing is written
    ):
        assert run(*options, "-c", PROGRAM, cwd=odd, drop=dropped, **environment) == expected
    assert (odd / "reach.yaml").stat().st_size > 1000


@pytest.mark.skipif(sys.platform != "linux", reason="names are UTF-8 elsewhere")
def test_names_that_the_locale_cannot_write_are_named(tmp_path):
    said = run("-c", LOCALE_NAMES, cwd=tmp_path, **C_LOCALE)
    assert "character 1 is not in ascii, the encoding of this locale's names" in said
    assert list(tmp_path.iterdir()) == []


FORKED = """
import os, signal, sys, threading
from functools import cached_property

import numpy as np
import pepper_kin as pk

pepper = pk.load_pepper()
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
task = pk.ik.HandPosition("left", (0.38, 0.22, 0.82))

def path():
    problem = pk.PlanProblem(pepper, pepper.posture("Stand"), [task], scene, timeout=100.0)
    return pk.plan_batch([problem] * 2, processes=2).plans[0].path

expected, locks = path(), []
for name, module in list(sys.modules.items()):
    if name.startswith("pepper_kin"):
        locks += [module._lock] if hasattr(module, "_lock") else []
        for kind in [value for value in vars(module).values() if isinstance(value, type)]:
            found = [value for value in vars(kind).values() if isinstance(value, cached_property)]
            locks += [value.lock for value in found if hasattr(value, "lock")]
held, over = threading.Event(), threading.Event()

def hold():
    for lock in {id(lock): lock for lock in locks}.values():
        lock.acquire()
    held.set()
    over.wait()

threading.Thread(target=hold, daemon=True).start()
assert held.wait(60) and len(locks) > 5
child = os.fork()
if not child:
    signal.alarm(60)
    os._exit(0 if np.array_equal(path(), expected) else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
over.set()
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks")
def test_a_child_forked_while_a_thread_holds_locks_computes():
    """Cached properties share a lock among all robots until Python 3.11; a child waited for it for ever."""
    assert run("-W", "ignore", "-c", FORKED) == "0\n"
