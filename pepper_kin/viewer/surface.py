"""Triangle surfaces to draw: read from files or made for shapes that meshcat has no primitive for."""

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
"""A mesh file with more colors is drawn in one."""
CREASE_ANGLE = np.deg2rad(35.0)
"""Edges that bend more than this are drawn sharp, all others smooth [rad]."""


@dataclass(frozen=True)
class DrawnSurface:
    """An indexed triangle surface; corners that meet at a sharp edge are separate vertices.

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
    """Read a mesh file, of any format that `collision.mesh_file` knows, as an indexed surface.

    Corners at the same place become one vertex unless a sharp edge runs between their triangles, so a viewer
    that averages normals per vertex shades round parts smoothly and keeps hard edges, and the data of an STL
    file shrinks to about a quarter.

    Args:
        path: The file.
        crease_angle: Largest angle between neighboring triangles that is drawn smooth [rad].

    Returns:
        The surface [m before scaling].

    Raises:
        FileFormatError: The file cannot be read, is cut short, holds no triangle or holds NaN or infinite
            coordinates.
    """
    vertices, faces = read_mesh(path)
    return _smooth_surface(path, vertices, faces, crease_angle)


def read_colored_surfaces(path: str | Path) -> tuple[tuple[DrawnSurface, FaceColor | None], ...]:
    """Read a mesh file as one surface for each color that it names; see `read_surface`.

    Returns:
        Surfaces and their colors: red, green, blue and opacity, 0 to 1. None for a file without colors.
    """
    vertices, faces, colors = read_colored_mesh(path)
    if not len(colors):
        return ((_smooth_surface(path, vertices, faces, CREASE_ANGLE), None),)
    kinds, places = np.unique(colors, axis=0, return_inverse=True)
    if len(kinds) > MOST_COLORS:  # painted corner by corner: one surface of the mean color
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
    """Give each vertex on a sharp edge one copy per smooth patch that meets there.

    Two corners at the same vertex belong together when their triangles share an edge at that vertex and bend
    by at most `crease_angle` across it; the patches are the connected components of that relation.

    Args:
        vertices: Positions [m before scaling], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        crease_angle: Largest bend that is smooth [rad].

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
    """Return the least node that each of `count` nodes is connected with, by edges from first to second.

    Each round lets the least of two joined nodes stand for what stood for both, and halves the ways there.

    Args:
        count: Number of nodes.
        first: Nodes where the E edges begin, shape (E,).
        second: Nodes where they end, shape (E,).

    Returns:
        Nodes, shape (count,).
    """
    least = np.arange(count)
    while (least[first] != least[second]).any():
        lower = np.minimum(least[first], least[second])
        for ends in (first, second):
            np.minimum.at(least, least[ends], lower)
        least = least[least]
    return least


def capsule_surface(radius: float, length: float, segments: int = 24, rings: int = 8) -> DrawnSurface:
    """Make a capsule around the z axis, centered at the origin.

    Args:
        radius: Radius of the tube and of its two half spheres [m].
        length: Length of the straight part [m].
        segments: Corners around the axis.
        rings: Steps from each pole to its equator.

    Returns:
        A closed surface whose vertices lie on the capsule.
    """
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 2 * rings + 1)
    latitude = np.insert(latitude[1:-1], rings - 1, 0.0)  # the equator twice: once per end of the tube
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
    """Make a little octahedron for each of many balls.

    Args:
        points: Centers, shape (k, 3) [m].
        radius: Distance of the corners from the center [m].
        most: Balls drawn at most; of more, every second, third, ... is drawn.

    Returns:
        One surface; without balls, a single point that shows nothing.
    """
    if not len(points):
        return DrawnSurface(np.zeros((3, 3), dtype=np.float32), np.array([[0, 1, 2]], dtype=np.uint32))
    centers = np.asarray(points)[:: -(-len(points) // most)]
    corners = radius * np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
    vertices = (centers[:, None, :] + corners).reshape(-1, 3).astype(np.float32)
    indices = (np.arange(len(centers))[:, None, None] * 6 + faces).reshape(-1, 3).astype(np.uint32)
    return DrawnSurface(vertices, indices)
