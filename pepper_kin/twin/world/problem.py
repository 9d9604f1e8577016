"""The contact problem of one step, assembled: masses, velocities without contact, Jacobians, gaps."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.twin.world.cholesky import factor, solve
from pepper_kin.twin.world.colliders import FREE, ON_ROBOT

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SOFTNESS = 1e-5
"""R over the diagonal of A."""
RECOVERY = 0.2
"""Share of an overlap that one step takes back."""
FASTEST_RECOVERY = 0.2
"""Overlaps are not taken back faster than this [m/s]."""
IMMOVABLE = 1e-9
"""Points of which an impulse of 1 N s moves nothing faster than this [m/s] do not push."""
ALIGNED = 1e-7
"""Slower slips have no direction [m/s]."""


class ContactProblem(NamedTuple):
    """One step's problem for k points and N velocities: of the robot, if touched, and of bodies touched.

    Attributes:
        mass: M, shape (N, N).
        free: Velocities without contact, shape (N,).
        start: Velocities before the step, shape (N,).
        jacobian: J, rows normal, first and second tangent of each point, shape (3 k, N).
        response: J M^-1, shape (3 k, N).
        soft: R of each point's edges, shape (k,).
        drop: Speed that closes the gap, gap / h, or, below zero, takes an overlap back, shape (k,).
        friction: mu, shape (k,).
        tangents: First tangent in the world, shape (k, 3).
        columns: First column of each free body, -1 where it touches nothing, shape (b,).
        sound: Whether the robot's mass matrix is positive definite.
    """

    mass: Array
    free: Array
    start: Array
    jacobian: Array
    response: Array
    soft: Array
    drop: Array
    friction: Array
    tangents: Array
    columns: Indices
    sound: bool


@njit(
    "void(int64, int64, float64[::1], float64, int64[::1], boolean[::1], int64[::1], float64[::1], "
    "float64[:, ::1], float64[:, ::1], float64[:, ::1], int64[::1], float64[:, ::1])",
    **OPTIONS,
)
def _point_rows(
    mover: int,
    index: int,
    point: Array,
    sign: float,
    parent: Indices,
    slides: NDArray[np.bool_],
    driver: Indices,
    ratio: Array,
    joint_position: Array,
    joint_axis: Array,
    body_position: Array,
    columns: Indices,
    rows: Array,
) -> None:
    """Add the velocity of a point of a link or body, in the world's axes, to three rows."""
    if mover == ON_ROBOT:
        joint = index
        while joint > 0:
            column = driver[joint]
            if column >= 0:
                scale = sign * ratio[joint]
                ax, ay, az = joint_axis[joint, 0], joint_axis[joint, 1], joint_axis[joint, 2]
                if slides[joint]:
                    rows[0, column] += scale * ax
                    rows[1, column] += scale * ay
                    rows[2, column] += scale * az
                else:
                    x = point[0] - joint_position[joint, 0]
                    y = point[1] - joint_position[joint, 1]
                    z = point[2] - joint_position[joint, 2]
                    rows[0, column] += scale * (ay * z - az * y)
                    rows[1, column] += scale * (az * x - ax * z)
                    rows[2, column] += scale * (ax * y - ay * x)
            joint = parent[joint]
    elif mover == FREE:
        first = columns[index]
        x, y, z = (
            point[0] - body_position[index, 0],
            point[1] - body_position[index, 1],
            point[2] - body_position[index, 2],
        )
        for i in range(3):
            rows[i, first + i] += sign
        rows[0, first + 4] += sign * z
        rows[0, first + 5] -= sign * y
        rows[1, first + 5] += sign * x
        rows[1, first + 3] -= sign * z
        rows[2, first + 3] += sign * y
        rows[2, first + 4] -= sign * x


