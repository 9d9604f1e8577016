"""Bodies that nothing holds: what they are, where they are, and how they fly and turn."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.model import Box, Sphere
from pepper_kin.model.shapes import read_only

Array = NDArray[np.float64]

ROUNDS = 50
"""Of the fixed-point iteration for a turn; three or four are needed at 1 ms and a few turns a second."""


@dataclass(frozen=True, eq=False)
class FreeBody:
    """A rigid box or ball of even density, and its state.  Arrays are read-only.

    Attributes:
        name: Its name.
        geometry: Its shape, centred at its frame.
        mass: [kg].
        inertia: Principal moments about the axes of its frame [kg m^2], shape (3,).
        friction: Coefficient; of two things that touch, the geometric mean counts.
        pose: `transform_body_to_world`, shape (4, 4).
        velocity: Of its centre [m/s], then of its turning [rad/s], both in the world, shape (6,).
    """

    name: str
    geometry: Box | Sphere
    mass: float
    inertia: Array
    friction: float
    pose: Array
    velocity: Array

    def __post_init__(self) -> None:
        for name in ("inertia", "pose", "velocity"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def position(self) -> Array:
        """Of its centre in the world [m], shape (3,), read-only."""
        return self.pose[:3, 3]

    @property
    def momentum(self) -> Array:
        """Linear, m v [N s], then angular about the world's origin, x x m v + I w [N m s], shape (6,)."""
        linear = self.mass * self.velocity[:3]
        rotation = self.pose[:3, :3]
        spin = rotation @ (self.inertia * (rotation.T @ self.velocity[3:]))
        return np.concatenate([linear, np.cross(self.position, linear) + spin])

    @property
    def kinetic_energy(self) -> float:
        """Of moving and turning, m v^2 / 2 + w . I w / 2 [J]."""
        turning = self.pose[:3, :3].T @ self.velocity[3:]
        moving = self.velocity[:3]
        return float(self.mass * moving @ moving + self.inertia @ turning**2) / 2


def principal_inertia(geometry: Box | Sphere, mass: float) -> Array:
    """Return the principal moments of a body of even density [kg m^2], shape (3,)."""
    if isinstance(geometry, Sphere):
        return np.full(3, 0.4 * mass * geometry.radius**2)
    squares = np.square(geometry.size)
    return mass / 12 * (squares.sum() - squares)


@njit("void(float64[:, ::1], float64[:, ::1])", **OPTIONS)
def _orthonormal(turned: Array, rotation: Array) -> None:
    """Write a rotation from one that has collected rounding errors."""
    for row in range(2):
        for i in range(3):
            rotation[row, i] = turned[row, i]
        if row:
            along = 0.0
            for i in range(3):
                along += rotation[1, i] * rotation[0, i]
            for i in range(3):
                rotation[1, i] -= along * rotation[0, i]
        length = math.sqrt(rotation[row, 0] ** 2 + rotation[row, 1] ** 2 + rotation[row, 2] ** 2)
        for i in range(3):
            rotation[row, i] /= length
    rotation[2, 0] = rotation[0, 1] * rotation[1, 2] - rotation[0, 2] * rotation[1, 1]
    rotation[2, 1] = rotation[0, 2] * rotation[1, 0] - rotation[0, 0] * rotation[1, 2]
    rotation[2, 2] = rotation[0, 0] * rotation[1, 1] - rotation[0, 1] * rotation[1, 0]


@njit("void(float64[:, ::1], float64[::1], float64[::1], float64)", **OPTIONS)
def _turn(rotation: Array, angular: Array, inertia: Array, h: float) -> None:
    start, now, middle = np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        for k in range(3):
            start[i] += rotation[k, i] * angular[k]
        now[i] = start[i]
    for _ in range(ROUNDS):
        change, size = 0.0, 0.0
        for i in range(3):
            middle[i] = 0.5 * (start[i] + now[i])
        for i in range(3):
            k, m = (i + 1) % 3, (i + 2) % 3
            better = start[i] + h * (inertia[k] - inertia[m]) / inertia[i] * middle[k] * middle[m]
            change = max(change, abs(better - now[i]))
            size = max(size, abs(better))
            now[i] = better
        if change <= 1e-15 * size:
            break
    for i in range(3):
        middle[i] = 0.25 * h * (start[i] + now[i])  # half the turn
    turned = np.empty((3, 3))
    x, y, z = middle[0], middle[1], middle[2]
    scale = 2.0 / (1.0 + x * x + y * y + z * z)
    for i in range(3):  # R (1 + scale (S + S^2)), S the cross product with the middle
        a, b, c = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        along = a * x + b * y + c * z
        square = x * x + y * y + z * z
        turned[i, 0] = a + scale * (b * z - c * y + along * x - square * a)
        turned[i, 1] = b + scale * (c * x - a * z + along * y - square * b)
        turned[i, 2] = c + scale * (a * y - b * x + along * z - square * c)
    _orthonormal(turned, rotation)
    for i in range(3):
        angular[i] = rotation[i, 0] * now[0] + rotation[i, 1] * now[1] + rotation[i, 2] * now[2]


@njit(
    "void(float64[:, ::1], float64[:, :, ::1], float64[:, ::1], float64[:, ::1], float64)",
    **OPTIONS,
)
def fly(position: Array, rotation: Array, velocity: Array, inertia: Array, h: float) -> None:
    """Move all bodies by h [s], in place: x+ = x + h v, and the free turning of a rigid body.

    In the body's frame, with W its angular velocity and I its principal moments, the implicit midpoint rule

        I (W+ - W) = -h w x I w,   w = (W + W+) / 2,   R+ = R cay(h w),

    keeps kinetic energy and angular momentum to the accuracy of its solution (1e-14), because both are
    quadratic (Hairer, Lubich and Wanner, Geometric Numerical Integration, 2006, IV.2.1 and VII.5).
    """
    for b in range(len(position)):
        turning = 0.0
        for i in range(3):
            position[b, i] += h * velocity[b, i]
            turning += velocity[b, 3 + i] ** 2
        if turning > 0:
            _turn(rotation[b], velocity[b, 3:], inertia[b], h)
