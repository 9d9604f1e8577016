"""Many shapes as few: what moves together and has one colour is drawn as one surface.

A page pays for every object that it draws, most of all where the processor does the drawing.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import Box, Capsule, Cylinder, Mesh, PepperModel, Shape, Sphere
from pepper_kin.viewer.drawable import Color, Drawable
from pepper_kin.viewer.surface import CREASE_ANGLE, Surface, capsule_surface, read_stl, split_at_creases

SEGMENTS, RINGS = 12, 3
"""Corners around a round shape and steps from its pole to its equator: enough for glass."""

_BOX_FACES = np.array(
    [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
     [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]
)  # fmt: skip


def merged(
    pepper: PepperModel,
    shapes: tuple[Shape, ...],
    color: Color | None = None,
    segments: int = SEGMENTS,
    rings: int = RINGS,
) -> tuple[Drawable, ...]:
    """Return the shapes as one drawable for each moving body and colour.

    Args:
        pepper: The robot.
        shapes: Shapes on its links.
        color: The colour of all; None for their own.
        segments: Corners around a round shape.
        rings: Steps from its pole to its equator.
    """
    carriers = _carriers(pepper)
    surfaces: dict[Path, Surface] = {}
    groups: dict[tuple[str, Color], list[tuple[NDArray[np.float64], NDArray[np.int64]]]] = {}
    for shape in shapes:
        carrier, transform_link_to_carrier = carriers[shape.link]
        surface, scale = _surface(shape, surfaces, segments, rings)
        pose = transform_link_to_carrier @ shape.transform_shape_to_link
        vertices = (surface.vertices * scale) @ pose[:3, :3].T + pose[:3, 3]
        groups.setdefault((carrier, color or shape.color), []).append((vertices, np.asarray(surface.faces)))
    return tuple(
        Drawable(f"part {index}", carrier, _joined(parts), np.eye(4), tint)
        for index, ((carrier, tint), parts) in enumerate(groups.items())
    )


def coarsened(drawables: tuple[Drawable, ...], fineness: float) -> tuple[Drawable, ...]:
    """Return merged drawables with fewer triangles: the vertices of each cube of a grid become one.

    J. Rossignac and P. Borrel, Multi-resolution 3D approximations (1993).  The one lies where the planes of
    the triangles around it meet best, so that edges stay sharp: P. Lindstrom, Out-of-core simplification of
    large polygonal models (2000).  All colours of a body share it, so that no gap opens between them.  The
    cubes of a small body are smaller, as the square root of its length: a finger keeps its shape, and a flank
    has no more triangles than it takes.

    Args:
        drawables: As `merged` returns them.
        fineness: Edge of the cubes of a body that is one metre long [m].
    """
    bodies: dict[str | None, list[tuple[Drawable, Surface]]] = {}
    for drawable in drawables:
        if isinstance(drawable.geometry, Surface):
            bodies.setdefault(drawable.link, []).append((drawable, drawable.geometry))
    return tuple(
        replace(drawable, geometry=mesh)
        for parts in bodies.values()
        for (drawable, _), mesh in zip(parts, _clustered([part for _, part in parts], fineness), strict=True)
        if mesh is not None
    )


def _clustered(parts: list[Surface], fineness: float) -> list[Surface | None]:
    """Return the parts of one body with common, and fewer, vertices; None for one that vanishes."""
    whole = _joined([(part.vertices.astype(float), part.faces.astype(np.int64)) for part in parts])
    vertices, faces = whole.vertices.astype(float), whole.faces.astype(np.int64)
    cell = fineness * np.sqrt(np.linalg.norm(np.ptp(vertices, axis=0)))
    cubes = np.floor(vertices / cell).astype(np.int64)
    _, cube, count = np.unique(cubes, axis=0, return_inverse=True, return_counts=True)
    cube = cube.reshape(-1)
    middles = np.stack([np.bincount(cube, vertices[:, k]) for k in range(3)], axis=-1) / count[:, None]
    points = _meeting_points(vertices, faces, cube, middles, cell)
    # Of triangles with the same corners one is enough; the first keeps its orientation.
    coarse = cube[faces]
    _, first = np.unique(np.sort(coarse, axis=1), axis=0, return_index=True)
    kept = np.zeros(len(coarse), dtype=bool)
    kept[first] = True
    a, b, c = coarse.T
    kept &= (a != b) & (b != c) & (c != a)
    ends = np.cumsum([len(part.faces) for part in parts])[:-1]
    own = [faces[keep] for faces, keep in zip(np.split(coarse, ends), np.split(kept, ends), strict=True)]
    return [split_at_creases(points, part, CREASE_ANGLE) if len(part) else None for part in own]


def _meeting_points(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    cube: NDArray[np.int64],
    middles: NDArray[np.float64],
    cell: float,
) -> NDArray[np.float64]:
    """Return for each cube the point x that minimises sum (n (x - p))^2 over its triangles, shape (k, 3).

    The normals n are as long as the triangles are large, and p is any of their corners; where the planes say
    little a weak pull to the middle of the vertices decides.
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    products = np.einsum("fi,fj->fij", normals, normals)
    matrix, vector = np.zeros((len(middles), 3, 3)), np.zeros((len(middles), 3))
    for k in range(3):
        at = cube[faces[:, k]]
        away = corners[:, k] - middles[at]
        np.add.at(matrix, at, products)
        np.add.at(vector, at, np.einsum("fij,fj->fi", products, away))
    pull = 0.03 * np.trace(matrix, axis1=1, axis2=2) + 1e-30
    offset = np.linalg.solve(matrix + pull[:, None, None] * np.eye(3), vector[:, :, None])[:, :, 0]
    far = np.linalg.norm(offset, axis=1, keepdims=True)
    return np.asarray(middles + offset * np.minimum(1.0, cell / np.maximum(far, 1e-12)))


