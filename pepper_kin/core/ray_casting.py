"""Ray casting: the nearest solid along each of many rays, by trees of boxes over solids and their parts.

Each function of a convex solid takes a point o of a line and its unit direction d in the solid's own frame
and returns the interval of t for which o + t d lies in the solid; an empty interval is (inf, -inf).
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1, Ints2

Vector: TypeAlias = tuple[float, float, float]
Interval: TypeAlias = tuple[float, float]

SPHERE, BOX, CYLINDER, CAPSULE, HALF_SPACE, TRIANGLES, BALLS = range(7)
DEPTH = 128
"""Maximum depth of a tree, which is the size of a traversal's stack."""
_MEDIAN_BELOW = 48  # depth beyond which nodes are split at the median, so that at most 64 levels follow
_BINS = 12
_HAIR = 1e-12  # margin of boxes, [m] and relative to the coordinates
_PARALLEL = 1e-14


class Solids(NamedTuple):
    """Solids in tables for compiled code.

    Attributes:
        kind: SPHERE ... BALLS, shape (m,).
        size: Radius and half length, half lengths, offset, or padding, shape (m, 3) [m].
        start: For triangles and spheres of a cloud, the index of the root in `node_box` and of the first part
            in `parts`, shape (m, 2).
        node_box: Nodes of the trees of all meshes and clouds, shape (k, 6).
        node_link: Links of the nodes, see `build_tree`, relative to the solid's first, shape (k, 2).
        parts: A corner and two sides of each triangle, or the center of each sphere and zeros, shape (p, 9).
    """

    kind: Ints1
    size: Floats2
    start: Ints2
    node_box: Floats2
    node_link: Ints2
    parts: Floats2


class Placed(NamedTuple):
    """Poses of the solids, and the tree over them.

    Attributes:
        pose: transform_solid_to_world, shape (m, 4, 4).
        top_box: Tree of the boxes around the b bounded solids, in the world, shape (2 b - 1, 6); see
            `place_solids`.
        top_link: Links of the tree, shape (2 b - 1, 2).
        top_order: Indices of the solids in the tree's order, shape (b,).
        endless: Indices of the half-spaces, shape (h,).
    """

    pose: Floats3
    top_box: Floats2
    top_link: Ints2
    top_order: Ints1
    endless: Ints1


def unplaced(count: int, bounded: Ints1, endless: Ints1) -> Placed:
    """Return arrays for poses of solids; indices of bounded ones, shape (b,), half-spaces, shape (h,)."""
    nodes = max(2 * len(bounded) - 1, 0)
    return Placed(
        np.empty((count, 4, 4)), np.empty((nodes, 6)), np.zeros((nodes, 2), np.int64), bounded.copy(), endless
    )


class Hits(NamedTuple):
    """The first hit of each of n rays.

    Attributes:
        distance: Distance [m], inf without a hit, shape (n,).
        solid: Index of the solid, -1 without a hit, shape (n,).
        part: Index of the solid's triangle or sphere, shape (n,).
    """

    distance: Floats1
    solid: Ints1
    part: Ints1


@compiled("void(float64[:, ::1], float64[:, ::1], float64[::1], Solids, Placed, Hits)")
def nearest_hits(
    origins: Floats2, directions: Floats2, most: Floats1, solids: Solids, placed: Placed, hits: Hits
) -> None:
    """Find the first surface along each ray.

    Args:
        origins: Start points of the rays, shape (n, 3) [m].
        directions: Unit vectors, shape (n, 3).
        most: Maximum distance of each ray, shape (n,) [m].
        solids: The solids.
        placed: Poses of the solids.
        hits: Output.
    """
    distance, solid, part = hits
    for ray in range(len(distance)):
        distance[ray], solid[ray], part[ray] = np.inf, -1, 0
    above, below = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH, dtype=np.int64)
    for ray in range(len(distance)):
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


@compiled
def _local(pose: Floats2, o: Vector, d: Vector) -> tuple[Vector, Vector]:
    """Return a ray of the world in the frame of a solid whose pose has shape (4, 4)."""
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


@compiled
def _inverse(d: Vector) -> Vector:
    """Return 1 / d; zeros are replaced by a tiny number, so that no product with a length is NaN."""
    tiny = 1e-300
    return (
        1.0 / (d[0] if abs(d[0]) > tiny else tiny),
        1.0 / (d[1] if abs(d[1]) > tiny else tiny),
        1.0 / (d[2] if abs(d[2]) > tiny else tiny),
    )


