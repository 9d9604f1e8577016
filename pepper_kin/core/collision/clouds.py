"""Clouds of points: grids of distances to the nearest point, and distances of balls and solids to them.

For each cell of a grid, a field holds a lower bound of the distance of its center to the nearest point: that
to the nearest cell with a point in it, by a distance transform along one axis after another.  A ball that is
far from all points by the field costs a few loads.  For any other, points are sorted by bins of two cells'
edge, row by row along x, so that those of neighboring bins of a row are side by side, and the rows that the
ball meets are searched.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.collision.gjk import CONTACT, FREE, GJK_WORKSPACE_SIZE, TIE, ConvexCore, nearer_than
from pepper_kin.core.collision.layout import BOX, CYLINDER, HULL
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.lanes import (
    LANES,
    double_at,
    lane_maximum,
    lane_minimum,
    lane_round,
    lane_sqrt,
    lanes_below,
    load_lanes,
    single_at,
    spread,
    store_double,
    store_lanes,
    store_single,
)

HEAD = 16
"""Numbers at the head of a cloud's block: least corner of the grid, edge of a cell, cells of a row (a
multiple of eight), rows of a layer, layers, points, how many cells the field resolves at most, then places
in the block, in doubles, of the field, the firsts of the bins, x, y and z of the points in single precision,
their coordinates in double precision, and of workspace."""
BEYOND = 1e-5
"""What ranges of cells are widened by, for rounding [m]."""
POINT_WORKSPACE_SIZE = GJK_WORKSPACE_SIZE + 21
"""Doubles of workspace that `point_verdict` and `cloud_verdict` need: that of `nearer_than`, half lengths and
pose of a point, its coordinates, and an axis."""
ROUNDED = 1e-6
"""What the field may be wrong by, for rounding [m]."""
FAR = 1e18
"""Where no point is [m^2]."""


class Cloud(NamedTuple):
    """A cloud's grid, its bins and the addresses of its arrays; see HEAD."""

    x: float
    y: float
    z: float
    edge: float
    row: int
    rows: int
    layers: int
    bin: float
    per_bin: float
    bins: int
    bin_rows: int
    bin_layers: int
    field: int
    first: int
    xs: int
    ys: int
    zs: int
    points: int


@compiled
def cloud_at(address: int) -> Cloud:
    """Return the cloud whose block is at an address."""
    return Cloud(
        double_at(address),
        double_at(address + 8),
        double_at(address + 16),
        double_at(address + 24),
        int(double_at(address + 32)),
        int(double_at(address + 40)),
        int(double_at(address + 48)),
        2.0 * double_at(address + 24),
        0.5 / double_at(address + 24),
        (int(double_at(address + 32)) + 1) // 2,
        (int(double_at(address + 40)) + 1) // 2,
        (int(double_at(address + 48)) + 1) // 2,
        address + 8 * int(double_at(address + 72)),
        address + 8 * int(double_at(address + 80)),
        address + 8 * int(double_at(address + 88)),
        address + 8 * int(double_at(address + 96)),
        address + 8 * int(double_at(address + 104)),
        address + 8 * int(double_at(address + 112)),
    )


@compiled(inline=True)
def _cell(x: float, low: float, rate: float, count: int) -> int:
    """Return the cell of a coordinate, `rate` cells a meter, the nearest one where it is outside."""
    place = (x - low) * rate
    return int(place) if 0.0 < place < count else (0 if place <= 0.0 else count - 1)


