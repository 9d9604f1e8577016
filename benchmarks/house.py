"""The size and the structure of the package, counted beside earlier commits.

Lines of Python, imports of our own in functions, circles of files that import each other, literal byte
offsets in addresses of the core's loads and stores, the files that a second call runs.  Prints Markdown.
What edits and first answers cost is measured by `edits.py` and `first_start.py`.

    python benchmarks/house.py 95bd4e3 10c88739
"""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

from edits import HERE, copy_of

LOADS = re.compile(r"(load|store)_\w+|(word|single|double|integer|byte|float|lanes|row)s?_at")
"""Functions whose first argument is an address."""
CALLS = """
import sys
import numpy as np
import pepper_kin as pk

pepper, point = pk.load_pepper().with_requirements("limits"), (0.38, 0.22, 0.82)
tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
stand, goal = pepper.posture("Stand"), pk.ik.solve(pepper, tasks, scene=scene).q
servo = pk.servo.Servo(pepper, stand)
servo.set_target(tasks)
calls = {
    "`plan`, goal of tasks": lambda: pk.plan(pepper, stand, tasks, scene, timeout=60.0),
    "`plan`, goal of joints": lambda: pk.plan(pepper, stand, goal, scene, timeout=60.0),
    "`ik.solve`": lambda: pk.ik.solve(pepper, tasks),
    "`Servo.step`": lambda: servo.step(),
}
for name, call in calls.items():
    call()
    files = set()
    sys.setprofile(lambda frame, event, _: event == "call" and files.add(frame.f_code.co_filename))
    call()
    sys.setprofile(None)
    print(f"{name}|{len([file for file in files if '/pepper_kin/' in file])}")
"""


def modules(package: Path) -> dict[str, ast.Module]:
    """Return the syntax trees of the package by the names of its modules."""
    trees = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        trees[name] = ast.parse(path.read_text("utf-8"))
        trees[name].is_package = parts[-1] == "__init__"
    return trees


def imports(name: str, tree: ast.Module, known: set[str]) -> Iterator[tuple[set[str], bool, bool]]:
    """Yield modules that an import names, whether it is in a function, and whether for types alone."""

    def within(*kinds: type, test: str = "") -> set[int]:
        outer = (n for n in ast.walk(tree) if isinstance(n, kinds))
        return {id(i) for n in outer if not test or ast.unparse(n.test) == test for i in ast.walk(n)}

    functions = within(ast.FunctionDef, ast.AsyncFunctionDef)
    typed = within(ast.If, test="TYPE_CHECKING")
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                up = name.split(".")[: (1 - node.level if tree.is_package else -node.level) or None]
                base = ".".join([*up, *filter(None, [base])])
            if base.partition(".")[0] == "pepper_kin":
                found = {f"{base}.{alias.name}" for alias in node.names} & known
                yield found or {base}, id(node) in functions, id(node) in typed


def circles(arrows: dict[str, set[str]]) -> list[set[str]]:
    """Return the largest sets of modules each of which leads to every other one."""

    def reached(name: str) -> set[str]:
        visited, open_ = set(), [name]
        while open_:
            open_ += [
                new for new in arrows.get(open_.pop(), ()) if new not in visited and not visited.add(new)
            ]
        return visited

    after = {name: reached(name) for name in arrows}
    rings = {frozenset(other for other in after[name] if name in after.get(other, ())) for name in arrows}
    return sorted((set(ring) for ring in rings if len(ring) > 1), key=len, reverse=True)


def byte_offsets(tree: ast.Module) -> int:
    """Return how many addresses of loads and stores end with a literal number of bytes."""
    return sum(
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and LOADS.fullmatch(node.func.id) is not None
        and bool(node.args)
        and isinstance(node.args[0], ast.BinOp)
        and any(isinstance(side, ast.Constant) for side in (node.args[0].left, node.args[0].right))
        for node in ast.walk(tree)
    )


def lines(folder: Path) -> int:
    """Return the lines of all Python files of a folder."""
    return sum(path.read_bytes().count(b"\n") for path in folder.rglob("*.py"))


def counts(commit: str | None) -> dict[str, int]:
    """Return each row's number for a commit, or for the sources here."""
    with tempfile.TemporaryDirectory() as place:
        layout = copy_of(commit, Path(place) / "copy")
        package, tests = layout / "pepper_kin", HERE / "tests"
        if commit is not None:
            packed = subprocess.run(
                ["git", "archive", commit, "tests"], cwd=HERE, capture_output=True, check=True
            )
            with tarfile.open(fileobj=BytesIO(packed.stdout)) as archive:
                archive.extractall(place, filter="data")
            tests = Path(place) / "tests"
        trees = modules(package)
        arrows = {name: list(imports(name, tree, set(trees))) for name, tree in trees.items()}
        run = {name: set().union(*(to for to, _, typed in f if not typed)) for name, f in arrows.items()}
        every = {name: set().union(*(to for to, _, _ in found)) for name, found in arrows.items()}
        result = {
            "lines of library and planners": lines(package) - lines(package / "urdf"),
            "lines of tests": lines(tests),
            "imports of our own in functions": sum(inside for f in arrows.values() for _, inside, _ in f),
            "circles of files": len(circles(run)),
            "circles of files, imports for types counted": len(circles(every)),
            "literal byte offsets in `core/`": sum(
                byte_offsets(tree) for name, tree in trees.items() if name.startswith("pepper_kin.core")
            ),
        }
        variables = os.environ | {"PYTHONPATH": str(layout), "PEPPER_KIN_CACHE": f"{place}/cache"}
        command = [sys.executable, "-c", CALLS]
        done = subprocess.run(
            command, cwd=place, env=variables, stdout=subprocess.PIPE, text=True, check=True
        )
        for line in done.stdout.splitlines():
            name, _, number = line.partition("|")
            result[f"files in which {name} runs"] = int(number)
        return result


def main() -> None:
    """Print the table."""
    commits = [*sys.argv[1:], None]
    columns = [counts(commit) for commit in commits]
    print("| counted |" + "".join(f" {commit or 'now'} |" for commit in commits))
    print("|---|" + "---|" * len(commits))
    for name in columns[-1]:
        print(f"| {name} |" + "".join(f" {column.get(name, '-')} |" for column in columns))


if __name__ == "__main__":
    main()
