"""Trees of boxes around the objects of a scene, and the other sections of the scene's block."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.layout import section, section_bits, section_single
from pepper_kin.core.collision.records import NODE, OBJECT, ROOT
from pepper_kin.core.collision.scene_rows import VAST
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.lanes import LANES
from pepper_kin.kernels.signatures import Bytes2, Floats1, Floats2, Ints1, Ints2, Singles2

FEW = 12
"""Maximum number of objects in a tree that is a single leaf."""
LEAF = 4
"""Maximum number of objects in a leaf of any other tree."""
LARGE = 8.0
"""Ratio to the median length beyond which objects get a separate tree, because they would widen all boxes."""
CELLS = 65535
"""Number of cells, less one, along each axis of the grid of the Morton curve."""
OUTWARD, TINY = 2.0**-23, 1e-37
"""Relative and absolute amount by which a number is moved outward, so that rounding to single precision
cannot move it inward."""


class ObjectSets(NamedTuple):
    """Objects of a scene, in sets that are compared with the same groups of bodies.

    Attributes:
        rows: Rows of the objects, see `scene_rows`, shape (k, ROW).
        items: Objects as spheres are compared with them, see `write_objects`, shape (k, OBJECT.width).
        lows: Minimum corners of the boxes around the objects, shape (k, 3) [m].
        highs: Maximum corners of the boxes, shape (k, 3) [m].
        members: Indices of the objects, set after set, shape (k,).
        ends: End of each set in `members`, shape (s,).
        met: 1 if a set is compared with a group, else 0, shape (s, g).
        order: Output: indices of the objects, tree after tree, shape (k,).
        trees: Output: set, first object and end of objects of each tree, shape (2 s, 3).
    """

    rows: Floats2
    items: Singles2
    lows: Floats2
    highs: Floats2
    members: Ints1
    ends: Ints1
    met: Bytes2
    order: Ints1
    trees: Ints2


@compiled
def _sort(keys: NDArray[np.int64], order: NDArray[np.int64]) -> None:
    """Sort indices, shape (m,), by their keys, shape (k,), stably."""
    count, width = order.size, 1
    scratch = np.empty(count, np.int64)
    while width < count:
        for first in range(0, count, 2 * width):
            middle, end = min(first + width, count), min(first + 2 * width, count)
            i, j = first, middle
            for k in range(first, end):
                if i < middle and (j == end or keys[order[i]] <= keys[order[j]]):
                    scratch[k] = order[i]
                    i += 1
                else:
                    scratch[k] = order[j]
                    j += 1
        for k in range(count):
            order[k] = scratch[k]
        width *= 2


@compiled
def _longest(sets: ObjectSets, o: int) -> float:
    """Return the longest edge of the box around an object [m]."""
    longest = 0.0
    for i in range(3):
        longest = max(longest, sets.highs[o, i] - sets.lows[o, i])
    return longest


@compiled
def _length_that_is_large(sets: ObjectSets, first: int, end: int) -> float:
    """Return the length beyond which objects of a set get a separate tree [m]; infinite for small sets."""
    count = end - first
    if count <= FEW:
        return math.inf
    lengths, keys, order = np.empty(count), np.empty(count, np.int64), np.empty(count, np.int64)
    for k in range(count):
        lengths[k], order[k] = _longest(sets, sets.members[first + k]), k
    bits = lengths.view(np.int64)  # nonnegative doubles sort like their bits
    for k in range(count):
        keys[k] = bits[k]
    _sort(keys, order)
    return LARGE * 0.5 * (lengths[order[(count - 1) // 2]] + lengths[order[count // 2]])


@compiled
def _spread_bits(cell: int) -> int:
    """Return a number of 16 bits with two zero bits inserted before each bit."""
    cell = (cell | (cell << 16)) & 0xFF0000FF
    cell = (cell | (cell << 8)) & 0xF00F00F00F
    cell = (cell | (cell << 4)) & 0xC30C30C30C3
    return (cell | (cell << 2)) & 0x249249249249


@compiled
def _sort_along_curve(sets: ObjectSets, first: int, end: int) -> None:
    """Sort the objects of a tree along Morton's curve, which keeps neighbors together."""
    lows, highs, order = sets.lows, sets.highs, sets.order[first:end]
    keys = np.zeros(sets.rows.shape[0], np.int64)
    for i in range(3):
        low, high = math.inf, -math.inf
        for o in order:
            middle = 0.5 * (lows[o, i] + highs[o, i])
            low, high = min(low, middle), max(high, middle)
        for o in order:
            share = (0.5 * (lows[o, i] + highs[o, i]) - low) / max(high - low, 1e-9)
            keys[o] |= _spread_bits(int(share * CELLS)) << i
    _sort(keys, order)


