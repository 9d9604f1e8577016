"""The machine code that comes with the package: one file for a baseline processor.

The file is made by `python -m pepper_kin.jobs.shipping` (see `docs/kernels.md`) from the sources beside it; a
part whose sources have changed since has another key and is not found.  Parts that are much alike, those of
one package or kernels of one name, are compressed together, with a checksum; reading a part reads these.
"""

from __future__ import annotations

import hashlib
import lzma
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from pepper_kin.kernels.package_file import read_file, read_head, tell, write_file
from pepper_kin.kernels.target import Target, baseline_features, host_target, make_target

FORMAT = 2
BASELINE = "x86-64-v3"
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 2, "lp": 0, "pb": 0}]
_WHAT = "the machine code"


def shipped_path() -> Path:
    """The package's file."""
    return Path(__file__).with_name("data") / f"{BASELINE}.code"


def baseline_target() -> Target:
    """The processor that the package's file is for: x86-64-v3 (AVX2 and FMA, since 2013)."""
    return make_target("x86_64-unknown-linux-gnu", BASELINE, baseline_features())


def shipped_part(name: str, key: str) -> tuple[bytes, Target] | None:
    """The part of a key, or None where the file does not have it or cannot be used; a line says why.

    Args:
        name: What it is, for the message.
        key: Hash of all that it was made from.
    """
    loaded = _index()
    if loaded is None:
        return None
    entries = loaded.entries
    entry = entries.get(key)
    if entry is None:
        if name.startswith("pepper_kin.") and name in {known for known, *_ in entries.values()}:
            tell(f"{_WHAT} that comes with the package was made from other sources of {name}")
        return None
    _, group, begin, size = entry
    content = _group(group)
    if content is None:
        tell(f"{_WHAT} of {name} that comes with the package is damaged")
        return None
    return content[begin : begin + size], baseline_target()


def shipped_keys() -> dict[str, str]:
    """Key -> name of what the package's file holds, in the order in which it is needed, for any processor."""
    return {key: str(entry[0]) for key, entry in read_head(shipped_path()).get("entries", {}).items()}


def write_shipped(parts: Mapping[str, tuple[str, bytes]], path: Path | None = None) -> int:
    """Write the package's file.

    Args:
        parts: Key -> name and content.
        path: Where to; the package's own place if left out.

    Returns:
        Size of the file [bytes].
    """
    contents: dict[str, bytes] = {}
    entries: dict[str, tuple[str, str, int, int]] = {}
    for key, (name, content) in parts.items():
        group = _group_name(name)
        before = contents.get(group, b"")
        entries[key] = name, group, len(before), len(content)
        contents[group] = before + content
    groups: dict[str, tuple[int, int, str]] = {}
    body = b""
    for group, content in contents.items():
        packed = lzma.compress(content, lzma.FORMAT_RAW, filters=_FILTERS)
        groups[group] = len(body), len(packed), hashlib.sha256(packed).hexdigest()[:32]
        body += packed
    target = baseline_target()
    head = {
        "format": FORMAT,
        "triple": target.triple,
        "features": target.features,
        "groups": groups,
        "entries": entries,
    }
    return write_file(path or shipped_path(), head, body)


def is_usable() -> bool:
    """Whether the package's file can be used on this processor."""
    return _index() is not None


def _group_name(name: str) -> str:
    """Return what parts of a name are compressed with: the package of a module, or kernels of the name."""
    return name.rpartition(".")[0] if name.startswith("pepper_kin.") else name


class _Index(NamedTuple):
    """What the file holds.

    Attributes:
        groups: Name -> begin and size in the body, and checksum.
        entries: Key -> name of the part, name of its group, begin and size in that.
        body: All groups, compressed.
    """

    groups: dict[str, Any]
    entries: dict[str, Any]
    body: bytes


@cache
def _group(name: str) -> bytes | None:
    """Return the content of a group, or None where it is damaged."""
    index = _index()
    assert index is not None
    begin, size, checksum = index.groups[name]
    packed = index.body[begin : begin + size]
    if hashlib.sha256(packed).hexdigest()[:32] != checksum:
        return None
    return lzma.decompress(packed, lzma.FORMAT_RAW, filters=_FILTERS)


@cache
def _index() -> _Index | None:
    """Return what the file holds, or None where it cannot be used."""
    read = read_file(shipped_path(), _WHAT, FORMAT)
    if read is None:
        return None
    head, body = read
    host = host_target()
    present = {name for name in host.features.split(",") if name.startswith("+")}
    missing = [name[1:] for name in head["features"].split(",") if name not in present]
    if head["triple"] != host.triple or missing:
        what = f"has no {', '.join(missing)}" if missing else f"is {host.triple}"
        tell(f"no machine code comes with the package for this processor, which {what}")
        return None
    return _Index(head["groups"], head["entries"], body)


__all__ = [
    "BASELINE",
    "baseline_target",
    "is_usable",
    "shipped_keys",
    "shipped_part",
    "shipped_path",
    "write_shipped",
]