@njit("void(float64[:, ::1], float64[::1], float64[::1], float64[::1])", **OPTIONS)
def _frame(rows: Array, normal: Array, free: Array, tangent: Array) -> None:
    """Turn rows in the world's axes to normal and tangents, the first along the free slip."""
    size = rows.shape[1]
    slip = np.zeros(3)
    for i in range(3):
        for k in range(size):
            slip[i] += rows[i, k] * free[k]
    along = slip[0] * normal[0] + slip[1] * normal[1] + slip[2] * normal[2]
    for i in range(3):
        slip[i] -= along * normal[i]
    length = math.sqrt(slip[0] ** 2 + slip[1] ** 2 + slip[2] ** 2)
    if length < ALIGNED:
        axis = 0
        for i in range(1, 3):
            if abs(normal[i]) < abs(normal[axis]) - 1e-6:
                axis = i
        for i in range(3):
            slip[i] = -normal[axis] * normal[i]
        slip[axis] += 1.0
        length = math.sqrt(slip[0] ** 2 + slip[1] ** 2 + slip[2] ** 2)
    for i in range(3):
        tangent[i] = slip[i] / length
    second = np.empty(3)
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        second[i] = normal[k] * tangent[m] - normal[m] * tangent[k]
    for k in range(size):
        x, y, z = rows[0, k], rows[1, k], rows[2, k]
        rows[0, k] = normal[0] * x + normal[1] * y + normal[2] * z
        rows[1, k] = tangent[0] * x + tangent[1] * y + tangent[2] * z
        rows[2, k] = second[0] * x + second[1] * y + second[2] * z


@njit(
    "void(float64[:, ::1], float64[::1], float64[::1], float64[:, :, ::1], float64[:, ::1], float64[::1], "
    "float64[:, ::1], int64[::1], float64[::1], float64)",
    **OPTIONS,
)
def _bodies(
    mass: Array,
    free: Array,
    start: Array,
    rotation: Array,
    velocity: Array,
    masses: Array,
    inertia: Array,
    columns: Indices,
    gravity: Array,
    h: float,
) -> None:
    for b in range(len(columns)):
        k = columns[b]
        if k < 0:
            continue
        for i in range(3):
            mass[k + i, k + i] = masses[b]
            free[k + i] = velocity[b, i] + h * gravity[i]
            free[k + 3 + i] = velocity[b, 3 + i]
            start[k + i], start[k + 3 + i] = velocity[b, i], velocity[b, 3 + i]
            for m in range(3):
                for o in range(3):
                    mass[k + 3 + i, k + 3 + m] += rotation[b, i, o] * inertia[b, o] * rotation[b, m, o]


@njit(
    "void(float64[::1], float64[::1], int64, float64[:, ::1], int64[::1], float64[::1], float64[:, ::1], "
    "float64[:, :, ::1])",
    **OPTIONS,
)
def _respond(
    row: Array,
    response: Array,
    n: int,
    lower: Array,
    columns: Indices,
    masses: Array,
    inertia: Array,
    rotation: Array,
) -> None:
    """Write M^-1 row."""
    if n:
        for k in range(n):
            response[k] = row[k]
        solve(lower, response[:n])
    for b in range(len(columns)):
        k = columns[b]
        if k < 0:
            continue
        for i in range(3):
            response[k + i] = row[k + i] / masses[b]
            response[k + 3 + i] = 0.0
        for o in range(3):
            turned = 0.0
            for i in range(3):
                turned += rotation[b, i, o] * row[k + 3 + i]
            turned /= inertia[b, o]
            for i in range(3):
                response[k + 3 + i] += rotation[b, i, o] * turned


@njit(
    "boolean(float64[:, ::1], float64[::1], float64[::1], float64[:, ::1], float64[::1], float64[:, ::1], "
    "float64[::1], float64)",
    **OPTIONS,
)
def _robot(
    mass: Array, free: Array, start: Array, lower: Array, v: Array, mass_hat: Array, force: Array, h: float
) -> bool:
    """Write the robot's part, and the factor of its mass matrix; return whether that is positive definite."""
    n = len(lower)
    if n == 0:
        return True
    for i in range(n):
        start[i], free[i] = v[i], force[i]
        for k in range(n):
            lower[i, k] = mass[i, k] = mass_hat[i, k]
    sound = factor(lower)
    solve(lower, free[:n])
    for k in range(n):
        free[k] = v[k] + h * free[k]
    return sound


@njit("int64(int64, int64[:, ::1], int64[::1], int64[::1], int64, int64[::1])", **OPTIONS)
def _number(count: int, shapes: Indices, mover: Indices, index: Indices, n: int, columns: Indices) -> int:
    """Give columns to the free bodies that touch something; return how many columns the robot has: n or 0."""
    robot = 0
    columns[:] = -1
    for c in range(count):
        for side in range(2):
            s = shapes[c, side]
            if mover[s] == ON_ROBOT:
                robot = n
            elif mover[s] == FREE:
                columns[index[s]] = 0
    size = robot
    for b in range(len(columns)):
        if columns[b] == 0:
            columns[b] = size
            size += 6
    return robot