@compiled("void(float64[:, ::1], float64[::1], float64[::1])")
def build_cloud(points: Array, middle: Array, block: Array) -> None:
    """Fill a cloud's block whose head is written.

    Args:
        points: Coordinates, shape (k, 3) [m].
        middle: The origin of the cloud's frame, shape (3,) [m].
        block: Written, except for its head, shape (s,).
    """
    c, count = cloud_at(block.ctypes.data), points.shape[0]
    cells, bins, rate = c.row * c.rows * c.layers, c.bins * c.bin_rows * c.bin_layers, 1.0 / c.edge
    widest = block[8]
    scratch = block.ctypes.data + 8 * int(block[15])  # of each point its bin, then lines of lanes
    for k in range(0, cells, LANES):
        store_lanes(c.field + 4 * k, spread(widest * widest))
    for k in range(bins + 1):
        store_single(c.first + 4 * k, 0.0)
    for p in range(count):
        x, y, z = points[p, 0] - middle[0], points[p, 1] - middle[1], points[p, 2] - middle[2]
        i, j, k = (
            _cell(x, c.x, rate, c.row),
            _cell(y, c.y, rate, c.rows),
            _cell(z, c.z, rate, c.layers),
        )
        store_single(c.field + 4 * (i + c.row * (j + c.rows * k)), 0.0)
        cell = i // 2 + c.bins * (j // 2 + c.bin_rows * (k // 2))
        store_single(scratch + 4 * p, cell)
        store_single(c.first + 4 * cell + 4, single_at(c.first + 4 * cell + 4) + 1.0)
    for k in range(bins):
        store_single(c.first + 4 * k + 4, single_at(c.first + 4 * k) + single_at(c.first + 4 * k + 4))
    places = floats_at(c.points, 3 * count)
    for p in range(count):  # each cell's first moves to its end, which is put right below
        cell = int(single_at(scratch + 4 * p))
        place = int(single_at(c.first + 4 * cell))
        store_single(c.first + 4 * cell, place + 1.0)
        for i in range(3):
            places[3 * place + i] = points[p, i] - middle[i]
        store_single(c.xs + 4 * place, places[3 * place])
        store_single(c.ys + 4 * place, places[3 * place + 1])
        store_single(c.zs + 4 * place, places[3 * place + 2])
    for k in range(bins, 0, -1):
        store_single(c.first + 4 * k, single_at(c.first + 4 * k - 4))
    store_single(c.first, 0.0)
    for i in range(LANES):  # read with the last eight points
        store_single(c.xs + 4 * (count + i), 1e9)
        store_single(c.ys + 4 * (count + i), 1e9)
        store_single(c.zs + 4 * (count + i), 1e9)
    _fill_field(c, int(widest), scratch)


@compiled
def _fill_field(c: Cloud, widest: int, scratch: int) -> None:
    """Write the field: squared distances along rows, then across them, then across layers.

    A point somewhere in a cell that is e cells away along an axis is (e - 1/2) edges away at least.

    Args:
        c: The cloud, its field zero where points are and not zero elsewhere.
        widest: Distances above this many cells are not distinguished.
        scratch: Address of workspace for as many singles as a layer has cells, or `layers` times a row.
    """
    most = (widest - 0.5) ** 2
    for r in range(c.rows * c.layers):
        field, gap = c.field + 4 * c.row * r, float(widest)
        for i in range(c.row):
            gap = 0.0 if single_at(field + 4 * i) == 0.0 else gap + 1.0
            store_single(field + 4 * i, min(max(gap - 0.5, 0.0) ** 2, most))
        gap = float(widest)
        for i in range(c.row - 1, -1, -1):
            gap = 0.0 if single_at(field + 4 * i) == 0.0 else gap + 1.0
            store_single(field + 4 * i, min(max(gap - 0.5, 0.0) ** 2, single_at(field + 4 * i)))
    for k in range(c.layers):
        layer = c.field + 4 * c.row * c.rows * k
        _spread_across(layer, 4 * c.row, c.rows, c.row, widest, scratch)
    for j in range(c.rows):
        _spread_across(c.field + 4 * c.row * j, 4 * c.row * c.rows, c.layers, c.row, widest, scratch)
    for k in range(c.row * c.rows * c.layers):
        store_single(c.field + 4 * k, math.sqrt(single_at(c.field + 4 * k)) * c.edge - ROUNDED)


@compiled
def _spread_across(begin: int, stride: int, count: int, width: int, widest: int, scratch: int) -> None:
    """Take of f(j) and all f(j + e) + (|e| - 1/2)^2 the least, for lines of singles.

    Args:
        begin: Address of the first line.
        stride: Bytes from one line to the next.
        count: Lines.
        width: Singles of a line.
        widest: Distances above this many lines are not distinguished.
        scratch: Address of workspace for `count` lanes.
    """
    for i in range(0, 4 * width, 4 * LANES):
        for j in range(count):
            least = load_lanes(begin + i + stride * j)
            for e in range(1, widest):
                square = (e - 0.5) ** 2
                if lanes_below(spread(square), least) == 0:
                    break
                if j >= e:
                    least = lane_minimum(least, load_lanes(begin + i + stride * (j - e)) + square)
                if j + e < count:
                    least = lane_minimum(least, load_lanes(begin + i + stride * (j + e)) + square)
            store_lanes(scratch + 4 * LANES * j, least)
        for j in range(count):
            store_lanes(begin + i + stride * j, load_lanes(scratch + 4 * LANES * j))