@compiled
def _depth(count: int) -> int:
    """Return the number of levels of branches above the leaves of a tree of `count` objects."""
    depth = 0
    while count > FEW and LEAF << depth < count:
        depth += 1
    return depth


@compiled("Tuple(int64, int64, int64)(ObjectSets)")
def sort_objects(sets: ObjectSets) -> tuple[int, int, int]:
    """Sort the objects of a scene into trees; objects much longer than the median get a separate tree.

    Returns:
        The number of trees, of their nodes, and of pairs of a tree and a group that are compared.
    """
    made = nodes = pairs = placed = first = 0
    for s in range(sets.ends.size):
        end, groups = sets.ends[s], 0
        for g in range(sets.met.shape[1]):
            groups += sets.met[s, g]
        large = _length_that_is_large(sets, first, end)
        for part in range(2):
            begin = placed
            for k in range(first, end):
                o = sets.members[k]
                if (_longest(sets, o) > large) == (part == 1):
                    sets.order[placed] = o
                    placed += 1
            count = placed - begin
            if count == 0:
                continue
            if count > FEW:
                _sort_along_curve(sets, begin, placed)
            sets.trees[made, 0], sets.trees[made, 1], sets.trees[made, 2] = s, begin, placed
            made += 1
            nodes += (2 << _depth(count)) - 1
            pairs += groups
        first = end
    return made, nodes, pairs


@compiled
def _round_outward(target: NDArray[np.float32], place: int, low: float, high: float) -> None:
    """Write a range's ends to an array, shape (s,), three indices apart, rounded outward [m]."""
    target[place] = low - abs(low) * OUTWARD - TINY
    target[place + 3] = high + abs(high) * OUTWARD + TINY


