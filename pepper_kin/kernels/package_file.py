"""Files of code that come with the package: a checksum, a head, which is a line of JSON, and a body."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_DIGEST_SIZE = hashlib.sha256().digest_size
_logger = logging.getLogger(__name__)


def read_file(path: Path, what: str, version: int) -> tuple[dict[str, Any], bytes] | None:
    """Return head and body of a file, or None where it cannot be used, for which `tell` keeps the reason.

    Args:
        path: The file.
        what: Its content, for the message.
        version: The expected format; the head holds that of the file.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        tell(f"{what} that comes with the package cannot be read ({error.strerror})")
        return None
    end = data.find(b"\n", _DIGEST_SIZE) + 1
    line = data[_DIGEST_SIZE:end]
    if hashlib.sha256(line).digest() != data[:_DIGEST_SIZE]:
        tell(f"{what} that comes with the package is damaged")
        return None
    head = json.loads(line)
    if head["format"] != version:
        tell(f"{what} that comes with the package has format {head['format']}, not {version}")
        return None
    return head, data[end:]


def read_head(path: Path) -> dict[str, Any]:
    """Return the head of a file, whether or not it can be used; empty where there is none."""
    try:
        data = path.read_bytes()
        return dict(json.loads(data[_DIGEST_SIZE : data.find(b"\n", _DIGEST_SIZE)]))
    except (OSError, ValueError):
        return {}


def write_file(path: Path, head: Mapping[str, Any], body: bytes) -> int:
    """Write a file.

    Returns:
        Its size [bytes].
    """
    from pepper_kin.atomic_file import write_bytes

    line = json.dumps(head).encode() + b"\n"
    whole = hashlib.sha256(line).digest() + line + body
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, whole)
    return len(whole)


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
