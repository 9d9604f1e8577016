"""The block of constants of a scene: its objects, in trees of boxes."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision.fast.rounding import COMPARING, FAR, Rounding
from pepper_kin.collision.fast.solids import Array, Solid
from pepper_kin.collision.fast.structure import Structure
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.ball_check import NODE_SINGLES, OBJECT_SINGLES
from pepper_kin.core.collision.scene_rows import VAST, write_objects
from pepper_kin.kernels.lanes import LANES

FEW = 12
"""Objects in a tree that is one leaf;"""
LEAF = 4
"""those in a leaf of any other tree, at most."""
LARGE = 8.0
"""Objects longer than this many times the median get a separate tree: they would widen all boxes."""


class SceneBlock(NamedTuple):
    """The block of a scene as one robot sees it.

    Attributes:
        block: At a multiple of 64 bytes, not to be written to.
        address: Of the block.
        places: The place of each object of the structure in the block, shape (k,).
        kept: Blocks of clouds, of which it has the addresses.
    """

    block: Array
    address: int
    places: NDArray[np.intp]
    kept: tuple[Array, ...]


def scene_block(structure: Structure, rounding: Rounding) -> SceneBlock:
    """Return the block of a scene as one robot sees it."""
    rows, special = structure.object_rows, structure.special
    items = np.empty((len(rows), OBJECT_SINGLES), np.float32)
    lows, highs = np.empty((2, len(rows), 3))
    write_objects(rows, COMPARING, FAR, rounding.farthest, items, lows, highs)
    order: list[NDArray[np.intp]] = []
    trees: list[tuple[Array, frozenset[int]]] = []
    placed = 0
    for members, groups in structure.sets:
        for part in _by_length(members, lows, highs):
            own, nodes = box_tree(lows[part], highs[part])
            nodes[:, 6] += sum(len(tree) for tree, _ in trees)
            nodes[:, 7:] += placed
            placed += len(part)
            order.append(part[own])
            trees.append((nodes, groups))
    chosen = np.concatenate([np.zeros(0, np.intp), *order])
    placed_in = chosen.tolist()
    first = np.cumsum([0, *(len(nodes) for nodes, _ in trees)])
    lists = [[r for r, (_, met) in enumerate(trees) if g in met] for g in range(len(structure.groups))]
    nodes = np.concatenate([np.zeros((0, NODE_SINGLES)), *(nodes for nodes, _ in trees)])
    sections = {
        at.OBJECTS: singles(items[chosen]),
        at.BOXES: singles(_side_by_side(lows[chosen], highs[chosen])),
        at.NODES: singles(nodes),
        at.CLOUDS: cloud_addresses([special.get(o) for o in placed_in]),
        **_root_lists(first, lists),
        **solid_sections(rows[chosen], [special[o].vertices if o in special else _NONE for o in placed_in]),
    }
    block = at.aligned_copy(at.pack(sections))
    block.setflags(write=False)
    kept = tuple(solid.cloud for solid in special.values() if solid.cloud is not None)
    return SceneBlock(block, block.ctypes.data, np.argsort(chosen), kept)


_NONE = np.zeros((0, 3))


def cloud_addresses(solids: Sequence[Solid | None]) -> Array:
    """Return the addresses of the blocks of clouds, which the solids keep; 0 of anything else."""
    clouds = [None if solid is None else solid.cloud for solid in solids]
    return words(np.array([0 if cloud is None else cloud.ctypes.data for cloud in clouds], np.int64))


def _root_lists(first: NDArray[np.int64], lists: list[list[int]]) -> dict[int, Array]:
    """Return the trees of each group, one after the other, with where each group's begin."""
    listed = np.array([r for some in lists for r in some], np.int64)
    roots = np.stack([first[listed], first[listed + 1]], axis=1)
    return {at.ROOTS: words(roots), at.ROOT_LISTS: words(firsts(lists))}


def _by_length(members: NDArray[np.intp], lows: Array, highs: Array) -> list[NDArray[np.intp]]:
    """Return places of objects, those much longer than most apart."""
    if len(members) <= FEW:
        return [members]
    longest = (highs - lows)[members].max(axis=1)
    large = longest > LARGE * np.median(longest)
    return [part for part in (members[~large], members[large]) if len(part)]