@compiled
def _write_nodes(sets: ObjectSets, first: int, end: int, begin: int, nodes: NDArray[np.float32]) -> int:
    """Write the nodes of a tree to a section, shape (s,), from `begin` on; return the index after them.

    The branches of a node follow it, the branch of the first half of its objects first.
    """
    count = end - first
    depth = _depth(count)
    total = (2 << depth) - 1
    corners = np.empty((total, 6))
    for k in range(total):
        for i in range(3):
            corners[k, i], corners[k, 3 + i] = math.inf, -math.inf
    for leaf in range(1 << depth):
        low, high = first + ((leaf * count) >> depth), first + (((leaf + 1) * count) >> depth)
        node = 0
        for level in range(depth + 1):
            within = (2 << (depth - level)) - 1  # number of nodes of the branch that starts here
            for k in range(low, high):
                o = sets.order[k]
                for i in range(3):
                    corners[node, i] = min(corners[node, i], sets.lows[o, i])
                    corners[node, 3 + i] = max(corners[node, 3 + i], sets.highs[o, i])
            place = NODE.at(nodes.ctypes.data, begin + node)
            NODE.set_after(place, begin + node + within)
            NODE.set_first_object(place, low if level == depth else 0)
            NODE.set_object_end(place, high if level == depth else 0)
            if level < depth:
                node += 1 + ((leaf >> (depth - 1 - level)) & 1) * ((within - 1) // 2)
    for k in range(total):
        for i in range(3):
            _round_outward(nodes, NODE.width * (begin + k) + i, corners[k, i], corners[k, 3 + i])
    return begin + total


@compiled
def _write_boxes(sets: ObjectSets, boxes: NDArray[np.float32]) -> None:
    """Write the corners of the objects' boxes to a section, shape (s,), in blocks of eight [m]."""
    count = sets.order.size
    for k in range(boxes.size // 6):
        place = 6 * LANES * (k // LANES) + k % LANES
        for i in range(3):
            low, high = VAST, VAST
            if k < count:
                low, high = sets.lows[sets.order[k], i], sets.highs[sets.order[k], i]
            boxes[place + LANES * i] = low - abs(low) * OUTWARD - TINY
            boxes[place + LANES * (3 + i)] = high + abs(high) * OUTWARD + TINY


@compiled("void(ObjectSets, int64, float64[::1])")
def write_scene(sets: ObjectSets, tree_count: int, block: Floats1) -> None:
    """Write trees and objects into a scene's block; the caller writes hulls and clouds.

    Args:
        sets: The objects, sorted.
        tree_count: Number of trees that `sort_objects` returned.
        block: Output: a block of zeros whose sections have their sizes, shape (s,).
    """
    nodes, roots, listed = section_single(block, at.NODES), at.address_of(block, at.ROOTS), 0
    lists, items = section_bits(block, at.ROOT_LISTS), section_single(block, at.OBJECTS)
    begins, place = np.empty(tree_count + 1, np.int64), 0
    for r in range(tree_count):
        begins[r] = place
        place = _write_nodes(sets, sets.trees[r, 1], sets.trees[r, 2], place, nodes)
    begins[tree_count] = place
    for g in range(lists.size - 1):
        for r in range(tree_count):
            if sets.met[sets.trees[r, 0], g] != 0:
                ROOT.set_first_node(roots, begins[r], listed)
                ROOT.set_node_end(roots, begins[r + 1], listed)
                ROOT.set_first_object(roots, sets.trees[r, 1], listed)
                ROOT.set_object_end(roots, sets.trees[r, 2], listed)
                listed += 1
        lists[g + 1] = listed
    _write_boxes(sets, section_single(block, at.BOXES))
    solids, half, poses = (
        section(block, at.SOLIDS),
        section(block, at.SOLID_HALF),
        section(block, at.SOLID_POSES),
    )
    for k in range(sets.order.size):
        o = sets.order[k]
        for i in range(OBJECT.width):
            items[OBJECT.width * k + i] = sets.items[o, i]
        for i in range(4):
            solids[4 * k + i] = sets.rows[o, i]
        for i in range(3):
            half[3 * k + i] = sets.rows[o, 5 + i]
        for i in range(12):
            poses[12 * k + i] = sets.rows[o, 8 + i]


@compiled("float64(float64[:, ::1], float64[:, ::1], int64[:, ::1], float64[::1])")
def write_gaps(ours: Floats2, rows: Floats2, pairs: Ints2, gaps: Floats1) -> float:
    """Write a lower bound of the distance of each pair of a robot's solid and an object [m].

    The bound is the distance of the solid's bounding sphere from the box around the object's core, less
    radii.

    Args:
        ours: Rows of the robot's solids, see `scene_rows`, shape (a, ROW) [m].
        rows: Rows of the objects, shape (k, ROW).
        pairs: Index of the solid and of the object, shape (m, 2).
        gaps: Output, shape (m,) [m].

    Returns:
        The minimum bound [m], infinite if there is no pair.
    """
    least = math.inf
    for k in range(pairs.shape[0]):
        a, o = pairs[k, 0], pairs[k, 1]
        squared = 0.0
        for j in range(3):
            along = 0.0
            for i in range(3):
                along += (ours[a, 8 + i] - rows[o, 8 + i]) * rows[o, 11 + 3 * j + i]
            beyond = max(abs(along) - rows[o, 5 + j], 0.0)
            squared += beyond * beyond
        gaps[k] = math.sqrt(squared) - ours[a, 2] - rows[o, 1]
        least = min(least, gaps[k])
    return least
