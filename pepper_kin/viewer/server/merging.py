"""Merging of shapes: shapes that move together and have one color are drawn as one surface.

Every drawn object costs a page time, most of all with software rendering.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import Box, Capsule, Cylinder, Mesh, PepperModel, Shape, Sphere
from pepper_kin.viewer.drawable import Color, Drawable, colored_surfaces_of
from pepper_kin.viewer.surface import (
    CREASE_ANGLE,
    DrawnSurface,
    capsule_surface,
    read_surface,
    split_at_creases,
)

SEGMENTS, RINGS = 12, 3
"""Vertices around a round shape, and steps from its pole to its equator: enough for translucent shapes."""

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
    """Merge shapes to one drawable for each moving body and color.

    Args:
        pepper: Model of the robot.
        shapes: Shapes on the robot's links.
        color: Color of all shapes; None for their own colors.
        segments: Number of vertices around a round shape.
        rings: Number of steps from its pole to its equator.
    """
    carriers = carriers_of(pepper)
    surfaces: dict[Path, DrawnSurface] = {}
    groups: dict[tuple[str, Color], list[tuple[NDArray[np.float64], NDArray[np.int64]]]] = {}
    for shape in shapes:
        carrier, transform_link_to_carrier = carriers[shape.link]
        pose = transform_link_to_carrier @ shape.transform_shape_to_link
        parts = colored_surfaces_of(shape)
        if parts is None:
            surface, scale = _surface(shape, surfaces, segments, rings)
            parts = (
                (DrawnSurface((surface.vertices * scale).astype(np.float32), surface.faces), shape.color),
            )
        for part, own in parts:
            vertices = part.vertices @ pose[:3, :3].T + pose[:3, 3]
            groups.setdefault((carrier, color or own), []).append((vertices, np.asarray(part.faces)))
    return tuple(
        Drawable(f"part {index}", carrier, _joined(parts), np.eye(4), tint)
        for index, ((carrier, tint), parts) in enumerate(groups.items())
    )


def carriers_of(pepper: PepperModel) -> dict[str, tuple[str, NDArray[np.float64]]]:
    """Map each link to its carrier, the first link that moves with it, and the link's pose in the carrier."""
    model, found = pepper.inner_model, {}
    first: dict[int, tuple[str, Any]] = {}
    for name in pepper.frame_names:
        frame = model.frames[pepper.frame_id(name)]
        carrier, placement = first.setdefault(frame.parentJoint, (name, frame.placement))
        found[name] = (carrier, np.asarray((placement.inverse() * frame.placement).homogeneous))
    return found


def _surface(
    shape: Shape, surfaces: dict[Path, DrawnSurface], segments: int, rings: int
) -> tuple[DrawnSurface, NDArray[np.float64]]:
    """Return the surface of a shape's geometry, and its scale, shape (3,)."""
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
                surfaces[path] = read_surface(path)
            return surfaces[path], np.broadcast_to(np.asarray(geometry.scale, dtype=float), 3)
    raise AssertionError("links have no other geometry")


def _cylinder(cylinder: Cylinder, segments: int) -> DrawnSurface:
    """Return the surface of a cylinder along z."""
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


def _as_surface(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> DrawnSurface:
    """Return the surface of vertices [m], shape (V, 3), and faces, shape (F, 3)."""
    return DrawnSurface(vertices.astype(np.float32), faces.astype(np.uint32))


def _joined(parts: list[tuple[NDArray[np.float64], NDArray[np.int64]]]) -> DrawnSurface:
    """Join parts, each of vertices [m], shape (V, 3), and faces, shape (F, 3), to one surface."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    faces = [faces.astype(np.int64) + start for (_, faces), start in zip(parts, starts, strict=True)]
    return _as_surface(np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces))
