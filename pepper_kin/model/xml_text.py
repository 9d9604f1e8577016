"""Numbers and elements as XML text."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InvalidValueError


def number(value: float) -> str:
    """Return the shortest text that reads back as the same number.

    Raises:
        InvalidValueError: for NaN or infinity, which the formats have no text for.
    """
    if not math.isfinite(value):
        raise InvalidValueError("number to export", value, "a finite number")
    short = repr(float(value))
    return "0" if float(value) == 0.0 else short.removesuffix(".0")


def numbers(values: Iterable[float]) -> str:
    """Return numbers separated by blanks; see `number`."""
    return " ".join(number(float(value)) for value in values)


def child(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    """Append an element with attributes and text and return it."""
    element = ET.SubElement(parent, tag, attributes)
    element.text = text
    return element


def document(root: ET.Element, *comments: str) -> str:
    """Return an indented XML text with comments before its root."""
    ET.indent(root)
    notes = "".join(f"<!-- {comment.replace('--', '- -')} -->\n" for comment in comments)
    return f'<?xml version="1.0"?>\n{notes}{ET.tostring(root, encoding="unicode")}\n'


def rpy_of(rotation: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of Rz(yaw) Ry(pitch) Rx(roll), shape (3, 3).

    At pitch = +-pi/2, where roll and yaw turn about one axis, yaw is zero.
    """
    r = rotation
    pitch = math.atan2(-r[2, 0], math.hypot(r[0, 0], r[1, 0]))
    if math.hypot(r[0, 0], r[1, 0]) < 1e-9:
        return math.atan2(-math.copysign(1.0, r[2, 0]) * r[0, 1], r[1, 1]), pitch, 0.0
    return math.atan2(r[2, 1], r[2, 2]), pitch, math.atan2(r[1, 0], r[0, 0])


def quaternion_wxyz_of(rotation: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return the unit quaternion (w, x, y, z), w >= 0, of a rotation, shape (3, 3).

    Shepperd's choice of the largest of the four components keeps the division well conditioned.
    """
    r = np.asarray(rotation, dtype=float)
    squares = np.array([1 + np.trace(r), *(1 - np.trace(r) + 2 * np.diag(r))])
    q = np.empty(4)
    largest = int(np.argmax(squares))
    if largest == 0:
        q[:] = squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q[0], q[1 + i] = r[k, j] - r[j, k], squares[largest]
        q[1 + j], q[1 + k] = r[j, i] + r[i, j], r[k, i] + r[i, k]
    q /= np.linalg.norm(q)
    q = q if q[0] >= 0 else -q
    return float(q[0]), float(q[1]), float(q[2]), float(q[3])
