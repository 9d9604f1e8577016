"""Compiled: a tree of boxes over many small things, so that a ray meets few of them."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

DEPTH = 128
"""No tree is deeper: room for a traversal's stack."""
_MEDIAN_BELOW = 48  # beyond this depth halves are equal in number, so that at most 64 levels follow
_BINS = 12
_HAIR = 1e-12  # [m], and of the coordinates


@njit(cache=True, nogil=True, error_model="numpy")
def build_tree(boxes: Array, leaf: int) -> tuple[Array, Indices, Indices]:
    """Return a binary tree of boxes, split where the surface area heuristic is least.

    Wald, On fast construction of SAH-based bounding volume hierarchies (2007): bins along the longest axis.

    Args:
        boxes: Least corner, then greatest corner of each thing, shape (m, 6), m > 0.
        leaf: Things in a leaf at most.

    Returns:
        Boxes of the nodes, shape (k, 6); their links, shape (k, 2): the first child (the second is next to
        it) and 0, or in a leaf the first place in the order and the number of things; the order, shape (m,).
    """
    count = boxes.shape[0]
    node_box = np.empty((2 * count - 1, 6))
    link = np.zeros((2 * count - 1, 2), dtype=np.int64)
    depth = np.zeros(2 * count - 1, dtype=np.int64)
    order = np.arange(count)
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
    return node_box[:used].copy(), link[:used].copy(), order


@njit(cache=True, nogil=True, error_model="numpy")
def _enclose(boxes: Array, order: Indices, first: int, number: int, out: Array) -> None:
    """Write the box around some things, a hair wider: a ray along a face of it goes through it."""
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


@njit(cache=True, nogil=True, error_model="numpy")
def _split(boxes: Array, order: Indices, first: int, number: int) -> int:
    """Reorder some things into two halves; return where the second begins."""
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
    if left in (first, first + number):  # rounding: all fell into one bin
        return int(first + number // 2)
    return int(left)


@njit(cache=True, nogil=True, error_model="numpy")
def _best_border(
    boxes: Array, order: Indices, first: int, number: int, axis: int, low: float, scale: float
) -> int:
    """Return the bin before which to cut: least sum of surface times number."""
    inside = np.zeros(_BINS, dtype=np.int64)
    room = np.empty((_BINS, 6))
    room[:, :3], room[:, 3:] = np.inf, -np.inf
    for place in range(first, first + number):
        thing = order[place]
        b = int((boxes[thing, axis] + boxes[thing, axis + 3] - low) * scale)
        inside[b] += 1
        for k in range(3):
            room[b, k] = min(room[b, k], boxes[thing, k])
            room[b, k + 3] = max(room[b, k + 3], boxes[thing, k + 3])
    after = np.zeros(_BINS)
    grown, total = np.empty(6), 0
    grown[:3], grown[3:] = np.inf, -np.inf
    for b in range(_BINS - 1, 0, -1):
        total += inside[b]
        _join(grown, room[b])
        after[b] = _surface(grown) * total if total else 0.0
    grown[:3], grown[3:] = np.inf, -np.inf
    best, border, total = np.inf, 1, 0
    for b in range(1, _BINS):
        total += inside[b - 1]
        _join(grown, room[b - 1])
        cost = after[b] + (_surface(grown) * total if total else 0.0)
        if 0 < total < number and cost < best:
            best, border = cost, b
    return border


@njit(cache=True, nogil=True, error_model="numpy")
def _join(box: Array, other: Array) -> None:
    for k in range(3):
        box[k] = min(box[k], other[k])
        box[k + 3] = max(box[k + 3], other[k + 3])


@njit(cache=True, nogil=True, error_model="numpy")
def _surface(box: Array) -> float:
    x, y, z = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return float(x * y + y * z + z * x)
