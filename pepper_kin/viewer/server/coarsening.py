"""Mesh simplification: fewer triangles of nearly the same shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.mesh_file import unique_rows
from pepper_kin.viewer.drawable import Drawable
from pepper_kin.viewer.surface import CREASE_ANGLE, DrawnSurface, split_at_creases

_PATIENCE = 3.0
"""The power by which errors may grow from round to round; in the k-th, an edge goes whose squared error is
below 1e-9 (k + 3)^3 [m^2].  After a hundred rounds, at three centimeters, what is left stays."""

_HAIR = 1e-3
"""Edge of the cubes within which all corners are one [m]."""


def coarsened(drawables: tuple[Drawable, ...], triangles: int) -> tuple[Drawable, ...]:
    """Return drawables that together have about so many triangles, and look as alike as these can.

    Of all their edges the one whose collapse moves the surface least goes first, by quadrics: M. Garland and
    P. Heckbert, Surface simplification using quadric error metrics (1997).  All drawables share one budget,
    so that triangles go where shapes bend most, whatever the size of the body.

    Args:
        drawables: Surfaces, as `merged` returns them; what is not a surface is left out.
        triangles: How many to keep; fewer stay as they are.  Torn meshes, whose triangles share no corners,
            may keep more.

    Returns:
        The drawables in the same order, without those that vanish.
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
    """Return one corner for each cube of a fine grid that has any, and the triangles that are left by them.

    Edges that run beside each other a hair apart would tear, and nothing there could collapse.
    """
    cubes, cube = unique_rows(np.round(surface.vertices / _HAIR))
    first = np.empty(len(cubes), dtype=np.intp)
    first[cube[::-1]] = np.arange(len(cube))[::-1]
    faces = cube[surface.faces]
    return surface.vertices[first], faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def _surface(points: NDArray[np.float32], faces: NDArray[np.int32]) -> DrawnSurface:
    """Return the surface of the faces, shape (F, 3), without the points [m], shape (V, 3), that none uses."""
    used, index = np.unique(faces, return_inverse=True)
    return split_at_creases(points[used], index.reshape(-1, 3), CREASE_ANGLE)
