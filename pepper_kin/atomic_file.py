"""Files that are either written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path
from typing import TypeAlias

from pepper_kin.exceptions import FileFormatError, InvalidValueError

PathName: TypeAlias = str | os.PathLike[str]
"""The name of a file or folder."""


def as_path(path: object, quantity: str = "path") -> Path:
    """Return the name of a file or folder as a path.

    Raises:
        InvalidValueError: naming the quantity, for what is neither a text nor a path.
        FileFormatError: for a name that no file has: with a null character, or half of a surrogate pair.
    """
    if not isinstance(path, str | os.PathLike):
        raise InvalidValueError(quantity, repr(path), "the name of a file or folder")
    name = os.fspath(path)
    if isinstance(name, bytes):
        raise InvalidValueError(quantity, repr(path), "a name as a text or a path, not as bytes")
    try:
        if b"\0" in os.fsencode(name):
            raise FileFormatError(ascii(name), "cannot be the name of a file: it holds a null character")
    except UnicodeEncodeError as error:
        reason = f"cannot be the name of a file: character {error.start} is half of a surrogate pair"
        raise FileFormatError(ascii(name), reason) from error
    return Path(name)


def make_folder(path: str | os.PathLike[str]) -> Path:
    """Make a folder, with those above it; one that is there already is fine.

    Raises:
        FileFormatError: naming the path and why it cannot be made.
    """
    folder = as_path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = f"cannot be made a folder: {error.strerror or error}"
        raise FileFormatError(folder, reason) from error
    return folder


def check_folder(path: str | os.PathLike[str]) -> None:
    """Check that a folder is there or can be made, before long work whose results go into it.

    Raises:
        FileFormatError: naming the path and what is in the way.
    """
    folder = as_path(path).absolute()
    there = next(place for place in (folder, *folder.parents) if os.path.lexists(place))
    if not there.is_dir():
        raise FileFormatError(path, f"cannot be made a folder: {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise FileFormatError(path, f"cannot be written: no permission in {there}")


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text as UTF-8, its line ends as they are; see `write_bytes`."""
    return write_bytes(path, text.encode("utf-8"))


def write_bytes(path: str | os.PathLike[str], content: bytes) -> Path:
    """Write a file so that a reader sees the old content or the new, never a part.

    The content goes to a temporary file in the same folder, which then takes the file's name in one step.
    An existing file keeps its permissions; a new one gets the usual ones.

    Args:
        path: The file; its folder must exist.
        content: What it shall hold.

    Returns:
        The path.

    Raises:
        FileFormatError: naming the path and why it cannot be written; nothing is left behind.
    """
    target = as_path(path)
    temporary = None
    try:
        if target.is_dir():
            raise IsADirectoryError(f"it is a folder: {target}")
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}.", suffix=".part", dir=target.parent)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, _permissions(target))
        os.replace(temporary, target)
    except OSError as error:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        raise FileFormatError(target, f"cannot be written: {error.strerror or error}") from error
    except BaseException:
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        raise
    return target


def _permissions(target: Path) -> int:
    """Return the mode bits of an existing file, or what the process's mask leaves of 0666."""
    try:
        return target.stat().st_mode & 0o777
    except FileNotFoundError:
        mask = os.umask(0)
        os.umask(mask)
        return 0o666 & ~mask
