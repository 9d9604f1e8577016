"""Damaged files: every reader returns something sound or raises the library's error that names the file.

Files are damaged by bytes, tokens, elements and nesting (`mutations.py`), and read in processes of their own
that may take 10 s and 1 GB (`reader_process.py`).  The readers, and what their results must be, are in
`reader_cases.py`.
"""

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

Server = tuple[subprocess.Popen[str], dict[str, tuple[str, bool]]]
"""The process that reads, and the large files that it makes: name -> reader, whether a small one is read."""
FOLDER = Path(__file__).parent
LARGE = (20, 300, 4900)
"""Sizes of large files [kB]."""
READERS = (
    "URDF", "URDF text", "URDF on a base", "URDF of Pepper", "xacro", "SDF", "SRDF", "SRDF text", "audit",
    "audit of meshes", "compare", "scene", "CSV", "Parquet", "JSON", "NPZ", "ROS YAML", "NAOqi script",
    "MCAP", "robot's log", "joint states CSV", "joint states MCAP", "bag", "table", "columns",
    "columns of a CSV",
    "Choregraphe behavior", "Choregraphe boxes", "Choregraphe project", "Choregraphe export", "run",
    "motion", "recording header", "recording", "reach map", "policy", "dataset job",
    "manifest", "shard", "key points", "key points CSV", "STL",
    "STL text", "OBJ", "COLLADA", "PLY", "glTF", "Pepper's meshes",
)  # fmt: skip
WITHOUT_LARGE = {
    "manifest",
    "shard",
    "URDF text",
    "URDF of Pepper",
    "xacro",
    "SDF",
    "SRDF text",
    "joint states",
    "columns of a CSV",
    "Choregraphe boxes",
}
"""Readers of texts and of files that others read."""
NO_READERS = {
    "collision.AttachedObject.load", "collision.load_torque", "collision.load_wrench", "collision.loads_of",
    "kernels.CompiledFunction.load", "twin.Push.load",
}  # fmt: skip
"""Public names that begin alike: masses, code and forces."""
NOT_READ = {"xacro", "SDF", "shard"}
"""Formats that are refused by name even where they are whole, or after any change: a shard by its SHA-256."""
FUNCTIONS = {
    "collision.Scene.load", "datasets.load_job", "datasets.open",
    "files.load", "files.load_columns", "files.load_table", "files.read_choregraphe",
    "files.read_joint_states", "files.read_naoqi_export", "identification.read_log", "jobs.load_motion",
    "kinematics.ReachMap.load", "learning.load_policy",
    "model.audit", "model.compare", "model.load_pepper", "model.load_robot",
    "motion.read_key_points", "twin.load_recording",
    "twin.load_run",
}  # fmt: skip
"""Public functions that read files, all of which `reader_cases.py` and `reader_checks.py` call."""


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
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
    first = json.loads(cast(IO[str], process.stdout).readline())
    assert tuple(first["readers"]) == READERS
    assert {kind for kind, _ in first["large"].values()} == set(READERS) - WITHOUT_LARGE
    yield process, first["large"]
    process.communicate(timeout=60)


@pytest.mark.parametrize("reader", READERS)
def test_a_damaged_file_is_read_or_refused_by_name(
    server: Server,
    reader: str,
    amount: Callable[[int, int, int], int],
    tried: Callable[..., None],
    request: pytest.FixtureRequest,
) -> None:
    batch = {
        "reader": reader,
        "seed": request.config.getoption("--fuzz-seed"),
        "first": 0,
        "count": amount(12, 300, 10_000),
    }
    answer = answer_of(server, batch)
    tried("damaged files", batch["count"], answer["wrong"])
    assert answer["read"] + answer["refused"] + answer["wrong"] == batch["count"]
    assert not answer["faults"], "\n".join(answer["faults"])
    if batch["count"] >= 300 and reader not in NOT_READ:
        assert answer["read"], "no file was read: what is damaged was wrong before"


@pytest.mark.parametrize("kind", [reader for reader in READERS if reader not in WITHOUT_LARGE])
def test_a_large_file_is_read_or_refused_by_name(
    server: Server,
    kind: str,
    amount: Callable[[int, int, int], int],
    tried: Callable[..., None],
    request: pytest.FixtureRequest,
) -> None:
    """Files of 20 kB, 300 kB or 4.9 MB, within 10 s of the processor and 1 GB."""
    size = LARGE[["small", "middle", "long"].index(request.config.getoption("--fuzz-size"))]
    named = {name: whole for name, (of, whole) in server[1].items() if of == kind}
    amount(*[len(named)] * 3)
    wrong = []
    for name, whole in named.items():
        answer = answer_of(server, {"reader": f"{name}, {size} kB", "seed": 0, "first": 0, "count": 1})
        wrong += [f"{name}: {fault}" for fault in answer["faults"]]
        if size == LARGE[0] and answer["read"] != whole:
            wrong.append(f"{name}: {answer}")
    tried("large files", len(named), len(wrong))
    assert not wrong, "\n".join(wrong)


def answer_of(server: Server, batch: dict[str, Any]) -> dict[str, Any]:
    """Return what the process says of a batch."""
    requests, answers = cast(IO[str], server[0].stdin), cast(IO[str], server[0].stdout)
    requests.write(json.dumps(batch) + "\n")
    requests.flush()
    answer: dict[str, Any] = json.loads(answers.readline())
    return answer


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
