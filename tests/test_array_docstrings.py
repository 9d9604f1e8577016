"""Docstrings of functions that take arrays: they name a shape, of inner functions as of public ones."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {
    ".": ROOT / "pepper_kin",
    "planners": ROOT / "planners",
    "urdf": ROOT / "urdf",
    **{path.parent.name: path.parent for path in (ROOT / "pepper_kin").glob("*/__init__.py")},
}
"""Folders by name; "." are the modules beside the packages."""

ALIASES = ("core", "kernels")
"""Packages where the aliases of `kernels/signatures.py` (`Floats2`) count as arrays too."""

ARRAY = re.compile(r"\b(Array|ArrayLike|NDArray|ndarray)\b")
ALIAS = re.compile(rf"{ARRAY.pattern}|\b(Floats|Singles|Ints|Words|Bytes|Flags)\d\b")
SHAPE = re.compile(r"\bshapes?\b|\(\.\.\.,|\((\d+|\w),( \w+)*\)")


def array_arguments(function: ast.FunctionDef, array: re.Pattern[str]) -> list[str]:
    """Return the names of the arguments that are arrays; those that are functions of arrays are not."""
    arguments = (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)
    return [
        a.arg
        for a in arguments
        if a.annotation is not None
        and array.search(ast.unparse(a.annotation))
        and not ast.unparse(a.annotation).startswith("Callable")
    ]


def without_shape(source: str, array: re.Pattern[str] = ARRAY) -> list[str]:
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
                if array_arguments(part, array) and not SHAPE.search(text):
                    found.append(part.name)

    look(ast.parse(source), "")
    return found


@pytest.mark.parametrize("name", PACKAGES)
def test_functions_that_take_arrays_name_a_shape(name):
    paths = sorted(PACKAGES[name].glob("*.py" if name == "." else "**/*.py"))
    assert paths
    array = ALIAS if name in ALIASES else ARRAY
    found = {
        (path.name, function) for path in paths for function in without_shape(path.read_text("utf-8"), array)
    }
    assert not found


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


def test_aliases_of_arrays_are_found():
    source = "def bare(q: Floats2, n: int): ...\ndef count(n: int): ..."
    assert without_shape(source) == []
    assert without_shape(source, ALIAS) == ["bare"]
