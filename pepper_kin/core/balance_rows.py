"""Balance constraints of the servo: zero-moment point and capture point inside the support polygon."""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from pepper_kin.core.kinematic_tree import compose, place_joints
from pepper_kin.core.ray_casting import cross
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

Vector: TypeAlias = tuple[float, float, float]

BODY_MASS = 10
"""Inertial numbers of a body: m [kg], h = sum(m x) [kg m], and xx, xy, xz, yy, yz, zz of
Sigma = sum(m x x^T) [kg m^2]."""

AHEAD = 3.0
"""Look-ahead k in units of 1 / omega, after which the center of mass must be inside every edge: with k = 1
the wheels' whole braking ability would be used to stop it, and none would be left for moving trunk and
arms."""

RETURN = 0.5
"""Ratio b by which the zero-moment point may be farther outside an edge than the capture point that it brings
back."""


class BalanceTable(NamedTuple):
    """Constants of a robot on wheels and its payload.

    Attributes:
        joints: Placements of the joints, see `core.kinematic_tree`, shape (njoints, JOINT).
        above: 1 where a joint is moved by a coordinate of the tree, shape (njoints, njoints - 1).
        full_map: E of q_full = E q + e, shape (njoints - 1, n).
        full_offset: e, shape (njoints - 1,).
        masses: Inertial numbers of the body of each joint in the joint's frame, the world first, shape
            (njoints, BODY_MASS).
        base: Index of the joint that carries the base, and the pose of the base in the joint's frame, shape
            (13,).
        corners: Contact points of the wheels in the base frame [m], shape (k, 2).
        inward: Unit normals of the edges, pointing inward, edge i starting at corner i, shape (k, 2).
        gravity: Acceleration of gravity [m/s^2], shape (3,).
        margin: Distance kept from the edges [m].
    """

    joints: Floats2
    above: Floats2
    full_map: Floats2
    full_offset: Floats1
    masses: Floats2
    base: Floats1
    corners: Floats2
    inward: Floats2
    gravity: Floats1
    margin: float


@compiled
def _vector(numbers: Floats1, place: int) -> Vector:
    """Return three entries of an array from index `place` on."""
    return (float(numbers[place]), float(numbers[place + 1]), float(numbers[place + 2]))


@compiled
def _plus(a: Vector, b: Vector) -> Vector:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@compiled
def _times(factor: float, a: Vector) -> Vector:
    return (factor * a[0], factor * a[1], factor * a[2])


@compiled
def _turning(mass: Floats1, a: Vector) -> Vector:
    """Return (tr Sigma - Sigma) a, the moment of inertia times a."""
    xx, xy, xz, yy, yz, zz = mass[4], mass[5], mass[6], mass[7], mass[8], mass[9]
    return (
        (yy + zz) * a[0] - xy * a[1] - xz * a[2],
        (xx + zz) * a[1] - xy * a[0] - yz * a[2],
        (xx + yy) * a[2] - xz * a[0] - yz * a[1],
    )


@compiled
def _wrench(mass: Floats1, a: Vector, alpha: Vector) -> tuple[Vector, Vector]:
    """Return force and moment of the accelerations a and alpha, about the point that accelerates by a."""
    h = _vector(mass, 1)
    return _plus(_times(mass[0], a), cross(alpha, h)), _plus(cross(h, a), _turning(mass, alpha))


@compiled
def _turned(pose: Floats1, mass: Floats1, turned: Floats1) -> None:
    """Write the inertial numbers of a body in the world's axes about its joint's origin.

    Args:
        pose: Pose of the joint in the world, shape (12,).
        mass: Inertial numbers in the joint's frame, shape (BODY_MASS,).
        turned: Output, shape (BODY_MASS,).
    """
    turned[0] = mass[0]
    for i in range(3):
        turned[1 + i] = mass[1] * pose[3 + i] + mass[2] * pose[6 + i] + mass[3] * pose[9 + i]
    place = 4
    for i in range(3):
        x, y, z = pose[3 + i], pose[6 + i], pose[9 + i]
        a = mass[4] * x + mass[5] * y + mass[6] * z
        b = mass[5] * x + mass[7] * y + mass[8] * z
        c = mass[6] * x + mass[8] * y + mass[9] * z
        for j in range(i, 3):
            turned[place] = a * pose[3 + j] + b * pose[6 + j] + c * pose[9 + j]
            place += 1


