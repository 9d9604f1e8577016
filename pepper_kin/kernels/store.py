"""Store of machine code: the file of a wheel, and a cache folder.

A part is found by a key: the hash of all inputs of its code.  Changed inputs change the key, so stale code is
never read.  Three sources are tried in turn:

1. The file of a wheel for its platform, `data/wheel.code` (`wheel_code`); a clone has none.
2. The cache folder, for code made for this processor.
3. The part's maker; the result is then kept in the cache folder.

After `pepper-kin warm-up --native` the wheel's file is not used.

A file of the cache is written under a temporary name and renamed, which is atomic: readers and other
writers see a whole file or none.  A checksum detects damage; a damaged file counts as missing and is written
again.  If a folder cannot be written, code stays in memory, without an error.  If several processes need a
part that does not exist yet, one makes it and the others wait.

The files hold machine code that is run without further checks.  So the folder and its files must belong to
this user or to root, and no other user may write to them (`private_folder`).
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from pepper_kin.kernels.private_folder import folder_without_home, made, private, read_own
from pepper_kin.kernels.progress import making
from pepper_kin.kernels.target import Target, host_target, made_by
from pepper_kin.kernels.wheel_code import has_wheel_part, wheel_part
from pepper_kin.kernels.working_time import not_counted

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

CACHE_VARIABLE = "PEPPER_KIN_CACHE"
"""Environment variable that names the folder; the platform's cache folder if it is not set."""

NATIVE = "native"
_SUFFIX = ".code"
_LOCK = ".lock"
_DIGEST_SIZE = hashlib.sha256().digest_size
_logger = logging.getLogger(__name__)


class StoredPart(NamedTuple):
    """Machine code of the store.

    Attributes:
        content: Bytes that the maker returned.
        target: The processor for which it is made.
        made: Whether it was made by this call.
    """

    content: bytes
    target: Target
    made: bool


def obtain(
    name: str, key: str, make: Callable[[Target], bytes], *, target: Target | None = None, keep: bool = True
) -> StoredPart:
    """Return a part from the wheel's file, from the cache or from its maker.

    Args:
        name: Name of the part, for messages ("planners.rrt_connect").
        key: Hash of all inputs of the part, except the processor.
        make: Function that makes the part for a processor.
        target: The processor; None for this one, or the processor of the wheel's file.
        keep: Whether to read and write files at all.
    """
    wanted = target or host_target()
    if not keep:
        return StoredPart(make(wanted), wanted, True)
    if target is None and _collection is not None:
        _collection.add(name, key, make)
    found = find(name, key) if target is None else None
    if found is None:
        with not_counted():
            found = _kept_or_made(name, _for_target(key, wanted), wanted, make)
    return found


def find(name: str, key: str) -> StoredPart | None:
    """Return a part from the wheel's file or from the cache folder, or None."""
    if not prefers_native():
        brought = wheel_part(name, key)
        if brought is not None:
            return StoredPart(*brought, False)
    content = read_part(_for_target(key, host_target()))
    return None if content is None else StoredPart(content, host_target(), False)


def make_ahead(key: str, make: Callable[[Target], bytes], target: Target | None = None) -> None:
    """Make a part for a processor and keep it, unless it is kept or another process is making it.

    Args:
        key: Hash of all inputs of the part, except the processor.
        make: Function that makes the part for a processor.
        target: The processor; this one if omitted.
    """
    own_key = _for_target(key, target or host_target())
    with only_maker(own_key, wait=False) as mine:
        if mine and not is_kept(key, target):
            write_part(own_key, make(target or host_target()))


def can_write() -> bool:
    """Whether the cache folder can be written."""
    try:
        with tempfile.TemporaryFile(dir=made(cache_folder())):
            return True
    except OSError:
        return False


def _kept_or_made(name: str, own_key: str, wanted: Target, make: Callable[[Target], bytes]) -> StoredPart:
    """Return a part from the cache folder, or make and keep it."""
    content = read_part(own_key)
    if content is not None:
        return StoredPart(content, wanted, False)
    with only_maker(own_key):
        content = read_part(own_key)  # another process may have made it meanwhile
        if content is not None:
            return StoredPart(content, wanted, False)
        with making(name):
            content = make(wanted)
        write_part(own_key, content)
    return StoredPart(content, wanted, True)


class Collection:
    """Parts that are requested within `collected`, made for a given processor.

    Attributes:
        parts: Key -> name and content, in the order of the requests.
    """

    def __init__(self, target: Target) -> None:
        self.parts: dict[str, tuple[str, bytes]] = {}
        self._target = target

    def add(self, name: str, key: str, make: Callable[[Target], bytes]) -> None:
        """Add a part, from the cache folder or its maker, unless it is collected already."""
        if key not in self.parts:
            part = _kept_or_made(name, _for_target(key, self._target), self._target, make)
            self.parts[key] = name, part.content


