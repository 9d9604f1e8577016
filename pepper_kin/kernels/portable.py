"""The portable code that comes with the package: LLVM IR of all compiled functions, each once.

Where the package's machine code does not fit the processor, LLVM makes other machine code from this, in a
tenth of the time that it takes with Numba.  The file is for x86-64 and ARM64 processors under Linux and
macOS, which lay out all structures in it alike, and the version of LLVM that wrote it and later ones.
"""

from __future__ import annotations

import contextlib
import hashlib
import lzma
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import llvmlite.binding as llvm

from pepper_kin.kernels.package_file import read_file, read_head, tell, write_file
from pepper_kin.kernels.target import host_target

FORMAT = 1
_FILTERS = [{"id": lzma.FILTER_LZMA2, "preset": 9 | lzma.PRESET_EXTREME, "lc": 4, "lp": 0, "pb": 0}]
_WHAT = "the portable code"
_PROCESSORS = ("x86_64", "aarch64", "arm64")
_SYSTEMS = ("linux", "darwin", "macos")


def portable_path() -> Path:
    """The package's file."""
    return Path(__file__).with_name("data") / "portable.ir"


def portable_part(key: str) -> bytes | None:
    """Return a module, as bitcode, that has the functions of a unit among others; None without one.

    Args:
        key: Hash of all that the unit's machine code is made from.
    """
    loaded = _loaded() if _anew is None else _anew
    return loaded[1] if loaded is not None and key in loaded[0] else None


def portable_keys() -> dict[str, str]:
    """Key -> name of the units that the package's file has, for any processor."""
    return dict(read_head(portable_path()).get("units", {}))


def write_portable(units: Mapping[str, str], bitcode: bytes, path: Path | None = None) -> int:
    """Write the package's file.

    Args:
        units: Key -> name of the units whose functions the module has.
        bitcode: The module.
        path: Where to; the package's own place if left out.

    Returns:
        Size of the file [bytes].
    """
    body = lzma.compress(bitcode, lzma.FORMAT_RAW, filters=_FILTERS)
    head = {
        "format": FORMAT,
        "llvm": llvm.llvm_version_info[0],
        "checksum": hashlib.sha256(body).hexdigest(),
        "units": dict(units),
    }
    return write_file(path or portable_path(), head, body)


@contextlib.contextmanager
def used(units: Mapping[str, str], bitcode: bytes) -> Iterator[None]:
    """Take a new module in place of the package's file.

    Args:
        units: Key -> name of the units whose functions it has.
        bitcode: The module.
    """
    global _anew
    _anew = dict(units), bitcode
    try:
        yield
    finally:
        _anew = None


_anew: tuple[dict[str, str], bytes] | None = None


@cache
def _loaded() -> tuple[dict[str, str], bytes] | None:
    """Units and module of the file, or None where it cannot be used."""
    read = read_file(portable_path(), _WHAT, FORMAT)
    if read is None:
        return None
    head, body = read
    if hashlib.sha256(body).hexdigest() != head["checksum"]:
        tell(f"{_WHAT} that comes with the package is damaged")
        return None
    if llvm.llvm_version_info[0] < head["llvm"]:
        present = llvm.llvm_version_info[0]
        tell(f"{_WHAT} that comes with the package is for LLVM {head['llvm']}, and llvmlite has {present}")
        return None
    processor, _, rest = host_target().triple.partition("-")
    if processor not in _PROCESSORS or not any(system in rest for system in _SYSTEMS):
        return None  # the message about the machine code covers it
    return head["units"], lzma.decompress(body, lzma.FORMAT_RAW, filters=_FILTERS)


__all__ = ["portable_keys", "portable_part", "portable_path", "used", "write_portable"]
