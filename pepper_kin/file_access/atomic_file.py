"""Atomic writing of files: complete or not at all."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, TypeAlias

from pepper_kin.exceptions import FileFormatError, InvalidValueError

PathName: TypeAlias = str | os.PathLike[str]
"""Name of a file or folder."""


def as_path(path: object, quantity: str = "path") -> Path:
    """Return the name of a file or folder as a path.

    Raises:
        InvalidValueError: naming the quantity, for anything but a text or a path.
        FileFormatError: for an impossible name: with a null character, half of a surrogate pair, or a
            character that the locale's encoding lacks.
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
        what = "is half of a surrogate pair"
        if not "\ud800" <= name[error.start] <= "\udfff":
            what = f"is not in {error.encoding}, the encoding of this locale's names; choose one of UTF-8"
        reason = f"cannot be the name of a file: character {error.start} {what}"
        raise FileFormatError(ascii(name), reason) from error
    return Path(name)


def make_folder(path: str | os.PathLike[str]) -> Path:
    """Create a folder and its parents, if missing.

    Raises:
        FileFormatError: naming the path and the reason why it cannot be created.
    """
    folder = as_path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = f"cannot be made a folder: {error.strerror or error}"
        raise FileFormatError(folder, reason) from error
    return folder


def check_folder(path: str | os.PathLike[str]) -> None:
    """Check that a folder exists or can be created, before long work whose results are written to it.

    Raises:
        FileFormatError: naming the path and the obstacle.
    """
    folder = as_path(path).absolute()
    there = next(place for place in (folder, *folder.parents) if os.path.lexists(place))
    if not there.is_dir():
        raise FileFormatError(path, f"cannot be made a folder: {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise FileFormatError(path, f"cannot be written: no permission in {there}")


def check_file(path: str | os.PathLike[str]) -> Path:
    """Create the folder of a file, and check that the file can be written, before long work.

    Raises:
        FileFormatError: naming the path and the obstacle.
    """
    target = as_path(path)
    folder = make_folder(target.parent)
    try:
        there, is_folder = target.exists(), target.is_dir()
    except OSError as error:
        raise FileFormatError(target, f"cannot be written: {error.strerror or error}") from error
    if is_folder:
        raise FileFormatError(target, "cannot be written: it is a folder")
    place = target if there and not target.is_file() else folder
    if not os.access(place, os.W_OK):
        raise FileFormatError(target, f"cannot be written: no permission in {place}")
    return target


def write_text(path: str | os.PathLike[str], text: str) -> Path:
    """Write a text as UTF-8, its line ends as they are; see `write_bytes`."""
    try:
        content = text.encode("utf-8")
    except UnicodeEncodeError as error:
        reason = f"cannot be written: character {error.start} of its text is half of a surrogate pair"
        raise FileFormatError(as_path(path), reason) from error
    return write_bytes(path, content)


def write_bytes(path: str | os.PathLike[str], content: bytes) -> Path:
    """Write a file atomically; see `whole_file`.

    Args:
        path: The file; its folder must exist.
        content: Content of the file.

    Returns:
        The path.

    Raises:
        FileFormatError: naming the path and why it cannot be written; nothing is left behind.
    """
    with whole_file(path) as file:
        file.write(content)
    return as_path(path)


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a file for writing such that readers see the old or the new content, never a part.

    The content goes to a temporary file in the same folder, which takes the file's name in one step at the
    end of the context, and is removed after an exception.  An existing file keeps its permissions; a new one
    gets the usual ones. For a link, its target is replaced, not the link. A device or a pipe gets the content
    at the end of the context.

    Args:
        path: The file; its folder must exist.

    Raises:
        FileFormatError: naming the path and why it cannot be written; nothing is left behind.
    """
    target = as_path(path)
    try:
        if target.is_dir():
            raise IsADirectoryError("it is a folder")
        if target.exists() and not target.is_file():
            with _written_through(target) as file:
                yield file
        else:
            with _replaced(Path(os.path.realpath(target))) as file:
                yield file
    except OSError as error:
        raise FileFormatError(target, f"cannot be written: {error.strerror or error}") from error


@contextlib.contextmanager
def _replaced(target: Path) -> Iterator[BinaryIO]:
    """Open a temporary file beside a file, which it replaces at the end."""
    handle, temporary = _temporary(target)
    try:
        with os.fdopen(handle, "w+b") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


@contextlib.contextmanager
def _written_through(target: Path) -> Iterator[BinaryIO]:
    """Open a temporary file whose content is copied to a device or a pipe, which cannot be replaced."""
    with tempfile.TemporaryFile() as file:
        yield file
        file.seek(0)
        with open(target, "wb") as device:
            shutil.copyfileobj(file, device)


def _temporary(target: Path) -> tuple[int, Path]:
    """Create a file beside another, with its permissions, or with a new file's if it does not exist."""
    try:
        mode: int | None = target.stat().st_mode & 0o777
    except FileNotFoundError:
        mode = None
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    # Part of the name only: a long name with a prefix and suffix could exceed the limit.
    temporary = target.parent / f".{target.name[:32]}.{os.urandom(6).hex()}.part"
    handle = os.open(temporary, flags, 0o666 if mode is None else mode)
    if mode is not None:
        os.chmod(temporary, mode)
    return handle, temporary