@compiled
def _add_moved(mass: Floats1, o: Vector, total: Floats1) -> None:
    """Add inertial numbers about a point o, shape (BODY_MASS,), to a total about the world's origin."""
    h, m, place = _vector(mass, 1), mass[0], 4
    total[0] += m
    for i in range(3):
        total[1 + i] += h[i] + m * o[i]
        for j in range(i, 3):
            total[place] += mass[place] + h[i] * o[j] + o[i] * h[j] + m * o[i] * o[j]
            place += 1


@compiled
def _gather(
    table: BalanceTable, poses: Floats2, axes: Floats2, v: Floats1, wrench: Floats1, masses: Floats2
) -> None:
    """Write the floor's wrench at zero joint acceleration, and the inertial numbers of each subtree.

    Args:
        table: The robot.
        poses: Poses of the joints in the world, shape (njoints, 12).
        axes: Axes of the joints in the world, shape (njoints, 3).
        v: Velocities of the joints, shape (njoints - 1,) [rad/s or m/s].
        wrench: Output: force [N] and moment about the world's origin [N m], shape (6,).
        masses: Output: inertial numbers of each joint's subtree about the world's origin, shape
            (njoints, BODY_MASS).
    """
    count, own, still = table.joints.shape[0], np.empty(BODY_MASS), (0.0, 0.0, 0.0)
    motion = np.zeros(
        (count, 9)
    )  # angular velocity and acceleration, acceleration of the origin less gravity
    wrench[:], masses[:] = 0.0, 0.0
    for i in range(3):
        motion[0, 6 + i] = -table.gravity[i]
    for k in range(count):
        o = _vector(poses[k], 0)
        if k > 0:
            parent, u, speed = int(table.joints[k, 0]), _vector(axes[k], 0), v[k - 1]
            omega, alpha = _vector(motion[parent], 0), _vector(motion[parent], 3)
            r = _plus(o, _times(-1.0, _vector(poses[parent], 0)))
            a = _plus(_vector(motion[parent], 6), _plus(cross(alpha, r), cross(omega, cross(omega, r))))
            across = _times(speed, cross(omega, u))
            if table.joints[k, 1] > 0.0:
                a = _plus(a, _times(2.0, across))
            else:
                alpha, omega = _plus(alpha, across), _plus(omega, _times(speed, u))
            for i in range(3):
                motion[k, i], motion[k, 3 + i], motion[k, 6 + i] = omega[i], alpha[i], a[i]
        else:
            omega, alpha, a = still, still, _vector(motion[0], 6)
        _turned(poses[k], table.masses[k], own)
        force, moment = _wrench(own, a, alpha)
        force = _plus(force, cross(omega, cross(omega, _vector(own, 1))))
        moment = _plus(_plus(moment, cross(omega, _turning(own, omega))), cross(o, force))
        for i in range(3):
            wrench[i] += force[i]
            wrench[3 + i] += moment[i]
        _add_moved(own, o, masses[k])
    for k in range(count - 1, 0, -1):
        for i in range(BODY_MASS):
            masses[int(table.joints[k, 0]), i] += masses[k, i]


@compiled
def _write_rates(table: BalanceTable, poses: Floats2, axes: Floats2, masses: Floats2, rates: Floats2) -> None:
    """Write the Jacobian of the floor's wrench about the world's origin by the accelerations, shape (6, n).

    Poses and axes are in the world, shapes (njoints, 12) and (njoints, 3); `masses` has the inertial numbers
    of the subtrees about the world's origin, shape (njoints, BODY_MASS).
    """
    rates[:] = 0.0
    for j in range(table.full_map.shape[0]):
        u, o = _vector(axes[j + 1], 0), _vector(poses[j + 1], 0)
        slides = table.joints[j + 1, 1] > 0.0
        a, alpha = (u, (0.0, 0.0, 0.0)) if slides else (cross(o, u), u)
        force, moment = _wrench(masses[j + 1], a, alpha)
        for i in range(table.full_map.shape[1]):
            gain = table.full_map[j, i]
            if gain != 0.0:
                for k in range(3):
                    rates[k, i] += gain * force[k]
                    rates[3 + k, i] += gain * moment[k]


@compiled
def _add_carried(
    table: BalanceTable, poses: Floats2, axes: Floats2, place: Vector, center: Vector, rate: Floats2
) -> None:
    """Subtract from the Jacobian of the center of mass the motion that the base makes with it.

    Args:
        table: The robot.
        poses: Poses of the joints in the world, shape (njoints, 12).
        axes: Axes of the joints in the world, shape (njoints, 3).
        place: Origin of the base in the world [m]; it is not used.
        center: Center of mass in the world [m].
        rate: Jacobian of the center of mass, changed, shape (2, n).
    """
    carrier = int(table.base[0])
    for j in range(table.full_map.shape[0]):
        if table.above[carrier, j] == 0.0:
            continue
        u, o = _vector(axes[j + 1], 0), _vector(poses[j + 1], 0)
        moved = u if table.joints[j + 1, 1] > 0.0 else cross(u, _plus(center, _times(-1.0, o)))
        for i in range(table.full_map.shape[1]):
            for k in range(2):
                rate[k, i] -= table.full_map[j, i] * moved[k]


