"""Mesh simplification: fewer triangles of nearly the same shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.mesh_file import unique_rows
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.surface import CREASE_ANGLE, DrawnSurface, split_at_creases

_PATIENCE = 3.0
"""Exponent of the growth of errors from round to round: in round k, edges collapse whose squared error is
below 1e-9 (k + 3)^3 [m^2].  After a hundred rounds, at three centimeters, the remaining edges stay."""

_HAIR = 1e-3
"""Edge length of the grid cubes whose vertices are merged [m]."""


def coarsened(drawables: tuple[Drawable, ...], triangles: int) -> tuple[Drawable, ...]:
    """Simplify drawables to a total number of triangles, with the least change of shape.

    The edge whose collapse moves the surface least, by quadric errors, collapses first: M. Garland and
    P. Heckbert, Surface simplification using quadric error metrics (1997).  All drawables share one budget,
    so that triangles remain where shapes bend most, whatever the size of the body.

    Args:
        drawables: Surfaces, from `merged`; other geometries are left out.
        triangles: Total number to keep; fewer are left unchanged.  Torn meshes, whose triangles share no
            vertices, may keep more.

    Returns:
        The drawables in the same order, without vanished ones.
    """
    kept = [drawable for drawable in drawables if isinstance(drawable.geometry, DrawnSurface)]
    parts = [_welded(drawable.geometry) for drawable in kept if isinstance(drawable.geometry, DrawnSurface)]
    if sum(len(faces) for _, faces in parts) <= triangles:
        return tuple(kept)
    sizes = [len(places) for places, _ in parts]
    starts = np.cumsum([0, *sizes[:-1]])
    points = np.concatenate([places for places, _ in parts]).astype(np.float32)
    faces = np.concatenate([part + start for (_, part), start in zip(parts, starts, strict=True)])
    faces = faces.astype(np.int32)
    import fast_simplification

    collapses = fast_simplification.simplify(
        points, faces, target_count=triangles, agg=_PATIENCE, return_collapses=True
    )[2]
    points, faces, became = fast_simplification.replay_simplification(points, faces, collapses)
    owner = np.full(len(points), -1)
    owner[became] = np.repeat(np.arange(len(parts)), sizes)
    return tuple(
        replace(drawable, geometry=_surface(points, faces[own]))
        for index, drawable in enumerate(kept)
        if (own := owner[faces[:, 0]] == index).any()
    )


def _welded(surface: DrawnSurface) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Merge the vertices within each cube of a fine grid; return vertices and remaining triangles.

    Otherwise adjacent edges with a tiny gap would tear, and could not collapse.
    """
    cubes, cube = unique_rows(np.round(surface.vertices / _HAIR))
    first = np.empty(len(cubes), dtype=np.intp)
    first[cube[::-1]] = np.arange(len(cube))[::-1]
    faces = cube[surface.faces]
    return surface.vertices[first], faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def _surface(points: NDArray[np.float32], faces: NDArray[np.int32]) -> DrawnSurface:
    """Return the surface of faces, shape (F, 3), with only the used points [m], shape (V, 3)."""
    used, index = np.unique(faces, return_inverse=True)
    return split_at_creases(points[used], index.reshape(-1, 3), CREASE_ANGLE)
