"""Compiled: the nearest solid along each of many rays."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.twin.sensors.ray_shapes import (
    Vector,
    along,
    box,
    capsule,
    cylinder,
    dot,
    first_of,
    half_space,
    minus,
    nearest_of_triangle,
    rounded_triangle,
    sphere,
    triangle,
)
from pepper_kin.twin.sensors.ray_tree import DEPTH

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SPHERE, BOX, CYLINDER, CAPSULE, HALF_SPACE, TRIANGLES, BALLS = range(7)


class Solids(NamedTuple):
    """Solids laid out for compiled code.

    Attributes:
        kind: SPHERE ... BALLS, shape (m,).
        size: Radius and half length, half lengths, offset, or padding, shape (m, 3).
        start: Of triangles and balls, the place of the root in `node_box` and of the first in `parts`,
            shape (m, 2).
        node_box: Nodes of the trees of all meshes and clouds, shape (k, 6).
        node_link: See `build_tree`, shape (k, 2); places count from the solid's own first.
        parts: A corner and two sides of each triangle, or the centre of each ball and zeros, shape (p, 9).
    """

    kind: Indices
    size: Array
    start: Indices
    node_box: Array
    node_link: Indices
    parts: Array


class Placed(NamedTuple):
    """Where the solids are.

    Attributes:
        pose: transform_solid_to_world, shape (m, 4, 4).
        top_box: Tree of the boxes around the bounded solids, in the world, shape (k, 6).
        top_link: Its links, shape (k, 2).
        top_order: The solids in its order, shape (b,).
        endless: The half-spaces, shape (h,).
    """

    pose: Array
    top_box: Array
    top_link: Indices
    top_order: Indices
    endless: Indices


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_hits(
    origins: Array, directions: Array, most: Array, solids: Solids, placed: Placed
) -> tuple[Array, Indices, Indices]:
    """Return the first surface along each ray.

    Args:
        origins: Where the rays start, shape (n, 3) [m].
        directions: Unit vectors, shape (n, 3).
        most: Nothing beyond this distance counts, shape (n,) [m].
        solids: What may be hit.
        placed: Where it is.

    Returns:
        Distances [m], inf without a hit; the solids, -1 without a hit; the triangles or balls; shape (n,).
    """
    count = origins.shape[0]
    distance, solid = np.full(count, np.inf), np.full(count, -1, dtype=np.int64)
    part = np.zeros(count, dtype=np.int64)
    above, below = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH, dtype=np.int64)
    for ray in range(count):
        o = (origins[ray, 0], origins[ray, 1], origins[ray, 2])
        d = (directions[ray, 0], directions[ray, 1], directions[ray, 2])
        best = most[ray]
        for k in range(placed.endless.shape[0]):
            item = placed.endless[k]
            local_o, local_d = _local(placed.pose[item], o, d)
            t = half_space(local_o, local_d, solids.size[item, 0])
            if t <= best and t < math.inf:
                best = distance[ray] = t
                solid[ray] = item
        if placed.top_box.shape[0] == 0:
            continue
        inverse = _inverse(d)
        if _enters(placed.top_box[0], o, inverse, best) == math.inf:
            continue
        above[0], height = 0, 1
        while height > 0:
            height -= 1
            node = above[height]
            if _enters(placed.top_box[node], o, inverse, best) == math.inf:
                continue
            first, number = placed.top_link[node, 0], placed.top_link[node, 1]
            if number == 0:
                height = _push(placed.top_box, first, 0, o, inverse, best, above, height)
                continue
            for place in range(first, first + number):
                item = placed.top_order[place]
                local_o, local_d = _local(placed.pose[item], o, d)
                t, which = _hit(solids, item, local_o, local_d, best, below)
                if t <= best and t < math.inf:
                    best = distance[ray] = t
                    solid[ray], part[ray] = item, which
    return distance, solid, part


@njit(cache=True, nogil=True, error_model="numpy")
def _local(pose: Array, o: Vector, d: Vector) -> tuple[Vector, Vector]:
    """Return a ray in the coordinates of a solid."""
    x, y, z = o[0] - pose[0, 3], o[1] - pose[1, 3], o[2] - pose[2, 3]
    turned_o = (
        pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z,
        pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z,
        pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z,
    )
    turned_d = (
        pose[0, 0] * d[0] + pose[1, 0] * d[1] + pose[2, 0] * d[2],
        pose[0, 1] * d[0] + pose[1, 1] * d[1] + pose[2, 1] * d[2],
        pose[0, 2] * d[0] + pose[1, 2] * d[1] + pose[2, 2] * d[2],
    )
    return turned_o, turned_d


@njit(cache=True, nogil=True, error_model="numpy")
def _inverse(d: Vector) -> Vector:
    """Return 1 / d; a zero becomes so small that its product with a length is huge and never NaN."""
    tiny = 1e-300
    return (
        1.0 / (d[0] if abs(d[0]) > tiny else tiny),
        1.0 / (d[1] if abs(d[1]) > tiny else tiny),
        1.0 / (d[2] if abs(d[2]) > tiny else tiny),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _enters(room: Array, o: Vector, inverse: Vector, best: float) -> float:
    """Return the distance at which a ray enters a box (0 from inside), or inf if not before `best`."""
    enter, leave = 0.0, best
    a, b = (room[0] - o[0]) * inverse[0], (room[3] - o[0]) * inverse[0]
    enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    a, b = (room[1] - o[1]) * inverse[1], (room[4] - o[1]) * inverse[1]
    enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    a, b = (room[2] - o[2]) * inverse[2], (room[5] - o[2]) * inverse[2]
    enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    # Rounding must not lose a box that is flat along the ray.
    return enter if enter <= leave * (1.0 + 1e-12) + 1e-12 else math.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _push(
    boxes: Array, child: int, root: int, o: Vector, inverse: Vector, best: float, stack: Indices, height: int
) -> int:
    """Put the two children of a node on the stack, the nearer on top; return the stack's height."""
    left = _enters(boxes[root + child], o, inverse, best)
    right = _enters(boxes[root + child + 1], o, inverse, best)
    near, far, near_child, far_child = left, right, child, child + 1
    if right < left:
        near, far, near_child, far_child = right, left, child + 1, child
    if far < math.inf:
        stack[height] = far_child
        height += 1
    if near < math.inf:
        stack[height] = near_child
        height += 1
    return height


