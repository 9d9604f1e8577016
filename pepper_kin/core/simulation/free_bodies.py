"""Motion of free rigid bodies under gravity."""

from __future__ import annotations

import math

from pepper_kin.core.simulation.contact_solver import FASTEST
from pepper_kin.core.simulation.narrow_phase import BodyTable
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

ROUNDS = 50
"""Maximum number of fixed-point iterations of a rotation; three or four suffice at 1 ms and a few turns a
second."""
LARGEST_TURN = 0.5
"""Maximum angle of one part of a step, for which the iteration converges for every body [rad]."""


@compiled(lean=True)
def integrate_bodies(bodies: BodyTable, h: float, work: Floats2) -> None:
    """Move all bodies by h [s], in place: x+ = x + h v, and the free rotation of a rigid body.

    `work` is workspace of shape (>= 6, 3).  In the body's frame, with W its angular velocity and I its
    principal moments, the implicit midpoint rule

        I (W+ - W) = -h w x I w,   w = (W + W+) / 2,   R+ = R cay(h w),

    keeps kinetic energy and angular momentum to the accuracy of its solution (1e-14), because both are
    quadratic (Hairer, Lubich and Wanner, Geometric Numerical Integration, 2006, IV.2.1 and VII.5).
    """
    for b in range(len(bodies.mass)):
        turning = 0.0
        for i in range(3):
            bodies.position[b, i] += h * bodies.velocity[b, i]
            turning += bodies.velocity[b, 3 + i] ** 2
        parts = math.ceil(h * math.sqrt(turning) / LARGEST_TURN)
        for _ in range(parts):
            _turn(bodies.rotation[b], bodies.velocity[b, 3:], bodies.inertia[b], h / parts, work)


@compiled(lean=True)
def apply_gravity(bodies: BodyTable, h: float) -> bool:
    """Add the change by gravity over h [s] to all velocities; return whether their sum is below `FASTEST`."""
    total, velocity = 0.0, bodies.velocity
    for b in range(len(velocity)):
        for i in range(3):
            velocity[b, i] += h * bodies.gravity[b, i]
            total += abs(velocity[b, i]) + abs(velocity[b, 3 + i])
    return total < FASTEST


@compiled(lean=True)
def _turn(rotation: Floats2, angular: Floats1, inertia: Floats1, h: float, work: Floats2) -> None:
    """Rotate a body freely; see `integrate_bodies`.

    Args:
        rotation: Rotation of the body in the world, overwritten, shape (3, 3).
        angular: Angular velocity in the world, overwritten, shape (3,) [rad/s].
        inertia: Principal moments, shape (3,) [kg m^2].
        h: Length of the step [s].
        work: Workspace, shape (>= 6, 3).
    """
    start, now, middle, turned = work[0], work[1], work[2], work[3:6]
    for i in range(3):
        start[i] = 0.0
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
        middle[i] = 0.25 * h * (start[i] + now[i])  # half the rotation vector
    x, y, z = middle[0], middle[1], middle[2]
    scale = 2.0 / (1.0 + x * x + y * y + z * z)
    for i in range(3):  # R (1 + scale (S + S^2)), S the cross product with the middle
        a, b, c = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        along = a * x + b * y + c * z
        square = x * x + y * y + z * z
        turned[i, 0] = a + scale * (b * z - c * y + along * x - square * a)
        turned[i, 1] = b + scale * (c * x - a * z + along * y - square * b)
        turned[i, 2] = c + scale * (a * y - b * x + along * z - square * c)
    _orthonormalize(turned, rotation)
    for i in range(3):
        angular[i] = rotation[i, 0] * now[0] + rotation[i, 1] * now[1] + rotation[i, 2] * now[2]


@compiled(lean=True)
def _orthonormalize(turned: Floats2, rotation: Floats2) -> None:
    """Write the orthonormalized matrix of a rotation with rounding errors, shape (3, 3) each."""
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