@compiled
def _enters(box: Floats1, o: Vector, inverse: Vector, best: float) -> float:
    """Return the distance to a box, shape (6,) [m], 0 from inside; inf if the ray enters after `best`."""
    enter, leave = 0.0, best
    a, b = (box[0] - o[0]) * inverse[0], (box[3] - o[0]) * inverse[0]
    enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    a, b = (box[1] - o[1]) * inverse[1], (box[4] - o[1]) * inverse[1]
    enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    a, b = (box[2] - o[2]) * inverse[2], (box[5] - o[2]) * inverse[2]
    enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    # Rounding must not lose a box that is flat along the ray.
    return enter if enter <= leave * (1.0 + 1e-12) + 1e-12 else math.inf


@compiled
def _push(
    boxes: Floats2, child: int, root: int, o: Vector, inverse: Vector, best: float, stack: Ints1, height: int
) -> int:
    """Push both children of a node, boxes of shape (k, 6), on a stack, nearer on top; return its height."""
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


@compiled
def _hit(solids: Solids, item: int, o: Vector, d: Vector, best: float, stack: Ints1) -> tuple[float, int]:
    """Return the distance to a solid, inf if beyond `best`, and its part; stack of shape (DEPTH,)."""
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


@compiled
def _part(numbers: Floats1, kind: int, padding: float, o: Vector, d: Vector) -> float:
    """Return the distance to a triangle or sphere, numbers of shape (9,), or inf without a hit [m]."""
    corner = (numbers[0], numbers[1], numbers[2])
    if kind == BALLS:
        return first_of(sphere(o, d, corner, padding))
    e, f = (numbers[3], numbers[4], numbers[5]), (numbers[6], numbers[7], numbers[8])
    if padding > 0.0:
        return first_of(rounded_triangle(o, d, corner, e, f, padding))
    return triangle(o, d, corner, e, f)


@compiled("void(float64[:, ::1], float64[:, ::1], Hits, Solids, float64[:, :, ::1], float64[:, ::1])")
def normals_at(
    origins: Floats2, directions: Floats2, hits: Hits, solids: Solids, pose: Floats3, result: Floats2
) -> None:
    """Write the unit normals at the hits, against the ray, in the world, shape (n, 3); rays without are kept.

    Rays and hits are those of `nearest_hits`; `pose` is `Placed.pose`, shape (m, 4, 4).
    """
    distance, solid, part = hits
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


@compiled
def _normal(solids: Solids, item: int, part: int, p: Vector) -> Vector:
    """Return a normal, not normalized, at a point of a solid's surface, in the solid's frame."""
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


class BoxTree(NamedTuple):
    """A binary tree of boxes over m items, with at most 2 m - 1 nodes.

    Attributes:
        box: Boxes of the nodes, shape (k, 6).
        link: First child (the second follows it) and 0, or for a leaf the offset in `order` and the number of
            items, shape (k, 2).
        order: Indices of the items, shape (m,).
    """

    box: Floats2
    link: Ints2
    order: Ints1


def box_tree(boxes: Floats2, leaf: int) -> BoxTree:
    """Return a tree over boxes, shape (m, 6); see `build_tree`."""
    count = len(boxes)
    tree = BoxTree(
        np.empty((2 * count - 1, 6)), np.zeros((2 * count - 1, 2), np.int64), np.zeros(count, np.int64)
    )
    used = build_tree(np.ascontiguousarray(boxes, dtype=np.float64), leaf, tree)
    return BoxTree(tree.box[:used], tree.link[:used], tree.order)


@compiled("int64(float64[:, ::1], int64, BoxTree)")
def build_tree(boxes: Floats2, leaf: int, tree: BoxTree) -> int:
    """Write a binary tree of boxes, split by the surface area heuristic; return the number of nodes.

    Wald, On fast construction of SAH-based bounding volume hierarchies (2007): bins along the longest axis.

    Args:
        boxes: Minimum corner, then maximum corner of each item, shape (m, 6) [m], m > 0.
        leaf: Maximum number of items in a leaf.
        tree: Output, with 2 m - 1 rows.

    Returns:
        Number of nodes.
    """
    count = boxes.shape[0]
    node_box, link, order = tree
    depth = np.zeros(2 * count - 1, dtype=np.int64)
    for k in range(count):
        order[k] = k
    link[0, 0] = 0
    link[0, 1] = count
    used, next_node = 1, 0
    while next_node < used:
        node = next_node
        next_node += 1
        first, number = link[node, 0], link[node, 1]
        _enclose(boxes, order, first, number, node_box[node])
        if number <= leaf:
            continue
        middle = first + number // 2
        if depth[node] < _MEDIAN_BELOW:
            middle = _split(boxes, order, first, number)
        link[used, 0], link[used, 1] = first, middle - first
        link[used + 1, 0], link[used + 1, 1] = middle, first + number - middle
        link[node, 0], link[node, 1] = used, 0
        depth[used] = depth[used + 1] = depth[node] + 1
        used += 2
    return used