@compiled(inline=True, lean=True)
def _clamped(x: Any, low: float, high: float) -> Any:
    return lane_minimum(lane_maximum(x, spread(low)), spread(high))


@compiled(lean=True)
def field_squared(c: Cloud, x: Any, y: Any, z: Any, scratch: int) -> Any:
    """Return in lanes a lower bound of the squared distance of points to a cloud's points [m^2].

    The field is off by at most how far a point is from its cell's center.  A point outside the grid is at
    least as far as it is from the grid, squared, and the nearest point of the grid from the cloud, squared:
    the grid is convex.

    Args:
        c: The cloud.
        x: Coordinates in its frame [m].
        y: The same.
        z: The same.
        scratch: Address of workspace for eight singles.
    """
    edge, rate = c.edge, 1.0 / c.edge
    u = _clamped(x, c.x, c.x + c.row * edge)
    v = _clamped(y, c.y, c.y + c.rows * edge)
    w = _clamped(z, c.z, c.z + c.layers * edge)
    i = _clamped(lane_round((u - c.x) * rate - 0.5), 0.0, c.row - 1.0)
    j = _clamped(lane_round((v - c.y) * rate - 0.5), 0.0, c.rows - 1.0)
    k = _clamped(lane_round((w - c.z) * rate - 0.5), 0.0, c.layers - 1.0)
    store_lanes(scratch, i + c.row * (j + c.rows * k))
    for lane in range(LANES):
        store_single(scratch + 4 * lane, single_at(c.field + 4 * int(single_at(scratch + 4 * lane))))
    dx, dy, dz = (
        u - i * edge - (c.x + 0.5 * edge),
        v - j * edge - (c.y + 0.5 * edge),
        w - k * edge - (c.z + 0.5 * edge),
    )
    bound = load_lanes(scratch) - lane_sqrt(dx * dx + dy * dy + dz * dz) - BEYOND
    bound = lane_maximum(bound, spread(0.0))
    x, y, z = x - u, y - v, z - w
    return bound * bound + (x * x + y * y + z * z)


@compiled
def nearest_squared(c: Cloud, x: float, y: float, z: float, reach: float, enough: float) -> float:
    """Return the squared distance of a point to a cloud's points, or reach^2 where that is less [m^2].

    Args:
        c: The cloud.
        x: Coordinate of the point in the cloud's frame [m].
        y: The same.
        z: The same.
        reach: Distance beyond which points do not count [m].
        enough: A squared distance below which any will do [m^2].
    """
    best, wide = reach * reach, reach + BEYOND
    k0, first, last = (
        _cell(z, c.z, c.per_bin, c.bin_layers),
        _cell(z - wide, c.z, c.per_bin, c.bin_layers),
        _cell(z + wide, c.z, c.per_bin, c.bin_layers),
    )
    for a in range(2 * max(k0 - first, last - k0) + 1):  # layers and rows from the nearest one outward
        k = k0 - (a + 1) // 2 if a & 1 else k0 + a // 2
        low = c.z + k * c.bin
        off = max(max(low - z, z - low - c.bin) - BEYOND, 0.0)
        left = best - off * off
        if k < first or k > last or left <= 0.0:
            continue
        wide, above = math.sqrt(left) + BEYOND, off * off
        j0, begin, end = (
            _cell(y, c.y, c.per_bin, c.bin_rows),
            _cell(y - wide, c.y, c.per_bin, c.bin_rows),
            _cell(y + wide, c.y, c.per_bin, c.bin_rows),
        )
        for b in range(2 * max(j0 - begin, end - j0) + 1):
            j = j0 - (b + 1) // 2 if b & 1 else j0 + b // 2
            low = c.y + j * c.bin
            off = max(max(low - y, y - low - c.bin) - BEYOND, 0.0)
            rest = best - above - off * off
            if j < begin or j > end or rest <= 0.0:
                continue
            wide = math.sqrt(rest) + BEYOND
            row = c.first + 4 * c.bins * (j + c.bin_rows * k)
            p0 = int(single_at(row + 4 * _cell(x - wide, c.x, c.per_bin, c.bins)))
            p1 = int(single_at(row + 4 * _cell(x + wide, c.x, c.per_bin, c.bins) + 4))
            for p in range(p0, p1, LANES):
                dx, dy, dz = (
                    load_lanes(c.xs + 4 * p) - x,
                    load_lanes(c.ys + 4 * p) - y,
                    load_lanes(c.zs + 4 * p) - z,
                )
                found = lanes_below(dx * dx + dy * dy + dz * dz, spread(best))
                q = p
                while found != 0:
                    if found & 1:
                        dx1, dy1, dz1 = (
                            single_at(c.xs + 4 * q) - x,
                            single_at(c.ys + 4 * q) - y,
                            single_at(c.zs + 4 * q) - z,
                        )
                        best = min(best, dx1 * dx1 + dy1 * dy1 + dz1 * dz1)
                    found >>= 1
                    q += 1
                if best < enough:
                    return best
    return best


