"""The machine code that comes with the package: one file for a baseline processor.

The file is made by `pepper-kin ship` (see `docs/kernels.md`) from the sources beside it; a part whose
sources have changed since has another key and is not found.  Its first 32 bytes are the checksum of the
index, a line of JSON; each part is compressed and has a checksum of its own, so reading one part does not
read the others.
"""

from __future__ import annotations

import hashlib
import json
import logging
import lzma
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pepper_kin.kernels.target import Target, baseline_features, host_target, make_target

FORMAT = 1
BASELINE = "x86-64-v3"
_FILTERS = [{"id": lzma.FILTER_X86}, {"id": lzma.FILTER_LZMA2, "preset": 9}]
_DIGEST_SIZE = hashlib.sha256().digest_size
_logger = logging.getLogger(__name__)


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
            _tell(f"the machine code that comes with the package was made from other sources of {name}")
        return None
    _, begin, size, checksum = entry
    packed = data[begin : begin + size]
    if hashlib.sha256(packed).hexdigest()[:32] != checksum:
        _tell(f"the machine code of {name} that comes with the package is damaged")
        return None
    return lzma.decompress(packed, lzma.FORMAT_RAW, filters=_FILTERS), baseline_target()


def shipped_keys() -> dict[str, str]:
    """Key -> name of what the package's file holds, in the order in which it is needed, for any processor."""
    try:
        data = shipped_path().read_bytes()
        head = json.loads(data[_DIGEST_SIZE : data.find(b"\n", _DIGEST_SIZE)])
        return {key: str(entry[0]) for key, entry in head["entries"].items()}
    except (OSError, ValueError, KeyError):
        return {}


def write_shipped(parts: Mapping[str, tuple[str, bytes]], path: Path | None = None) -> int:
    """Write the package's file.

    Args:
        parts: Key -> name and content.
        path: Where to; the package's own place if left out.

    Returns:
        Size of the file [bytes].
    """
    from pepper_kin.atomic_file import write_bytes

    entries: dict[str, tuple[str, int, int, str]] = {}
    body = b""
    for key, (name, content) in parts.items():
        packed = lzma.compress(content, lzma.FORMAT_RAW, filters=_FILTERS)
        entries[key] = (name, len(body), len(packed), hashlib.sha256(packed).hexdigest()[:32])
        body += packed
    target = baseline_target()
    head = {"format": FORMAT, "triple": target.triple, "features": target.features, "entries": entries}
    index = json.dumps(head).encode() + b"\n"
    whole = hashlib.sha256(index).digest() + index + body
    place = path or shipped_path()
    place.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(place, whole)
    return len(whole)


def is_usable() -> bool:
    """Whether the package's file can be used on this processor."""
    return _index() is not None


@cache
def _index() -> tuple[dict[str, Any], bytes] | None:
    """Entries and body of the file, or None where it cannot be used."""
    try:
        data = shipped_path().read_bytes()
    except OSError as error:
        _tell(f"the machine code that comes with the package cannot be read ({error.strerror})")
        return None
    end = data.find(b"\n", _DIGEST_SIZE) + 1
    index = data[_DIGEST_SIZE:end]
    if hashlib.sha256(index).digest() != data[:_DIGEST_SIZE]:
        _tell("the machine code that comes with the package is damaged")
        return None
    head = json.loads(index)
    if head["format"] != FORMAT:
        _tell(f"the machine code that comes with the package has format {head['format']}, not {FORMAT}")
        return None
    host = host_target()
    present = {name for name in host.features.split(",") if name.startswith("+")}
    missing = [name[1:] for name in head["features"].split(",") if name not in present]
    if head["triple"] != host.triple or missing:
        what = f"has no {', '.join(missing)}" if missing else f"is {host.triple}"
        _tell(f"no machine code comes with the package for this processor, which {what}")
        return None
    return head["entries"], data[end:]


@cache
def _tell(reason: str) -> None:
    """Say once why machine code is made here."""
    _logger.warning("%s; it is made here, once, and kept", reason)


__all__ = [
    "BASELINE",
    "baseline_target",
    "is_usable",
    "shipped_keys",
    "shipped_part",
    "shipped_path",
    "write_shipped",
]
