"""Rotation and acceleration of every body, from the world to the tips, in each body's own frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pepper_kin.symbolic.bodies import Inertia
from pepper_kin.symbolic.scalars import Value
from pepper_kin.symbolic.states import StateExpressions
from pepper_kin.symbolic.vectors import ZERO, Matrix, Vector, add, cross, scale, times


@dataclass(frozen=True)
class Motion:
    """Rotation and acceleration of a body, in the body's axes.

    The acceleration of a point x of the body is a + U x, where U = [alpha]x + [omega]x [omega]x.  Velocities
    of origins are never needed: dynamics does not change between frames that move uniformly.

    Attributes:
        omega: Angular velocity [rad/s].
        alpha: Angular acceleration [rad/s^2].
        a: Acceleration of the origin minus gravity [m/s^2].
    """

    omega: Vector
    alpha: Vector
    a: Vector

    def field(self) -> Matrix:
        """Return U, three rows [1/s^2]."""
        (x, y, z), (p, q, r) = self.omega, self.alpha
        xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
        return (
            (-(yy + zz), xy - r, xz + q),
            (xy + r, -(xx + zz), yz - p),
            (xz - q, yz + p, -(xx + yy)),
        )


def world_motion(gravity: Vector) -> Motion:
    """Return the motion of the world: no rotation, and the acceleration -g in place of gravity."""
    return Motion(ZERO, ZERO, (-gravity[0], -gravity[1], -gravity[2]))


def motions(state: StateExpressions, gravity: Vector | None = None) -> list[Motion]:
    """Return the motion of every body (Luh, Walker and Paul, 1980, outward pass).

    Args:
        state: Positions, velocities and accelerations.
        gravity: Gravity vector [m/s^2]; the robot's gravity by default.
    """
    world = world_motion(state.tree.gravity if gravity is None else gravity)
    result: list[Motion] = []
    parts = zip(state.tree.bodies, state.turns, state.translations, state.v, state.a, strict=True)
    for body, turn, r, v, rate in parts:
        parent = result[body.parent] if body.parent >= 0 else world
        carried = add(parent.a, times(parent.field(), r))
        omega, alpha, a = (turn.inward(u) for u in (parent.omega, parent.alpha, carried))
        if body.slides:
            a = add(a, scale(2.0 * v, (omega[1], -omega[0], 0.0)), (0.0, 0.0, rate))
        else:
            alpha = (alpha[0] + v * omega[1], alpha[1] - v * omega[0], alpha[2] + rate)
            omega = (omega[0], omega[1], omega[2] + v)
        result.append(Motion(omega, alpha, a))
    return result


def force_and_moment(motion: Motion, inertia: Inertia) -> tuple[Vector, Vector]:
    """Return the wrench of a motion: f = m a + U h and n = h x a + moment(U, Sigma) about the origin."""
    force = add(scale(inertia.mass, motion.a), times(motion.field(), inertia.first))
    return force, add(cross(inertia.first, motion.a), moment(motion, inertia.second))


def moment(motion: Motion, second: Matrix) -> Vector:
    """Return sum(m x x (U x)) = I alpha + omega x I omega: the axial vector of U Sigma - (U Sigma)^T."""
    u = motion.field()
    x, y, z = (component * component for component in motion.omega)
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = second
    return (
        u[2][1] * yy - u[1][2] * zz + (z - y) * yz + u[2][0] * xy - u[1][0] * xz,
        u[0][2] * zz - u[2][0] * xx + (x - z) * xz + u[0][1] * yz - u[2][1] * xy,
        u[1][0] * xx - u[0][1] * yy + (y - x) * xy + u[1][2] * xz - u[0][2] * yz,
    )


def collect(
    state: StateExpressions, wrenches: Sequence[tuple[Vector, Vector]]
) -> tuple[list[tuple[Vector, Vector]], tuple[Vector, Vector]]:
    """Sum wrenches from the tips to the world.

    Args:
        state: The state.
        wrenches: (force [N], moment about the origin [N m]) of each body in the body's axes.

    Returns:
        Sum over each body and its descendants, and the sum at the origin of the world.
    """
    totals = list(wrenches)
    world: tuple[Vector, Vector] = (ZERO, ZERO)
    for i in reversed(range(len(totals))):
        body = state.tree.bodies[i]
        force, torque = to_parent(state, i, *totals[i])
        if body.parent >= 0:
            f, n = totals[body.parent]
            totals[body.parent] = (add(f, force), add(n, torque))
        else:
            world = (add(world[0], force), add(world[1], torque))
    return totals, world


def to_parent(state: StateExpressions, i: int, force: Vector, torque: Vector) -> tuple[Vector, Vector]:
    """Return a wrench on body i in the axes of its parent and about the parent's origin."""
    turned = state.turns[i].outward(force)
    return turned, add(state.turns[i].outward(torque), cross(state.translations[i], turned))


def along_joints(state: StateExpressions, wrenches: Sequence[tuple[Vector, Vector]]) -> list[Value]:
    """Return the component of each wrench along the body's joint."""
    bodies = state.tree.bodies
    return [f[2] if body.slides else n[2] for body, (f, n) in zip(bodies, wrenches, strict=True)]


def turn_towards(state: StateExpressions, body: int, u: Vector) -> Vector:
    """Return a world vector in the axes of a body."""
    for i in state.tree.path(body):
        u = state.turns[i].inward(u)
    return u
