"""A triangle mesh as a value, with the few operations that the shapes need."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.exceptions import InvalidValueError

GRID = 1e-6
"""Vertices lie on a grid of one micrometer [m], so that every machine writes the same bytes."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Closed triangle mesh with outward faces (counter-clockwise seen from outside).

    Attributes:
        vertices: Corners [m], shape (v, 3), rounded to `GRID`, read-only.
        faces: Indices into `vertices`, shape (f, 3), read-only.

    Raises:
        InvalidValueError: Wrong shapes, numbers that are not finite, or an index out of range.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=float)
        faces = np.array(self.faces, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or not np.all(np.isfinite(vertices)):
            raise InvalidValueError("vertices", f"shape {vertices.shape}", "finite numbers, shape (v, 3)")
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise InvalidValueError("faces", f"shape {faces.shape}", "indices, shape (f, 3)")
        if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise InvalidValueError(
                "faces", f"{faces.min()}..{faces.max()}", f"indices from 0 to {len(vertices) - 1}"
            )
        vertices = np.round(vertices / GRID) * GRID + 0.0
        for array in (vertices, faces):
            array.setflags(write=False)
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners of every face [m], shape (f, 3, 3)."""
        corners: NDArray[np.float64] = self.vertices[self.faces]
        return corners

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lowest and highest corner of the axis-aligned box [m], shape (2, 3)."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def volume(self) -> float:
        """Enclosed volume [m^3]: sum of det(a, b, c) / 6 over the faces, positive when they face outward."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)

    def transformed(self, rotation: ArrayLike, translation: ArrayLike) -> Mesh:
        """Return the mesh mapped by x -> R x + t.

        Args:
            rotation: Matrix R, shape (3, 3).  A reflection turns the faces over, so they stay outward.
            translation: Vector t [m], shape (3,).
        """
        matrix = np.asarray(rotation, dtype=float)
        faces = self.faces[:, ::-1] if np.linalg.det(matrix) < 0.0 else self.faces
        return Mesh(self.vertices @ matrix.T + np.asarray(translation, dtype=float), faces)

    def shifted(self, translation: ArrayLike) -> Mesh:
        """Return the mesh moved by a vector [m], shape (3,)."""
        return self.transformed(np.eye(3), translation)

    def mirrored(self) -> Mesh:
        """Return the mirror image in the plane y = 0: what is left becomes right."""
        return self.transformed(np.diag([1.0, -1.0, 1.0]), np.zeros(3))


def join(meshes: Sequence[Mesh]) -> Mesh:
    """Put several meshes into one; they may overlap, each stays closed.

    Args:
        meshes: At least one mesh.

    Raises:
        InvalidValueError: No mesh given.
    """
    if not meshes:
        raise InvalidValueError("meshes", "an empty sequence", "at least one mesh")
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)]),
    )
