"""The direction of imports: each package imports only those above it."""

import ast
import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pepper_kin as pk
from pepper_kin import __version__

ROOT = Path(__file__).parents[1]
ORDER = (
    "arrays", "exceptions", "call_errors", "lazy_names", "forked_children", "status", "file_access",
    "servers", "proxsuite_library", "plugins", "ros_messages",
    "model",
    "symbolic",
    "kernels", "core", "batch", "kinematics", "dynamics", "collision", "ik", "servo", "base_placement",
    "trajectory", "files", "motion", "twin", "learning", "identification", "datasets",
    "supervision", "jobs",
    "viewer",
    "cli", "paper", "naoqi", "ros", "qibullet",
)  # fmt: skip
"""From the top down: a package may import those before it."""
APART = {("kinematics", "dynamics"), ("dynamics", "kinematics"), ("cli", "planners")}
ONLY = {
    "kernels": {"exceptions", "file_access"},
    "core": {"exceptions", "kernels"},
    "planners": {"exceptions", "call_errors", "status", "kernels", "core"},
    "urdf": {"exceptions"},
    "exceptions": set(),
    "status": set(),
    "arrays": set(),
    "lazy_names": {"call_errors"},
    "call_errors": {"exceptions"},
    "plugins": set(),
    "forked_children": set(),
    "file_access": {"exceptions"},
    "servers": {"exceptions"},
    "ros_messages": {"exceptions", "file_access"},
}
"""All that these packages may import; they are independent of the robot."""
COMMANDS = {*(ROOT / "pepper_kin/cli").glob("*.py"), *(ROOT / "pepper_kin").glob("*/command*.py")}
"""Modules of commands, which import `pepper_kin` as its users do."""


def python_files():
    for folder in ("pepper_kin", "planners", "urdf"):
        yield from sorted((ROOT / folder).rglob("*.py"))


def package_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    if parts[0] != "pepper_kin":
        return parts[0]
    return parts[1] if len(parts) > 1 else "__init__"


class Facts(NamedTuple):
    """What the tests ask of a file, whose syntax tree is not kept: those of all files take 200 MB.

    Attributes:
        imported: Packages of pepper_kin that it imports, at the top, in functions or for type checking.
        modules: Modules of pepper_kin that it imports by `from`.
        texts: Texts that are the name of a module of pepper_kin.
        positional: The most positional parameters of a function, and its name.
        inside: Lines of imports of our own in functions.
    """

    imported: set[str]
    modules: set[str]
    texts: set[str]
    positional: tuple[int, str]
    inside: set[int]


@cache
def facts(path):
    """Return the facts of a file."""
    imported, modules, texts, positional, inside = set(), set(), set(), (0, ""), set()
    package = ("pepper_kin", *path.relative_to(ROOT).parts[:-1])
    if package[1] == "pepper_kin":
        package = package[1:]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                base = ".".join([*package[: len(package) - node.level + 1], *filter(None, [node.module])])
            names = [base] if base != "pepper_kin" else [f"pepper_kin.{alias.name}" for alias in node.names]
            modules.add(base)
        elif isinstance(node, ast.Constant) and re.fullmatch(r"pepper_kin(\.\w+)+", str(node.value)):
            texts.add(str(node.value))
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            count = len(node.args.posonlyargs) + len(node.args.args) - (node.name == "__init__")
            positional = max(positional, (count, node.name))
            inside |= {
                inner.lineno
                for inner in ast.walk(node)
                if isinstance(inner, ast.ImportFrom)
                and (inner.level or (inner.module or "").partition(".")[0] == "pepper_kin")
            }
        parts = [name.split(".") for name in names]
        imported |= {(*part, "__init__")[1] for part in parts if part[0] == "pepper_kin"}
    return Facts(imported - {"__version__"}, modules, texts, positional, inside)


def packages_imported(path):
    return facts(path).imported


ALL_FILES = list(python_files())


def test_imports_point_one_way():
    """A package imports those that stand before it alone, and none pepper_kin itself."""
    for path in ALL_FILES:
        package = package_of(path)
        if package == "__init__":
            continue
        imported = packages_imported(path) - {package, "arrays"}
        if path in COMMANDS:
            imported.discard("__init__")
        if package in ONLY:
            assert imported <= ONLY[package], path
            continue
        above = set(ORDER[: ORDER.index(package)]) | {"planners", "urdf"}
        assert imported <= above, (path, imported - above)
        assert not [pair for pair in APART if pair[0] == package and pair[1] in imported], path


INTERFACES = ("ros_messages", "paper", "naoqi", "ros", "qibullet")
"""What connects the toolkit with other programs, by entry points: the toolkit works without it."""


def test_the_toolkit_imports_no_interface():
    """At the top, in functions, for type checking, or by a name in a text."""
    for path in ALL_FILES:
        if package_of(path) not in INTERFACES:
            named = {text.split(".")[1] for text in facts(path).texts}
            assert not (packages_imported(path) | named) & set(INTERFACES), path


