"""The machine code that comes with the package: one file for a baseline processor.

The file is made by `python -m pepper_kin.jobs.shipping` (see `docs/kernels.md`) from the sources beside it; a
part whose sources have changed since has another key and is not found.  Parts are much alike: what several
modules call is in each of them.  They are therefore compressed as two streams, one of compiled functions and
one of kernels, in the order in which they are first needed; reading a part decompresses what comes before it.
"""

from __future__ import annotations

import hashlib
import lzma
import threading
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from pepper_kin.kernels.package_file import read_file, read_head, tell, write_file
from pepper_kin.kernels.target import Target, baseline_features, host_target, make_target

FORMAT = 3
BASELINE = "x86-64-v3"
_FILTERS = [
    {
        "id": lzma.FILTER_LZMA2,
        "preset": 9 | lzma.PRESET_EXTREME,
        "dict_size": 1 << 22,  # all of a stream; a reader sets that much aside
        "lc": 4,
        "lp": 0,
        "pb": 0,
    }
]
_WHAT = "the machine code"


def shipped_path() -> Path:
    """The package's file."""
    return Path(__file__).with_name("data") / f"{BASELINE}.code"


def baseline_target() -> Target:
    """The processor that the package's file is for: x86-64-v3 (AVX2 and FMA, since 2013)."""
    return make_target("x86_64-unknown-linux-gnu", BASELINE, baseline_features())


def shipped_part(name: str, key: str) -> tuple[bytes, Target] | None:
    """The part of a key, or None where the file does not have it or cannot be used; the reason is logged.

    Args:
        name: Of the part, for the message.
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
    _, stream, begin, size = entry
    content = _stream(stream).read(begin, size)
    if content is None:
        tell(f"{_WHAT} of {name} that comes with the package is damaged")
        return None
    return content, baseline_target()


def shipped_keys() -> dict[str, str]:
    """Key -> name of what the package's file holds, in the order in which it is needed, for any processor."""
    return {key: str(entry[0]) for key, entry in read_head(shipped_path()).get("entries", {}).items()}


def write_shipped(parts: Mapping[str, tuple[str, bytes]], path: Path | None = None) -> int:
    """Write the package's file.

    Args:
        parts: Key -> name and content, in the order in which they are first needed.
        path: Where to; the package's own place if left out.

    Returns:
        Size of the file [bytes].
    """
    contents: dict[str, bytes] = {}
    entries: dict[str, tuple[str, str, int, int]] = {}
    for key, (name, content) in parts.items():
        stream = "functions" if name.startswith("pepper_kin.") else "kernels"
        before = contents.get(stream, b"")
        entries[key] = name, stream, len(before), len(content)
        contents[stream] = before + content
    streams: dict[str, tuple[int, int, str]] = {}
    body = b""
    for stream, content in contents.items():
        packed = lzma.compress(content, lzma.FORMAT_RAW, filters=_FILTERS)
        streams[stream] = len(body), len(packed), hashlib.sha256(packed).hexdigest()[:32]
        body += packed
    target = baseline_target()
    head = {
        "format": FORMAT,
        "triple": target.triple,
        "features": target.features,
        "streams": streams,
        "entries": entries,
    }
    return write_file(path or shipped_path(), head, body)


def is_usable() -> bool:
    """Whether the package's file can be used on this processor."""
    return _index() is not None


class _Index(NamedTuple):
    """Contents of the file.

    Attributes:
        streams: Name -> begin and size in the body, and checksum.
        entries: Key -> name of the part, name of its stream, begin and size in that.
        body: All streams, compressed.
    """

    streams: dict[str, Any]
    entries: dict[str, Any]
    body: bytes


class _Stream:
    """A compressed stream, decompressed as far as it has been read."""

    def __init__(self, packed: bytes, checksum: str) -> None:
        self._packed = packed
        self._is_whole = hashlib.sha256(packed).hexdigest()[:32] == checksum
        self._decompressor = lzma.LZMADecompressor(lzma.FORMAT_RAW, filters=_FILTERS)
        self._content = bytearray()
        self._lock = threading.Lock()

    def read(self, begin: int, size: int) -> bytes | None:
        """Return bytes of the content, or None where the stream is damaged."""
        if not self._is_whole:
            return None
        with self._lock:
            while (missing := begin + size - len(self._content)) > 0:
                self._content += self._decompressor.decompress(self._packed, missing)
                self._packed = b""  # the decompressor has what it has not used yet
            return bytes(self._content[begin : begin + size])


@cache
def _stream(name: str) -> _Stream:
    """Return a stream of the file."""
    index = _index()
    assert index is not None
    begin, size, checksum = index.streams[name]
    return _Stream(index.body[begin : begin + size], checksum)


@cache
def _index() -> _Index | None:
    """Return the contents of the file, or None where it cannot be used."""
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
    return _Index(head["streams"], head["entries"], body)


__all__ = [
    "BASELINE",
    "baseline_target",
    "is_usable",
    "shipped_keys",
    "shipped_part",
    "shipped_path",
    "write_shipped",
]
