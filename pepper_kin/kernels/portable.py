"""Portable code of compiled functions: LLVM IR of one function each, which machine code is made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple


class PortablePart(NamedTuple):
    """Portable code of one function for certain types of its arguments.

    Attributes:
        key: Hash of what the function itself is made from, without the functions that it calls.
        needs: Symbols of the functions that it calls.
        bitcode: The function, and nothing that is a part itself.
        types: Description of its types for the front end, where another function calls it; empty for entry
            points.
    """

    key: str
    needs: tuple[str, ...]
    bitcode: bytes
    types: bytes


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