TOOLKIT_PROGRAM = """
import importlib, pkgutil
import pytest
import numpy as np
import pepper_kin as pk

for module in pkgutil.walk_packages(pk.__path__, "pepper_kin."):
    importlib.import_module(module.name)
pepper = pk.load_pepper()
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
tasks = [pk.ik.HandPosition("left", (0.38, 0.22, 0.82)), pk.ik.LookAt((0.38, 0.22, 0.82))]
assert pk.ik.solve(pepper, tasks, scene=scene).success
plan = pk.plan(pepper, pepper.posture("Stand"), tasks, scene, seed=0, timeout=300.0)
trajectory = pk.retime(pepper, plan, balance=0.01)
assert trajectory.check(pepper, scene=scene).success
run = pk.Twin(pepper, timestep=0.001).execute(trajectory)
assert np.abs(run.position[-1] - trajectory.end).max() < 0.01
for name in ("motion.json", "motion.csv", "motion.yaml", "motion.py"):
    pk.files.save(trajectory, name, scene=scene)
    again = pk.files.load(name, pepper=pepper)
    assert abs(again.duration - trajectory.duration) < 0.01
for refused in (
    lambda: pk.files.save(trajectory, "motion.mcap"),
    lambda: pk.files.load("motion.mcap"),
    lambda: pk.files.read_joint_states(pepper, "motion.mcap"),
):
    try:
        refused()
    except pk.exceptions.UnknownNameError as error:
        print(error)
"""


def test_the_toolkit_works_where_the_interfaces_are_deleted(tmp_path):
    """In a copy of the package, with metadata that register nothing, and without the one installed."""
    for folder in ("pepper_kin", "planners", "urdf"):
        to = tmp_path / ("pepper_kin" if folder == "pepper_kin" else f"pepper_kin/{folder}")
        shutil.copytree(ROOT / folder, to, ignore=shutil.ignore_patterns("__pycache__"))
    for name in INTERFACES:
        found = tmp_path / "pepper_kin" / name
        shutil.rmtree(found) if found.is_dir() else found.with_suffix(".py").unlink()
    metadata = tmp_path / f"pepper_kin-{__version__}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: pepper_kin\nVersion: {__version__}\n")
    # README's environment lies in the checkout: what is installed there stays.
    others = [
        path
        for path in sys.path
        if path and (Path(path).is_relative_to(sys.prefix) or not Path(path).is_relative_to(ROOT))
    ]
    (tmp_path / "work").mkdir()

    def run(code):
        """Run a program without the module `site`, which finds what is installed from this folder."""
        done = subprocess.run(
            [sys.executable, "-S", "-c", code],
            capture_output=True,
            text=True,
            cwd=tmp_path / "work",
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *others])},
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert str(tmp_path) in run("import pepper_kin; print(pepper_kin.__file__)")
    refused = run(TOOLKIT_PROGRAM).splitlines()
    assert len(refused) == 3
    assert all("'.mcap'; available: .csv" in line for line in refused)
    shown = run("import sys; from pepper_kin.cli import main; sys.argv = ['pepper-kin', '--help']; main()")
    assert "reach" in shown
    assert not re.search(r"naoqi|\bros\b", shown, re.IGNORECASE)


ENGINE_PROGRAM = """
import importlib, pkgutil, sys
for name in ("pinocchio", "coal", "hppfcl", "placo", "pepper_kin.model"):
    sys.modules[name] = None  # cannot be imported
import pepper_kin
for name in sys.argv[1:]:
    module = importlib.import_module(f"pepper_kin.{name}")
    for found in pkgutil.walk_packages(getattr(module, "__path__", ()), f"pepper_kin.{name}."):
        importlib.import_module(found.name)

import numpy as np
from pepper_kin import planners
outside = lambda states: np.linalg.norm(states - 0.5, axis=1) > 0.3
problem = planners.Problem([0, 0], [1, 1], [0.1, 0.5], [0.9, 0.5], outside, resolution=0.01)
found = planners.rrt_connect(problem, seed=0, timeout=60.0)
assert planners.certify(problem, found.path).success
"""


def test_what_is_independent_of_robots_works_without_pinocchio_and_models(child):
    child(ENGINE_PROGRAM, *ORDER[: ORDER.index("model")], "kernels", "core", "planners")


PLANNERS = {"pepper_kin.planners", "pepper_kin.planners.compiled", "pepper_kin.planners.optimization"}
"""What the library imports of the planners: public names, and the inner steps that compiled callers use."""


def test_the_library_imports_of_planners_what_they_offer():
    used = set()
    for path in ALL_FILES:
        if package_of(path) != "planners":
            found = {name for name in facts(path).modules if name.startswith("pepper_kin.planners")}
            assert found <= PLANNERS, f"{path} imports {found - PLANNERS}"
            used |= found
    assert used == PLANNERS


