"""Digests of syntax trees that every version of Python computes alike.

This file needs nothing but Python's own library: `tests/pythons` runs it under versions of Python for which
nothing is installed.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Mapping
from typing import NamedTuple

DIGEST_SIZE = 32
"""Length of a digest [hexadecimal digits]."""

_Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


class Digests(NamedTuple):
    """Digests of one file.

    Attributes:
        whole: Of its syntax tree.
        functions: Of each of its functions, by qualified name.
    """

    whole: str
    functions: Mapping[str, str]


def digests_of(source: bytes) -> Digests:
    """Return the digests of a source: hashes of its syntax tree, without docstrings."""
    tree = ast.parse(source)
    functions: dict[str, str] = {}

    def visit(node: ast.AST, prefix: str) -> None:
        for child in ast.iter_child_nodes(node):
            inner = prefix
            if isinstance(child, _Definition):
                inner = f"{prefix}{child.name}."
                if not isinstance(child, ast.ClassDef):
                    name = prefix + child.name
                    functions[name] = functions.get(name, "") + digest(child)  # more than one: by an if
                    inner += "<locals>."
            visit(child, inner)

    visit(tree, "")
    return Digests(digest(tree), functions)


def digest(node: ast.AST) -> str:
    """Return the hash of a tree, written as words that every version of Python writes alike.

    `ast.unparse` and `ast.dump` differ between versions.  Fields that are empty are left out, since versions
    add some; so are strings that are statements, which are docstrings, those of attributes among them.
    """
    words: list[str] = []
    _write(node, words)
    return hashlib.sha256(" ".join(words).encode()).hexdigest()[:DIGEST_SIZE]


def _write(node: object, words: list[str]) -> None:
    if isinstance(node, ast.AST):
        words.append(type(node).__name__)
        for name in node._fields:
            value = getattr(node, name, None)
            if value is not None and value != [] and name not in _LEFT_OUT:
                words.append(name)
                _write(value, words)
        words.append(")")
    elif isinstance(node, list):
        for value in node:
            if not _is_string(value):
                _write(value, words)
        words.append("]")
    else:
        words.append(repr(node))


_LEFT_OUT = frozenset(["ctx", "kind"])
"""Fields that follow from others, or do not change what a program does."""


def _is_string(node: object) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
