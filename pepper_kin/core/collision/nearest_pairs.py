"""Distances of the nearest bodies at many states, with their gradients, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.core.collision.distances import CARRIER, NearTable, measure
from pepper_kin.core.collision.layout import CYLINDER
from pepper_kin.core.collision.scene_rows import BOUNDING, HALF, KIND, PLACE, RADIUS
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Floats4, Ints1, Ints2


class NearestPairs(NamedTuple):
    """The R nearest pairs at each of K states.

    Attributes:
        distance: Distances of the pairs less the gaps that they keep, ascending, shape (K, R) [m].
        pair: Indices of the pairs, shape (K, R).
        points: The nearest points of their cores [m], and the direction from the second to the first, shape
            (K, R, 3, 3).
        found: Number of pairs found, at most R, shape (K,).
    """

    distance: Floats2
    pair: Ints2
    points: Floats4
    found: Ints1


class NearestWorkspace(NamedTuple):
    """Workspace of the search at K states.

    Attributes:
        frames: Poses of F frames, states contiguous: origin, x, y and z axis, shape (F, 12, K).
        cores: Poses of the bodies' cores, shape (B, 12, K); axes x and y of points and segments are not
            written.
        square: Squared distances of two bodies' centers, and of each center to the other's core,
            shape (3, K).
        pair: Poses of the two cores that are compared at a state, shape (2, 12).
        near: Nearest points and direction of the two cores, see `measure`, shape (3, 3).
        work: Workspace of `measure`.
        poses: Poses of the joints at a state, of which only the origins are written, shape (J + 1, 12).
        axes: Axes of the joints at a state, shape (J + 1, 3).
        gradient: Gradient of a distance, shape (J,).
    """

    frames: Floats3
    cores: Floats3
    square: Floats2
    pair: Floats2
    near: Floats2
    work: Floats1
    poses: Floats2
    axes: Floats2
    gradient: Floats1


@compiled(lean=True)
def find_nearest(
    poses: Floats4, table: NearTable, influence: float, near: NearestPairs, scratch: NearestWorkspace
) -> None:
    """Write the nearest pairs at each state.

    Bounding spheres, and each bounding sphere against the other's core, are compared at all states at a time.

    Args:
        poses: World poses of the frames that the joints move at K states, shape (K, J, 4, 4).
        table: The shapes and pairs.
        influence: Distance beyond which pairs do not count [m]; unused rows have this distance.
        near: Output.
        scratch: Workspace.
    """
    distance, pairs, shapes = near.distance, table.pairs, table.shapes
    states, most = distance.shape
    square, first, second = scratch.square, scratch.pair[0], scratch.pair[1]
    _place_cores(poses, table, scratch)
    for k in range(states):
        near.found[k] = 0
        for i in range(most):
            distance[k, i] = influence
    for p in range(len(pairs)):
        a, b, gap = pairs[p, 0], pairs[p, 1], table.keep[p]
        one, other = shapes[a], shapes[b]
        balls, ours = one[BOUNDING] + other[BOUNDING] + gap, one[BOUNDING] + other[RADIUS] + gap
        theirs, radii = one[RADIUS] + other[BOUNDING] + gap, one[RADIUS] + other[RADIUS] + gap
        if _are_far(table, scratch, a, b, (balls + influence, ours + influence, theirs + influence)):
            continue
        for k in range(states):
            width = distance[k, most - 1]
            if (
                square[0, k] >= (balls + width) ** 2
                or square[1, k] >= (ours + width) ** 2
                or square[2, k] >= (theirs + width) ** 2
            ):
                continue
            _fetch(one, scratch.cores[a], k, first)
            _fetch(other, scratch.cores[b], k, second)
            far = max(radii + width, 0.0)
            apart = (
                measure(one, first, other, second, table.vertices, far, scratch.near, scratch.work) - radii
            )
            if apart < distance[k, most - 1]:
                _insert(near, k, apart, p, scratch.near)


@compiled(lean=True)
def _are_far(
    table: NearTable, scratch: NearestWorkspace, a: int, b: int, widths: tuple[float, float, float]
) -> bool:
    """Write squared distances of two shapes at all states; return whether one proves that they are far.

    `widths` are the distances of the two centers, of a's center from b's core, and of b's center from a's
    core beyond which the shapes are far [m].
    """
    balls, ours, theirs = widths
    one, other, square = scratch.cores[a], scratch.cores[b], scratch.square
    if _square_between(one, other, square[0]) >= balls * balls:
        return True
    if _square_outside(one, other, table.shapes[b], square[1], square[0]) >= ours * ours:
        return True
    return _square_outside(other, one, table.shapes[a], square[2], square[0]) >= theirs * theirs


@compiled(lean=True)
def _is_thin(shape: Floats1) -> bool:
    """Return whether axes x and y of a core, shape (SHAPE,), are irrelevant and not placed."""
    return shape[HALF] == 0.0 and shape[HALF + 1] == 0.0


@compiled(lean=True)
def _fetch(shape: Floats1, core: Floats2, k: int, pose: Floats1) -> None:
    """Copy the pose, shape (12,), of a shape's core, shape (12, K), at a state; unplaced axes are zero."""
    is_thin = _is_thin(shape)
    for i in range(12):
        pose[i] = 0.0 if is_thin and 3 <= i < 9 else core[i, k]


