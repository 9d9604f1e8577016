"""Point clouds: distance fields on grids, and distances of spheres and solids to the points.

For each cell of a grid, a field holds a lower bound of the distance from its center to the nearest point: the
distance to the nearest cell that contains a point, by a distance transform along one axis after another.  A
sphere that the field shows to be far from all points costs a few loads.  For any other sphere, the points are
sorted by bins with an edge of two cells, row by row along x, so that adjacent bins of a row are contiguous,
and the rows that the sphere meets are searched.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import Array
from pepper_kin.core.collision.gjk import (
    CONTACT,
    FREE,
    GJK_WORKSPACE_SIZE,
    TIE,
    ConvexCore,
    nearer_than,
    turned,
    turned_back,
)
from pepper_kin.core.collision.layout import BOX, CYLINDER, HULL
from pepper_kin.core.collision.records import POSE, VECTORS, between, dot
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import floats_at
from pepper_kin.kernels.lanes import (
    LANES,
    lane_maximum,
    lane_minimum,
    lane_round,
    lane_sqrt,
    lanes_below,
    load_lanes,
    single_at,
    spread,
    store_lanes,
    store_single,
)
from pepper_kin.kernels.records import DOUBLES, SINGLES, RecordView, double

_NAMES = "edge cells rows layers count widest field first xs ys zs points workspace"
HEAD = RecordView("HEAD", low=3 * double, **dict.fromkeys(_NAMES.split(), double))
"""Head of a cloud's block: minimum corner of the grid, edge of a cell, number of cells of a row (a multiple
of eight), of rows of a layer, of layers, of points, maximum number of cells that the field resolves; then
offsets in the block, in doubles, of the field, of the bins' first points, of x, y and z of the points in
single precision, of their coordinates in double precision, and of workspace."""
BEYOND = 1e-5
"""Distance by which ranges of cells are widened against rounding [m]."""
POINT_WORKSPACE = RecordView(
    "POINT_WORKSPACE",
    pair=GJK_WORKSPACE_SIZE * double,
    half=3 * double,
    pose=12 * double,
    point=3 * double,
    axis=3 * double,
)
"""Workspace of `point_verdict` and `cloud_verdict`: workspace of `nearer_than`, half lengths and pose of a
point, its coordinates, and an axis."""
ROUNDED = 1e-6
"""Maximum rounding error of the field [m]."""
FAR = 1e18
"""Squared distance that stands for "no point" [m^2]."""


class Cloud(NamedTuple):
    """Grid and bins of a cloud, and the addresses of its arrays; see HEAD."""

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
    x, y, z = HEAD.low(address)
    edge, row = HEAD.edge(address), int(HEAD.cells(address))
    rows, layers = int(HEAD.rows(address)), int(HEAD.layers(address))
    return Cloud(
        x,
        y,
        z,
        edge,
        row,
        rows,
        layers,
        2.0 * edge,
        0.5 / edge,
        (row + 1) // 2,
        (rows + 1) // 2,
        (layers + 1) // 2,
        DOUBLES.at(address, int(HEAD.field(address))),
        DOUBLES.at(address, int(HEAD.first(address))),
        DOUBLES.at(address, int(HEAD.xs(address))),
        DOUBLES.at(address, int(HEAD.ys(address))),
        DOUBLES.at(address, int(HEAD.zs(address))),
        DOUBLES.at(address, int(HEAD.points(address))),
    )


@compiled(inline=True)
def _cell(x: float, low: float, rate: float, count: int) -> int:
    """Return the index of the cell nearest to a coordinate; `rate` is in cells per meter."""
    place = (x - low) * rate
    return int(place) if 0.0 < place < count else (0 if place <= 0.0 else count - 1)


@compiled("void(float64[:, ::1], float64[::1], float64[::1])")
def build_cloud(points: Array, middle: Array, block: Array) -> None:
    """Fill a cloud's block whose head has been written.

    Args:
        points: Coordinates, shape (k, 3) [m].
        middle: Origin of the cloud's frame, shape (3,) [m].
        block: The block; everything after its head is output, shape (s,).
    """
    address, count = block.ctypes.data, points.shape[0]
    c, widest = cloud_at(address), HEAD.widest(address)
    cells, bins, rate = c.row * c.rows * c.layers, c.bins * c.bin_rows * c.bin_layers, 1.0 / c.edge
    scratch = DOUBLES.at(address, int(HEAD.workspace(address)))  # bin of each point, then lines of lanes
    for k in range(0, cells, LANES):
        store_lanes(SINGLES.at(c.field, k), spread(widest * widest))
    for k in range(bins + 1):
        store_single(c.first, 0.0, k)
    for p in range(count):
        x, y, z = points[p, 0] - middle[0], points[p, 1] - middle[1], points[p, 2] - middle[2]
        i, j, k = (
            _cell(x, c.x, rate, c.row),
            _cell(y, c.y, rate, c.rows),
            _cell(z, c.z, rate, c.layers),
        )
        store_single(c.field, 0.0, i + c.row * (j + c.rows * k))
        cell = i // 2 + c.bins * (j // 2 + c.bin_rows * (k // 2))
        store_single(scratch, cell, p)
        store_single(c.first, single_at(c.first, cell + 1) + 1.0, cell + 1)
    for k in range(bins):
        store_single(c.first, single_at(c.first, k) + single_at(c.first, k + 1), k + 1)
    places = floats_at(c.points, 3 * count)
    for p in range(count):  # each bin's start moves to its end, which is corrected below
        cell = int(single_at(scratch, p))
        place = int(single_at(c.first, cell))
        store_single(c.first, place + 1.0, cell)
        for i in range(3):
            places[3 * place + i] = points[p, i] - middle[i]
        store_single(c.xs, places[3 * place], place)
        store_single(c.ys, places[3 * place + 1], place)
        store_single(c.zs, places[3 * place + 2], place)
    for k in range(bins, 0, -1):
        store_single(c.first, single_at(c.first, k - 1), k)
    store_single(c.first, 0.0)
    for i in range(LANES):  # padding, loaded with the last points
        store_single(c.xs, 1e9, count + i)
        store_single(c.ys, 1e9, count + i)
        store_single(c.zs, 1e9, count + i)
    _fill_field(c, int(widest), scratch)


@compiled
def _fill_field(c: Cloud, widest: int, scratch: int) -> None:
    """Write the field: squared distances along rows, then across them, then across layers.

    A point anywhere in a cell that is e cells away along an axis is at least (e - 1/2) edges away.

    Args:
        c: The cloud; its field is zero where points are and not zero elsewhere.
        widest: Distances above this number of cells are not distinguished.
        scratch: Address of workspace of LANES singles for each row of a layer, or each layer.
    """
    most = (widest - 0.5) ** 2
    for r in range(c.rows * c.layers):
        field, gap = SINGLES.at(c.field, c.row * r), float(widest)
        for i in range(c.row):
            gap = 0.0 if single_at(field, i) == 0.0 else gap + 1.0
            store_single(field, min(max(gap - 0.5, 0.0) ** 2, most), i)
        gap = float(widest)
        for i in range(c.row - 1, -1, -1):
            gap = 0.0 if single_at(field, i) == 0.0 else gap + 1.0
            store_single(field, min(max(gap - 0.5, 0.0) ** 2, single_at(field, i)), i)
    for k in range(c.layers):
        layer = SINGLES.at(c.field, c.row * c.rows * k)
        _spread_across(layer, c.row, c.rows, c.row, widest, scratch)
    for j in range(c.rows):
        row = SINGLES.at(c.field, c.row * j)
        _spread_across(row, c.row * c.rows, c.layers, c.row, widest, scratch)
    for k in range(c.row * c.rows * c.layers):
        store_single(c.field, math.sqrt(single_at(c.field, k)) * c.edge - ROUNDED, k)


@compiled
def _spread_across(begin: int, stride: int, count: int, width: int, widest: int, scratch: int) -> None:
    """Replace f(j) by the minimum of f(j) and all f(j + e) + (|e| - 1/2)^2, for lines of singles.

    Args:
        begin: Address of the first line.
        stride: Number of singles from one line to the next.
        count: Number of lines.
        width: Number of singles of a line.
        widest: Distances above this number of lines are not distinguished.
        scratch: Address of workspace for `count` lanes.
    """
    for i in range(0, width, LANES):
        for j in range(count):
            least = load_lanes(SINGLES.at(begin, i + stride * j))
            for e in range(1, widest):
                square = (e - 0.5) ** 2
                if lanes_below(spread(square), least) == 0:
                    break
                if j >= e:
                    least = lane_minimum(least, load_lanes(SINGLES.at(begin, i + stride * (j - e))) + square)
                if j + e < count:
                    least = lane_minimum(least, load_lanes(SINGLES.at(begin, i + stride * (j + e))) + square)
            store_lanes(scratch, least, j)
        for j in range(count):
            store_lanes(SINGLES.at(begin, i + stride * j), load_lanes(scratch, j))


@compiled(inline=True, lean=True)
def _clamped(x: Any, low: float, high: float) -> Any:
    """Return lanes clamped to [low, high]."""
    return lane_minimum(lane_maximum(x, spread(low)), spread(high))


@compiled(lean=True)
def field_squared(c: Cloud, x: Any, y: Any, z: Any, scratch: int) -> Any:
    """Return a lower bound of the squared distances of points to a cloud's points, in lanes [m^2].

    The field is off by at most the distance of a point from its cell's center.  For a point outside the grid,
    the squared distance is at least the sum of its squared distance from the grid and that of the nearest
    point of the grid from the cloud: the grid is convex.

    Args:
        c: The cloud.
        x: x coordinates in the cloud's frame, in lanes [m].
        y: y coordinates in lanes [m].
        z: z coordinates in lanes [m].
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
        store_single(scratch, single_at(c.field, int(single_at(scratch, lane))), lane)
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
    """Return the squared distance of a point to a cloud's points, at most reach^2 [m^2].

    Args:
        c: The cloud.
        x: x coordinate of the point in the cloud's frame [m].
        y: y coordinate of the point [m].
        z: z coordinate of the point [m].
        reach: Distance beyond which points do not count [m].
        enough: Squared distance below which the search ends with any point [m^2].
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
            row = SINGLES.at(c.first, c.bins * (j + c.bin_rows * k))
            p0 = int(single_at(row, _cell(x - wide, c.x, c.per_bin, c.bins)))
            p1 = int(single_at(row, _cell(x + wide, c.x, c.per_bin, c.bins) + 1))
            for p in range(p0, p1, LANES):
                dx, dy, dz = (
                    load_lanes(SINGLES.at(c.xs, p)) - x,
                    load_lanes(SINGLES.at(c.ys, p)) - y,
                    load_lanes(SINGLES.at(c.zs, p)) - z,
                )
                found = lanes_below(dx * dx + dy * dy + dz * dz, spread(best))
                q = p
                while found != 0:
                    if found & 1:
                        dx1, dy1, dz1 = (
                            single_at(c.xs, q) - x,
                            single_at(c.ys, q) - y,
                            single_at(c.zs, q) - z,
                        )
                        best = min(best, dx1 * dx1 + dy1 * dy1 + dz1 * dz1)
                    found >>= 1
                    q += 1
                if best < enough:
                    return best
    return best


@compiled(lean=True)
def point_to_core(core: ConvexCore, x: float, y: float, z: float) -> float:
    """Return the distance of a point to a core [m]: a box, a cylinder, or the box around a hull."""
    center, half = POSE.center(core.pose), VECTORS.xyz(core.half)
    u, v, w = turned(core.pose, x - center[0], y - center[1], z - center[2])
    w = max(abs(w) - half[2], 0.0)
    if core.kind != CYLINDER:
        u, v = max(abs(u) - half[0], 0.0), max(abs(v) - half[1], 0.0)
        return math.sqrt(u * u + v * v + w * w)
    u = max(math.sqrt(u * u + v * v) - half[0], 0.0)
    return math.sqrt(u * u + w * w)


@compiled(lean=True)
def point_verdict(core: ConvexCore, place: int, threshold: float, tie: float, axis: int, scratch: int) -> int:
    """Return whether a point is nearer to a core than a threshold [m]: FREE, CONTACT or TIE.

    Args:
        core: The core.
        place: Address of the point's coordinates.
        threshold: The distance [m].
        tie: Half width of the range around the threshold in which a distance is a TIE [m].
        axis: Address of the direction that last separated the two, changed.
        scratch: Address of a POINT_WORKSPACE, initially zeros.
    """
    x, y, z = VECTORS.xyz(place)
    distance = point_to_core(core, x, y, z)
    if distance > threshold + tie:
        return FREE
    if core.kind == HULL:
        half, pose = POINT_WORKSPACE.half_at(scratch), POINT_WORKSPACE.pose_at(scratch)
        VECTORS.set_xyz(pose, (x, y, z))
        point = ConvexCore(BOX, half, pose, 0, 0, 0, 0.0)
        return int(nearer_than(core, point, threshold, tie, axis, scratch))
    return CONTACT if distance < threshold - tie else TIE


@compiled(lean=True)
def cloud_verdict(
    core: ConvexCore, address: int, pose: int, reach: float, threshold: float, tie: float, places: int
) -> int:
    """Return whether any point of a cloud is nearer to a core than a threshold: FREE, CONTACT or TIE.

    Args:
        core: The core, in the world.
        address: Address of the cloud's block.
        pose: Address of the cloud's frame in the world, center and axes, shape (12,).
        reach: Distance from the core's center beyond which points do not count [m].
        threshold: The distance [m].
        tie: Half width of the range around the threshold in which a distance is a TIE [m].
        places: Address of a POINT_WORKSPACE, initially zeros.
    """
    c, worst = cloud_at(address), FREE
    point, axis = POINT_WORKSPACE.point_at(places), POINT_WORKSPACE.axis_at(places)
    dx, dy, dz = between(core.pose, pose)
    x, y, z = turned(pose, dx, dy, dz)
    beyond = threshold + tie + BEYOND
    wide = min(_extent(core, POSE.x_axis(pose)) + beyond, reach + BEYOND)
    high = min(_extent(core, POSE.y_axis(pose)) + beyond, reach + BEYOND)
    deep = min(_extent(core, POSE.z_axis(pose)) + beyond, reach + BEYOND)
    layers = _cell(z - deep, c.z, c.per_bin, c.bin_layers), _cell(z + deep, c.z, c.per_bin, c.bin_layers)
    rows = _cell(y - high, c.y, c.per_bin, c.bin_rows), _cell(y + high, c.y, c.per_bin, c.bin_rows)
    for k in range(layers[0], layers[1] + 1):
        for j in range(rows[0], rows[1] + 1):
            row = SINGLES.at(c.first, c.bins * (j + c.bin_rows * k))
            begin = int(single_at(row, _cell(x - wide, c.x, c.per_bin, c.bins)))
            end = int(single_at(row, _cell(x + wide, c.x, c.per_bin, c.bins) + 1))
            for p in range(begin, end):
                u, v, w = VECTORS.xyz(c.points, p)
                if (u - x) * (u - x) + (v - y) * (v - y) + (w - z) * (w - z) > reach * reach:
                    continue
                VECTORS.set_xyz(point, _placed(pose, u, v, w))
                verdict = point_verdict(core, point, threshold, tie, axis, places)
                if verdict == CONTACT:
                    return CONTACT
                worst = max(worst, verdict)
    return worst


@compiled(lean=True)
def _extent(core: ConvexCore, axis: tuple[float, float, float]) -> float:
    """Return how far the box around a core reaches from its center along a unit vector [m]."""
    u, v, w = turned(core.pose, axis[0], axis[1], axis[2])
    return float(dot(abs(u), abs(v), abs(w), VECTORS.xyz(core.half)))


@compiled(inline=True, lean=True)
def _placed(pose: int, u: float, v: float, w: float) -> tuple[float, float, float]:
    """Return the world coordinates of a point in a cloud's frame."""
    center = POSE.center(pose)
    x, y, z = turned_back(pose, u, v, w)
    return center[0] + x, center[1] + y, center[2] + z