@compiled(lean=True)
def point_to_core(core: ConvexCore, x: float, y: float, z: float) -> float:
    """Return the distance of a point to a core: a box, a cylinder, or the box around a hull [m]."""
    pose, half = core.pose, core.half
    dx, dy, dz = x - double_at(pose), y - double_at(pose + 8), z - double_at(pose + 16)
    u = dx * double_at(pose + 24) + dy * double_at(pose + 32) + dz * double_at(pose + 40)
    v = dx * double_at(pose + 48) + dy * double_at(pose + 56) + dz * double_at(pose + 64)
    w = dx * double_at(pose + 72) + dy * double_at(pose + 80) + dz * double_at(pose + 88)
    w = max(abs(w) - double_at(half + 16), 0.0)
    if core.kind != CYLINDER:
        u, v = max(abs(u) - double_at(half), 0.0), max(abs(v) - double_at(half + 8), 0.0)
        return math.sqrt(u * u + v * v + w * w)
    u = max(math.sqrt(u * u + v * v) - double_at(half), 0.0)
    return math.sqrt(u * u + w * w)


@compiled(lean=True)
def point_verdict(core: ConvexCore, place: int, threshold: float, tie: float, axis: int, scratch: int) -> int:
    """Return whether a point is nearer to a core than a threshold [m]: FREE, CONTACT or TIE.

    Args:
        core: The core.
        place: Address of the point's coordinates.
        threshold: The distance [m].
        tie: Distances within this of the threshold are ties [m].
        axis: Address of the direction that parted the two last, changed.
        scratch: Address of workspace for POINT_WORKSPACE_SIZE doubles, zeros at first.
    """
    x, y, z = double_at(place), double_at(place + 8), double_at(place + 16)
    distance = point_to_core(core, x, y, z)
    if distance > threshold + tie:
        return FREE
    if core.kind == HULL:
        half = scratch + 8 * GJK_WORKSPACE_SIZE
        store_double(half + 24, x)
        store_double(half + 32, y)
        store_double(half + 40, z)
        single = ConvexCore(BOX, half, half + 24, 0, 0, 0, 0.0)
        return int(nearer_than(core, single, threshold, tie, axis, scratch))
    return CONTACT if distance < threshold - tie else TIE