_VECTOR, _MATRIX, _CUBE, _INDICES = "float64[::1]", "float64[:, ::1]", "float64[:, :, ::1]", "int64[::1]"


@njit(
    f"Tuple(({_MATRIX}, {_VECTOR}, {_VECTOR}, {_MATRIX}, {_MATRIX}, {_VECTOR}, {_VECTOR}, {_VECTOR}, "
    f"{_MATRIX}, {_INDICES}, boolean))("
    f"Tuple((int64, {_MATRIX}, int64[:, ::1])), Tuple(({_INDICES}, {_INDICES}, {_VECTOR})), "
    f"Tuple(({_INDICES}, boolean[::1], {_INDICES}, {_VECTOR}, {_MATRIX}, {_MATRIX})), "
    f"Tuple(({_MATRIX}, {_CUBE}, {_MATRIX}, {_VECTOR}, {_MATRIX})), "
    f"Tuple(({_VECTOR}, {_MATRIX}, {_VECTOR})), {_VECTOR}, float64)",
    **OPTIONS,
)
def assemble(
    contacts: tuple[int, Array, Indices],
    shapes: tuple[Indices, Indices, Array],
    tree: tuple[Indices, NDArray[np.bool_], Indices, Array, Array, Array],
    bodies: tuple[Array, Array, Array, Array, Array],
    robot: tuple[Array, Array, Array],
    gravity: Array,
    h: float,
) -> tuple[Array, Array, Array, Array, Array, Array, Array, Array, Array, Indices, bool]:
    """Return the fields of a `ContactProblem`.

    Args:
        contacts: Count, rows and shapes of a `ContactSearch`.
        shapes: Mover, index and friction of each shape.
        tree: Parent, slides, driver and ratio of a `Tree`; position and axis of its state.
        bodies: Position, rotation, velocity, mass and inertia of the free bodies.
        robot: Velocity (n,), effective mass matrix (n, n) and force (n,); n is 0 for a robot held still.
        gravity: [m/s^2], shape (3,).
        h: Length of the step [s].
    """
    count, points, touching = contacts
    mover, index, rough = shapes
    parent, slides, driver, ratio, joint_position, joint_axis = tree
    position, rotation, velocity, masses, inertia = bodies
    v, mass_hat, force = robot
    columns = np.empty(len(masses), np.int64)
    n = _number(count, touching, mover, index, len(v), columns)
    size = n
    for b in range(len(columns)):
        if columns[b] >= 0:
            size += 6
    mass = np.zeros((size, size))
    free, start = np.zeros(size), np.zeros(size)
    lower = np.zeros((n, n))
    sound = _robot(mass, free, start, lower, v, mass_hat, force, h)
    _bodies(mass, free, start, rotation, velocity, masses, inertia, columns, gravity, h)
    jacobian, response = np.zeros((3 * count, size)), np.zeros((3 * count, size))
    soft, drop, friction = np.zeros(count), np.zeros(count), np.zeros(count)
    tangents = np.zeros((count, 3))
    for c in range(count):
        rows = jacobian[3 * c : 3 * c + 3]
        for side in range(2):
            s = touching[c, side]
            sign = 1.0 if side == 0 else -1.0
            if mover[s] == ON_ROBOT and n == 0:
                continue
            _point_rows(
                mover[s], index[s], points[c, :3], sign, parent, slides, driver, ratio,
                joint_position, joint_axis, position, columns, rows,
            )  # fmt: skip
        _frame(rows, points[c, 3:6], free, tangents[c])
        mu = math.sqrt(rough[touching[c, 0]] * rough[touching[c, 1]])
        total = 0.0
        for i in range(3):
            row, answer = jacobian[3 * c + i], response[3 * c + i]
            _respond(row, answer, n, lower, columns, masses, inertia, rotation)
            weight = 1.0 if i == 0 else 0.5 * mu * mu
            for k in range(size):
                total += weight * row[k] * answer[k]
        gap = points[c, 6]
        friction[c], soft[c] = mu, SOFTNESS * total
        drop[c] = gap / h if gap >= 0 else max(RECOVERY * gap / h, -FASTEST_RECOVERY)
        if total < IMMOVABLE:
            soft[c], drop[c] = 1.0, max(drop[c], 0.0)
    return mass, free, start, jacobian, response, soft, drop, friction, tangents, columns, sound
