"""Digests of Python sources, parts of the keys of kept machine code."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from pepper_kin.exceptions import UnknownNameError


@cache
def source_digest(*modules: str) -> str:
    """Return a hash of the sources of modules and packages, read once in a process.

    A package counts as the files in its own folder, without those of its sub-packages.  The ends of lines do
    not count, nor do the places of the files.

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


@cache
def file_digest(path: str) -> str:
    """Return a hash of a text file, read once in a process; the ends of lines do not count."""
    return hashlib.sha256(Path(path).read_bytes().replace(b"\r\n", b"\n")).hexdigest()


def _files(module: str) -> list[Path]:
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        spec = None
    if spec is None or spec.origin is None:
        raise UnknownNameError("module", module, ())
    path = Path(spec.origin)
    return sorted(path.parent.glob("*.py")) if spec.submodule_search_locations else [path]