@compiled(lean=True)
def _insert(near: NearestPairs, k: int, apart: float, p: int, points: Floats2) -> None:
    """Insert a pair into the sorted nearest pairs of a state; points: shape (3, 3)."""
    distance, most = near.distance, near.distance.shape[1]
    place = min(near.found[k], most - 1)
    while place > 0 and distance[k, place - 1] > apart:
        distance[k, place], near.pair[k, place] = distance[k, place - 1], near.pair[k, place - 1]
        for i in range(9):
            near.points[k, place, i // 3, i % 3] = near.points[k, place - 1, i // 3, i % 3]
        place -= 1
    distance[k, place], near.pair[k, place] = apart, p
    for i in range(9):
        near.points[k, place, i // 3, i % 3] = points[i // 3, i % 3]
    near.found[k] = min(near.found[k] + 1, most)


@compiled(lean=True, vector=True)
def _square_between(one: Floats2, other: Floats2, square: Floats1) -> float:
    """Write the squared distances of two cores' centers at all states; return the minimum."""
    least = 1e300
    ax, ay, az, bx, by, bz = one[0], one[1], one[2], other[0], other[1], other[2]
    for k in range(square.size):
        x, y, z = ax[k] - bx[k], ay[k] - by[k], az[k] - bz[k]
        value = x * x + y * y + z * z
        square[k] = value
        least = value if value < least else least
    return least


@compiled(lean=True)
def _square_outside(one: Floats2, core: Floats2, local: Floats1, square: Floats1, between: Floats1) -> float:
    """Write the squared distances of a core's center to another core at all states; return the minimum.

    Args:
        one: Poses of the core whose center is taken, shape (12, K).
        core: Poses of the other core, shape (12, K).
        local: Shape of the other core, see `NearTable`, shape (SHAPE,).
        square: Output, shape (K,).
        between: Squared distances of the two centers, shape (K,).
    """
    if local[HALF] > 0.0 or local[HALF + 1] > 0.0:
        x, y, z = local[HALF], local[HALF + 1], local[HALF + 2]
        return _outside_solid(one, core, (x, y, z), local[KIND] == CYLINDER, square)
    return _outside_segment(one, core, local[HALF + 2], square, between)


@compiled(lean=True, vector=True)
def _outside_segment(one: Floats2, core: Floats2, half: float, square: Floats1, between: Floats1) -> float:
    """Write `_square_outside` for a point or a segment along z, whose axes x and y are not placed."""
    least = 1e300
    ax, ay, az, bx, by, bz = one[0], one[1], one[2], core[0], core[1], core[2]
    zx, zy, zz = core[9], core[10], core[11]
    for k in range(square.size):
        along = (ax[k] - bx[k]) * zx[k] + (ay[k] - by[k]) * zy[k] + (az[k] - bz[k]) * zz[k]
        along = abs(along)
        out = along - half
        out = out if out > 0.0 else 0.0
        value = between[k] - along * along + out * out
        square[k] = value
        least = value if value < least else least
    return least


@compiled(lean=True, vector=True)
def _outside_solid(
    one: Floats2, core: Floats2, half: tuple[float, float, float], is_round: bool, square: Floats1
) -> float:
    """Write `_square_outside` for a box or a cylinder."""
    least, (hx, hy, hz) = 1e300, half
    ax, ay, az, bx, by, bz = one[0], one[1], one[2], core[0], core[1], core[2]
    xx, xy, xz, yx, yy, yz = core[3], core[4], core[5], core[6], core[7], core[8]
    zx, zy, zz = core[9], core[10], core[11]
    for k in range(square.size):
        dx, dy, dz = ax[k] - bx[k], ay[k] - by[k], az[k] - bz[k]
        x = abs(dx * xx[k] + dy * xy[k] + dz * xz[k])
        y = abs(dx * yx[k] + dy * yy[k] + dz * yz[k])
        z = abs(dx * zx[k] + dy * zy[k] + dz * zz[k]) - hz
        if is_round:
            x, y = math.sqrt(x * x + y * y), 0.0
        x, y = x - hx, y - hy
        x = x if x > 0.0 else 0.0
        y = y if y > 0.0 else 0.0
        z = z if z > 0.0 else 0.0
        value = x * x + y * y + z * z
        square[k] = value
        least = value if value < least else least
    return least


@compiled(lean=True)
def _place_cores(poses: Floats4, table: NearTable, scratch: NearestWorkspace) -> None:
    """Write the world poses of all shapes' cores, states contiguous; poses: shape (K, F, 4, 4)."""
    frames, cores = scratch.frames, scratch.cores
    states, count = poses.shape[0], frames.shape[0]
    for k in range(states):
        for f in range(count):
            for i in range(3):
                row = poses[k, f, i]
                frames[f, i, k], frames[f, 3 + i, k] = row[3], row[0]
                frames[f, 6 + i, k], frames[f, 9 + i, k] = row[1], row[2]
    for b in range(table.shapes.shape[0]):
        shape, core = table.shapes[b], cores[b]
        f, is_thin = int(shape[CARRIER]) - 1, _is_thin(shape)
        for column in range(4):
            if is_thin and 0 < column < 3:
                continue
            at = PLACE + 3 * column
            x, y, z = shape[at], shape[at + 1], shape[at + 2]
            for i in range(3):
                if f < 0:
                    _fill(core[3 * column + i], shape[at + i])
                else:
                    _turn(frames[f], i, (x, y, z), core[3 * column + i])
                    if column == 0:
                        _add(core[i], frames[f, i])


@compiled(lean=True)
def _fill(values: Floats1, value: float) -> None:
    for k in range(values.size):
        values[k] = value


@compiled(lean=True)
def _add(values: Floats1, more: Floats1) -> None:
    for k in range(values.size):
        values[k] += more[k]


@compiled(lean=True, vector=True)
def _turn(frame: Floats2, i: int, vector: tuple[float, float, float], values: Floats1) -> None:
    """Write coordinate i of a frame's vector in the world at all states, shape (K,)."""
    x, y, z = vector
    first, second, third = frame[3 + i], frame[6 + i], frame[9 + i]
    for k in range(values.size):
        values[k] = first[k] * x + second[k] * y + third[k] * z


@compiled(lean=True)
def place_axes(poses: Floats4, k: int, table: NearTable, origins: Floats2, axes: Floats2) -> None:
    """Write origins, shape (J + 1, 12), and axes, shape (J + 1, 3), of all joints in the world at a state."""
    for j in range(1, axes.shape[0]):
        for i in range(3):
            row = poses[k, j - 1, i]
            origins[j, i], axes[j, i] = row[3], 0.0
            for m in range(3):
                axes[j, i] += row[m] * table.joints[j, 14 + m]
