"""Texts of the rosbridge protocol: size limits, fragments, and compression as a picture."""

from __future__ import annotations

import base64
import json
import math
import struct
import time
import zlib
from typing import Any

from pepper_kin.exceptions import PepperKinError, shortened

LARGEST_TEXT = 16_000_000
"""Maximum number of characters of one message, also when assembled from fragments."""

MOST_FRAGMENTS = 10_000
"""Maximum number of fragments of one message."""

OPEN_MESSAGES = 16
"""Maximum number of incomplete messages at a time."""

FRAGMENT_TIMEOUT = 30.0
"""Time after which fragments of an incomplete message are dropped [s]."""


class ProtocolError(PepperKinError):
    """Error for a text that is not a message of the protocol."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)


def parse(text: str | bytes) -> dict[str, Any]:
    """Return the JSON object of a text.

    Raises:
        ProtocolError: for a text that is not a JSON object with an `op`, or is too long.
    """
    if isinstance(text, bytes):
        raise ProtocolError("binary messages are not read; send JSON as text")
    if len(text) > LARGEST_TEXT:
        raise ProtocolError(f"{len(text)} characters, at most {LARGEST_TEXT} are read")
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ProtocolError(f"not JSON: {shortened(str(error))}") from None
    if not isinstance(found, dict) or not isinstance(found.get("op"), str):
        raise ProtocolError('not an object with a string "op"')
    return found


def text_of(message: dict[str, Any]) -> str:
    """Return a message of the protocol as compact JSON."""
    return json.dumps(message, separators=(",", ":"), allow_nan=False)


def fragments_of(text: str, identifier: str, size: int) -> list[str]:
    """Return a text as messages `fragment` with at most `size` characters of it each."""
    count = math.ceil(len(text) / size)
    return [
        text_of(
            {
                "op": "fragment",
                "id": identifier,
                "data": text[k * size : (k + 1) * size],
                "num": k,
                "total": count,
            }
        )
        for k in range(count)
    ]


class Fragments:
    """Messages that arrive in fragments, in any order, within limits of size, number and time."""

    def __init__(self) -> None:
        self._open: dict[str, tuple[float, dict[int, str], int]] = {}

    def add(self, message: dict[str, Any]) -> str | None:
        """Add a message `fragment`; return the whole text once all fragments have arrived.

        Raises:
            ProtocolError: for inconsistent numbers, or above a limit.
        """
        identifier, data = message.get("id"), message.get("data")
        number, total = message.get("num"), message.get("total")
        whole = all(isinstance(n, int) and not isinstance(n, bool) for n in (number, total))
        if not isinstance(identifier, str) or not isinstance(data, str) or not whole:
            raise ProtocolError("a fragment has id and data, strings, and num and total, whole numbers")
        assert isinstance(number, int)
        assert isinstance(total, int)
        if not 0 <= number < total <= MOST_FRAGMENTS:
            raise ProtocolError(f"fragment {number} of {total}, at most {MOST_FRAGMENTS} are put together")
        now = time.monotonic()
        self._open = {k: v for k, v in self._open.items() if now - v[0] < FRAGMENT_TIMEOUT}
        if identifier not in self._open and len(self._open) >= OPEN_MESSAGES:
            raise ProtocolError(f"more than {OPEN_MESSAGES} messages in fragments at a time")
        _, parts, known = self._open.setdefault(identifier, (now, {}, total))
        parts[number] = data
        if known != total or sum(map(len, parts.values())) > LARGEST_TEXT:
            del self._open[identifier]
            raise ProtocolError(
                f"fragments of {shortened(identifier)!r} do not fit together, or are too long"
            )
        if len(parts) < total:
            return None
        del self._open[identifier]
        return "".join(parts[k] for k in range(total))


def png_of(text: str) -> str:
    """Return a text as rosbridge's "png" compression: its bytes as colors of a picture, in base64."""
    raw = text.encode()
    width = max(math.isqrt(len(raw) // 3), 1)
    height = math.ceil(len(raw) / (3 * width))
    raw += b"\n" * (3 * width * height - len(raw))
    rows = b"".join(b"\0" + raw[3 * width * y : 3 * width * (y + 1)] for y in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows, 6)), (b"IEND", b""))
    picture = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
    return base64.b64encode(picture).decode("ascii")
