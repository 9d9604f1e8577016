"""Many shapes as few: what moves together and has one colour is drawn as one surface.

A page pays for every object that it draws, most of all where the processor does the drawing.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import TriangleMesh
from pepper_kin.model import Box, Capsule, Cylinder, Mesh, PepperModel, Shape, Sphere
from pepper_kin.viewer.drawable import Color, Drawable
from pepper_kin.viewer.surface import Surface, capsule_surface, read_stl

SEGMENTS, RINGS = 12, 3
"""Corners around a round shape and steps from its pole to its equator: enough for glass."""

_BOX_FACES = np.array(
    [[0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4],
     [2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]]
)  # fmt: skip


def merged(
    pepper: PepperModel, shapes: tuple[Shape, ...], color: Color | None = None
) -> tuple[Drawable, ...]:
    """Return the shapes as one drawable for each moving body and colour.

    Args:
        pepper: The robot.
        shapes: Shapes on its links.
        color: The colour of all; None for their own.
    """
    carriers = _carriers(pepper)
    surfaces: dict[Path, Surface] = {}
    groups: dict[tuple[str, Color], list[tuple[NDArray[np.float64], NDArray[np.int64]]]] = {}
    for shape in shapes:
        carrier, transform_link_to_carrier = carriers[shape.link]
        surface, scale = _surface(shape, surfaces)
        pose = transform_link_to_carrier @ shape.transform_shape_to_link
        vertices = (surface.vertices * scale) @ pose[:3, :3].T + pose[:3, 3]
        groups.setdefault((carrier, color or shape.color), []).append((vertices, np.asarray(surface.faces)))
    return tuple(
        Drawable(f"part {index}", carrier, _joined(parts), np.eye(4), tint)
        for index, ((carrier, tint), parts) in enumerate(groups.items())
    )


def coarsened(drawables: tuple[Drawable, ...], cell: float) -> tuple[Drawable, ...]:
    """Return merged drawables with fewer triangles: the vertices of each cube of a grid become one.

    J. Rossignac and P. Borrel, Multi-resolution 3D approximations (1993).

    Args:
        drawables: As `merged` returns them.
        cell: Edge of the cubes [m].
    """
    return tuple(
        replace(drawable, geometry=_clustered(drawable.geometry, cell))
        for drawable in drawables
        if isinstance(drawable.geometry, TriangleMesh)
    )


def _clustered(mesh: TriangleMesh, cell: float) -> TriangleMesh:
    cubes = np.floor(mesh.vertices / cell).astype(np.int64)
    _, cube, count = np.unique(cubes, axis=0, return_inverse=True, return_counts=True)
    cube = cube.reshape(-1)
    middles = np.stack([np.bincount(cube, mesh.vertices[:, k]) for k in range(3)], axis=-1) / count[:, None]
    faces = cube[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    # Of triangles with the same corners one is enough; the first keeps its orientation.
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return mesh if not len(first) else TriangleMesh(middles, faces[np.sort(first)])


def _carriers(pepper: PepperModel) -> dict[str, tuple[str, NDArray[np.float64]]]:
    """Return for each link one that moves with it, the same for all that move together, and the way there."""
    model, found = pepper.pinocchio_model, {}
    first: dict[int, tuple[str, Any]] = {}
    for name in pepper.frame_names:
        frame = model.frames[pepper.frame_id(name)]
        carrier, placement = first.setdefault(frame.parentJoint, (name, frame.placement))
        found[name] = (carrier, np.asarray((placement.inverse() * frame.placement).homogeneous))
    return found


def _surface(shape: Shape, surfaces: dict[Path, Surface]) -> tuple[Surface, NDArray[np.float64]]:
    geometry, ones = shape.geometry, np.ones(3)
    match geometry:
        case Box():
            corners = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
            return _as_surface(corners * geometry.size, _BOX_FACES), ones
        case Sphere():
            return capsule_surface(geometry.radius, 0.0, SEGMENTS, RINGS), ones
        case Capsule():
            return capsule_surface(geometry.radius, geometry.length, SEGMENTS, RINGS), ones
        case Cylinder():
            return _cylinder(geometry), ones
        case Mesh():
            path = Path(geometry.path)
            if path not in surfaces:
                surfaces[path] = read_stl(path)
            return surfaces[path], np.broadcast_to(np.asarray(geometry.scale, dtype=float), 3)
    raise AssertionError("links have no other geometry")


def _cylinder(cylinder: Cylinder) -> Surface:
    angle = np.arange(SEGMENTS) * (2 * np.pi / SEGMENTS)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * cylinder.radius
    ends = [np.column_stack([ring, np.full(SEGMENTS, z * cylinder.length)]) for z in (-0.5, 0.5)]
    here, after = np.arange(SEGMENTS), np.roll(np.arange(SEGMENTS), -1)
    sides = np.concatenate(
        [np.stack([here, after, SEGMENTS + after], 1), np.stack([here, SEGMENTS + after, SEGMENTS + here], 1)]
    )
    fan = np.arange(1, SEGMENTS - 1)
    bottom = np.stack([np.zeros_like(fan), fan + 1, fan], 1)
    top = np.stack([np.zeros_like(fan), fan, fan + 1], 1) + SEGMENTS
    return _as_surface(np.concatenate(ends), np.concatenate([sides, bottom, top]))


def _as_surface(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Surface:
    return Surface(vertices.astype(np.float32), faces.astype(np.uint32))


def _joined(parts: list[tuple[NDArray[np.float64], NDArray[np.int64]]]) -> TriangleMesh:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [faces.astype(np.int64) + start for (_, faces), start in zip(parts, starts, strict=True)]
    return TriangleMesh(np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces))
