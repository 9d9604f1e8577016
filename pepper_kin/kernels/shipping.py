"""The machine code that comes with the package: one file for a baseline processor.

The file is made by `python -m pepper_kin.jobs.shipping` (see `docs/kernels.md`) from the sources beside it; a
part whose sources have changed since has another key and is not found.  Each part is compressed and has a
checksum of its own, so reading one part does not read the others.
"""

from __future__ import annotations

import hashlib
import lzma
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pepper_kin.kernels.package_file import read_file, read_head, tell, write_file
from pepper_kin.kernels.target import Target, baseline_features, host_target, make_target

FORMAT = 1
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
    entries, data = loaded
    entry = entries.get(key)
    if entry is None:
        if name.startswith("pepper_kin.") and name in {known for known, *_ in entries.values()}:
            tell(f"{_WHAT} that comes with the package was made from other sources of {name}")
        return None
    _, begin, size, checksum = entry
    packed = data[begin : begin + size]
    if hashlib.sha256(packed).hexdigest()[:32] != checksum:
        tell(f"{_WHAT} of {name} that comes with the package is damaged")
        return None
    return lzma.decompress(packed, lzma.FORMAT_RAW, filters=_FILTERS), baseline_target()


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
    entries: dict[str, tuple[str, int, int, str]] = {}
    body = b""
    for key, (name, content) in parts.items():
        packed = lzma.compress(content, lzma.FORMAT_RAW, filters=_FILTERS)
        entries[key] = (name, len(body), len(packed), hashlib.sha256(packed).hexdigest()[:32])
        body += packed
    target = baseline_target()
    head = {"format": FORMAT, "triple": target.triple, "features": target.features, "entries": entries}
    return write_file(path or shipped_path(), head, body)


def is_usable() -> bool:
    """Whether the package's file can be used on this processor."""
    return _index() is not None


@cache
def _index() -> tuple[dict[str, Any], bytes] | None:
    """Entries and body of the file, or None where it cannot be used."""
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
    return head["entries"], body


__all__ = [
    "BASELINE",
    "baseline_target",
    "is_usable",
    "shipped_keys",
    "shipped_part",
    "shipped_path",
    "write_shipped",
]