@compiled(lean=True)
def cloud_verdict(
    core: ConvexCore, address: int, pose: int, reach: float, threshold: float, tie: float, places: int
) -> int:
    """Return the verdict on a core and a cloud: whether any point is nearer than a threshold.

    Args:
        core: The core, in the world.
        address: Of the cloud's block.
        pose: Address of the cloud's frame in the world, center and axes, shape (12,).
        reach: Points farther than this from the core's center do not count [m].
        threshold: The distance [m].
        tie: Distances within this of the threshold are ties [m].
        places: Address of workspace for POINT_WORKSPACE_SIZE doubles, zeros at first.
    """
    c, worst = cloud_at(address), FREE
    point, axis = places + 8 * (GJK_WORKSPACE_SIZE + 15), places + 8 * (GJK_WORKSPACE_SIZE + 18)
    dx, dy, dz = (
        double_at(core.pose) - double_at(pose),
        double_at(core.pose + 8) - double_at(pose + 8),
        double_at(core.pose + 16) - double_at(pose + 16),
    )
    x = dx * double_at(pose + 24) + dy * double_at(pose + 32) + dz * double_at(pose + 40)
    y = dx * double_at(pose + 48) + dy * double_at(pose + 56) + dz * double_at(pose + 64)
    z = dx * double_at(pose + 72) + dy * double_at(pose + 80) + dz * double_at(pose + 88)
    beyond = threshold + tie + BEYOND
    wide = min(_extent(core, pose + 24) + beyond, reach + BEYOND)
    high = min(_extent(core, pose + 48) + beyond, reach + BEYOND)
    deep = min(_extent(core, pose + 72) + beyond, reach + BEYOND)
    layers = _cell(z - deep, c.z, c.per_bin, c.bin_layers), _cell(z + deep, c.z, c.per_bin, c.bin_layers)
    rows = _cell(y - high, c.y, c.per_bin, c.bin_rows), _cell(y + high, c.y, c.per_bin, c.bin_rows)
    for k in range(layers[0], layers[1] + 1):
        for j in range(rows[0], rows[1] + 1):
            row = c.first + 4 * c.bins * (j + c.bin_rows * k)
            begin = int(single_at(row + 4 * _cell(x - wide, c.x, c.per_bin, c.bins)))
            end = int(single_at(row + 4 * _cell(x + wide, c.x, c.per_bin, c.bins) + 4))
            for p in range(begin, end):
                place = c.points + 24 * p
                u, v, w = double_at(place), double_at(place + 8), double_at(place + 16)
                if (u - x) * (u - x) + (v - y) * (v - y) + (w - z) * (w - z) > reach * reach:
                    continue
                for i in range(3):
                    at = pose + 8 * i
                    turned = u * double_at(at + 24) + v * double_at(at + 48) + w * double_at(at + 72)
                    store_double(point + 8 * i, double_at(at) + turned)
                verdict = point_verdict(core, point, threshold, tie, axis, places)
                if verdict == CONTACT:
                    return CONTACT
                worst = max(worst, verdict)
    return worst


@compiled(lean=True)
def _extent(core: ConvexCore, axis: int) -> float:
    """Return how far the box around a core reaches from its center along a unit vector at an address [m]."""
    pose, half, total = core.pose, core.half, 0.0
    x, y, z = double_at(axis), double_at(axis + 8), double_at(axis + 16)
    for i in range(3):
        at = pose + 24 * (i + 1)
        along = x * double_at(at) + y * double_at(at + 8) + z * double_at(at + 16)
        total += abs(along) * double_at(half + 8 * i)
    return total


@compiled(lean=True)
def point_in_cloud(place: int, pose: int, address: int, threshold: float, tie: float) -> int:
    """Return whether a point is nearer to a cloud's points than a threshold [m]: FREE, CONTACT or TIE.

    Args:
        place: Address of the point's coordinates.
        pose: Address of the cloud's frame, center and axes, shape (12,).
        address: Of the cloud's block.
        threshold: The distance [m].
        tie: Distances within this of the threshold are ties [m].
    """
    c, reach = cloud_at(address), threshold + tie + BEYOND
    dx, dy, dz = (
        double_at(place) - double_at(pose),
        double_at(place + 8) - double_at(pose + 8),
        double_at(place + 16) - double_at(pose + 16),
    )
    x = dx * double_at(pose + 24) + dy * double_at(pose + 32) + dz * double_at(pose + 40)
    y = dx * double_at(pose + 48) + dy * double_at(pose + 56) + dz * double_at(pose + 64)
    z = dx * double_at(pose + 72) + dy * double_at(pose + 80) + dz * double_at(pose + 88)
    best = (threshold + 2.0 * tie) ** 2
    layers = _cell(z - reach, c.z, c.per_bin, c.bin_layers), _cell(z + reach, c.z, c.per_bin, c.bin_layers)
    rows = _cell(y - reach, c.y, c.per_bin, c.bin_rows), _cell(y + reach, c.y, c.per_bin, c.bin_rows)
    for k in range(layers[0], layers[1] + 1):
        for j in range(rows[0], rows[1] + 1):
            row = c.first + 4 * c.bins * (j + c.bin_rows * k)
            begin = int(single_at(row + 4 * _cell(x - reach, c.x, c.per_bin, c.bins)))
            end = int(single_at(row + 4 * _cell(x + reach, c.x, c.per_bin, c.bins) + 4))
            for p in range(begin, end):
                at = c.points + 24 * p
                u, v, w = double_at(at) - x, double_at(at + 8) - y, double_at(at + 16) - z
                best = min(best, u * u + v * v + w * w)
    nearest = math.sqrt(best)
    if nearest > threshold + tie:
        return FREE
    return CONTACT if nearest < threshold - tie else TIE


