"""Block of a cloud: its points in the cells of a grid, and the distance of each cell from the points."""

from __future__ import annotations

import math
from weakref import WeakKeyDictionary

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision.solids import PointCloud
from pepper_kin.core.collision import layout as at
from pepper_kin.core.collision.clouds import HEAD, build_cloud, extent
from pepper_kin.kernels.lanes import LANES

MOST_CELLS = 40_000
"""Approximate maximum number of cells of a grid."""
EDGE = 0.02
"""Minimum edge of a cell [m]."""
FIELD = 0.25
"""Distance to the points of a cloud up to which the field is resolved, or slightly more [m]."""

_blocks: WeakKeyDictionary[PointCloud, Array] = WeakKeyDictionary()


def cloud_block(cloud: PointCloud) -> Array:
    """Return the block of a cloud that has points, cached.

    The frame is the cloud's own, its origin in the middle of the box around the points; see
    `pepper_kin.core.collision.clouds`.
    """
    found = _blocks.get(cloud)
    if found is None:
        found = _blocks[cloud] = _made(cloud.points)
    return found


def _made(points: Array) -> Array:
    """Return a new block, shape (s,), of a cloud of points [m], shape (k, 3)."""
    middle, half = box_around(points)
    edge, counts = EDGE, _counts(half, EDGE)
    while math.prod(counts) > MOST_CELLS:
        edge *= max(1.02, (math.prod(counts) / MOST_CELLS) ** (1 / 3))
        counts = _counts(half, edge)
    cells, most = math.prod(counts), max(counts[1:])
    sizes = [-(-size // 2) for size in (cells, cells + 1, *[len(points) + LANES] * 3)]
    sizes += [3 * len(points), max(len(points), LANES * most) // 2 + 1]
    places = [HEAD.width]
    for size in sizes[:-1]:
        places.append(-(-(places[-1] + size) // at.ALIGNMENT) * at.ALIGNMENT)
    widest = min(16, math.ceil(FIELD / edge))
    block = at.aligned(places[-1] + sizes[-1])
    names = "field", "first", "xs", "ys", "zs", "points", "workspace"
    head = dict(zip(("cells", "rows", "layers", *names), (*counts, *places), strict=True))
    block[: HEAD.width] = HEAD.row(low=-half, edge=edge, count=len(points), widest=widest, **head)
    build_cloud(points, middle, block)
    return block


def box_around(points: Array) -> tuple[Array, Array]:
    """Return middle and half lengths of the box around points, shape (3,) each [m]."""
    box = np.empty(6)
    extent(points, box)
    return (box[:3] + box[3:]) / 2, (box[3:] - box[:3]) / 2


def _counts(half: Array, edge: float) -> tuple[int, int, int]:
    """Return the number of cells of a row, a multiple of LANES, of rows of a layer and of layers of a grid.

    Args:
        half: Half lengths of the grid [m], shape (3,).
        edge: Edge of a cell [m].
    """
    x, y, z = (int(2.0 * length / edge) + 1 for length in half.tolist())
    return -(-x // LANES) * LANES, y, z
