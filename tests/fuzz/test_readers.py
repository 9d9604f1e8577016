"""Damaged files: every reader returns something sound or raises the library's error that names the file.

Files are damaged by bytes, tokens, elements and nesting (`mutations.py`), and read in processes of their own
that may take 10 s and 1 GB (`reader_process.py`).  The readers, and what their results must be, are in
`reader_cases.py`.
"""

from __future__ import annotations

import importlib
import inspect
import json
import os
import pkgutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, cast

import pytest

import pepper_kin

FOLDER = Path(__file__).parent
STARTS_A_PROCESS = {"COLLADA", "PLY", "glTF"}
READERS = (
    "URDF", "URDF text", "URDF on a base", "URDF of Pepper", "xacro", "SDF", "SRDF", "SRDF text", "audit",
    "audit of meshes", "compare", "scene", "CSV", "JSON", "NPZ", "ROS YAML", "NAOqi script", "MCAP",
    "joint states CSV", "joint states MCAP", "bag", "table", "columns", "columns of a CSV",
    "Choregraphe behavior", "Choregraphe project", "Choregraphe export", "run", "motion",
    "recording header", "recording", "reach map", "STL", "STL text", "OBJ", "COLLADA", "PLY", "glTF",
    "Pepper's meshes",
)  # fmt: skip
NO_READERS = {
    "collision.AttachedObject.load", "collision.load_torque", "collision.load_wrench", "collision.loads_of",
    "kernels.CompiledFunction.load", "twin.Push.load",
}  # fmt: skip
"""Public names that begin alike: masses, code and forces."""
NOT_READ = {"xacro", "SDF"}
"""Formats that are refused by name even where they are whole."""
FUNCTIONS = {
    "collision.Scene.load", "files.load", "files.load_columns", "files.load_table", "files.read_choregraphe",
    "files.read_joint_states", "files.read_naoqi_export", "jobs.load_motion", "kinematics.ReachMap.load",
    "model.audit", "model.compare", "model.load_pepper", "model.load_robot", "twin.load_recording",
    "twin.load_run",
}  # fmt: skip
"""Public functions that read files, all of which `reader_cases.py` and `reader_checks.py` call."""


@pytest.fixture(scope="module")
def server() -> Iterator[subprocess.Popen[str]]:
    """Start the process that runs the cases."""
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(FOLDER.parents[1]), os.environ.get("PYTHONPATH", "")]),
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = [sys.executable, str(FOLDER / "reader_process.py")]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    )
    assert tuple(json.loads(cast(IO[str], process.stdout).readline())["readers"]) == READERS
    yield process
    process.communicate(timeout=60)


@pytest.mark.parametrize("reader", READERS)
def test_a_damaged_file_is_read_or_refused_by_name(
    server: subprocess.Popen[str],
    reader: str,
    amount: Callable[[int, int, int], int],
    tried: Callable[..., None],
    request: pytest.FixtureRequest,
) -> None:
    small = 3 if reader in STARTS_A_PROCESS else 12
    batch = {
        "reader": reader,
        "seed": request.config.getoption("--fuzz-seed"),
        "first": 0,
        "count": amount(small, 300, 10_000),
    }
    requests, answers = cast(IO[str], server.stdin), cast(IO[str], server.stdout)
    requests.write(json.dumps(batch) + "\n")
    requests.flush()
    answer: dict[str, Any] = json.loads(answers.readline())
    tried("damaged files", batch["count"], answer["wrong"])
    assert answer["read"] + answer["refused"] + answer["wrong"] == batch["count"]
    assert not answer["faults"], "\n".join(answer["faults"])
    if batch["count"] >= 300 and reader not in NOT_READ:
        assert answer["read"], "no file was read: what is damaged was wrong before"


def test_all_public_readers_are_tried() -> None:
    found = set()
    for package in pkgutil.iter_modules(pepper_kin.__path__):
        module = importlib.import_module(f"pepper_kin.{package.name}")
        for name in getattr(module, "__all__", ()):
            thing = getattr(module, name)
            methods = [f"{name}.{method}" for method in ("load", "read") if hasattr(thing, method)]
            if inspect.isclass(thing):
                found |= {f"{package.name}.{method}" for method in methods}
            elif name.startswith(("load", "read", "open")) or name in ("audit", "compare"):
                found.add(f"{package.name}.{name}")
    assert found - NO_READERS == FUNCTIONS
    files = ("reader_cases.py", "reader_checks.py")
    cases = "".join((FOLDER / name).read_text(encoding="utf-8") for name in files)
    assert not [name for name in FUNCTIONS if name.split(".", 1)[1] not in cases]