def _carriers(pepper: PepperModel) -> dict[str, tuple[str, NDArray[np.float64]]]:
    """Return for each link one that moves with it, the same for all that move together, and the way there."""
    model, found = pepper.pinocchio_model, {}
    first: dict[int, tuple[str, Any]] = {}
    for name in pepper.frame_names:
        frame = model.frames[pepper.frame_id(name)]
        carrier, placement = first.setdefault(frame.parentJoint, (name, frame.placement))
        found[name] = (carrier, np.asarray((placement.inverse() * frame.placement).homogeneous))
    return found


def _surface(
    shape: Shape, surfaces: dict[Path, Surface], segments: int, rings: int
) -> tuple[Surface, NDArray[np.float64]]:
    geometry, ones = shape.geometry, np.ones(3)
    match geometry:
        case Box():
            corners = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
            return split_at_creases(corners * geometry.size, _BOX_FACES, CREASE_ANGLE), ones
        case Sphere():
            return capsule_surface(geometry.radius, 0.0, segments, rings), ones
        case Capsule():
            return capsule_surface(geometry.radius, geometry.length, segments, rings), ones
        case Cylinder():
            return _cylinder(geometry, segments), ones
        case Mesh():
            path = Path(geometry.path)
            if path not in surfaces:
                surfaces[path] = read_stl(path)
            return surfaces[path], np.broadcast_to(np.asarray(geometry.scale, dtype=float), 3)
    raise AssertionError("links have no other geometry")


def _cylinder(cylinder: Cylinder, segments: int) -> Surface:
    angle = np.arange(segments) * (2 * np.pi / segments)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * cylinder.radius
    ends = [np.column_stack([ring, np.full(segments, z * cylinder.length)]) for z in (-0.5, 0.5)]
    here, after = np.arange(segments), np.roll(np.arange(segments), -1)
    sides = np.concatenate(
        [np.stack([here, after, segments + after], 1), np.stack([here, segments + after, segments + here], 1)]
    )
    fan = np.arange(1, segments - 1)
    bottom = np.stack([np.zeros_like(fan), fan + 1, fan], 1)
    top = np.stack([np.zeros_like(fan), fan, fan + 1], 1) + segments
    return split_at_creases(np.concatenate(ends), np.concatenate([sides, bottom, top]), CREASE_ANGLE)


def _as_surface(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Surface:
    return Surface(vertices.astype(np.float32), faces.astype(np.uint32))


def _joined(parts: list[tuple[NDArray[np.float64], NDArray[np.int64]]]) -> Surface:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [faces.astype(np.int64) + start for (_, faces), start in zip(parts, starts, strict=True)]
    return _as_surface(np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces))
