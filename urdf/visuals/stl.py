"""Binary STL, written so that equal shapes give equal bytes."""

from __future__ import annotations

import numpy as np

from .mesh import Mesh

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A facet of the file, of which there are as many as fill it from byte 84 on."""
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
    facets = np.zeros(len(corners), dtype=FACET)
    facets["normal"] = np.round(normals, _NORMAL_DECIMALS) + 0.0
    facets["corners"] = corners
    return _HEADER + np.uint32(len(facets)).tobytes() + facets.tobytes()