@compiled("void(float64[:, ::1], int64[::1], int64, Placed)")
def place_solids(bounds: Floats2, bounded: Ints1, leaf: int, placed: Placed) -> None:
    """Write the tree of boxes around the placed solids.

    Args:
        bounds: Box around each solid in its own frame, minimum corner, then maximum, shape (m, 6) [m].
        bounded: Indices of the solids with finite boxes, shape (b,).
        leaf: Maximum number of solids in a leaf.
        placed: Poses of the solids; its tree is output.
    """
    count = bounded.shape[0]
    if count == 0:
        return
    boxes = np.empty((count, 6))
    for place in range(count):
        item = bounded[place]
        pose, bound = placed.pose[item], bounds[item]
        for i in range(3):
            middle, half = pose[i, 3], 0.0
            for k in range(3):
                middle += pose[i, k] * (0.5 * (bound[k] + bound[3 + k]))
                half += abs(pose[i, k]) * (0.5 * (bound[3 + k] - bound[k]))
            boxes[place, i], boxes[place, 3 + i] = middle - half, middle + half
    build_tree(boxes, leaf, BoxTree(placed.top_box, placed.top_link, placed.top_order))
    for place in range(count):
        placed.top_order[place] = bounded[placed.top_order[place]]


@compiled
def _enclose(boxes: Floats2, order: Ints1, first: int, number: int, out: Floats1) -> None:
    """Write the box, shape (6,), around some boxes, shape (m, 6), with a margin for rays along a face."""
    for axis in range(3):
        out[axis], out[axis + 3] = np.inf, -np.inf
    for place in range(first, first + number):
        thing = order[place]
        for axis in range(3):
            out[axis] = min(out[axis], boxes[thing, axis])
            out[axis + 3] = max(out[axis + 3], boxes[thing, axis + 3])
    for axis in range(3):
        out[axis] -= _HAIR * (1.0 + abs(out[axis]))
        out[axis + 3] += _HAIR * (1.0 + abs(out[axis + 3]))


