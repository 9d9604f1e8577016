"""Block of constants of a scene: its objects, in trees of boxes."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision.fast.rounding import COMPARING, FAR, Rounding
from pepper_kin.collision.fast.solids import Solid
from pepper_kin.collision.fast.structure import ComparedParts
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.records import NODE, OBJECT, ROOT
from pepper_kin.core.collision.scene_rows import write_objects
from pepper_kin.core.collision.scene_trees import ObjectSets, sort_objects, write_scene
from pepper_kin.kernels.lanes import LANES


class SceneBlock(NamedTuple):
    """Block of a scene for one robot.

    Attributes:
        block: The block, aligned to 64 bytes, not to be written to.
        address: Address of the block.
        order: Indices in the structure of the block's objects, shape (k,).
        kept: Blocks of clouds, whose addresses the block holds.
    """

    block: Array
    address: int
    order: NDArray[np.int64]
    kept: tuple[Array, ...]


def scene_block(structure: ComparedParts, rounding: Rounding) -> SceneBlock:
    """Return the block of a scene for one robot."""
    rows, special, count = structure.object_rows, structure.special, len(structure.items)
    items, corners = np.empty((count, OBJECT.width), np.float32), np.empty((2, count, 3))
    write_objects(rows, COMPARING, FAR, rounding.farthest, items, corners[0], corners[1])
    order, trees = np.empty(count, np.int64), np.empty((2 * len(structure.ends), 3), np.int64)
    sets = ObjectSets(
        rows, items, corners[0], corners[1], structure.members, structure.ends, structure.met, order, trees
    )
    tree_count, nodes, pairs = sort_objects(sets)
    hulls = _hulls(special, order) if special else {}
    block = at.blank(
        {
            at.OBJECTS: -(-OBJECT.width * count // 2),
            at.BOXES: 3 * LANES * -(-count // LANES),
            at.NODES: -(-NODE.width * nodes // 2),
            at.CLOUDS: count,
            at.ROOTS: ROOT.width * pairs,
            at.ROOT_LISTS: len(structure.groups) + 1,
            at.SOLIDS: 4 * count,
            at.SOLID_HALF: 3 * count,
            at.SOLID_POSES: 12 * count,
            at.VERTEX_FIRST: count + 1,
            **{which: values.size for which, values in hulls.items()},
        }
    )
    write_scene(sets, tree_count, block)
    for which, values in hulls.items():
        at.section(block, which)[:] = values
    block.setflags(write=False)
    kept = tuple(solid.cloud for solid in special.values() if solid.cloud is not None)
    return SceneBlock(block, block.ctypes.data, order, kept)


def _hulls(special: dict[int, Solid], order: NDArray[np.int64]) -> dict[int, Array]:
    """Return the sections of a scene's hulls and clouds; `order`: indices in the structure, shape (k,)."""
    solids = [special.get(o) for o in order.tolist()]
    hulls = hull_sections([_NONE if solid is None else solid.vertices for solid in solids])
    return {at.CLOUDS: cloud_addresses(solids), **hulls}


_NONE = np.zeros((0, 3))


def cloud_addresses(solids: Sequence[Solid | None]) -> Array:
    """Return the addresses of the blocks of clouds, which the solids keep alive; 0 for other solids."""
    clouds = [None if solid is None else solid.cloud for solid in solids]
    return words(np.array([0 if cloud is None else cloud.ctypes.data for cloud in clouds], np.int64))


def solid_sections(rows: Array, vertices: Sequence[Array]) -> dict[int, Array]:
    """Return the sections of solids' shapes and poses, from their rows, shape (k, ROW), and vertices."""
    return {
        at.SOLIDS: rows[:, :4],
        at.SOLID_HALF: rows[:, 5:8],
        at.SOLID_POSES: rows[:, 8:],
        **hull_sections(vertices),
    }


def hull_sections(vertices: Sequence[Array]) -> dict[int, Array]:
    """Return the sections of solids' vertices [m], shape (v, 3) for each solid."""
    padded = [_padded(corners) for corners in vertices]
    hulls = np.concatenate([np.zeros(0), *(corners.T.ravel() for corners in padded if len(corners))])
    return {
        at.VERTEX_FIRST: firsts(padded).astype(float),
        at.VERTICES: hulls,
        at.VERTEX_SINGLES: singles(hulls),
    }


def _padded(corners: Array) -> Array:
    """Return corners [m], shape (v, 3), with the last one repeated to fill all lanes, shape (w, 3)."""
    if len(corners) % LANES == 0:
        return corners
    return np.concatenate([corners, np.repeat(corners[-1:], -len(corners) % LANES, axis=0)])


def firsts(parts: Sequence[Sized]) -> NDArray[np.int64]:
    """Return the offsets of concatenated lists, and the total length, shape (lists + 1,)."""
    found = np.zeros(len(parts) + 1, np.int64)
    np.cumsum([len(part) for part in parts], out=found[1:])
    return found


def words(values: NDArray[np.int64]) -> Array:
    """Return integers, of any shape, stored as the bits of doubles, one-dimensional."""
    return np.ascontiguousarray(values, np.int64).ravel().view(np.float64)


def singles(values: NDArray[Any]) -> Array:
    """Return floats, s in any shape, stored as the bits of doubles, two in each, shape (ceil(s / 2),)."""
    padded = np.zeros(values.size + values.size % 2, dtype=np.float32)
    padded[: values.size] = values.ravel()
    return padded.view(np.float64)
