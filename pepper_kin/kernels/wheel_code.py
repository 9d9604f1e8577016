"""Machine code in a wheel: one file, for the processors of the wheel's platform.

`build_backend.py` makes it when a wheel is built for a platform (see `docs/kernels.md`); a clone has none.
A part whose sources have changed has another key and is not found.  Parts lie one after the other,
uncompressed: a process reads only the parts that it needs.  (The wheel is compressed as a whole.)
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from pepper_kin.file_access.atomic_file import write_bytes
from pepper_kin.kernels.progress import note_reason
from pepper_kin.kernels.target import Target, host_target

FORMAT = 5
_WHAT = "the machine code that comes with the package"
_DIGEST_SIZE = hashlib.sha256().digest_size


def wheel_code_path() -> Path:
    """Return the path of the file in the package."""
    return Path(__file__).with_name("data") / "wheel.code"


def wheel_part(name: str, key: str) -> tuple[bytes, Target] | None:
    """Return the part of a key, or None if the file does not have it or cannot be used.

    Args:
        name: Name of the part, for the message about a damaged one.
        key: Hash of all inputs of the part.
    """
    index = _index()
    entry = None if index is None else index.entries.get(key)
    if index is None or entry is None:
        return None
    content = entry.read(index.path)
    if content is None:
        note_reason(f"{_WHAT} is damaged: {name}")
        return None
    return content, index.target


def write_wheel_code(parts: Mapping[str, tuple[str, bytes]], target: Target, path: Path) -> int:
    """Write a file.

    Args:
        parts: Key -> name and content, in the order in which they are first needed.
        target: The processor for which they are made.
        path: Path of the file.

    Returns:
        Size of the file [bytes].
    """
    head = {
        "format": FORMAT,
        "target": [target.triple, target.cpu, target.features, target.vector_bytes, target.has_fma],
        "entries": {key: (name, len(content), _checksum(content)) for key, (name, content) in parts.items()},
    }
    line = json.dumps(head).encode() + b"\n"
    whole = hashlib.sha256(line).digest() + line + b"".join(content for _, content in parts.values())
    write_bytes(path, whole)
    return len(whole)


def has_wheel_part(key: str) -> bool:
    """Return whether the file has a part that this processor can run."""
    index = _index()
    return index is not None and key in index.entries


def wheel_processor() -> str | None:
    """Return LLVM's name of the file's processor; None if no file can be used here."""
    index = _index()
    return None if index is None else index.target.cpu


class _Entry(NamedTuple):
    """A part in a file."""

    offset: int
    size: int
    checksum: str

    def read(self, path: Path) -> bytes | None:
        """Return the part's content, or None if it is damaged."""
        try:
            with path.open("rb") as file:
                file.seek(self.offset)
                content = file.read(self.size)
        except OSError:
            return None
        return content if _checksum(content) == self.checksum else None


class _Index(NamedTuple):
    """Path, processor and parts of a file."""

    path: Path
    target: Target
    entries: dict[str, _Entry]


@cache
def _index() -> _Index | None:
    """Return the index of the file, or None if no file can be used; the reason is recorded."""
    path = wheel_code_path()
    read = _read_head(path)
    if read is None:
        return None
    head, offset = read
    target, host = Target(*head["target"]), host_target()
    if _system(target.triple) != _system(host.triple):
        note_reason(f"{_WHAT} is for {target.triple}, this processor is {host.triple}")
        return None
    present = {name for name in host.features.split(",") if name.startswith("+")}
    missing = [name[1:] for name in target.features.split(",") if name and name not in present]
    if missing:
        note_reason(f"{_WHAT} needs a processor that has {', '.join(missing)}")
        return None
    entries = {}
    for key, (_, size, checksum) in head["entries"].items():
        entries[key] = _Entry(offset, size, checksum)
        offset += size
    return _Index(path, target, entries)


def _read_head(path: Path) -> tuple[dict[str, Any], int] | None:
    """Return the head of a file and the offset of its first part, or None if it cannot be used."""
    try:
        with path.open("rb") as file:
            digest, line = file.read(_DIGEST_SIZE), file.readline()
    except FileNotFoundError:  # a clone, or a wheel for every platform
        return None
    except OSError as error:
        note_reason(f"{_WHAT} cannot be read ({error.strerror})")
        return None
    if hashlib.sha256(line).digest() != digest:
        note_reason(f"{_WHAT} is damaged")
        return None
    head = json.loads(line)
    if head["format"] != FORMAT:
        note_reason(f"{_WHAT} has format {head['format']}, not {FORMAT}")
        return None
    return head, _DIGEST_SIZE + len(line)


def _system(triple: str) -> tuple[str, str]:
    """Return the processor and operating system of a triple, without the system's version."""
    processor = triple.partition("-")[0].replace("arm64", "aarch64")
    return processor, next((name for name in ("linux", "darwin", "windows") if name in triple), triple)


def _checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]
