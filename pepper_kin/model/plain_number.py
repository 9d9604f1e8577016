"""Strict reading of numbers in texts; in this package because keys of a robot's machine code name it."""

from __future__ import annotations

import math
import re

_PLAIN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def plain_number(text: str) -> float:
    """Return the number that a text states in ASCII digits; NaN for anything else, such as 1_0 or \u0661.

    The words nan and inf, and numbers beyond the largest float, give NaN.
    """
    if _PLAIN.fullmatch(text.strip(" \t\r\n")) is None:
        return math.nan
    value = float(text)
    return value if math.isfinite(value) else math.nan
