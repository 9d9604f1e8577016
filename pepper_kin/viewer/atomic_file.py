"""Writing a file whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pepper_kin.exceptions import InvalidValueError


@contextmanager
def replaced_when_whole(path: str | Path) -> Iterator[Path]:
    """Give a temporary path beside `path` that takes its place when the block ends without an error.

    Args:
        path: The file to write; its folder must exist.

    Yields:
        An empty file in the same folder (same file system, so that the rename is atomic).

    Raises:
        InvalidValueError: The folder does not exist or cannot be written, or `path` is a folder.
    """
    target = Path(path)
    if target.is_dir():
        raise InvalidValueError("path", f"the folder {target}", "the name of a file")
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise InvalidValueError(
            "path", f"{target} ({error.strerror})", "a file in a folder that exists and can be written"
        ) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes the file private; a result should have the rights that any other new file gets.
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)
