"""Folders of files that are executed: owned by this user or root, and writable by no other user."""

from __future__ import annotations

import atexit
import logging
import os
import shutil
import stat
import tempfile
from functools import cache
from pathlib import Path

_logger = logging.getLogger(__name__)

_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_HAS_OWNERS = hasattr(os, "geteuid")  # not on Windows, where folders of a user are private


def private(folder: Path) -> Path:
    """Return a folder, or another private one, with a logged warning, if others could write to it."""
    fault = fault_of(folder)
    return folder if fault is None else _other(str(folder), fault)


def folder_without_home() -> Path:
    """Return a folder for a user without a home: the session's, or one in the temporary folder."""
    wanted = _candidates()
    return next((folder for folder in wanted if fault_of(folder) is None), None) or private(wanted[-1])


def made(folder: Path) -> Path:
    """Make a folder unless it exists, and return it.

    Raises:
        PermissionError: if another user has made it meanwhile.
        OSError: if it cannot be made.
    """
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    fault = fault_of(folder)
    if fault is not None:
        raise PermissionError(fault)
    return folder


def fault_of(folder: Path) -> str | None:
    """Return why others could change a folder's content, or None if they cannot or it does not exist."""
    if not _HAS_OWNERS:
        return None
    try:
        link = os.lstat(folder)
    except OSError:  # it does not exist yet, or cannot be reached
        return None
    if stat.S_ISLNK(link.st_mode) and not _is_ours(link):
        return f"{folder} is a link of another user"
    try:
        real = Path(os.path.realpath(folder))
        found = os.stat(real)
        above = [(parent, os.stat(parent)) for parent in real.parents]
    except OSError:
        return None
    if not stat.S_ISDIR(found.st_mode):
        return f"{folder} is no folder"
    if not _is_ours(found):
        return f"{folder} belongs to another user"
    if found.st_mode & _OTHERS:
        return f"{folder} can be written by others (chmod go-w)"
    for parent, status in above:
        if status.st_mode & stat.S_IWOTH and not status.st_mode & stat.S_ISVTX:
            return f"{parent}, in which {folder.name} is, can be written by others"
    return None


def read_own(path: Path) -> bytes:
    """Return the content of a file that is owned by this user or root and that no other user may write.

    Raises:
        OSError: if there is no file, or it is a link or another user's, which is logged.
    """
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(handle, "rb") as file:
        found = os.fstat(handle)
        own = not _HAS_OWNERS or (_is_ours(found) and not found.st_mode & _OTHERS)
        if not own or not stat.S_ISREG(found.st_mode):
            _logger.warning("%s is not read: it belongs to another user, or others can write to it", path)
            raise PermissionError(str(path))
        return file.read()


@cache
def _other(wanted: str, fault: str) -> Path:
    """Return another private folder, or a temporary one, and log the fault of the wanted one."""
    for folder in _candidates():
        if str(folder) != wanted and fault_of(folder) is None:
            break
    else:
        folder = Path(tempfile.mkdtemp(prefix="pepper_kin-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    _logger.warning("%s: it is not used for machine code, but %s is", fault, folder)
    return folder


def _candidates() -> list[Path]:
    """Return this user's folders that stay the same from process to process."""
    number = os.geteuid() if _HAS_OWNERS else "cache"
    session = os.environ.get("XDG_RUNTIME_DIR")
    own = [Path(session) / "pepper_kin"] if session and os.path.isdir(session) else []
    return [*own, Path(tempfile.gettempdir()) / f"pepper_kin-{number}"]


def _is_ours(status: os.stat_result) -> bool:
    return status.st_uid in (0, os.geteuid())