@compiled
def _split(boxes: Floats2, order: Ints1, first: int, number: int) -> int:
    """Reorder indices, shape (m,), of boxes, shape (m, 6), into two parts; return the second's offset."""
    axis, low, high = 0, 0.0, -1.0
    for candidate in range(3):
        least, greatest = np.inf, -np.inf
        for place in range(first, first + number):
            middle = boxes[order[place], candidate] + boxes[order[place], candidate + 3]
            least, greatest = min(least, middle), max(greatest, middle)
        if greatest - least > high - low:
            axis, low, high = candidate, least, greatest
    if not high > low:
        return int(first + number // 2)
    scale = _BINS / (high - low) * (1.0 - 1e-9)
    border = _best_border(boxes, order, first, number, axis, low, scale)
    left, right = first, first + number - 1
    while left <= right:
        middle = boxes[order[left], axis] + boxes[order[left], axis + 3]
        if int((middle - low) * scale) < border:
            left += 1
        else:
            order[left], order[right] = order[right], order[left]
            right -= 1
    if left in (first, first + number):  # rounding: all are in one bin
        return int(first + number // 2)
    return int(left)


@compiled
def _best_border(
    boxes: Floats2, order: Ints1, first: int, number: int, axis: int, low: float, scale: float
) -> int:
    """Return the bin at which to split boxes, shape (m, 6): minimum sum of surface times number."""
    inside = np.zeros(_BINS, dtype=np.int64)
    bins = np.empty((_BINS, 6))
    for b in range(_BINS):
        _clear(bins[b])
    for place in range(first, first + number):
        thing = order[place]
        b = int((boxes[thing, axis] + boxes[thing, axis + 3] - low) * scale)
        inside[b] += 1
        for k in range(3):
            bins[b, k] = min(bins[b, k], boxes[thing, k])
            bins[b, k + 3] = max(bins[b, k + 3], boxes[thing, k + 3])
    after = np.zeros(_BINS)
    grown, total = np.empty(6), 0
    _clear(grown)
    for b in range(_BINS - 1, 0, -1):
        total += inside[b]
        _join(grown, bins[b])
        after[b] = _surface(grown) * total if total else 0.0
    _clear(grown)
    best, border, total = np.inf, 1, 0
    for b in range(1, _BINS):
        total += inside[b - 1]
        _join(grown, bins[b - 1])
        cost = after[b] + (_surface(grown) * total if total else 0.0)
        if 0 < total < number and cost < best:
            best, border = cost, b
    return border


@compiled
def _join(box: Floats1, other: Floats1) -> None:
    """Enlarge a box, shape (6,), by another."""
    for k in range(3):
        box[k] = min(box[k], other[k])
        box[k + 3] = max(box[k + 3], other[k + 3])


@compiled
def _surface(box: Floats1) -> float:
    """Return half the surface area of a box, shape (6,) [m^2]."""
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return float(x * y + y * z + z * x)


@compiled(lean=True)
def _clear(box: Floats1) -> None:
    """Make a box, shape (6,), empty."""
    for k in range(3):
        box[k], box[k + 3] = np.inf, -np.inf


@compiled
def dot(a: Vector, b: Vector) -> float:
    """Return a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def minus(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@compiled
def along(o: Vector, d: Vector, t: float) -> Vector:
    """Return o + t d."""
    return (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])


@compiled
def first_of(interval: Interval) -> float:
    """Return the first t >= 0 at which the surface is crossed, from inside too; inf if there is none."""
    enter, leave = interval
    if leave < 0.0 or enter > leave:
        return math.inf
    return enter if enter >= 0.0 else leave


@compiled
def between(o: float, d: float, low: float, high: float) -> Interval:
    """Return the interval for low <= o + t d <= high, one coordinate."""
    if abs(d) < _PARALLEL:
        return (-math.inf, math.inf) if low <= o <= high else (math.inf, -math.inf)
    a, b = (low - o) / d, (high - o) / d
    return (a, b) if a < b else (b, a)


@compiled
def sphere(o: Vector, d: Vector, center: Vector, radius: float) -> Interval:
    """Return the interval inside a sphere."""
    o = minus(o, center)
    nearest = -dot(o, d)
    off = along(o, d, nearest)
    square = radius * radius - dot(off, off)  # from the line's nearest point: no cancellation far away
    if square < 0.0:
        return (math.inf, -math.inf)
    half = math.sqrt(square)
    return (nearest - half, nearest + half)


@compiled
def box(o: Vector, d: Vector, half: Vector) -> Interval:
    """Return the interval inside a box of given half lengths."""
    enter, leave = between(o[0], d[0], -half[0], half[0])
    low, high = between(o[1], d[1], -half[1], half[1])
    enter, leave = max(enter, low), min(leave, high)
    low, high = between(o[2], d[2], -half[2], half[2])
    enter, leave = max(enter, low), min(leave, high)
    return (enter, leave) if enter <= leave else (math.inf, -math.inf)


@compiled
def tube(o: Vector, d: Vector, radius: float) -> Interval:
    """Return the interval inside an infinite cylinder about the z axis."""
    square = d[0] * d[0] + d[1] * d[1]
    if square < _PARALLEL:
        inside = o[0] * o[0] + o[1] * o[1] <= radius * radius
        return (-math.inf, math.inf) if inside else (math.inf, -math.inf)
    nearest = -(o[0] * d[0] + o[1] * d[1]) / square
    x, y = o[0] + nearest * d[0], o[1] + nearest * d[1]
    square = (radius * radius - x * x - y * y) / square
    if square < 0.0:
        return (math.inf, -math.inf)
    half = math.sqrt(square)
    return (nearest - half, nearest + half)


@compiled
def cylinder(o: Vector, d: Vector, radius: float, half: float) -> Interval:
    """Return the interval inside a cylinder along z of given half length."""
    enter, leave = tube(o, d, radius)
    low, high = between(o[2], d[2], -half, half)
    enter, leave = max(enter, low), min(leave, high)
    return (enter, leave) if enter <= leave else (math.inf, -math.inf)


@compiled
def capsule(o: Vector, d: Vector, radius: float, half: float) -> Interval:
    """Return the interval inside a capsule along z; `half` is half the length of its straight part.

    The parts are convex and so is their union: the interval is from the first entry to the last exit.
    """
    enter, leave = cylinder(o, d, radius, half)
    for end in (-half, half):
        low, high = sphere(o, d, (0.0, 0.0, end), radius)
        enter, leave = min(enter, low), max(leave, high)
    return (enter, leave)


@compiled
def half_space(o: Vector, d: Vector, offset: float) -> float:
    """Return the t >= 0 at which the plane z = offset is crossed, or inf."""
    if abs(d[2]) < _PARALLEL:
        return math.inf
    t = (offset - o[2]) / d[2]
    return t if t >= 0.0 else math.inf


@compiled
def triangle(o: Vector, d: Vector, a: Vector, e: Vector, f: Vector) -> float:
    """Return the t >= 0 at which a triangle with corners a, a + e and a + f is crossed, or inf.

    Moeller and Trumbore, Fast, minimum storage ray/triangle intersection (1997).  A relative tolerance of
    1e-9 closes the seams between adjacent triangles.
    """
    p = cross(d, f)
    volume = dot(e, p)
    if volume == 0.0:
        return math.inf
    s = minus(o, a)
    u = dot(s, p) / volume
    if u < -1e-9 or u > 1.0 + 1e-9:
        return math.inf
    q = cross(s, e)
    w = dot(d, q) / volume
    if w < -1e-9 or u + w > 1.0 + 1e-9:
        return math.inf
    t = dot(f, q) / volume
    return t if t >= 0.0 else math.inf


@compiled
def rounded_triangle(o: Vector, d: Vector, a: Vector, e: Vector, f: Vector, radius: float) -> Interval:
    """Return the interval inside the set of points within `radius` of the triangle a, a + e, a + f.

    The set is a prism and a capsule along each side, joined as in `capsule`.
    """
    normal = cross(e, f)
    length = math.sqrt(dot(normal, normal))
    normal = (normal[0] / length, normal[1] / length, normal[2] / length)
    s = minus(o, a)
    enter, leave = between(dot(s, normal), dot(d, normal), -radius, radius)
    third = minus(f, e)
    for start, side in (((0.0, 0.0, 0.0), e), (e, third), (f, (-f[0], -f[1], -f[2]))):
        inward = cross(normal, side)
        low, high = between(dot(minus(s, start), inward), dot(d, inward), 0.0, math.inf)
        enter, leave = max(enter, low), min(leave, high)
    if enter > leave:
        enter, leave = math.inf, -math.inf
    for start, side in (((0.0, 0.0, 0.0), e), (e, third), (f, (-f[0], -f[1], -f[2]))):
        low, high = _rod(minus(s, start), d, side, radius)
        enter, leave = min(enter, low), max(leave, high)
    return (enter, leave)


@compiled
def _rod(o: Vector, d: Vector, side: Vector, radius: float) -> Interval:
    """Return the interval inside a capsule from the origin to `side`."""
    length = math.sqrt(dot(side, side))
    axis = (side[0] / length, side[1] / length, side[2] / length)
    helper = (1.0, 0.0, 0.0) if abs(axis[0]) < 0.9 else (0.0, 1.0, 0.0)
    across = cross(axis, helper)
    size = math.sqrt(dot(across, across))
    across = (across[0] / size, across[1] / size, across[2] / size)
    third = cross(axis, across)
    o = minus(o, (0.5 * side[0], 0.5 * side[1], 0.5 * side[2]))
    turned_o = (dot(o, across), dot(o, third), dot(o, axis))
    turned_d = (dot(d, across), dot(d, third), dot(d, axis))
    return capsule(turned_o, turned_d, radius, 0.5 * length)


@compiled
def nearest_of_triangle(p: Vector, a: Vector, e: Vector, f: Vector) -> Vector:
    """Return the point nearest to p of a triangle with corners a, a + e and a + f."""
    normal = cross(e, f)
    s = minus(p, a)
    area = dot(normal, normal)
    u = dot(cross(s, f), normal) / area
    w = dot(cross(e, s), normal) / area
    if u >= 0.0 and w >= 0.0 and u + w <= 1.0:
        return (a[0] + u * e[0] + w * f[0], a[1] + u * e[1] + w * f[1], a[2] + u * e[2] + w * f[2])
    best, found = math.inf, a
    for start, side in (
        (a, e),
        (along(a, e, 1.0), minus(f, e)),
        (along(a, f, 1.0), (-f[0], -f[1], -f[2])),
    ):
        share = dot(minus(p, start), side) / dot(side, side)
        point = along(start, side, min(max(share, 0.0), 1.0))
        off = minus(p, point)
        if dot(off, off) < best:
            best, found = dot(off, off), point
    return found
