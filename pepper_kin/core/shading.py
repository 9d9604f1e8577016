"""Pictures from rays: the colors of the surfaces that rays hit, shaded by a directional light."""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.core.ray_casting import Hits
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Bytes2, Floats1, Floats2

LIGHT = (0.35, 0.45, 0.82)
"""Direction to the light in the world; it need not be normalized."""
TILES = ((0.78, 0.78, 0.76), (0.66, 0.66, 0.65))
"""Red, green and blue of the two tile colors of the floor, from 0 to 1."""

_TILE = 0.5  # side of a tile [m]
_AMBIENT, _DIFFUSE, _FRONTAL = 0.40, 0.45, 0.15
_HORIZON, _ZENITH = (0.86, 0.90, 0.95), (0.55, 0.70, 0.90)


class Surfaces(NamedTuple):
    """Surfaces that n rays hit.

    Attributes:
        distance: Distance [m], inf without a hit, shape (n,).
        normal: Unit normal against the ray; 0 without a hit, shape (n, 3).
        color: Red, green and blue from 0 to 1; 0 without a hit, shape (n, 3).
    """

    distance: Floats1
    normal: Floats2
    color: Floats2


@compiled("void(float64[:, ::1], float64[:, ::1], float64[:, ::1], float64[:, ::1])")
def place_rays(pose: Floats2, local: Floats2, origins: Floats2, directions: Floats2) -> None:
    """Write the rays from the origin of a frame in the world.

    Args:
        pose: transform_frame_to_world, shape (4, 4).
        local: Unit vectors in the frame, shape (n, 3).
        origins: Output: start points in the world, shape (n, 3) [m].
        directions: Output: unit vectors in the world, shape (n, 3).
    """
    for ray in range(local.shape[0]):
        x, y, z = local[ray, 0], local[ray, 1], local[ray, 2]
        for row in range(3):
            origins[ray, row] = pose[row, 3]
            directions[ray, row] = pose[row, 0] * x + pose[row, 1] * y + pose[row, 2] * z


@compiled("void(float64[:, ::1], float64[:, ::1], Hits, float64[:, ::1], int64, Surfaces)")
def paint(
    origins: Floats2, directions: Floats2, hits: Hits, colors: Floats2, floor: int, surfaces: Surfaces
) -> None:
    """Write distances and colors of rays that hit something; other rays are left unchanged.

    Args:
        origins: Start points of the rays, shape (n, 3) [m].
        directions: Unit vectors, shape (n, 3).
        hits: What each ray hit.
        colors: Color of each solid, red, green and blue from 0 to 1, shape (m, 3).
        floor: Index of the solid that is the tiled floor; -1 for none.
        surfaces: Output.
    """
    for ray in range(len(hits.solid)):
        item, t = hits.solid[ray], hits.distance[ray]
        if item < 0:
            continue
        surfaces.distance[ray] = t
        red, green, blue = colors[item, 0], colors[item, 1], colors[item, 2]
        if item == floor:
            column = math.floor((origins[ray, 0] + t * directions[ray, 0]) / _TILE)
            row = math.floor((origins[ray, 1] + t * directions[ray, 1]) / _TILE)
            if (column + row) % 2 == 1:
                red, green, blue = TILES[1]
        surfaces.color[ray, 0], surfaces.color[ray, 1], surfaces.color[ray, 2] = red, green, blue


@compiled("void(float64[:, ::1], Surfaces, uint8[:, ::1])")
def shade(directions: Floats2, surfaces: Surfaces, picture: Bytes2) -> None:
    """Write the pixel of each ray, 0 to 255: one directional light, no shadows, a pale sky.

    Args:
        directions: Unit vectors, shape (n, 3).
        surfaces: Surfaces that the rays hit.
        picture: Output: red, green and blue, shape (n, 3).
    """
    length = math.sqrt(LIGHT[0] ** 2 + LIGHT[1] ** 2 + LIGHT[2] ** 2)
    x, y, z = LIGHT[0] / length, LIGHT[1] / length, LIGHT[2] / length
    for ray in range(len(surfaces.distance)):
        if surfaces.distance[ray] < math.inf:
            a, b, c = surfaces.normal[ray, 0], surfaces.normal[ray, 1], surfaces.normal[ray, 2]
            frontal = -(a * directions[ray, 0] + b * directions[ray, 1] + c * directions[ray, 2])
            light = _AMBIENT + _DIFFUSE * max(a * x + b * y + c * z, 0.0) + _FRONTAL * frontal
            red, green = light * surfaces.color[ray, 0], light * surfaces.color[ray, 1]
            blue = light * surfaces.color[ray, 2]
        else:
            up = min(max(directions[ray, 2], 0.0), 1.0)
            red = (1.0 - up) * _HORIZON[0] + up * _ZENITH[0]
            green = (1.0 - up) * _HORIZON[1] + up * _ZENITH[1]
            blue = (1.0 - up) * _HORIZON[2] + up * _ZENITH[2]
        picture[ray, 0], picture[ray, 1], picture[ray, 2] = _level(red), _level(green), _level(blue)


@compiled
def _level(share: float) -> int:
    """Return a brightness from 0 to 1 as an integer from 0 to 255; values outside are clamped."""
    return int(255.0 * min(max(share, 0.0), 1.0) + 0.5)
