"""Steps of a robot among things, many in one call, compiled.

What Python does for one step (`Coupling`, `World.advance`) is done here for as many as need nothing but
machine code: the numbers are the same to the last bit.  Where a step needs more (a pair for coal, a solver
that fails, NaN), nothing of it is kept and Python takes it.

Numba renews the machine code of this file when it changes, but not when only those do whose functions it
calls: after work on those, remove `__pycache__`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pepper_kin.collision.fast.options import OPTIONS
from pepper_kin.twin.fast.law import STRENGTH
from pepper_kin.twin.fast.loop import GIVEN, Q_REF, V_REF
from pepper_kin.twin.fast.once import step_once
from pepper_kin.twin.fast.settle import LOAD, NEXT_V, TORQUE, Room
from pepper_kin.twin.world.colliders import place_shapes
from pepper_kin.twin.world.free_body import fly
from pepper_kin.twin.world.outcome import apply, fall
from pepper_kin.twin.world.problem import assemble
from pepper_kin.twin.world.search import find
from pepper_kin.twin.world.slip import solve_compiled
from pepper_kin.twin.world.tree import place_joints

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

DONE, HARD, ABSURD = 0, 1, 2
"""Why a march ended: all steps done; the next one is for Python; the last row is a state that diverged."""


class Robot(NamedTuple):
    """A robot's step in machine code; see `pepper_kin.twin.fast.single`.

    Attributes:
        h: Timestep [s].
        addresses: Of the kernels of a step and of a solution.
        law: Parameters of the joints, shape (rows, n).
        room: Arrays to write to, of one lane.
    """

    h: float
    addresses: NDArray[np.int64]
    law: Array
    room: Room


class Limbs(NamedTuple):
    """`Tree` and `TreeState` for compiled code."""

    parent: Indices
    rotation: Array
    position: Array
    axis: Array
    slides: NDArray[np.bool_]
    driver: Indices
    ratio: Array
    offset: Array
    at_rotation: Array
    at_position: Array
    at_axis: Array
    linear: Array
    angular: Array


class Shapes(NamedTuple):
    """`Colliders` for compiled code, and the friction of each shape."""

    kind: Indices
    size: Array
    mover: Indices
    owner: Indices
    own_rotation: Array
    own_position: Array
    ball: Array
    rotation: Array
    position: Array
    middle: Array
    speed: Array
    pairs: Indices
    rough: Array


class Bodies(NamedTuple):
    """Free bodies; position, rotation and velocity are moved."""

    position: Array
    rotation: Array
    velocity: Array
    mass: Array
    inertia: Array
    gravity: Array


class Touch(NamedTuple):
    """What the last step found and solved; k points, N velocities.

    Attributes:
        rows: See `ContactSearch`.
        shapes: See `ContactSearch`.
        undecided: Pairs for coal.
        forces: At the points, in the world's axes [N], shape (MOST_POINTS, 3).
        velocity: u, in the first N.
        impulses: In the first 3 k.
        load: On the robot, shape (n,).
        numbers: k, N, and how many convex problems were solved.
        lift: See `StepSolution`, shape (1,).
    """

    rows: Array
    shapes: Indices
    undecided: Indices
    forces: Array
    velocity: Array
    impulses: Array
    load: Array
    numbers: Indices
    lift: Array


@njit(**OPTIONS)
def march(
    robot: Robot,
    limbs: Limbs,
    shapes: Shapes,
    bodies: Bodies,
    touch: Touch,
    q: Array,
    v: Array,
    told: tuple[Array, Array, Array, Array],
    rows: Array,
) -> tuple[int, int]:
    """Advance robot and bodies by a step for each row, as far as machine code goes.

    Args:
        robot: The robot's step.
        limbs: Its tree.
        shapes: All shapes.
        bodies: Free bodies.
        touch: Written.
        q: Position at the start [rad or m], shape (n,); overwritten by the last.
        v: Velocity, shape (n,); overwritten by the last.
        told: Position, velocity and given of a `Command`, shape (T, n) each, and the load from elsewhere,
            (T, n) or (1, n).
        rows: Written: position, velocity and torque after each step, shape (3, T, n).

    Returns:
        How many steps the world has taken, and why it took no more.
    """
    n = len(q)
    mass_hat, force, nothing = np.empty((n, n)), np.empty(n), np.empty((0, 0))
    before = np.empty_like(bodies.velocity)
    for k in range(rows.shape[1]):
        _tell(robot, q, v, told, k)
        if not _step(robot, mass_hat, force):
            return k, HARD
        _copy(bodies.velocity, before)
        if not _touch(robot.h, limbs, shapes, bodies, touch, q, v, mass_hat, force):
            _copy(before, bodies.velocity)
            return k, HARD
        fly(bodies.position, bodies.rotation, bodies.velocity, bodies.inertia, robot.h)
        good, pushed = True, False
        for j in range(n):
            pushed = pushed or touch.load[j] != 0.0
        if pushed:
            for j in range(n):
                robot.room.given[LOAD * n + j] += touch.load[j]
            good = _step(robot, nothing, force[:0])
        result = robot.room.result
        for j in range(n):
            q[j], v[j] = result[j], result[NEXT_V * n + j]
            rows[0, k, j], rows[1, k, j], rows[2, k, j] = q[j], v[j], result[TORQUE * n + j]
        if not good:
            return k + 1, ABSURD
    return rows.shape[1], DONE


@njit(**OPTIONS)
def _copy(source: Array, target: Array) -> None:
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@njit(**OPTIONS)
def _finite(values: Array) -> bool:
    total = 0.0
    for value in values:
        total += 0.0 * value
    return total == 0.0


@njit(**OPTIONS)
def _tell(robot: Robot, q: Array, v: Array, told: tuple[Array, Array, Array, Array], k: int) -> None:
    """Write state, command and load into the step kernel's input."""
    n, given = len(q), robot.room.given
    position, velocity, more, load = told
    row = min(k, len(load) - 1)
    for j in range(n):
        given[j], given[n + j] = q[j], v[j]
        given[Q_REF * n + j], given[V_REF * n + j] = position[k, j], velocity[k, j]
        given[GIVEN * n + j] = more[k, j] * robot.law[STRENGTH, j]
        given[LOAD * n + j] = load[row, j]


