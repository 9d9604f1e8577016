"""Support functions of the positions that a frame reaches: lower bounds of how far a point is beyond reach.

The support function h(u) = max over q of u . p(q) of the points p that a frame reaches satisfies, behind a
joint with placement (R, t) and rotation R_j(theta), h(u) = u . t + max over theta of h'(R_j(theta)^T R^T u),
with h' of the frame relative to the joint's child.  It is stored at the points of a grid on the six faces of
the cube |v|_max = 1.  Support functions are convex and positively homogeneous (Rockafellar, Convex Analysis,
1970), so that interpolation, whose weights are positive and reproduce v, gives no less than h: all values
computed here are upper bounds, whatever the grid, and x is at least u . x - h(u) beyond reach for every unit
vector u.
"""

from __future__ import annotations

import math

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

CELLS = 48
"""Number of grid cells along an edge of a face."""

COARSE, WITHIN = 8, 0.1
"""Stride of the grid points that a point is compared with first, and depth inside the best of their planes
[m] beyond which the grid points around it are not tried."""

ARC = math.radians(2.0)
"""Maximum step of a joint's angle [rad]; the angles between two steps are bounded, too."""


@compiled(lean=True, inline=True)
def _grid(place: int) -> float:
    """Return the coordinate of a grid point on a face, -1 to 1."""
    return 2.0 * place / CELLS - 1.0


@compiled(lean=True)
def _write_direction(face: int, i: int, j: int, v: Floats1) -> None:
    """Write grid point (i, j) of a face, shape (>= 3,): +-1 along axis face // 2, i and j after it."""
    axis = face // 2
    v[axis] = 1.0 if face % 2 == 0 else -1.0
    v[(axis + 1) % 3] = _grid(i)
    v[(axis + 2) % 3] = _grid(j)


@compiled(lean=True)
def _at(heights: Floats2, x: float, y: float, z: float) -> float:
    """Return an upper bound of h at a vector; `heights` has shape (6 * (CELLS + 1), CELLS + 1)."""
    size = max(abs(x), abs(y), abs(z))
    if size == 0.0:
        return 0.0
    if abs(x) == size:
        face, a, b = (0 if x > 0 else 1), y / size, z / size
    elif abs(y) == size:
        face, a, b = (2 if y > 0 else 3), z / size, x / size
    else:
        face, a, b = (4 if z > 0 else 5), x / size, y / size
    a, b = 0.5 * CELLS * (a + 1.0), 0.5 * CELLS * (b + 1.0)
    i, j = min(int(a), CELLS - 1), min(int(b), CELLS - 1)
    a, b = a - i, b - j
    row = face * (CELLS + 1) + i
    low = (1.0 - b) * heights[row, j] + b * heights[row, j + 1]
    high = (1.0 - b) * heights[row + 1, j] + b * heights[row + 1, j + 1]
    return size * ((1.0 - a) * low + a * high)