@contextlib.contextmanager
def collected(target: Target) -> Iterator[Collection]:
    """Collect the parts that are requested within a `with` block, for a processor."""
    global _collection
    _collection = Collection(target)
    try:
        yield _collection
    finally:
        _collection = None


_collection: Collection | None = None


def is_collecting() -> bool:
    """Return whether a `with` block of `collected` is active."""
    return _collection is not None


@cache
def prefers_native() -> bool:
    """Return whether code for this processor replaces the wheel's (`pepper-kin warm-up --native`)."""
    return (cache_folder() / NATIVE).exists()


def prefer_native() -> None:
    """Make later processes use code for this processor in place of the wheel's."""
    (made(cache_folder()) / NATIVE).touch()
    prefers_native.cache_clear()


def is_known(key: str, target: Target | None = None) -> bool:
    """Return whether a part for a processor, by default this one, is kept or in the wheel's file."""
    return is_kept(key, target) or (target is None and not prefers_native() and has_wheel_part(key))


def is_kept(key: str, target: Target | None = None) -> bool:
    """Return whether the cache folder has a part for a processor, by default this one."""
    return (cache_folder() / kept_name(key, target)).exists()


def kept_name(key: str, target: Target | None = None) -> str:
    """Return the name of a part's file in the cache folder, for a processor, by default this one."""
    return f"{_for_target(key, target or host_target())}{_SUFFIX}"


def cache_folder() -> Path:
    """The folder in which machine code is kept; it need not exist."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return private(Path(chosen).expanduser())
    if sys.platform == "darwin":
        base = Path("~/Library/Caches")
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or "~/AppData/Local")
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    try:
        folder = base.expanduser() / "pepper_kin"
    except RuntimeError:  # no home folder
        return folder_without_home()
    return private(folder) if _can_be_made(folder) else folder_without_home()


@cache
def _can_be_made(folder: Path) -> bool:
    """Return whether a folder can be written, or made: a home may be on a read-only file system."""
    present = next(path for path in (folder, *folder.parents) if path.exists())
    return present.is_dir() and os.access(present, os.W_OK)


def read_part(key: str) -> bytes | None:
    """Return the part kept under a key, or None if there is none or its file is damaged or another user's."""
    path = cache_folder() / f"{key}{_SUFFIX}"
    try:
        data = read_own(path)
    except OSError:
        return None
    checksum, content = data[:_DIGEST_SIZE], data[_DIGEST_SIZE:]
    if hashlib.sha256(key.encode() + content).digest() != checksum:
        _logger.warning("the machine code in %s is damaged; it is made again", path)
        return None
    return content


def write_part(key: str, content: bytes) -> bool:
    """Keep a part under a key.

    Returns:
        Whether it could be written.
    """
    folder = cache_folder()
    temporary: str | None = None
    try:
        made(folder)
        handle, temporary = tempfile.mkstemp(prefix=f"{key[:16]}-", suffix=".tmp", dir=folder)
        with os.fdopen(handle, "wb") as file:
            file.write(hashlib.sha256(key.encode() + content).digest() + content)
        os.replace(temporary, folder / f"{key}{_SUFFIX}")
    except OSError as error:
        _logger.info("machine code not kept in %s: %s", folder, error)
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        return False
    return True


@contextlib.contextmanager
def only_maker(key: str, *, wait: bool = True) -> Iterator[bool]:
    """Lock a part within a `with` block, so that one process at a time makes it; check again for it first.

    The lock saves work; correctness does not depend on it.  If files cannot be locked, or the lock's file is
    removed meanwhile, two processes make the same part.

    Args:
        key: Key of the part.
        wait: Whether to wait for another process; if not, the value is False if another one makes the part.
    """
    path = cache_folder() / f"{key}{_LOCK}"
    mine = True
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            made(path.parent)
            file = stack.enter_context(path.open("a"))
            if fcntl is not None:
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
                except BlockingIOError:
                    mine = False
        try:
            yield mine
        finally:
            if mine:
                with contextlib.suppress(OSError):
                    path.unlink(missing_ok=True)


def clear_cache() -> int:
    """Remove all kept machine code, and the temporary files of interrupted writers.

    Returns:
        Number of files removed.
    """
    removed = 0
    folder = cache_folder()
    for pattern in (f"*{_SUFFIX}", f"*{_LOCK}", "*.tmp", "*.kernel", NATIVE):
        for path in folder.glob(pattern):
            with contextlib.suppress(OSError):
                path.unlink()
                removed += 1
    return removed


def _for_target(key: str, target: Target) -> str:
    return hashlib.sha256(f"{key} {target!r} {made_by()}".encode()).hexdigest()
