"""Measured cross-sections and features of Pepper's visible shape."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import FileFormatError, UnknownNameError

DATA_FILE = Path(__file__).resolve().parent.parent / "data" / "visual_shape.json"


@dataclass(frozen=True, eq=False)
class LinkShape:
    """What was measured of one link, in the link's frame.

    Attributes:
        axis: Main axis of the sections, "x" or "z".
        sections: Rows (s, c1, c2, h1, h2, n) [m, n without unit], shape (k, 6).
        start: Where the link begins along the axis [m].
        end: Where it ends along the axis [m].
        bounds: Lowest and highest corner [m], shape (2, 3).
    """

    axis: str
    sections: NDArray[np.float64]
    start: float
    end: float
    bounds: NDArray[np.float64]


@functools.cache
def features() -> dict[str, Any]:
    """Return the whole data file: `links`, `head`, `tablet`, `footprint_hull_xy` (treat it as read-only)."""
    try:
        content: dict[str, Any] = json.loads(DATA_FILE.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise FileFormatError(DATA_FILE, error.msg, error.lineno) from error
    return content


def link_shape(name: str) -> LinkShape:
    """Return the measured shape of a link.

    Args:
        name: A center or left link, or `phalanx`, `fingertip`, `wheel`.

    Raises:
        UnknownNameError: There is no such link.
    """
    links = features()["links"]
    if name not in links:
        raise UnknownNameError("measured link", name, links)
    entry = links[name]
    sections, bounds = np.array(entry["sections"]), np.array(entry["bounds"])
    for array in (sections, bounds):
        array.setflags(write=False)
    start, end = entry["range"]
    return LinkShape(entry["axis"], sections, start, end, bounds)