def test_only_the_command_line_imports_the_viewer():
    for path in ALL_FILES:
        if "viewer" in packages_imported(path) and path.name != "body_page.py":
            assert package_of(path) in ("viewer", "cli", "__init__"), path


def test_functions_take_eight_positional_parameters_at_most():
    assert {path.name: facts(path).positional for path in ALL_FILES if facts(path).positional[0] > 8} == {}


CERTIFICATES = (
    "pepper_kin/trajectory/check.py",
    "pepper_kin/trajectory/certificate.py",
    "pepper_kin/collision/checker.py",
    "pepper_kin/collision/least_clearance.py",
    "pepper_kin/dynamics/newton_euler.py",
    "pepper_kin/trajectory/examined_states.py",
    *(str(path.relative_to(ROOT)) for path in (ROOT / "pepper_kin/core/certificates").glob("*.py")),
)
"""Modules that certify a motion: by Newton-Euler, bounds and coal."""

SHARED = {"collision.motion_tree", "core.motion_bounds"}
"""The bound on how far a joint moves a point is proven and stands once; see its own test."""


def test_certificates_share_no_code_with_the_core():
    for name in CERTIFICATES:
        for module in facts(ROOT / name).modules:
            parts = module.split(".")[1:]
            compiled = {*parts[:1]} & {"core", "planners"} or "fast" in parts
            own = parts[:2] == ["core", "certificates"] or ".".join(parts) in SHARED
            assert not compiled or own, f"{name} imports {module}"


def test_what_makes_motions_calls_no_code_of_certificates():
    for path in ALL_FILES:
        parts = path.relative_to(ROOT).parts
        if "certificates" in parts or not {"core", "planners", "fast"} & {*parts}:
            continue
        for module in facts(path).modules:
            assert ".core.certificates" not in module, f"{path} imports {module}"


ASKS_WHAT_IS_IMPORTED = {
    "pepper_kin/kernels/compiled_function.py",  # the file of a function's own module
    "pepper_kin/forked_children.py",  # the locks of what is imported
    "pepper_kin/kernels/signatures.py",  # the names of a class's own module
    "pepper_kin/call_errors.py",  # a package's own module
    "pepper_kin/lazy_names.py",
    "pepper_kin/naoqi/scripts.py",  # the modules that a script of NAOqi's imports, put back after it
    "pepper_kin/qibullet/programs.py",  # those of qiBullet's programs
}


def test_nothing_depends_on_what_happens_to_be_imported():
    """A module that others may or may not have loaded decides nothing: none is looked up by name."""
    found = {str(path.relative_to(ROOT)) for path in ALL_FILES if "sys.modules" in path.read_text("utf-8")}
    assert found == ASKS_WHAT_IS_IMPORTED


MOST_IN_FUNCTIONS = 40
"""Imports of our own modules in functions: what few calls need and takes long, and pairs of files."""


def test_few_imports_stand_in_functions():
    found = [(str(path.relative_to(ROOT)), line) for path in ALL_FILES for line in facts(path).inside]
    assert len(found) <= MOST_IN_FUNCTIONS, sorted(found)


IMPORTS = """
import importlib, sys

import pepper_kin
assert "numpy" not in sys.modules
heavy = {"pinocchio", "placo", "coal", "casadi", "proxsuite", "toppra", "ruckig", "scipy", "numba", "mujoco",
         "meshcat", "tornado", "asyncio", "matplotlib", "rich", "xacro", "yaml", "fast_simplification"}
for name in sys.argv[1:]:
    importlib.import_module(f"pepper_kin.{name}")
    assert not heavy & set(sys.modules), (name, heavy & set(sys.modules))
"""


def test_heavy_libraries_are_not_loaded_by_importing_packages(child):
    """A package's import takes 0.3 s at most: each of these takes longer than all of our own files."""
    packages = [name for name in pk.__all__ if name in {*ORDER, "planners"}]
    child(IMPORTS, *packages, "cli", "naoqi.commands", "ros.command")


def test_the_design_page_has_the_layer_of_every_package():
    """What is independent of robots imports nothing else, and the toolkit no interface."""
    page = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    table = page.partition("| package or module | layer | contents |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| `(\w+)(?:/|\.py)` \| ([a-z ]+) \| ", table, re.MULTILINE)
    layers = dict(rows)
    assert len(rows) == len(layers) == table.count("\n") - 1
    assert set(layers) == set(ORDER) | {"planners", "urdf"}
    known = {package_of(path) for path in ALL_FILES} - {"__init__"}
    assert set(layers) == known
    levels = ("independent", "toolkit", "interface")
    for path in ALL_FILES:
        package = package_of(path)
        for imported in packages_imported(path) & known if package in known else ():
            assert levels.index(layers[imported]) <= levels.index(layers[package]), (path, imported)
    interfaces = {name for name, layer in layers.items() if layer == "interface"}
    assert {layers[name] for name in set(INTERFACES) - interfaces} == {"independent"}
    assert interfaces < set(INTERFACES)
