"""Digests of Python sources, parts of the keys of machine code; comments and docstrings do not count."""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.file_access.atomic_file import write_bytes

_SIZE = 32
"""Of a digest [hexadecimal digits]."""

_Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


class Digests(NamedTuple):
    """Digests of one file.

    Attributes:
        whole: Of its syntax tree.
        functions: Of each of its functions, by qualified name.
    """

    whole: str
    functions: Mapping[str, str]


@cache
def source_digest(*modules: str) -> str:
    """Return a hash of the sources of modules and packages, read once in a process.

    A package counts as the files in its own folder, without those of its sub-packages.  Comments, docstrings
    and the ends of lines do not count, nor do the places of the files.

    Args:
        *modules: Full names, such as "pepper_kin.symbolic" or "pepper_kin.ik.fast.expression".

    Raises:
        UnknownNameError: for a module that is not there.
    """
    digest = hashlib.sha256()
    for module in modules:
        for path in _files(module):
            digest.update(f"{module} {path.name} {file_digest(str(path))}\n".encode())
    return digest.hexdigest()


def file_digest(path: str) -> str:
    """Return a hash of the syntax tree of a file, read once in a process."""
    return digests(path).whole


def function_digest(path: str, name: str) -> str:
    """Return a hash of the syntax tree of a function of a file; of the file where it has no such function.

    Args:
        path: The file.
        name: Qualified name of the function, such as "Outer.method" or "outer.<locals>.inner".
    """
    found = digests(path)
    return found.functions.get(name, found.whole)


@cache
def digests(path: str) -> Digests:
    """Return the digests of a file.

    Where the file is as it was when the machine code of the package was made they are looked up, which is
    faster than to parse it, and independent of how this version of Python writes a syntax tree.
    """
    data = Path(path).read_bytes().replace(b"\r\n", b"\n")
    content = hashlib.sha256(data).hexdigest()[:_SIZE]
    known = _known().get(content)
    made = digests_of(data) if known is None else Digests(known[0], known[1])
    _asked[content] = made
    return made


def digests_of(source: bytes) -> Digests:
    """Return the digests of a source: hashes of its syntax tree, written as text without docstrings."""
    tree = _without_strings(ast.parse(source))
    functions: dict[str, str] = {}

    def visit(node: ast.AST, prefix: str) -> None:
        for child in ast.iter_child_nodes(node):
            inner = prefix
            if isinstance(child, _Definition):
                inner = f"{prefix}{child.name}."
                if not isinstance(child, ast.ClassDef):
                    name = prefix + child.name
                    functions[name] = functions.get(name, "") + _digest(child)  # more than one: by an if
                    inner += "<locals>."
            visit(child, inner)

    visit(tree, "")
    return Digests(_digest(tree), functions)


def sources_path() -> Path:
    """The package's file of digests."""
    return Path(__file__).with_name("data") / "sources.json"


def write_sources(path: Path) -> None:
    """Write the digests of all files that were asked for in this process, a line each."""
    lines = [f"{json.dumps(content)}: {json.dumps(_asked[content])}" for content in sorted(_asked)]
    write_bytes(path, ("{\n" + ",\n".join(lines) + "\n}\n").encode())


_asked: dict[str, Digests] = {}
"""Digests by the hash of a file's bytes."""


@cache
def _known() -> dict[str, tuple[str, dict[str, str]]]:
    try:
        return dict(json.loads(sources_path().read_bytes()))
    except (OSError, ValueError):
        return {}


def _without_strings(tree: ast.Module) -> ast.Module:
    """Remove docstrings, those of attributes too, from a tree."""
    for node in ast.walk(tree):
        for name in ("body", "orelse", "finalbody"):
            body = getattr(node, name, None)
            if isinstance(body, list):
                setattr(node, name, [s for s in body if not _is_string(s)] or [ast.Pass()][: len(body)])
    return tree


def _is_string(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _digest(node: ast.AST) -> str:
    return hashlib.sha256(ast.unparse(node).encode()).hexdigest()[:_SIZE]


def _files(module: str) -> list[Path]:
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        spec = None
    if spec is None or spec.origin is None:
        raise UnknownNameError("module", module, ())
    path = Path(spec.origin)
    return sorted(path.parent.glob("*.py")) if spec.submodule_search_locations else [path]
