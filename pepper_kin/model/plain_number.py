"""Numbers of texts, read strictly; here, because the keys of a robot's machine code name this package."""

from __future__ import annotations

import math
import re

_PLAIN = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def plain_number(text: str) -> float:
    """Return the number that a text states in ASCII digits; NaN for anything else, such as 1_0 or \u0661.

    NaN and infinity in words are NaN here, and so is what exceeds the largest float.
    """
    if _PLAIN.fullmatch(text.strip(" \t\r\n")) is None:
        return math.nan
    value = float(text)
    return value if math.isfinite(value) else math.nan
