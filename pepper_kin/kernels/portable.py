"""The portable code that comes with the package: LLVM IR of every compiled function, a part each.

Where the package's machine code does not fit the processor, or the source of a function has changed, LLVM
makes machine code of these parts, in a tenth of the time that it takes with Numba.  They are for x86-64 and
ARM64 processors under Linux and macOS, which lay out all structures in them alike, and the version of LLVM
that wrote them and later ones.
"""

from __future__ import annotations

import contextlib
import hashlib
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import llvmlite.binding as llvm

from pepper_kin.kernels.package_file import (
    file_begins,
    made_by,
    read_at,
    read_file,
    read_head,
    tell,
    write_file,
)
from pepper_kin.kernels.target import host_target

FORMAT = 2
_WHAT = "the portable code"
_PROCESSORS = ("x86_64", "aarch64", "arm64")
_SYSTEMS = ("linux", "darwin", "macos")


class PortablePart(NamedTuple):
    """Portable code of one function for certain types of its arguments.

    Attributes:
        key: Hash of what the function itself is made from, without the functions that it calls.
        needs: Symbols of the functions that it calls.
        bitcode: The function, and nothing that is a part itself.
        types: What the front end has to know of it where another function calls it; empty for entry points.
    """

    key: str
    needs: tuple[str, ...]
    bitcode: bytes
    types: bytes


class PortableCode(NamedTuple):
    """Units and parts.

    Attributes:
        units: Key -> name of the units whose parts are all there.
        parts: Symbol -> part.
        alike: Whether the parts were made by the versions of Numba and LLVM that are here.
    """

    units: Mapping[str, str]
    parts: Mapping[str, PortablePart]
    alike: bool = True


def portable_path() -> Path:
    """The package's file."""
    return Path(__file__).with_name("data") / "portable.ir"


def portable_unit(key: str, symbols: Sequence[str]) -> list[bytes] | None:
    """Return the bitcode of all that a unit needs, or None where the package has other sources of it.

    Args:
        key: Hash of all that the unit's machine code is made from.
        symbols: Its entry points.
    """
    code = _loaded() if _anew is None else _anew
    if code is None or key not in code.units:
        return None
    return [code.parts[symbol].bitcode for symbol in needed(symbols, code.parts.__getitem__)]


def portable_part(symbol: str, key: str) -> PortablePart | None:
    """Return the part of a function, or None where the package has it of other sources or made by others."""
    code = _loaded() if _anew is None else _anew
    part = None if code is None or not code.alike else code.parts.get(symbol)
    return part if part is not None and part.key == key else None


def needed(symbols: Sequence[str], part_of: Callable[[str], PortablePart]) -> list[str]:
    """Return the symbols of all parts that entry points need, themselves included, in a fixed order."""
    found: dict[str, None] = {}
    waiting = list(reversed(symbols))
    while waiting:
        symbol = waiting.pop()
        if symbol not in found:
            found[symbol] = None
            waiting += reversed(part_of(symbol).needs)
    return list(found)


def portable_keys() -> dict[str, str]:
    """Key -> name of the units that the package's file has, for any processor."""
    return dict(read_head(portable_path()).get("units", {}))


def write_portable(code: PortableCode, path: Path | None = None) -> int:
    """Write the package's file.

    Args:
        code: Its content.
        path: Where to; the package's own place if left out.

    Returns:
        Size of the file [bytes].
    """
    dictionary = _dictionary() or _new_dictionary(code)
    parts, body = {}, dictionary
    for symbol, part in sorted(code.parts.items()):
        packed = [_packed(data, dictionary) for data in (part.bitcode, part.types)]
        parts[symbol] = part.key, part.needs, *map(len, packed)
        body += b"".join(packed)
    head = {
        "format": FORMAT,
        "llvm": llvm.llvm_version_info[0],
        "made_by": made_by(),
        "checksum": hashlib.sha256(body).hexdigest(),
        "dictionary": len(dictionary),
        "units": dict(sorted(code.units.items(), key=lambda entry: entry[1])),
        "parts": parts,
    }
    return write_file(path or portable_path(), head, body)


def _packed(data: bytes, dictionary: bytes) -> bytes:
    packer = zlib.compressobj(9, zdict=dictionary)
    return packer.compress(data) + packer.flush()


def _dictionary() -> bytes:
    """Return the dictionary of the package's file; later files keep it, so that parts keep their bytes."""
    read = file_begins(portable_path(), _WHAT, FORMAT)
    return b"" if read is None else read_at(portable_path(), read[1], read[0]["dictionary"])


def _new_dictionary(code: PortableCode) -> bytes:
    """Return samples of parts, of all sizes; compressed with them a part takes half the bytes."""
    samples = []
    for field, count, size in (("types", 8, 1024), ("bitcode", 8, 3072)):
        texts = sorted((getattr(part, field) for part in code.parts.values()), key=lambda t: (len(t), t))
        texts = [text for text in texts if text]
        samples += (
            [texts[(2 * k + 1) * len(texts) // (2 * count)][:size] for k in range(count)] if texts else []
        )
    return b"".join(samples)


@contextlib.contextmanager
def used(code: PortableCode) -> Iterator[None]:
    """Take new portable code in place of the package's file."""
    global _anew
    _anew = code
    try:
        yield
    finally:
        _anew = None


_anew: PortableCode | None = None


@cache
def _loaded() -> PortableCode | None:
    """Content of the file, or None where it cannot be used."""
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
    begin = head["dictionary"]
    parts, dictionary = {}, body[:begin]
    for symbol, (key, needs, *sizes) in head["parts"].items():
        texts = []
        for size in sizes:
            texts.append(zlib.decompressobj(zdict=dictionary).decompress(body[begin : begin + size]))
            begin += size
        parts[symbol] = PortablePart(key, tuple(needs), *texts)
    return PortableCode(head["units"], parts, head["made_by"] == made_by())
