"""Distances of the nearest bodies at many states, with their derivatives, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Floats4, Ints1, Ints2
from pepper_kin.motion.optimization.nearest import CYLINDER, HALF, KIND, nearest_points


class Bodies(NamedTuple):
    """Bodies on links and in the world, and the joints that carry them; B bodies, J joints, P pairs.

    Attributes:
        frame: Number of the frame that a body is fixed to, -1 for the world, shape (B,).
        cores: Their cores in that frame, shape (B, 16); see `nearest`.
        radius: Radii around the cores [m], shape (B,).
        reach: Radii of the bodies' bounding spheres about their centers [m], shape (B,).
        carried: 1 where a joint moves a body, else 0, shape (B, J).
        joint_frame: Number of the frame that a joint moves, shape (J,).
        joint_axis: Its axis in that frame, and a point of the axis [m], shape (J, 6).
        slides: 1 where it is prismatic, else 0, shape (J,).
        pairs: Bodies to compare, shape (P, 2).
        gap: Distance that each pair keeps [m], shape (P,).
    """

    frame: Ints1
    cores: Floats2
    radius: Floats1
    reach: Floats1
    carried: Ints2
    joint_frame: Ints1
    joint_axis: Floats2
    slides: Ints1
    pairs: Ints2
    gap: Floats1


class NearRows(NamedTuple):
    """The nearest pairs at K states, R of each.

    Attributes:
        distance: Their distances less the gaps that they keep, ascending, shape (K, R) [m].
        pair: Their places among the pairs, shape (K, R).
        points: Their nearest points, shape (K, R, 6) [m].
        found: How many there are, shape (K,).
    """

    distance: Floats2
    pair: Ints2
    points: Floats3
    found: Ints1


class NearWorkspace(NamedTuple):
    """Workspace of the search at K states.

    Attributes:
        frames: Poses of F frames with states side by side: origin, x, y and z axis, shape (F, 12, K).
        cores: Those of the bodies' cores, shape (B, 12, K); without axes x and y of those that are
            points or segments.
        square: Squared distances of two bodies' centers, and of each one's center to the other's core, shape
            (3, K).
        pair: The two cores that are compared at a state, shape (2, 16).
        guess: Where the last two were nearest, see `nearest_points`, shape (4,).
        axes: See `place_axes`, shape (J, 6).
        gradient: Shape (J,).
    """

    frames: Floats3
    cores: Floats3
    square: Floats2
    pair: Floats2
    guess: Floats1
    axes: Floats2
    gradient: Floats1


@compiled(lean=True)
def find_near_rows(
    poses: Floats4, bodies: Bodies, influence: float, near: NearRows, scratch: NearWorkspace
) -> None:
    """Write the nearest pairs at each state.

    Bounding spheres, and the sphere of one against the other's core, are compared at all states side by side.

    Args:
        poses: World poses of the frames at K states, shape (K, F, 4, 4).
        bodies: The bodies.
        influence: Distances beyond this do not count [m]; rows that are left have this distance.
        near: Written.
        scratch: Workspace.
    """
    distance, pairs = near.distance, bodies.pairs
    states, most = distance.shape
    reach, radius, gap = bodies.reach, bodies.radius, bodies.gap
    square, first, second = scratch.square, scratch.pair[0], scratch.pair[1]
    _place_cores(poses, bodies, scratch)
    for k in range(states):
        near.found[k] = 0
        for i in range(most):
            distance[k, i] = influence
    for p in range(len(pairs)):
        a, b = pairs[p, 0], pairs[p, 1]
        balls, ours = reach[a] + reach[b] + gap[p], reach[a] + radius[b] + gap[p]
        theirs = radius[a] + reach[b] + gap[p]
        if _are_far(bodies, scratch, a, b, (balls + influence, ours + influence, theirs + influence)):
            continue
        scratch.guess[0] = 0.0
        for k in range(states):
            width = distance[k, most - 1]
            if (
                square[0, k] >= (balls + width) ** 2
                or square[1, k] >= (ours + width) ** 2
                or square[2, k] >= (theirs + width) ** 2
            ):
                continue
            _fetch(bodies, scratch.cores, a, k, first)
            _fetch(bodies, scratch.cores, b, k, second)
            (x, y, z), (u, v, w) = nearest_points(first, second, scratch.guess)
            apart = math.sqrt((x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2) - radius[a] - radius[b] - gap[p]
            if apart < distance[k, most - 1]:
                _insert(near, k, apart, p, (x, y, z, u, v, w))


@compiled(lean=True)
def _are_far(
    bodies: Bodies, scratch: NearWorkspace, a: int, b: int, widths: tuple[float, float, float]
) -> bool:
    """Write the squared distances of two bodies at all states; return whether one shows that they are far."""
    balls, ours, theirs = widths
    one, other, square = scratch.cores[a], scratch.cores[b], scratch.square
    if _square_between(one, other, square[0]) >= balls * balls:
        return True
    if _square_outside(one, other, bodies.cores[b], square[1], square[0]) >= ours * ours:
        return True
    return _square_outside(other, one, bodies.cores[a], square[2], square[0]) >= theirs * theirs


@compiled(lean=True)
def _fetch(bodies: Bodies, cores: Floats3, b: int, k: int, core: Floats1) -> None:
    """Copy the core of a body in the world at a state."""
    for i in range(12):
        core[i] = cores[b, i, k]
    for i in range(12, 16):
        core[i] = bodies.cores[b, i]


@compiled(lean=True)
def _insert(
    near: NearRows, k: int, apart: float, p: int, points: tuple[float, float, float, float, float, float]
) -> None:
    """Put a pair in its place among the nearest of a state."""
    distance, most = near.distance, near.distance.shape[1]
    place = min(near.found[k], most - 1)
    while place > 0 and distance[k, place - 1] > apart:
        distance[k, place], near.pair[k, place] = distance[k, place - 1], near.pair[k, place - 1]
        for i in range(6):
            near.points[k, place, i] = near.points[k, place - 1, i]
        place -= 1
    distance[k, place], near.pair[k, place] = apart, p
    x, y, z, u, v, w = points
    near.points[k, place, 0], near.points[k, place, 1], near.points[k, place, 2] = x, y, z
    near.points[k, place, 3], near.points[k, place, 4], near.points[k, place, 5] = u, v, w
    near.found[k] = min(near.found[k] + 1, most)


@compiled(lean=True, vector=True)
def _square_between(one: Floats2, other: Floats2, square: Floats1) -> float:
    """Write the squared distances of two cores' centers at all states; return the least."""
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
    """Write the squared distances of a center to another core at all states; return the least.

    Args:
        one: Core whose center is taken, at all states, shape (12, K).
        core: The other core.
        local: Half sizes and kind of that, see `nearest`.
        square: Written, shape (K,).
        between: Squared distances of the two centers, shape (K,).
    """
    if local[HALF] > 0.0 or local[HALF + 1] > 0.0:
        x, y, z = local[HALF], local[HALF + 1], local[HALF + 2]
        return _outside_solid(one, core, (x, y, z), local[KIND] == CYLINDER, square)
    return _outside_segment(one, core, local[HALF + 2], square, between)


