"""Reading of bytes, texts, JSON and numbers from files, with errors that name the file."""

from __future__ import annotations

import json
import math
import re
from collections import Counter
from collections.abc import Iterable
from typing import Any, NoReturn

from pepper_kin.exceptions import FileFormatError, shortened
from pepper_kin.file_access.atomic_file import PathName, as_path

_PLAIN_WHOLE = re.compile(r"[+-]?\d{1,18}", re.ASCII)
_ESCAPED_HALF = re.compile(r"\\u[dD][89a-fA-F]")


def read_bytes(path: PathName) -> bytes:
    """Return the content of a file.

    Raises:
        FileFormatError: if the file cannot be read.
        InvalidValueError: for a path that is neither text nor a path.
    """
    try:
        return as_path(path).read_bytes()
    except OSError as error:
        raise FileFormatError(path, f"cannot be read: {error.strerror or error}") from error


def read_text(path: PathName) -> str:
    """Return the text of a file, with line feeds as line ends and without a byte order mark.

    Raises:
        FileFormatError: if the file cannot be read, or is not UTF-8.
        InvalidValueError: for a path that is neither text nor a path.
    """
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(path, f"is not text in UTF-8: {error.reason} at byte {error.start}") from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_json(path: PathName) -> tuple[Any, str]:
    """Read a JSON file strictly: no duplicate fields, no NaN, no number beyond the range of floats.

    Returns:
        Contents and text of the file, for `line_of`.

    Raises:
        FileFormatError: naming the file, the line if known, and the fault.
        InvalidValueError: for a path that is neither text nor a path.
    """
    text = read_text(path)

    def refuse(word: str) -> NoReturn:
        reason = f"holds {shortened(word)}, expected finite numbers"
        raise FileFormatError(path, reason, line_of(text, word))

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            name = repeated(name for name, _ in pairs)[0]
            quoted = json.dumps(name, ensure_ascii=False)
            raise FileFormatError(
                path, f"field {shortened(repr(name))} occurs twice", line_of(text, quoted, 2)
            )
        return found

    def real(digits: str) -> float:
        value = float(digits)
        return value if math.isfinite(value) else refuse(digits)

    def whole(digits: str) -> int:
        return int(digits) if len(digits) < 400 and math.isfinite(float(digits)) else refuse(digits)

    try:
        content = json.loads(
            text, parse_constant=refuse, parse_float=real, parse_int=whole, object_pairs_hook=unique
        )
        if _ESCAPED_HALF.search(text):
            json.dumps(content, ensure_ascii=False).encode()
    except json.JSONDecodeError as error:
        raise FileFormatError(path, f"is not complete JSON: {error.msg}", error.lineno) from error
    except UnicodeEncodeError as error:
        raise FileFormatError(path, "holds half of a surrogate pair, which is not a character") from error
    except RecursionError as error:
        raise FileFormatError(path, "is nested too deep") from error
    return content, text


def line_of(text: str, word: str, occurrence: int = 1) -> int | None:
    """Return the line of an occurrence of a word in a text, counted from 1; None without one."""
    place = -1
    for _ in range(occurrence):
        place = text.find(word, place + 1)
        if place < 0:
            return None
    return text.count("\n", 0, place) + 1


def repeated(names: Iterable[str]) -> list[str]:
    """Return the names that occur more than once, in the order of their first occurrence."""
    return [name for name, count in Counter(names).items() if count > 1]


def plain_whole(text: str) -> int | None:
    """Return the integer of up to 18 ASCII digits in a text; None for anything else."""
    return int(text) if _PLAIN_WHOLE.fullmatch(text) else None


def is_real_text(value: object) -> bool:
    """Whether a value is a text with at least one character and no half of a surrogate pair."""
    if not isinstance(value, str) or not value:
        return False
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True
