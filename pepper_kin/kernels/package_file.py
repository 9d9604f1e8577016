"""Files of code that come with the package: a checksum, a head, which is a line of JSON, and a body."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pepper_kin.file_access.atomic_file import write_bytes

_DIGEST_SIZE = hashlib.sha256().digest_size
_logger = logging.getLogger(__name__)


def read_file(path: Path, what: str, version: int) -> tuple[dict[str, Any], bytes] | None:
    """Return head and body of a file, or None where it cannot be used, for which `tell` keeps the reason.

    Args:
        path: The file.
        what: Its content, for the message.
        version: The expected format; the head holds that of the file.
    """
    begins = file_begins(path, what, version)
    return None if begins is None else (begins[0], read_at(path, begins[1]))


def file_begins(path: Path, what: str, version: int) -> tuple[dict[str, Any], int] | None:
    """Return the head of a file, and where its body begins; None as `read_file` does."""
    try:
        with path.open("rb") as file:
            digest, line = file.read(_DIGEST_SIZE), file.readline()
    except OSError as error:
        tell(f"{what} that comes with the package cannot be read ({error.strerror})")
        return None
    if hashlib.sha256(line).digest() != digest:
        tell(f"{what} that comes with the package is damaged")
        return None
    head = json.loads(line)
    if head["format"] != version:
        tell(f"{what} that comes with the package has format {head['format']}, not {version}")
        return None
    return head, _DIGEST_SIZE + len(line)


def read_at(path: Path, begin: int, size: int = -1) -> bytes:
    """Return bytes of a file from a place on, all if no size is given; fewer where it ends or is gone."""
    try:
        with path.open("rb") as file:
            file.seek(begin)
            return file.read(size)
    except OSError:
        return b""


def read_head_of(path: Path) -> tuple[dict[str, Any], int]:
    """Return the head of a file, whether or not it can be used, and where the body begins; empty without."""
    try:
        with path.open("rb") as file:
            file.seek(_DIGEST_SIZE)
            line = file.readline()
        return dict(json.loads(line)), _DIGEST_SIZE + len(line)
    except (OSError, ValueError):
        return {}, 0


def read_head(path: Path) -> dict[str, Any]:
    """Return the head of a file, whether or not it can be used; empty where there is none."""
    return read_head_of(path)[0]


def write_file(path: Path, head: Mapping[str, Any], body: bytes) -> int:
    """Write a file.

    Returns:
        Its size [bytes].
    """
    line = json.dumps(head).encode() + b"\n"
    whole = hashlib.sha256(line).digest() + line + body
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, whole)
    return len(whole)


@cache
def made_by() -> str:
    """Versions of what makes code here; looked up without importing Numba."""
    from importlib.metadata import version

    return f"llvmlite {version('llvmlite')} numba {version('numba')}"


def tell(reason: str) -> None:
    """Keep why machine code may have to be made on this machine; it is logged once something is made."""
    _reasons.setdefault(reason, False)


def log_reasons() -> None:
    """Log, once for each reason, why machine code is made on this machine."""
    for reason, logged in tuple(_reasons.items()):
        if not logged:
            _reasons[reason] = True
            _logger.warning("%s; it is made here, once, and kept", reason)


_reasons: dict[str, bool] = {}
"""Reasons, and whether they have been logged."""