@compiled
def write_balance_rows(
    table: BalanceTable, q: Floats1, v: Floats1, dt: float, matrix: Floats2, least: Floats1, slack: Floats1
) -> None:
    """Write two rows for each edge of the wheels' polygon, matrix @ v' >= least for the next velocity v'.

    With p a point of the edge, i its inward normal, m the margin, omega^2 = g / c_z, k = AHEAD:

        zero-moment point z of the acceleration (v' - v) / dt:       i . (z - p) >= m,
        center of mass some time later, x = c + J_c v' (dt + k / omega):   i . (x - p) >= m.

    The first keeps this tick from tipping, the second keeps a motion of the center of mass c that can be
    stopped before the edge; with k = 1 it is the capture point (Pratt et al., Capture point: a step toward
    humanoid push recovery, 2006).  Both are linear in the next velocity v': the first times the floor's
    vertical force.  A point x that is outside by d comes back at the rate b omega, b = RETURN: the second row
    then requires d (1 - b omega dt).  A capture point outside by d is brought back by a zero-moment point
    outside by (1 + b) d, as its rate is omega (x - z): this is the slack of the first row, without which the
    two rows would contradict each other and nothing would move.

    Args:
        table: The robot.
        q: Joint positions, shape (n,) [rad or m].
        v: Joint velocities, shape (n,) [rad/s or m/s].
        dt: Length of a tick [s].
        matrix: Output, the rows of the zero-moment point first, shape (2 k, n).
        least: Output, lower bounds of the rows, shape (2 k,).
        slack: Output, by how much each row may be violated, shape (2 k,).
    """
    n, count, edges = q.size, table.joints.shape[0], table.corners.shape[0]
    full, rates_full = np.empty(count - 1), np.empty(count - 1)
    for i in range(count - 1):
        full[i], rates_full[i] = table.full_offset[i], 0.0
        for j in range(n):
            full[i] += table.full_map[i, j] * q[j]
            rates_full[i] += table.full_map[i, j] * v[j]
    poses, axes = np.empty((count, 12)), np.empty((count, 3))
    place_joints(table.joints, full, poses, axes)
    wrench, masses, rates = np.empty(6), np.empty((count, BODY_MASS)), np.empty((6, n))
    _gather(table, poses, axes, rates_full, wrench, masses)
    _write_rates(table, poses, axes, masses, rates)
    total = masses[0, 0]
    center = _times(1.0 / total, _vector(masses[0], 1))
    base, drift = np.empty(12), np.empty((2, n))
    for i in range(n):
        drift[0, i], drift[1, i] = rates[0, i] / total, rates[1, i] / total
    compose(poses[int(table.base[0])], table.base[1:], base)
    _add_carried(table, poses, axes, _vector(base, 0), center, drift)
    g = table.gravity
    fall = math.sqrt(math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) / center[2])
    ahead = dt + AHEAD / fall
    for e in range(edges):
        x = table.inward[e, 0] * base[3] + table.inward[e, 1] * base[6]
        y = table.inward[e, 0] * base[4] + table.inward[e, 1] * base[7]
        reach = table.margin
        for i in range(2):
            at = base[i] + table.corners[e, 0] * base[3 + i] + table.corners[e, 1] * base[6 + i]
            reach += (x if i == 0 else y) * at
        # h = i . (-n_y, n_x) - reach f_z, linear in the acceleration.
        now, moved = y * wrench[3] - x * wrench[4] - reach * wrench[2], 0.0
        for i in range(n):
            slope = (y * rates[3, i] - x * rates[4, i] - reach * rates[2, i]) / dt
            moved += slope * v[i]
            matrix[e, i] = slope / wrench[2]
            matrix[edges + e, i] = (x * drift[0, i] + y * drift[1, i]) * ahead
        least[e] = (moved - now) / wrench[2]
        inside, speed = x * center[0] + y * center[1] - reach, 0.0
        for i in range(n):
            speed += (x * drift[0, i] + y * drift[1, i]) * v[i]
        slack[e], slack[edges + e] = (1.0 + RETURN) * max(-inside - speed / fall, 0.0), 0.0
        outside = max(-inside - AHEAD * speed / fall, 0.0)
        least[edges + e] = -inside - (1.0 - RETURN * fall * dt) * outside
