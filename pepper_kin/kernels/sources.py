"""Digests of Python sources for the keys of machine code; comments and docstrings do not count."""

from __future__ import annotations

import atexit
import hashlib
import json
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.kernels.store import read_part, write_part
from pepper_kin.kernels.syntax_digests import DIGEST_SIZE, Digests, digests_of
from pepper_kin.kernels.wheel_code import wheel_part

_KEPT = 2000
"""Maximum number of files whose digests are kept; the package has some 700."""


@cache
def source_digest(*modules: str) -> str:
    """Return a hash of the sources of modules and packages, read once in a process.

    A package counts as the files in its own folder, without its sub-packages.  Comments, docstrings, line
    endings and the locations of the files do not count.

    Args:
        *modules: Full names, such as "pepper_kin.symbolic" or "pepper_kin.ik.fast.expression".

    Raises:
        UnknownNameError: for a module that does not exist.
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
    """Return a hash of the syntax tree of a function of a file, or of the file if it lacks the function.

    Args:
        path: The file.
        name: Qualified name of the function, such as "Outer.method" or "outer.<locals>.inner".
    """
    found = digests(path)
    return found.functions.get(name, found.whole)


@cache
def digests(path: str) -> Digests:
    """Return the digests of a file; digests kept by an earlier process are looked up, which is faster."""
    data = Path(path).read_bytes().replace(b"\r\n", b"\n")
    content = hashlib.sha256(data).hexdigest()[:DIGEST_SIZE]
    known = _known()
    if content not in known:
        if not _added:
            atexit.register(_keep)
        known[content] = digests_of(data)
        _added.append(content)
    return Digests(*known[content])


@cache
def _known() -> dict[str, Digests]:
    """Return digests by the hash of a file's bytes, from the package and from earlier processes."""
    brought, kept = wheel_part("digests", digests_key()), read_part(digests_key())
    known: dict[str, Digests] = json.loads(brought[0]) if brought else {}
    return known | (json.loads(kept) if kept else {})


_added: list[str] = []
"""Hashes of the files whose digests this process computed."""


def known_digests() -> bytes:
    """Return the newest digests as JSON, including the files that this process has read."""
    return json.dumps(dict(list(_known().items())[-_KEPT:])).encode()


def digests_key() -> str:
    """Return the key under which digests are kept: a hash of the source of `digests_of`."""
    source = Path(__file__).with_name("syntax_digests.py").read_bytes()
    return hashlib.sha256(b"digests " + source).hexdigest()


def _keep() -> None:
    write_part(digests_key(), known_digests())


def _files(module: str) -> list[Path]:
    """Return the source files of a module or package; raise UnknownNameError if it does not exist."""
    try:
        spec = find_spec(module)
    except ModuleNotFoundError:
        spec = None
    if spec is None or spec.origin is None:
        raise UnknownNameError("module", module, ())
    path = Path(spec.origin)
    return sorted(path.parent.glob("*.py")) if spec.submodule_search_locations else [path]