def box_tree(lows: Array, highs: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the order in which a tree has boxes, and its nodes, shape (m, NODE_SINGLES).

    The boxes are sorted along a curve that keeps neighbors together (Morton's), and halved again and again.

    Args:
        lows: Least corners, shape (k, 3) [m].
        highs: Greatest corners.
    """
    count = len(lows)
    if count <= FEW:
        node = [*lows.min(axis=0), *highs.max(axis=0), 1, 0, count]
        return np.arange(count), _outward(np.array([node], dtype=float))
    order = np.argsort(_morton((lows + highs) / 2), kind="stable")
    depth = max(0, int(np.ceil(np.log2(count / LEAF))))
    edges = (np.arange(2**depth + 1) * count) >> depth
    low = np.minimum.reduceat(lows[order], edges[:-1])
    high = np.maximum.reduceat(highs[order], edges[:-1])
    levels = [(low, high)]
    for _ in range(depth):
        low, high = np.minimum(low[::2], low[1::2]), np.maximum(high[::2], high[1::2])
        levels.append((low, high))
    nodes, places = np.zeros((2 ** (depth + 1) - 1, NODE_SINGLES)), np.zeros(1, np.int64)
    for level in range(depth + 1):
        low, high = levels[depth - level]
        below = 2 ** (depth - level + 1) - 1
        nodes[places, :3], nodes[places, 3:6], nodes[places, 6] = low, high, places + below
        if level < depth:
            places = np.stack([places + 1, places + 1 + (below - 1) // 2], axis=1).ravel()
        else:
            nodes[places, 7], nodes[places, 8] = edges[:-1], edges[1:]
    return order, _outward(nodes)


def _outward(nodes: Array) -> Array:
    """Round corners to single precision, outward."""
    nodes[:, :3] = np.nextafter(nodes[:, :3].astype(np.float32), np.float32(-np.inf))
    nodes[:, 3:6] = np.nextafter(nodes[:, 3:6].astype(np.float32), np.float32(np.inf))
    return nodes


def _side_by_side(lows: Array, highs: Array) -> Array:
    """Return the corners of boxes, eight boxes after eight, coordinate by coordinate, shape (m, 6, 8)."""
    count = len(lows)
    boxes = np.full((-(-count // LANES) * LANES, 6), VAST)
    boxes[:count, :3], boxes[:count, 3:] = lows, highs
    return _outward(boxes).reshape(-1, LANES, 6).transpose(0, 2, 1)


_SPREAD = ((16, 0xFF0000FF), (8, 0xF00F00F00F), (4, 0xC30C30C30C3), (2, 0x249249249249))


def _morton(points: Array) -> NDArray[np.int64]:
    """Return the places of points along Morton's curve, with 16 bits for each axis."""
    low, high = points.min(axis=0), points.max(axis=0)
    cells = ((points - low) / np.maximum(high - low, 1e-9) * 65535.0).astype(np.int64)
    for shift, mask in _SPREAD:
        cells = (cells | (cells << shift)) & mask
    return np.asarray(cells[:, 0] | (cells[:, 1] << 1) | (cells[:, 2] << 2))


def solid_sections(rows: Array, vertices: Sequence[Array]) -> dict[int, Array]:
    """Return the sections that tell solids' shapes and poses, of their rows, shape (k, ROW), and vertices."""
    padded = [_padded(corners) for corners in vertices]
    hulls = np.concatenate([np.zeros(0), *(corners.T.ravel() for corners in padded if len(corners))])
    return {
        at.SOLIDS: rows[:, :4],
        at.SOLID_HALF: rows[:, 5:8],
        at.SOLID_POSES: rows[:, 8:],
        at.VERTEX_FIRST: firsts(padded).astype(float),
        at.VERTICES: hulls,
        at.VERTEX_SINGLES: singles(hulls),
    }


def _padded(corners: Array) -> Array:
    """Return corners, the last as often as it takes to fill all lanes."""
    if len(corners) % LANES == 0:
        return corners
    return np.concatenate([corners, np.repeat(corners[-1:], -len(corners) % LANES, axis=0)])


def firsts(parts: Sequence[Sized]) -> NDArray[np.int64]:
    """Return where each of some lists begins when they stand one after the other, and the end."""
    found = np.zeros(len(parts) + 1, np.int64)
    np.cumsum([len(part) for part in parts], out=found[1:])
    return found


def words(values: NDArray[np.int64]) -> Array:
    """Return integers in the room of doubles."""
    return np.ascontiguousarray(values, np.int64).ravel().view(np.float64)


def singles(values: NDArray[Any]) -> Array:
    """Return floats in the room of doubles."""
    padded = np.zeros(values.size + values.size % 2, dtype=np.float32)
    padded[: values.size] = values.ravel()
    return padded.view(np.float64)