@njit(**OPTIONS)
def _step(robot: Robot, mass_hat: Array, force: Array) -> bool:
    room = robot.room
    return step_once(
        robot.h, robot.addresses, robot.law, room.given, room.result, room.work, room.ask, room.answer,
        room.rows, room.flags, room.places, mass_hat, force,
    )  # fmt: skip


@njit(**OPTIONS)
def _touch(
    h: float,
    limbs: Limbs,
    shapes: Shapes,
    bodies: Bodies,
    touch: Touch,
    q: Array,
    v: Array,
    mass_hat: Array,
    force: Array,
) -> bool:
    """Find and solve the contacts; write velocities and load, return whether that was possible."""
    t, s, b = limbs, shapes, bodies
    place_joints(
        t.parent, t.rotation, t.position, t.axis, t.slides, t.driver, t.ratio, t.offset, q, v,
        t.at_rotation, t.at_position, t.at_axis, t.linear, t.angular,
    )  # fmt: skip
    place_shapes(
        s.mover, s.owner, s.own_rotation, s.own_position, s.ball, t.at_rotation, t.at_position, t.linear,
        t.angular, b.rotation, b.position, b.velocity, s.rotation, s.position, s.middle, s.speed,
    )  # fmt: skip
    count, undecided = find(
        s.pairs, s.kind, s.size, s.rotation, s.position, s.middle, s.ball, s.speed, h,
        touch.rows, touch.shapes, touch.undecided,
    )  # fmt: skip
    if count < 0 or undecided > 0:
        return False
    touch.numbers[0] = count
    if count == 0:
        for j in range(len(v)):
            touch.load[j] = 0.0
        return fall(b.velocity, b.gravity, h)
    points = touch.rows[:count]
    mass, free, start, jacobian, response, soft, drop, friction, tangents, columns, sound = assemble(
        (count, points, touch.shapes[:count]),
        (s.mover, s.owner, s.rough),
        (t.parent, t.slides, t.driver, t.ratio, t.at_position, t.at_axis),
        (b.position, b.rotation, b.velocity, b.mass, b.inertia),
        (v, mass_hat, force),
        b.gravity,
        h,
    )
    if not (sound and _finite(free)):
        return False
    u, pushes = touch.velocity[: len(free)], touch.impulses[: 3 * count]
    steps, sweeps, left = solve_compiled(
        mass, free, start, jacobian, response, soft, drop, friction, tangents, points, u, pushes
    )
    touch.numbers[1], touch.numbers[2], touch.lift[0] = len(free), sweeps, left
    if steps < 0:
        return False
    return apply(
        u, pushes, jacobian, points, tangents, columns, b.gravity, h, b.velocity, touch.forces[:count],
        touch.load,
    )  # fmt: skip
