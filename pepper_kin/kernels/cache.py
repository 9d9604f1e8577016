"""Compiled kernels kept on disk.

One file per kernel, named after a hash of everything that its code depends on, so a stale file is never read:
it is just not found.  A file is written under a temporary name and then renamed, which is atomic: readers and
other writers see a whole file or none.  A checksum in front finds files damaged otherwise; they count as
missing and are written anew.  A folder that cannot be written means no cache, not an error.  Where
several processes need a kernel that nobody has compiled, one compiles it and the others wait.

The files hold machine code that is run without further questions.  The folder is made readable by its owner
only; do not point `PEPPER_KIN_CACHE` to a place where others can write.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from pepper_kin.kernels.image import KernelImage

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

CACHE_VARIABLE = "PEPPER_KIN_CACHE"
"""Environment variable that names the folder; the platform's cache folder if it is not set."""

_SUFFIX = ".kernel"
_LOCK = ".lock"
_DIGEST_SIZE = hashlib.sha256().digest_size
_logger = logging.getLogger(__name__)


def cache_folder() -> Path:
    """The folder in which compiled kernels are kept; it need not exist."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen).expanduser()
    if sys.platform == "darwin":
        base = Path("~/Library/Caches")
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or "~/AppData/Local")
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache")
    try:
        return base.expanduser() / "pepper_kin"
    except RuntimeError:  # no home folder
        return Path(tempfile.gettempdir()) / f"pepper_kin-{os.getuid() if hasattr(os, 'getuid') else 'cache'}"


def cache_key(*parts: str) -> str:
    """Hash of texts, and of the source of the code generator itself."""
    digest = hashlib.sha256(_source_digest())
    for part in parts:
        data = part.encode()
        digest.update(len(data).to_bytes(8, "little"))
        digest.update(data)
    return digest.hexdigest()


def read_image(key: str) -> KernelImage | None:
    """The kernel kept under a key, or None if there is none or its file is damaged."""
    path = cache_folder() / f"{key}{_SUFFIX}"
    try:
        data = path.read_bytes()
    except OSError:
        return None
    checksum, body = data[:_DIGEST_SIZE], data[_DIGEST_SIZE:]
    if hashlib.sha256(key.encode() + body).digest() != checksum:
        _logger.info("cached kernel %s is damaged; it will be compiled again", path)
        return None
    return KernelImage.from_bytes(body)


def write_image(key: str, image: KernelImage) -> bool:
    """Keep a kernel under a key.

    Returns:
        Whether it could be written.
    """
    folder, body = cache_folder(), image.to_bytes()
    temporary: str | None = None
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle, temporary = tempfile.mkstemp(prefix=f"{key[:16]}-", suffix=".tmp", dir=folder)
        with os.fdopen(handle, "wb") as file:
            file.write(hashlib.sha256(key.encode() + body).digest() + body)
        os.replace(temporary, folder / f"{key}{_SUFFIX}")
    except OSError as error:
        _logger.info("kernel not cached in %s: %s", folder, error)
        if temporary is not None:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
        return False
    return True


@contextlib.contextmanager
def only_compiler(key: str) -> Iterator[None]:
    """Let one process at a time compile a kernel, and look for it again first.

    The lock spares work; correctness does not rest on it. Where files cannot be locked, or the file of the
    one that compiles is removed meanwhile, two compile the same.
    """
    path = cache_folder() / f"{key}{_LOCK}"
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            file = stack.enter_context(path.open("a"))
            if fcntl is not None:
                fcntl.flock(file, fcntl.LOCK_EX)
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


def clear_cache() -> int:
    """Remove all kept kernels, and what interrupted writers left behind.

    Returns:
        Number of files removed.
    """
    removed = 0
    folder = cache_folder()
    for pattern in (f"*{_SUFFIX}", f"*{_LOCK}", "*.tmp"):
        for path in folder.glob(pattern):
            with contextlib.suppress(OSError):
                path.unlink()
                removed += 1
    return removed


@cache
def _source_digest() -> bytes:
    """Hash of this package's source: a new code generator must not run old code."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.digest()