@compiled(lean=True, vector=True)
def _outside_segment(one: Floats2, core: Floats2, half: float, square: Floats1, between: Floats1) -> float:
    """See `_square_outside`; of a point or a segment along z, whose axes x and y are not placed."""
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
    """See `_square_outside`; of a box or a cylinder."""
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
def _place_cores(poses: Floats4, bodies: Bodies, scratch: NearWorkspace) -> None:
    """Write the cores of all bodies in the world, states side by side."""
    frames, cores = scratch.frames, scratch.cores
    states, count = poses.shape[0], frames.shape[0]
    for k in range(states):
        for f in range(count):
            for i in range(3):
                row = poses[k, f, i]
                frames[f, i, k], frames[f, 3 + i, k] = row[3], row[0]
                frames[f, 6 + i, k], frames[f, 9 + i, k] = row[1], row[2]
    for b in range(bodies.frame.size):
        local, f, core = bodies.cores[b], bodies.frame[b], cores[b]
        is_point = local[HALF] == 0.0 and local[HALF + 1] == 0.0
        for column in range(4):
            if is_point and 0 < column < 3:
                continue
            x, y, z = local[3 * column], local[3 * column + 1], local[3 * column + 2]
            for i in range(3):
                if f < 0:
                    _fill(core[3 * column + i], local[3 * column + i])
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
    """Write coordinate i of a frame's vector in the world at all states."""
    x, y, z = vector
    first, second, third = frame[3 + i], frame[6 + i], frame[9 + i]
    for k in range(values.size):
        values[k] = first[k] * x + second[k] * y + third[k] * z


@compiled(lean=True)
def place_axes(poses: Floats4, k: int, bodies: Bodies, axes: Floats2) -> None:
    """Write the axes of all joints and a point of each in the world at a state, shape (J, 6)."""
    for j in range(bodies.slides.size):
        f, own = bodies.joint_frame[j], bodies.joint_axis[j]
        for i in range(3):
            row = poses[k, f, i]
            axes[j, i] = row[0] * own[0] + row[1] * own[1] + row[2] * own[2]
            axes[j, 3 + i] = row[3] + row[0] * own[3] + row[1] * own[4] + row[2] * own[5]


@compiled(lean=True)
def differentiate(bodies: Bodies, near: NearRows, k: int, r: int, axes: Floats2, gradient: Floats1) -> None:
    """Write d(distance)/dq_j = n . (dp_a/dq_j - dp_b/dq_j), n the direction from b to a, shape (J,)."""
    a, b = bodies.pairs[near.pair[k, r], 0], bodies.pairs[near.pair[k, r], 1]
    p = near.points[k, r]
    x, y, z = p[0] - p[3], p[1] - p[4], p[2] - p[5]
    length = math.sqrt(x * x + y * y + z * z)
    scale = 1.0 / length if length >= 1e-12 else 0.0
    x, y, z = scale * x, scale * y, scale * z
    for j in range(gradient.size):
        # What carries both moves both alike, and leaves their distance as it is.
        sign = float(bodies.carried[a, j] - bodies.carried[b, j])
        gradient[j] = 0.0
        if sign == 0.0:
            continue
        axis, side = axes[j], 0 if sign > 0.0 else 3
        if bodies.slides[j] != 0:
            part = x * axis[0] + y * axis[1] + z * axis[2]
        else:
            u, v, w = p[side] - axis[3], p[side + 1] - axis[4], p[side + 2] - axis[5]
            part = x * (axis[1] * w - axis[2] * v)
            part += y * (axis[2] * u - axis[0] * w)
            part += z * (axis[0] * v - axis[1] * u)
        gradient[j] = sign * part
