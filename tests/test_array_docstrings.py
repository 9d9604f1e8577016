"""Docstrings of functions that take arrays: they name a shape, of inner functions as of public ones."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = (
    ".", "base_placement", "batch", "collision", "dynamics", "files", "ik", "jobs", "kinematics", "model",
    "motion", "naoqi", "planners", "servo", "symbolic", "trajectory", "twin", "urdf", "viewer",
)  # fmt: skip
"""Packages whose functions all name shapes, "." for the modules beside them; others are added as they do."""

WAITING = {("batch/states.py", "_by_kernel")}
"""Functions that do not name one yet; a function that does has to leave this set."""

ARRAY = re.compile(r"\b(Array|ArrayLike|NDArray|ndarray)\b")
SHAPE = re.compile(r"\bshapes?\b|\(\.\.\.,|\((\d+|\w),( \w+)*\)")


def array_arguments(function: ast.FunctionDef) -> list[str]:
    """Return the names of the arguments that are arrays; those that are functions of arrays are not."""
    arguments = (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)
    return [
        a.arg
        for a in arguments
        if a.annotation is not None
        and ARRAY.search(ast.unparse(a.annotation))
        and not ast.unparse(a.annotation).startswith("Callable")
    ]


def without_shape(source: str) -> list[str]:
    """Return the functions that take arrays and name no shape; an initializer's may be named by its class.

    Functions inside of functions are left out: they take what the function around them describes.
    """
    found = []

    def look(node: ast.AST, above: str) -> None:
        for part in ast.iter_child_nodes(node):
            if isinstance(part, ast.ClassDef):
                look(part, ast.get_docstring(part) or "")
            elif isinstance(part, ast.FunctionDef):
                text = ast.get_docstring(part) or ""
                text += above if part.name == "__init__" else ""
                if array_arguments(part) and not SHAPE.search(text):
                    found.append(part.name)

    look(ast.parse(source), "")
    return found


@pytest.mark.parametrize("folder", FOLDERS)
def test_functions_that_take_arrays_name_a_shape(folder):
    paths = sorted((ROOT / "pepper_kin" / folder).glob("*.py" if folder == "." else "**/*.py"))
    assert paths
    found = {
        (f"{folder}/{path.name}", name) for path in paths for name in without_shape(path.read_text("utf-8"))
    }
    assert found == {entry for entry in WAITING if entry[0].startswith(folder + "/")}


def test_functions_without_a_shape_are_found():
    source = '''
class A:
    """Points: array of shape (n, 3)."""
    def __init__(self, points: Array) -> None: ...
    def near(self, point: ArrayLike | None) -> float:
        """Return a distance."""
    def far(self, point: NDArray[np.float64]) -> float:
        """Return a distance from a point, shape (3,)."""
def bare(q: Array): ...
def call(function: Callable[[Array], Array]): ...
'''
    assert without_shape(source) == ["near", "bare"]
