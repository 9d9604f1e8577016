"""The machine code that comes with the package: one file for each baseline processor.

The files are made by `python -m pepper_kin.jobs.shipping` (see `docs/kernels.md`) from the sources beside
them; a part whose sources have changed since has another key and is not found.  Parts lie in a file one
after the other, uncompressed: a start reads those that it needs, and a change of one function changes the
bytes of the parts that hold it only.  (The wheel is compressed as a whole.)
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple

from pepper_kin.kernels.package_file import file_begins, made_by, read_at, read_head_of, tell, write_file
from pepper_kin.kernels.target import BASELINES, Target, host_target

FORMAT = 4
_WHAT = "the machine code"


def shipped_path(name: str) -> Path:
    """The package's file for a baseline processor, one of `BASELINES`."""
    return Path(__file__).with_name("data") / f"{name}.code"


def shipped_part(name: str, key: str) -> tuple[bytes, Target] | None:
    """The part of a key, or None where the file does not have it or cannot be used; the reason is logged.

    Args:
        name: Of the part, for the message.
        key: Hash of all that it was made from.
    """
    index = _index()
    if index is None:
        return None
    entry = index.entries.get(key)
    if entry is None:
        if name.startswith("pepper_kin.") and name in index.names:
            tell(f"{_WHAT} that comes with the package was made from other sources of {name}")
        return None
    content = entry.read(index.path)
    if content is None:
        tell(f"{_WHAT} of {name} that comes with the package is damaged")
        return None
    return content, index.target


def shipped_before(key: str, baseline: str) -> bytes | None:
    """The part of a key for a baseline processor where it was made as it would be now, else None."""
    path = shipped_path(baseline)
    head, begin = read_head_of(path)
    if head.get("format") != FORMAT or head.get("made_by") != made_by():
        return None
    entry = _entries(head, begin).get(key)
    return None if entry is None else entry.read(path)


def shipped_keys(baseline: str = next(iter(BASELINES))) -> dict[str, str]:
    """Key -> name of what a file holds, in the order in which it is needed, for any processor."""
    head, begin = read_head_of(shipped_path(baseline))
    return {} if head.get("format") != FORMAT else {k: e.name for k, e in _entries(head, begin).items()}


def write_shipped(parts: Mapping[str, tuple[str, bytes]], baseline: str, path: Path | None = None) -> int:
    """Write a file.

    Args:
        parts: Key -> name and content, in the order in which they are first needed.
        baseline: The processor that they are for, one of `BASELINES`.
        path: Where to; the package's own place if left out.

    Returns:
        Size of the file [bytes].
    """
    target = BASELINES[baseline]()
    head = {
        "format": FORMAT,
        "made_by": made_by(),
        "triple": target.triple,
        "features": target.features,
        "entries": {key: (name, len(content), _checksum(content)) for key, (name, content) in parts.items()},
    }
    return write_file(
        path or shipped_path(baseline), head, b"".join(content for _, content in parts.values())
    )


def has_shipped(key: str) -> bool:
    """Whether the package's file for this processor has a part."""
    index = _index()
    return index is not None and key in index.entries


def is_usable() -> bool:
    """Whether one of the package's files can be used on this processor."""
    return _index() is not None


def usable_baseline() -> str | None:
    """Return which one it is, by its name in `BASELINES`; None where there is none."""
    index = _index()
    return None if index is None else index.path.stem


class _Entry(NamedTuple):
    """A part in a file."""

    name: str
    begin: int
    size: int
    checksum: str

    def read(self, path: Path) -> bytes | None:
        """Return its content, or None where it is damaged."""
        content = read_at(path, self.begin, self.size)
        return content if _checksum(content) == self.checksum else None


class _Index(NamedTuple):
    """What a file holds."""

    path: Path
    target: Target
    entries: dict[str, _Entry]
    names: frozenset[str]


@cache
def _index() -> _Index | None:
    """Return what the file for this processor holds, or None where there is none that can be used."""
    host = host_target()
    present = {name for name in host.features.split(",") if name.startswith("+")}
    lacks = f"is {host.triple}"
    for baseline, target_of in BASELINES.items():
        target = target_of()
        if target.triple == host.triple:
            missing = [name[1:] for name in target.features.split(",") if name not in present]
            if not missing:
                return _index_of(shipped_path(baseline), target)
            lacks = f"has no {', '.join(missing)}"
    tell(f"no machine code comes with the package for this processor, which {lacks}")
    return None


def _index_of(path: Path, target: Target) -> _Index | None:
    read = file_begins(path, _WHAT, FORMAT)
    if read is None:
        return None
    entries = _entries(*read)
    return _Index(path, target, entries, frozenset(entry.name for entry in entries.values()))


def _entries(head: Mapping[str, dict[str, tuple[str, int, str]]], begin: int) -> dict[str, _Entry]:
    entries = {}
    for key, (name, size, checksum) in head["entries"].items():
        entries[key] = _Entry(name, begin, size, checksum)
        begin += size
    return entries


def _checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]
