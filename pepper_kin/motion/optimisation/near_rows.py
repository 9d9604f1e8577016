"""Distances of the nearest bodies at many states, with their derivatives, compiled."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Flags1, Flags2, Floats1, Floats2, Ints1, Ints2
from pepper_kin.motion.optimisation.nearest import Array, nearest_points, project

Integers = np.ndarray


class Bodies(NamedTuple):
    """Bodies on links and in the world, and the joints that carry them; B bodies, J joints, P pairs.

    Attributes:
        frame: Number of the frame that a body is fixed to, -1 for the world, shape (B,).
        cores: Their cores in that frame, shape (B, 16); see `nearest`.
        radius: Radii around the cores [m], shape (B,).
        reach: Radii of the bodies' bounding spheres about their centers [m], shape (B,).
        carried: Whether a joint moves a body, shape (B, J).
        joint_frame: Number of the frame that a joint moves, shape (J,).
        joint_axis: Its axis in that frame, and a point of the axis [m], shape (J, 6).
        slides: Whether it is prismatic, shape (J,).
        pairs: Bodies to compare, shape (P, 2).
        gap: Distance that each pair keeps [m], shape (P,).
    """

    frame: Ints1
    cores: Floats2
    radius: Floats1
    reach: Floats1
    carried: Flags2
    joint_frame: Ints1
    joint_axis: Floats2
    slides: Flags1
    pairs: Ints2
    gap: Floats1


@compiled("void(float64[:, :, :, ::1], Bodies, float64, float64[:, ::1], float64[:, :, ::1], boolean)")
def near_rows(
    poses: Array, bodies: Bodies, influence: float, distance: Array, gradient: Array, with_gradient: bool
) -> None:
    """Write the distances of the nearest pairs at each state, less the gaps that they keep, ascending.

    Args:
        poses: World poses of the frames at K states, shape (K, F, 4, 4).
        bodies: The bodies.
        influence: Distances beyond this do not count [m].
        distance: Written, shape (K, R) [m]; `influence` where fewer than R pairs are nearer.
        gradient: Written where wanted, shape (K, R, J) [m/rad or 1].
        with_gradient: Whether derivatives are wanted.
    """
    states, most = distance.shape
    pairs, gap, radius, reach = bodies.pairs, bodies.gap, bodies.radius, bodies.reach
    frame, local = bodies.frame, bodies.cores
    cores = local.copy()
    points, found = np.empty((most, 6)), np.empty(most, np.int64)
    for k in range(states):
        _place(poses, k, frame, local, cores)
        number = 0
        for i in range(most):
            distance[k, i] = influence
        for p in range(len(pairs)):
            a, b = pairs[p, 0], pairs[p, 1]
            limit = distance[k, most - 1] + gap[p]
            # Bounding spheres first, then the sphere of one against the other's core.
            x, y, z = cores[a, 0], cores[a, 1], cores[a, 2]
            room = reach[a] + reach[b] + limit
            if (x - cores[b, 0]) ** 2 + (y - cores[b, 1]) ** 2 + (z - cores[b, 2]) ** 2 >= room * room:
                continue
            u, v, w = project(cores, b, x, y, z)
            room = reach[a] + radius[b] + limit
            if (x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2 >= room * room:
                continue
            (x, y, z), (u, v, w) = nearest_points(cores, a, b)
            apart = math.sqrt((x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2) - radius[a] - radius[b] - gap[p]
            if apart >= distance[k, most - 1]:
                continue
            place = min(number, most - 1)
            while place > 0 and distance[k, place - 1] > apart:
                distance[k, place], found[place] = distance[k, place - 1], found[place - 1]
                for i in range(6):
                    points[place, i] = points[place - 1, i]
                place -= 1
            distance[k, place], found[place] = apart, p
            points[place, 0], points[place, 1], points[place, 2] = x, y, z
            points[place, 3], points[place, 4], points[place, 5] = u, v, w
            number = min(number + 1, most)
        if with_gradient:
            gradient[k] = 0.0
            for i in range(number):
                _differentiate(poses, k, bodies, found[i], points, gradient, i)


@compiled
def _place(poses: Array, k: int, frames: Integers, local: Array, cores: Array) -> None:
    """Write axes and centers of all bodies that move."""
    for b in range(frames.size):
        f = frames[b]
        if f < 0:
            continue
        for i in range(3):
            x, y, z = poses[k, f, i, 0], poses[k, f, i, 1], poses[k, f, i, 2]
            cores[b, i] = poses[k, f, i, 3] + x * local[b, 0] + y * local[b, 1] + z * local[b, 2]
            for j in range(3):
                turned = x * local[b, 3 + j] + y * local[b, 6 + j] + z * local[b, 9 + j]
                cores[b, 3 + 3 * i + j] = turned


@compiled
def _differentiate(
    poses: Array, k: int, bodies: Bodies, pair: int, points: Array, gradient: Array, row: int
) -> None:
    """Write d(distance)/dq_j = n . (dp_a/dq_j - dp_b/dq_j), n the direction from b to a."""
    carried, axes = bodies.carried, bodies.joint_axis
    frames, slides = bodies.joint_frame, bodies.slides
    a, b = bodies.pairs[pair, 0], bodies.pairs[pair, 1]
    x, y, z = (
        points[row, 0] - points[row, 3],
        points[row, 1] - points[row, 4],
        points[row, 2] - points[row, 5],
    )
    length = math.sqrt(x * x + y * y + z * z)
    if length < 1e-12:
        return
    x, y, z = x / length, y / length, z / length
    axis, arm = np.empty(3), np.empty(3)
    for j in range(slides.size):
        # What carries both moves both alike, and leaves their distance as it is.
        if carried[a, j] == carried[b, j]:
            continue
        frame, side = frames[j], 0 if carried[a, j] else 3
        for i in range(3):
            axis[i], arm[i] = 0.0, points[row, side + i] - poses[k, frame, i, 3]
            for c in range(3):
                axis[i] += poses[k, frame, i, c] * axes[j, c]
                arm[i] -= poses[k, frame, i, c] * axes[j, 3 + c]
        if slides[j]:
            part = x * axis[0] + y * axis[1] + z * axis[2]
        else:
            part = x * (axis[1] * arm[2] - axis[2] * arm[1])
            part += y * (axis[2] * arm[0] - axis[0] * arm[2])
            part += z * (axis[0] * arm[1] - axis[1] * arm[0])
        gradient[k, row, j] = part if carried[a, j] else -part
