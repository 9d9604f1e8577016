"""Binary STL, written so that equal shapes give equal bytes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import FileFormatError

from .mesh import Mesh

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = b"pepper_kin: generated from measured sections, meters".ljust(80)
_NORMAL_DECIMALS = 4


def to_bytes(mesh: Mesh) -> bytes:
    """Return the mesh as a binary STL file.

    Facet normals are rounded to four decimals and corners lie on the mesh's grid, so rounding noise of a
    machine's arithmetic does not reach the file.

    Args:
        mesh: What to write [m].
    """
    corners = mesh.corners
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facets = np.zeros(len(corners), dtype=_FACET)
    facets["normal"] = np.round(normals, _NORMAL_DECIMALS) + 0.0
    facets["corners"] = corners
    return _HEADER + np.uint32(len(facets)).tobytes() + facets.tobytes()


def corners_from_bytes(content: bytes, name: str = "STL") -> NDArray[np.float64]:
    """Read the corners of the facets of a binary STL file.

    Args:
        content: The whole file.
        name: What to call it in an error.

    Returns:
        Corners [m], shape (f, 3, 3).

    Raises:
        FileFormatError: The length does not fit the number of facets that the file announces.
    """
    if len(content) < 84:
        raise FileFormatError(name, f"{len(content)} bytes, a binary STL has at least 84")
    count = int(np.frombuffer(content[80:84], dtype="<u4")[0])
    if len(content) != 84 + count * _FACET.itemsize:
        raise FileFormatError(name, f"{len(content)} bytes do not hold the {count} facets announced")
    facets = np.frombuffer(content, dtype=_FACET, offset=84)
    return facets["corners"].astype(np.float64)