@compiled(lean=True)
def point_in_cloud(place: int, pose: int, address: int, threshold: float, tie: float) -> int:
    """Return whether a point is nearer to a cloud's points than a threshold [m]: FREE, CONTACT or TIE.

    Args:
        place: Address of the point's coordinates.
        pose: Address of the cloud's frame, center and axes, shape (12,).
        address: Address of the cloud's block.
        threshold: The distance [m].
        tie: Half width of the range around the threshold in which a distance is a TIE [m].
    """
    c, reach = cloud_at(address), threshold + tie + BEYOND
    dx, dy, dz = between(place, pose)
    x, y, z = turned(pose, dx, dy, dz)
    best = (threshold + 2.0 * tie) ** 2
    layers = _cell(z - reach, c.z, c.per_bin, c.bin_layers), _cell(z + reach, c.z, c.per_bin, c.bin_layers)
    rows = _cell(y - reach, c.y, c.per_bin, c.bin_rows), _cell(y + reach, c.y, c.per_bin, c.bin_rows)
    for k in range(layers[0], layers[1] + 1):
        for j in range(rows[0], rows[1] + 1):
            row = SINGLES.at(c.first, c.bins * (j + c.bin_rows * k))
            begin = int(single_at(row, _cell(x - reach, c.x, c.per_bin, c.bins)))
            end = int(single_at(row, _cell(x + reach, c.x, c.per_bin, c.bins) + 1))
            for p in range(begin, end):
                u, v, w = VECTORS.xyz(c.points, p)
                u, v, w = u - x, v - y, w - z
                best = min(best, u * u + v * v + w * w)
    nearest = math.sqrt(best)
    if nearest > threshold + tie:
        return FREE
    return CONTACT if nearest < threshold - tie else TIE