@compiled("void(float64[::1], float64[:, ::1])")
def write_point(point: Floats1, heights: Floats2) -> None:
    """Write the support function of one point, shape (3,) [m], h(v) = v . point; shapes as in `add_joint`."""
    v = point.copy()
    for place in range(6 * (CELLS + 1)):
        for j in range(CELLS + 1):
            _write_direction(place // (CELLS + 1), place % (CELLS + 1), j, v)
            heights[place, j] = v[0] * point[0] + v[1] * point[1] + v[2] * point[2]


@compiled("void(float64[:, ::1], float64[::1], float64[::1], float64, boolean, float64[:, ::1])")
def add_joint(
    placement: Floats2, axis: Floats1, limits: Floats1, radius: float, slides: bool, heights: Floats2
) -> None:
    """Replace the support function of points in a joint's frame by that of their reach in the parent's frame.

    Between two angles that are d apart, w(theta) = R_j(theta)^T w is a combination of both ends with weights
    whose sum is at most s = 1 / cos(d / 2), less (s - 1) times its part along the axis; h is at most
    radius |w| at each.

    Args:
        placement: R and t [m] of the joint in its parent's frame, shape (3, 4).
        axis: Unit vector, shape (3,).
        limits: Minimum and maximum position [rad or m], shape (2,).
        radius: Bound on the distance of the frame from the joint's origin [m].
        slides: Whether the joint is prismatic.
        heights: Support function, shape (6 * (CELLS + 1), CELLS + 1) [m]; overwritten.
    """
    before, v = heights.copy(), axis.copy()
    span = limits[1] - limits[0]
    count = int(span / ARC) + 1
    arc = 0.0 if slides else span / count
    between = 2.0 * radius * (1.0 / math.cos(0.5 * arc) - 1.0)
    for place in range(6 * (CELLS + 1)):
        for j in range(CELLS + 1):
            _write_direction(place // (CELLS + 1), place % (CELLS + 1), j, v)
            size = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
            shift = v[0] * placement[0, 3] + v[1] * placement[1, 3] + v[2] * placement[2, 3]
            x = v[0] * placement[0, 0] + v[1] * placement[1, 0] + v[2] * placement[2, 0]
            y = v[0] * placement[0, 1] + v[1] * placement[1, 1] + v[2] * placement[2, 1]
            z = v[0] * placement[0, 2] + v[1] * placement[1, 2] + v[2] * placement[2, 2]
            along = x * axis[0] + y * axis[1] + z * axis[2]
            if slides:
                most = _at(before, x, y, z) + max(along * limits[0], along * limits[1])
            else:
                # w(theta) = along axis + cos(theta) p - sin(theta) (axis x p), p across the axis
                px, py, pz = x - along * axis[0], y - along * axis[1], z - along * axis[2]
                sx = axis[1] * pz - axis[2] * py
                sy = axis[2] * px - axis[0] * pz
                sz = axis[0] * py - axis[1] * px
                most = -math.inf
                for k in range(count + 1):
                    angle = limits[0] + k * arc
                    c, s = math.cos(angle), math.sin(angle)
                    most = max(
                        most,
                        _at(
                            before,
                            along * axis[0] + c * px - s * sx,
                            along * axis[1] + c * py - s * sy,
                            along * axis[2] + c * pz - s * sz,
                        ),
                    )
            heights[place, j] = shift + most + between * size


@compiled("void(float64[:, ::1], float64[:, ::1], float64[::1])")
def write_shortfalls(heights: Floats2, points: Floats2, shortfalls: Floats1) -> None:
    """Write a lower bound of how far each point is beyond reach [m], 0 where nothing is proven.

    Args:
        heights: Support function in the frame of the points, shape (6 * (CELLS + 1), CELLS + 1) [m].
        points: Points, shape (N, 3) [m].
        shortfalls: Output, shape (N,) [m].
    """
    v, side, count = np.empty(3), CELLS + 1, CELLS // COARSE + 1
    planes = np.empty((6 * count * count, 4))
    for k in range(len(planes)):
        row, column = (k // count // count) * side + COARSE * (k // count % count), COARSE * (k % count)
        _write_direction(row // side, row % side, column, v)
        size = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        for i in range(3):
            planes[k, i] = v[i] / size
        planes[k, 3] = heights[row, column] / size
    for p in range(points.shape[0]):
        x, y, z, most, best = points[p, 0], points[p, 1], points[p, 2], -math.inf, 0
        for k in range(len(planes)):
            beyond = planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z - planes[k, 3]
            if beyond > most:
                most, best = beyond, k
        face, i, j = best // count // count, COARSE * (best // count % count), COARSE * (best % count)
        for a in range(max(i - COARSE, 0), min(i + COARSE, CELLS) + 1 if most > -WITHIN else 0):
            for b in range(max(j - COARSE, 0), min(j + COARSE, CELLS) + 1):
                _write_direction(face, a, b, v)
                beyond = v[0] * x + v[1] * y + v[2] * z - heights[face * side + a, b]
                most = max(most, beyond / math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))
        shortfalls[p] = max(most, 0.0)
