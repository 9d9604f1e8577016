"""Triangle surfaces to draw, from files or for shapes without a primitive in meshcat."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.mesh_file import read_colored_mesh, read_mesh, unique_rows
from pepper_kin.exceptions import FileFormatError

FaceColor: TypeAlias = tuple[float, float, float, float]
MOST_COLORS = 64
"""Maximum number of colors of a mesh file; a file with more is drawn in its mean color."""
CREASE_ANGLE = np.deg2rad(35.0)
"""Crease angle: edges with a larger angle are drawn sharp, all others smooth [rad]."""


@dataclass(frozen=True)
class DrawnSurface:
    """An indexed triangle surface; corners at a sharp edge are separate vertices.

    Attributes:
        vertices: Positions, shape (V, 3) [m before scaling], float32.
        faces: Vertex indices of each triangle, counter-clockwise seen from outside, shape (F, 3), uint32.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]

    def __post_init__(self) -> None:
        vertices = np.array(self.vertices, dtype=np.float32)
        faces = np.array(self.faces, dtype=np.uint32)
        vertices.flags.writeable = faces.flags.writeable = False
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)


def read_surface(path: str | Path, crease_angle: float = CREASE_ANGLE) -> DrawnSurface:
    """Read a mesh file of any format of `collision.mesh_file` as an indexed surface.

    Corners at the same position become one vertex unless a sharp edge is between their triangles, so a viewer
    that averages normals per vertex shades round parts smoothly and keeps sharp edges, and the data of an STL
    file shrinks to about a quarter.

    Args:
        path: Mesh file.
        crease_angle: Largest angle between neighboring triangles that are shaded smoothly [rad].

    Returns:
        The surface [m before scaling].

    Raises:
        FileFormatError: The file cannot be read, is truncated, has no triangle, or has NaN or infinite
            coordinates.
    """
    vertices, faces = read_mesh(path)
    return _smooth_surface(path, vertices, faces, crease_angle)


def read_colored_surfaces(path: str | Path) -> tuple[tuple[DrawnSurface, FaceColor | None], ...]:
    """Read a mesh file as one surface for each of its colors; see `read_surface`.

    Returns:
        Surfaces with red, green, blue and opacity, 0 to 1; the color is None for a file without colors.
    """
    vertices, faces, colors = read_colored_mesh(path)
    if not len(colors):
        return ((_smooth_surface(path, vertices, faces, CREASE_ANGLE), None),)
    kinds, places = np.unique(colors, axis=0, return_inverse=True)
    if len(kinds) > MOST_COLORS:  # colored by vertex: one surface of the mean color
        kinds, places = colors.mean(axis=0)[None], np.zeros(len(faces), int)
    surfaces = []
    for index, (red, green, blue, opacity) in enumerate((kinds / 255.0).tolist()):
        part = _smooth_surface(path, vertices, faces[places.ravel() == index], CREASE_ANGLE)
        surfaces.append((part, (red, green, blue, opacity)))
    return tuple(surfaces)


def _smooth_surface(
    path: str | Path, vertices: NDArray[np.float64], faces: NDArray[np.int64], crease_angle: float
) -> DrawnSurface:
    """Return the surface of vertices [m before scaling], shape (V, 3), and faces, shape (F, 3)."""
    places, indices = unique_rows(vertices.astype(np.float32))
    faces = indices[faces]
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    if flat.all():
        raise FileFormatError(path, "the mesh holds no triangle")
    return split_at_creases(places, faces[~flat], crease_angle)