@njit(cache=True, nogil=True, error_model="numpy")
def _hit(solids: Solids, item: int, o: Vector, d: Vector, best: float, stack: Indices) -> tuple[float, int]:
    """Return the distance to a solid, inf if not before `best`, and which of its parts is hit."""
    kind = solids.kind[item]
    a, b, c = solids.size[item, 0], solids.size[item, 1], solids.size[item, 2]
    if kind == SPHERE:
        return first_of(sphere(o, d, (0.0, 0.0, 0.0), a)), 0
    if kind == BOX:
        return first_of(box(o, d, (a, b, c))), 0
    if kind == CYLINDER:
        return first_of(cylinder(o, d, a, b)), 0
    if kind == CAPSULE:
        return first_of(capsule(o, d, a, b)), 0
    root, begin = solids.start[item, 0], solids.start[item, 1]
    inverse, found, which = _inverse(d), math.inf, 0
    stack[0], height = 0, 1
    while height > 0:
        height -= 1
        node = root + stack[height]
        if _enters(solids.node_box[node], o, inverse, best) == math.inf:
            continue
        first, number = solids.node_link[node, 0], solids.node_link[node, 1]
        if number == 0:
            height = _push(solids.node_box, first, root, o, inverse, best, stack, height)
            continue
        for place in range(begin + first, begin + first + number):
            t = _part(solids.parts[place], kind, a, o, d)
            if t <= best and t < math.inf:
                best = found = t
                which = place
    return found, which


@njit(cache=True, nogil=True, error_model="numpy")
def _part(numbers: Array, kind: int, padding: float, o: Vector, d: Vector) -> float:
    """Return the distance to a triangle or ball, or inf."""
    corner = (numbers[0], numbers[1], numbers[2])
    if kind == BALLS:
        return first_of(sphere(o, d, corner, padding))
    e, f = (numbers[3], numbers[4], numbers[5]), (numbers[6], numbers[7], numbers[8])
    if padding > 0.0:
        return first_of(rounded_triangle(o, d, corner, e, f, padding))
    return triangle(o, d, corner, e, f)


@njit(cache=True, nogil=True, error_model="numpy")
def normals_at(
    origins: Array,
    directions: Array,
    distance: Array,
    solid: Indices,
    part: Indices,
    solids: Solids,
    pose: Array,
) -> Array:
    """Return the unit normals where rays hit, against the ray, in the world, shape (n, 3); else 0."""
    result = np.zeros((origins.shape[0], 3))
    for ray in range(origins.shape[0]):
        item = solid[ray]
        if item < 0:
            continue
        o = (origins[ray, 0], origins[ray, 1], origins[ray, 2])
        d = (directions[ray, 0], directions[ray, 1], directions[ray, 2])
        local_o, local_d = _local(pose[item], o, d)
        n = _normal(solids, item, part[ray], along(local_o, local_d, distance[ray]))
        length = math.sqrt(dot(n, n))
        if length == 0.0:
            n, length = local_d, 1.0
        sign = -1.0 / length if dot(n, local_d) > 0.0 else 1.0 / length
        for row in range(3):
            turned = pose[item, row, 0] * n[0] + pose[item, row, 1] * n[1] + pose[item, row, 2] * n[2]
            result[ray, row] = sign * turned
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def _normal(solids: Solids, item: int, part: int, p: Vector) -> Vector:
    """Return a normal of any length at a point of a solid's surface, in its coordinates."""
    kind = solids.kind[item]
    a, b, c = solids.size[item, 0], solids.size[item, 1], solids.size[item, 2]
    if kind == SPHERE:
        return p
    if kind == BOX:
        x, y, z = a - abs(p[0]), b - abs(p[1]), c - abs(p[2])
        if x <= y and x <= z:
            return (p[0], 0.0, 0.0)
        return (0.0, p[1], 0.0) if y <= z else (0.0, 0.0, p[2])
    if kind == CYLINDER:
        on_side = a - math.sqrt(p[0] * p[0] + p[1] * p[1]) <= b - abs(p[2])
        return (p[0], p[1], 0.0) if on_side else (0.0, 0.0, p[2])
    if kind == CAPSULE:
        return (p[0], p[1], p[2] - min(max(p[2], -b), b))
    if kind == HALF_SPACE:
        return (0.0, 0.0, 1.0)
    numbers = solids.parts[part]
    corner = (numbers[0], numbers[1], numbers[2])
    if kind == BALLS:
        return minus(p, corner)
    e, f = (numbers[3], numbers[4], numbers[5]), (numbers[6], numbers[7], numbers[8])
    if a > 0.0:
        return minus(p, nearest_of_triangle(p, corner, e, f))
    return (e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0])
