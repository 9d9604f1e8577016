"""Store of machine code: the file that comes with the package, and a cache folder.

A part is found by a key: the hash of all that its code is made from.  What was made from something else has
another key, so stale code is never read; it is just not found.  Three places are searched in turn:

1. The package's files, `data/x86-64-v3.code` and `data/aarch64.code`, for baseline processors (`shipping`).
2. The cache folder, for code made for this very processor.
3. Its maker, which for compiled functions begins with the package's portable code (`portable`); the result
   is then kept in the cache folder.

After `pepper-kin warm-up --native` the package's file is left out.

A file of the cache is written under a temporary name and renamed, which is atomic: readers and other
writers see a whole file or none.  A checksum finds damage; what is damaged counts as missing and is written
again.  A folder that cannot be written means that code stays in memory, not an error.  Where several
processes need a part that does not exist yet, one makes it and the others wait.

The files hold machine code that is run without further checks.  So the folder has to belong to this user or
to root, and so have its files, and no other user may write to them (`private_folder`).
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import sys
import tempfile
from collections.abc import Callable, Container, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from pepper_kin.kernels.package_file import made_by
from pepper_kin.kernels.private_folder import folder_without_home, made, private, read_own
from pepper_kin.kernels.progress import making
from pepper_kin.kernels.shipping import has_shipped, shipped_before, shipped_part
from pepper_kin.kernels.target import BASELINES, Target, host_target

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


class MissingPartError(LookupError):
    """A part that was requested while `watched` does not allow it.

    Attributes:
        name: Of the part.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.name = name


class Part(NamedTuple):
    """Machine code as it is kept.

    Attributes:
        content: What the maker returned.
        target: The processor that it is for.
        made: Whether it was made just now.
    """

    content: bytes
    target: Target
    made: bool


def obtain(
    name: str, key: str, make: Callable[[Target], bytes], *, target: Target | None = None, keep: bool = True
) -> Part:
    """Return a part from the package's file, from the cache or from its maker.

    Args:
        name: Of the part, for messages ("planners.rrt_connect").
        key: Hash of all that it is made from, except the processor.
        make: Makes it for a processor.
        target: The processor; None for this one, or the baseline that the package's file is for.
        keep: Whether to read and write files at all.
    """
    if target is None and keep and _recording is not None:
        return _recording.obtain(name, key, make)
    wanted = target or host_target()
    if not keep:
        return Part(make(wanted), wanted, True)
    if target is None:
        found = find(name, key)
        if found is not None:
            return found
    return _kept_or_made(name, _for_target(key, wanted), wanted, make)


def find(name: str, key: str) -> Part | None:
    """Return a part from the package's file or from the cache folder, or None.

    Raises:
        MissingPartError: `watched` is under way and does not allow the key.
    """
    if _watch is not None:
        _watch.ask(name, key)
    if not prefers_native():
        shipped = shipped_part(name, key)
        if shipped is not None:
            return Part(*shipped, False)
    content = read_part(_for_target(key, host_target()))
    return None if content is None else Part(content, host_target(), False)


def make_ahead(name: str, key: str, make: Callable[[Target], bytes]) -> bool:
    """Make a part for this processor and keep it, unless it is kept or another process is making it.

    Returns:
        Whether it is kept now.
    """
    own_key = _for_target(key, host_target())
    with only_maker(own_key, wait=False) as mine:
        if mine and not is_kept(key):
            write_part(own_key, make(host_target()))
    return is_kept(key)


def is_recording() -> bool:
    """Whether `recorded` is under way."""
    return _recording is not None


def can_write() -> bool:
    """Whether the cache folder can be written."""
    try:
        with tempfile.TemporaryFile(dir=made(cache_folder())):
            return True
    except OSError:
        return False


def _kept_or_made(name: str, own_key: str, wanted: Target, make: Callable[[Target], bytes]) -> Part:
    content = read_part(own_key)
    if content is not None:
        return Part(content, wanted, False)
    with only_maker(own_key):
        content = read_part(own_key)  # another process may have made it meanwhile
        if content is not None:
            return Part(content, wanted, False)
        with making(name):
            content = make(wanted)
        write_part(own_key, content)
    return Part(content, wanted, True)


class Recording:
    """What is requested meanwhile, made for each baseline processor; this one runs what is for the first.

    Attributes:
        parts: Baseline -> key -> name and content.
    """

    def __init__(self, rebuild: bool) -> None:
        baselines = list(BASELINES)[: 1 if rebuild else None]
        self.parts: dict[str, dict[str, tuple[str, bytes]]] = {baseline: {} for baseline in baselines}
        self._rebuild = rebuild

    def obtain(self, name: str, key: str, make: Callable[[Target], bytes]) -> Part:
        """Return a part for the first baseline; what the package's files have is not made again."""
        for baseline, parts in self.parts.items():
            if key not in parts:
                content = None if self._rebuild else shipped_before(key, baseline)
                if content is None:
                    target = BASELINES[baseline]()
                    content = _kept_or_made(name, _for_target(key, target), target, make).content
                parts[key] = name, content
        baseline = next(iter(BASELINES))
        return Part(self.parts[baseline][key][1], BASELINES[baseline](), False)


@contextlib.contextmanager
def recorded(rebuild: bool = False) -> Iterator[Recording]:
    """Make everything for the baseline processors, and collect what is requested.

    Args:
        rebuild: Whether to make what the package's files have already, for the first of the processors.
    """
    global _recording
    _recording = Recording(rebuild)
    try:
        yield _recording
    finally:
        _recording = None


_recording: Recording | None = None


class _Watch(NamedTuple):
    """Keys of the parts that may be requested, and of those that were."""

    allowed: Container[str]
    asked: set[str]

    def ask(self, name: str, key: str) -> None:
        """Note a requested key.

        Raises:
            MissingPartError: It is not allowed.
        """
        if key not in self.allowed:
            raise MissingPartError(name)
        self.asked.add(key)


@contextlib.contextmanager
def watched(allowed: Container[str]) -> Iterator[set[str]]:
    """Collect the keys of the parts that are requested; one that is not allowed is a `MissingPartError`.

    Args:
        allowed: Keys of the parts that may be requested.
    """
    global _watch
    _watch = _Watch(allowed, set())
    try:
        yield _watch.asked
    finally:
        _watch = None


_watch: _Watch | None = None


@cache
def prefers_native() -> bool:
    """Whether code for this very processor has been made on purpose (`pepper-kin warm-up --native`)."""
    return (cache_folder() / NATIVE).exists()


def prefer_native() -> None:
    """Let later processes use code for this very processor in place of the package's."""
    (made(cache_folder()) / NATIVE).touch()
    prefers_native.cache_clear()


def is_known(key: str) -> bool:
    """Whether a part need not be made here."""
    return is_kept(key) or (not prefers_native() and has_shipped(key))


def is_kept(key: str) -> bool:
    """Whether the cache folder has a part for this processor."""
    return (cache_folder() / f"{_for_target(key, host_target())}{_SUFFIX}").exists()


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
        return private(base.expanduser() / "pepper_kin")
    except RuntimeError:  # no home folder
        return folder_without_home()


def read_part(key: str) -> bytes | None:
    """The part kept under a key, or None if there is none or its file is damaged or of another user."""
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
    """Let one process at a time make a part, and look for it again first.

    The lock saves work; correctness does not depend on it.  Where files cannot be locked, or the file of the
    one that makes it is removed meanwhile, two make the same.

    Args:
        key: Of the part.
        wait: Whether to wait for another process; if not, the value is False where another one makes it.
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
    """Remove all kept machine code, and what interrupted writers left behind.

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