@compiled(lean=True)
def clouds_verdict(
    pose: int, address: int, other: int, addressed: int, threshold: float, tie: float, scratch: int
) -> int:
    """Return whether two clouds have points nearer than a threshold: FREE, CONTACT or TIE.

    Args:
        pose: Address of the first cloud's frame in the world, center and axes, shape (12,).
        address: Address of the first cloud's block.
        other: Address of the second cloud's frame in the world, center and axes, shape (12,).
        addressed: Address of the second cloud's block.
        threshold: The distance [m].
        tie: Half width of the range around the threshold in which a distance is a TIE [m].
        scratch: Address of a POINT_WORKSPACE.
    """
    c, worst, place = cloud_at(address), FREE, POINT_WORKSPACE.point_at(scratch)
    for p in range(int(HEAD.count(address))):
        u, v, w = VECTORS.xyz(c.points, p)
        VECTORS.set_xyz(place, _placed(pose, u, v, w))
        verdict = point_in_cloud(place, other, addressed, threshold, tie)
        if verdict == CONTACT:
            return CONTACT
        worst = max(worst, verdict)
    return worst


@compiled("void(float64[:, ::1], float64[::1])")
def extent(points: Array, box: Array) -> None:
    """Write the minimum and the maximum corner, shape (6,), of the box around points, shape (k, 3) [m]."""
    for a in range(3):
        box[a], box[3 + a] = math.inf, -math.inf
    for p in range(points.shape[0]):
        for a in range(3):
            box[a] = min(box[a], points[p, a])
            box[3 + a] = max(box[3 + a], points[p, a])


@compiled("Tuple(int64, float64)(float64[:, ::1], float64[::1], float64, int64[::1], float64[:, ::1])")
def thin(points: Array, low: Array, edge: float, table: NDArray[np.int64], boxes: Array) -> tuple[int, float]:
    """Sort points into cubes; return the number of cubes, and the maximum error of a center [m].

    The error is the distance of a point from the center that `boxes` has for its cube.

    Args:
        points: Coordinates, shape (k, 3) [m].
        low: Minimum corner of the first cube, shape (>= 3,) [m].
        edge: Edge of a cube [m].
        table: Hash table, workspace, all -1, shape (t,) with t a power of two above k.
        boxes: Output in the first three columns: center of the box around each cube's points; the others are
            workspace, shape (k, 6) [m].
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
