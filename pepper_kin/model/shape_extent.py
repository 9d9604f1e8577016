"""Extent of a link's shapes: the box in which its center of mass must lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import FileFormatError
from pepper_kin.file_access.reading import read_bytes
from pepper_kin.model.plain_number import plain_number
from pepper_kin.model.tolerant_urdf import LinkFacts, ShapeFacts

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def link_extent(link: LinkFacts) -> NDArray[np.float64] | None:
    """Return the box around all shapes of a link, [[lower x, y, z], [upper x, y, z]] [m], in the link frame.

    None for a link without a shape whose size can be read.
    """
    boxes = [box for shape in link.shapes if (box := _extent(shape)) is not None]
    if not boxes:
        return None
    return np.array([np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)])


def _extent(shape: ShapeFacts) -> NDArray[np.float64] | None:
    """Return the box around a shape in the link frame [m], shape (2, 3); None for an unreadable mesh."""
    rotation, center = shape.pose[:3, :3], shape.pose[:3, 3]
    if shape.kind == "mesh":
        points = None if shape.path is None else mesh_points(shape.path)
        if points is None or not len(points):
            return None
        placed = (points * np.array(shape.sizes["scale"])) @ rotation.T + center
        return np.array([placed.min(axis=0), placed.max(axis=0)])
    if shape.kind == "box":
        reach = np.abs(rotation) @ (np.array(shape.sizes["size"]) / 2)
    else:
        radius = shape.sizes["radius"][0]
        axis = rotation[:, 2]
        half = shape.sizes.get("length", (0.0,))[0] / 2
        # A disk of normal `axis` extends radius * sqrt(1 - axis_i^2) along i, a sphere extends radius.
        across = np.sqrt(np.clip(1 - axis**2, 0, None)) if shape.kind == "cylinder" else np.ones(3)
        reach = half * np.abs(axis) + radius * across
    return np.array([center - reach, center + reach])


def mesh_points(path: Path) -> NDArray[np.float64] | None:
    """Return the vertices of an STL or OBJ mesh, shape (k, 3), in the file's unit; None if unreadable."""
    try:
        content = read_bytes(path)
    except FileFormatError:
        return None
    if path.suffix.lower() == ".obj":
        return _numbers_after(content, b"v")
    if path.suffix.lower() != ".stl":
        return None
    if len(content) >= 84:
        count = int(np.frombuffer(content[80:84], dtype="<u4")[0])
        if len(content) == 84 + count * _FACET.itemsize:
            corners = np.frombuffer(content, dtype=_FACET, offset=84)["corners"]
            return np.asarray(corners.reshape(-1, 3), dtype=float)
    return _numbers_after(content, b"vertex")


def _numbers_after(content: bytes, keyword: bytes) -> NDArray[np.float64] | None:
    """Return the three numbers after each keyword of a text file, shape (k, 3); None if malformed."""
    lines = [line.split() for line in content.splitlines()]
    rows = [[plain_number(v.decode("latin-1")) for v in x[1:4]] for x in lines if x and x[0] == keyword]
    if any(len(row) != 3 for row in rows):
        return None
    points = np.array(rows).reshape(-1, 3)
    return points if np.isfinite(points).all() else None