def split_at_creases(vertices: NDArray[Any], faces: NDArray[Any], crease_angle: float) -> DrawnSurface:
    """Duplicate each vertex on a sharp edge, with one copy per adjacent smooth patch.

    Two corners at a vertex belong to one patch if their triangles share an edge at that vertex and bend
    by at most `crease_angle` across it; the patches are the connected components of that relation.

    Args:
        vertices: Positions [m before scaling], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        crease_angle: Largest smooth angle between triangles [rad].

    Returns:
        The surface with the same triangles in the same order.
    """
    triangles = np.asarray(vertices, dtype=float)[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)

    # Corner 3 f + k is corner k of face f; edge k runs from corner k to corner k + 1.
    corner = np.arange(faces.size).reshape(-1, 3)
    start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    vertex = faces.ravel()
    swap = vertex[start] > vertex[end]
    low, high = np.where(swap, end, start), np.where(swap, start, end)
    order = np.lexsort((vertex[high], vertex[low]))
    low, high = low[order], high[order]
    same_edge = (vertex[low][1:] == vertex[low][:-1]) & (vertex[high][1:] == vertex[high][:-1])
    bend = np.einsum("ij,ij->i", normals[low[1:] // 3], normals[low[:-1] // 3])
    smooth = same_edge & (bend >= np.cos(crease_angle))
    rows = np.concatenate([low[1:][smooth], high[1:][smooth]])
    columns = np.concatenate([low[:-1][smooth], high[:-1][smooth]])
    firsts, patch = np.unique(_least_connected(faces.size, rows, columns), return_inverse=True)
    source = vertex[firsts]
    return DrawnSurface(np.asarray(vertices)[source], patch.reshape(-1, 3).astype(np.uint32))


def _least_connected(count: int, first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
    """Return the smallest node in the connected component of each node, by edges from first to second.

    Each round joins the representatives of connected nodes to the smaller one, and halves the paths to it.

    Args:
        count: Number of nodes.
        first: Start nodes of the E edges, shape (E,).
        second: End nodes of the edges, shape (E,).

    Returns:
        Smallest connected node of each node, shape (count,).
    """
    least = np.arange(count)
    while (least[first] != least[second]).any():
        lower = np.minimum(least[first], least[second])
        for ends in (first, second):
            np.minimum.at(least, least[ends], lower)
        least = least[least]
    return least


def capsule_surface(radius: float, length: float, segments: int = 24, rings: int = 8) -> DrawnSurface:
    """Create a capsule along the z axis, centered at the origin.

    Args:
        radius: Radius of the cylinder and its two hemispheres [m].
        length: Length of the cylinder [m].
        segments: Number of vertices around the axis.
        rings: Number of steps from each pole to its equator.

    Returns:
        A closed surface whose vertices lie on the capsule.
    """
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 2 * rings + 1)
    latitude = np.insert(latitude[1:-1], rings - 1, 0.0)  # the equator twice: once per end of the cylinder
    offset = np.where(np.arange(2 * rings) < rings, -length / 2, length / 2)
    longitude = np.arange(segments) * (2 * np.pi / segments)
    ring = np.stack(
        np.broadcast_arrays(
            radius * np.cos(latitude)[:, None] * np.cos(longitude),
            radius * np.cos(latitude)[:, None] * np.sin(longitude),
            (radius * np.sin(latitude) + offset)[:, None],
        ),
        axis=-1,
    ).reshape(-1, 3)
    poles = np.array([[0.0, 0.0, -length / 2 - radius], [0.0, 0.0, length / 2 + radius]])
    here = np.arange(segments)
    after = np.roll(here, -1)
    last = (2 * rings - 1) * segments
    south, north = 2 * rings * segments, 2 * rings * segments + 1
    faces = [np.stack([np.full(segments, south), after, here], axis=1)]
    for first in range(0, last, segments):
        faces.append(np.stack([first + here, first + after, first + segments + after], axis=1))
        faces.append(np.stack([first + here, first + segments + after, first + segments + here], axis=1))
    faces.append(np.stack([np.full(segments, north), last + here, last + after], axis=1))
    return DrawnSurface(np.concatenate([ring, poles]), np.concatenate(faces))


def balls_surface(points: NDArray[Any], radius: float, most: int = 40_000) -> DrawnSurface:
    """Create a small octahedron for each of many spheres.

    Args:
        points: Centers, shape (k, 3) [m].
        radius: Distance of the vertices from the center [m].
        most: Maximum number of spheres; of more, every second, third, ... is drawn.

    Returns:
        One surface; without points, a degenerate triangle that is invisible.
    """
    if not len(points):
        return DrawnSurface(np.zeros((3, 3), dtype=np.float32), np.array([[0, 1, 2]], dtype=np.uint32))
    centers = np.asarray(points)[:: -(-len(points) // most)]
    corners = radius * np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    vertices = (centers[:, None, :] + corners).reshape(-1, 3).astype(np.float32)
    indices = (np.arange(len(centers))[:, None, None] * 6 + faces).reshape(-1, 3).astype(np.uint32)
    return DrawnSurface(vertices, indices)
