"""Portable code of compiled functions: LLVM IR, one module per function, from which machine code is made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple


class PortablePart(NamedTuple):
    """Portable code of one function for certain types of its arguments.

    Attributes:
        key: Hash of the function's own inputs, without the functions that it calls.
        needs: Symbols of the functions that it calls.
        bitcode: LLVM bitcode of the function, without the code of other parts.
        types: Description of the function's types for callers in the front end; empty for entry points.
    """

    key: str
    needs: tuple[str, ...]
    bitcode: bytes
    types: bytes


def needed(symbols: Sequence[str], part_of: Callable[[str], PortablePart]) -> list[str]:
    """Return the symbols of entry points and of all parts that they need, in a fixed order."""
    found: dict[str, None] = {}
    waiting = list(reversed(symbols))
    while waiting:
        symbol = waiting.pop()
        if symbol not in found:
            found[symbol] = None
            waiting += reversed(part_of(symbol).needs)
    return list(found)