@compiled(lean=True)
def clouds_verdict(
    pose: int, address: int, other: int, addressed: int, threshold: float, tie: float, scratch: int
) -> int:
    """Return the verdict on two clouds: whether points of both are nearer than a threshold.

    Args:
        pose: Address of the frame of the first in the world, center and axes, shape (12,).
        address: Of its block.
        other: The same of the second.
        addressed: Of its block.
        threshold: The distance [m].
        tie: Distances within this of the threshold are ties [m].
        scratch: Address of workspace for POINT_WORKSPACE_SIZE doubles.
    """
    c, worst, place = cloud_at(address), FREE, scratch + 8 * (GJK_WORKSPACE_SIZE + 15)
    for p in range(int(double_at(address + 56))):
        at = c.points + 24 * p
        for i in range(3):
            turned = double_at(at) * double_at(pose + 24 + 8 * i)
            turned += double_at(at + 8) * double_at(pose + 48 + 8 * i)
            turned += double_at(at + 16) * double_at(pose + 72 + 8 * i)
            store_double(place + 8 * i, double_at(pose + 8 * i) + turned)
        verdict = point_in_cloud(place, other, addressed, threshold, tie)
        if verdict == CONTACT:
            return CONTACT
        worst = max(worst, verdict)
    return worst


@compiled("void(float64[:, ::1], float64[::1])")
def extent(points: Array, box: Array) -> None:
    """Write the least and the greatest corner, shape (6,), of the box around points, shape (k, 3) [m]."""
    for a in range(3):
        box[a], box[3 + a] = math.inf, -math.inf
    for p in range(points.shape[0]):
        for a in range(3):
            box[a] = min(box[a], points[p, a])
            box[3 + a] = max(box[3 + a], points[p, a])


@compiled("Tuple(int64, float64)(float64[:, ::1], float64[::1], float64, int64[::1], float64[:, ::1])")
def thin(points: Array, low: Array, edge: float, table: NDArray[np.int64], boxes: Array) -> tuple[int, float]:
    """Sort points into cubes; return how many there are, and how far a point is from its cube's at most [m].

    Args:
        points: Coordinates, shape (k, 3) [m].
        low: Least corner of the first cube, shape (>= 3,) [m].
        edge: Edge of a cube [m].
        table: Workspace, all -1, its shape (t,) with t a power of two above k.
        boxes: Written: of each cube the middle of the box around its points; and workspace, shape (k, 6) [m].
    """
    count, mask, off = 0, table.size - 1, 0.0
    keys, owner = np.empty((points.shape[0], 3), np.int64), np.empty(points.shape[0], np.int64)
    for p in range(points.shape[0]):
        i = int((points[p, 0] - low[0]) / edge)
        j = int((points[p, 1] - low[1]) / edge)
        k = int((points[p, 2] - low[2]) / edge)
        slot = (i * 73856093 ^ j * 19349663 ^ k * 83492791) & mask
        while table[slot] >= 0:
            cube = table[slot]
            if keys[cube, 0] == i and keys[cube, 1] == j and keys[cube, 2] == k:
                break
            slot = (slot + 1) & mask
        cube = table[slot]
        if cube < 0:
            cube = table[slot] = count
            keys[cube, 0], keys[cube, 1], keys[cube, 2] = i, j, k
            for a in range(3):
                boxes[cube, a] = boxes[cube, 3 + a] = points[p, a]
            count += 1
        owner[p] = cube
        for a in range(3):
            boxes[cube, a] = min(boxes[cube, a], points[p, a])
            boxes[cube, 3 + a] = max(boxes[cube, 3 + a], points[p, a])
    for k in range(count):
        for a in range(3):
            boxes[k, a] = 0.5 * (boxes[k, a] + boxes[k, 3 + a])
    for p in range(points.shape[0]):
        squared = 0.0
        for a in range(3):
            apart = points[p, a] - boxes[owner[p], a]
            squared += apart * apart
        off = max(off, squared)
    return count, math.sqrt(off)
