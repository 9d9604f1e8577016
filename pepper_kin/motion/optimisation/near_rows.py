"""Distances of the nearest bodies at many states, with their derivatives, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Floats4, Ints1, Ints2
from pepper_kin.motion.optimisation.nearest import nearest_points, place_core, project


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


class NearRoom(NamedTuple):
    """Room for the search at K states.

    Attributes:
        centers: Of all bodies, shape (B, 3, K) [m].
        square: Squared distances, shape (K,).
        cores: In the world, where they were needed, shape (K, B, 16).
        placed: 1 where they were, shape (K, B).
        axes: See `place_axes`, shape (J, 6).
        gradient: Shape (J,).
    """

    centers: Floats3
    square: Floats1
    cores: Floats3
    placed: Floats2
    axes: Floats2
    gradient: Floats1


@compiled(lean=True)
def find_near_rows(poses: Floats4, bodies: Bodies, influence: float, near: NearRows, room: NearRoom) -> None:
    """Write the nearest pairs at each state.

    Bounding spheres are compared at all states side by side first.

    Args:
        poses: World poses of the frames at K states, shape (K, F, 4, 4).
        bodies: The bodies.
        influence: Distances beyond this do not count [m]; rows that are left have this distance.
        near: Written.
        room: Room.
    """
    distance, count, pairs = near.distance, near.found, bodies.pairs
    states, most = distance.shape
    reach, radius, gap = bodies.reach, bodies.radius, bodies.gap
    square, cores, placed = room.square, room.cores, room.placed
    _place_centers(poses, bodies, room.centers)
    for k in range(states):
        count[k] = 0
        for b in range(radius.size):
            placed[k, b] = 0.0
        for i in range(most):
            distance[k, i] = influence
    for p in range(len(pairs)):
        a, b = pairs[p, 0], pairs[p, 1]
        balls, grown = reach[a] + reach[b] + gap[p], reach[a] + radius[b] + gap[p]
        width = balls + influence
        if _square_distances(room.centers, a, b, square) >= width * width:
            continue
        for k in range(states):
            width = balls + distance[k, most - 1]
            if square[k] >= width * width:
                continue
            _place(poses, k, bodies, a, cores, placed)
            _place(poses, k, bodies, b, cores, placed)
            # The sphere of one against the other's core.
            first, second = cores[k, a], cores[k, b]
            x, y, z = first[0], first[1], first[2]
            u, v, w = project(second, x, y, z)
            width = grown + distance[k, most - 1]
            if (x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2 >= width * width:
                continue
            (x, y, z), (u, v, w) = nearest_points(first, second)
            apart = math.sqrt((x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2) - radius[a] - radius[b] - gap[p]
            if apart < distance[k, most - 1]:
                _insert(near, k, apart, p, (x, y, z, u, v, w))


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
def _square_distances(centers: Floats3, a: int, b: int, square: Floats1) -> float:
    """Write the squared distances of two bodies' centers at all states; return the least."""
    least = 1e300
    ax, ay, az = centers[a, 0], centers[a, 1], centers[a, 2]
    bx, by, bz = centers[b, 0], centers[b, 1], centers[b, 2]
    for k in range(square.size):
        x, y, z = ax[k] - bx[k], ay[k] - by[k], az[k] - bz[k]
        value = x * x + y * y + z * z
        square[k] = value
        least = value if value < least else least
    return least


@compiled(lean=True)
def _place_centers(poses: Floats4, bodies: Bodies, centers: Floats3) -> None:
    """Write the centers of all bodies, shape (B, 3, K)."""
    for b in range(bodies.frame.size):
        f = bodies.frame[b]
        x, y, z = bodies.cores[b, 0], bodies.cores[b, 1], bodies.cores[b, 2]
        for k in range(centers.shape[2]):
            if f < 0:
                centers[b, 0, k], centers[b, 1, k], centers[b, 2, k] = x, y, z
            else:
                for i in range(3):
                    centers[b, i, k] = (
                        poses[k, f, i, 3]
                        + poses[k, f, i, 0] * x
                        + poses[k, f, i, 1] * y
                        + poses[k, f, i, 2] * z
                    )


@compiled(lean=True, inline=True)
def _place(poses: Floats4, k: int, bodies: Bodies, b: int, cores: Floats3, placed: Floats2) -> None:
    """Write the core of a body at a state, once."""
    if placed[k, b] != 0.0:
        return
    placed[k, b] = 1.0
    for i in range(12, 16):
        cores[k, b, i] = bodies.cores[b, i]
    if bodies.frame[b] < 0:
        for i in range(12):
            cores[k, b, i] = bodies.cores[b, i]
    else:
        place_core(poses[k, bodies.frame[b]], bodies.cores[b], cores[k, b])


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
