"""Robots that move to targets as with `setAngles`: commands are shaped, and robots stepped, in one call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.core.simulation.contact_solver import FreeStep
from pepper_kin.core.simulation.contact_step import SOLVED, WorldTables
from pepper_kin.core.simulation.drive_state import hold_in_play, remember, remembers
from pepper_kin.core.simulation.implicit_step import (
    ALIVE,
    CONSTANT,
    FEEDFORWARD_TORQUE,
    LOAD,
    Q_REF,
    TORQUE,
    V_REF,
    Q,
    RobotTables,
    StepWorkspace,
    V,
    all_sound,
    implicit_step,
    is_sound,
    write_segments,
)
from pepper_kin.core.simulation.narrow_phase import MARGIN
from pepper_kin.core.simulation.rollout import couple
from pepper_kin.core.simulation.target_following import time_to_target
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1, Ints2

# Row indices of the state.
POSITION, VELOCITY, EFFORT, COMMAND, COMMAND_SPEED, TARGET, FROM_OUTSIDE, STATE_ROWS = range(8)
HELD_COMMANDS, LINEAR, SHAPED = range(3)
"""Shapes of commands towards their targets: held at the target, linear over all steps, or along the cubic of
`target_following`."""
# Column indices of `Bodies.rows`.
ROTATION, MOTION, MASS, INERTIA, FRICTION, BODY = 3, 12, 18, 19, 22, 23


class Steps(NamedTuple):
    """Range of steps and blocks to process, and the shape of commands.

    Attributes:
        first: Index of the first block.
        last: Index after the last block.
        steps: Number of steps.
        kind: HELD_COMMANDS, LINEAR or SHAPED.
        clock: Number of steps taken before, since `Sent` was made.
    """

    first: int
    last: int
    steps: int
    kind: int
    clock: int


class Sent(NamedTuple):
    """Shaping and delay of commands, for B blocks of m elements.

    Attributes:
        limits: Maximum speed and acceleration of shaped commands, shape (2, m).
        curve: Curve of one block's commands: time, speed at the start, and coefficients of t^2 and t^3, shape
            (4, m); output.
        delay: Number of steps after which a command arrives, below R if R is above 0, shape (B, m).
        waiting: Position and velocity of the last R commands, shape (R, 2 B, m); R is 0 without delays.
    """

    limits: Floats2
    curve: Floats2
    delay: Ints2
    waiting: Floats3


class RobotWorlds(NamedTuple):
    """Free bodies and contacts of N robots, each in a separate world.

    Attributes:
        rows: Position, rotation, velocity, mass, inertia and friction of each of b bodies, as in `BodyTable`
            and `ShapeTable`, shape (N, b, BODY); changed.
        wrench: Mean force [N] of contacts on each robot and moment about the world's origin [N m], shape
            (N, 6); output.
        outcome: Outcome of the world's last step, shape (N,); output.
        apart: Lower bound of each robot's distance from all else [m], shape (N,); changed.
        lever: Motion bound of each joint for all points of the robot [m/rad or 1], shape (n,).
    """

    rows: Floats3
    wrench: Floats2
    outcome: Ints1
    apart: Floats1
    lever: Floats1


NO_BODIES = RobotWorlds(
    np.zeros((0, 0, BODY)), np.zeros((0, 6)), np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
)
"""Bodies of robots without a world."""


class _Around(NamedTuple):
    """Surroundings of robots: bodies, a world's tables, and memory for a robot's position and equation."""

    bodies: RobotWorlds
    world: WorldTables
    equation: FreeStep
    position: Floats1


@compiled(
    "void(Steps, RobotTables, StepWorkspace, float64[:, :, ::1], Sent, RobotWorlds, WorldTables, int64[::1])"
)
def shaped_steps(
    span: Steps, robots: RobotTables, space: StepWorkspace, state: Floats3, sent: Sent, bodies: RobotWorlds,
    world: WorldTables, good: Ints1,
) -> None:  # fmt: skip
    """Move robots towards their targets for some steps.

    The command of each joint moves from its present value to the target, shaped commands also from the
    present speed, and the joints follow it.

    Args:
        span: Steps, blocks and shape of commands.
        robots: The robots, in B blocks.
        space: Workspace.
        state: Position, velocity, torque, command [rad or m], its speed, target, and external load
            [N m or N], shape (7, B, m); changed.
        sent: Shaping and delay of commands; changed.
        bodies: Free bodies and contacts of the robots; changed.
        world: Tables of a world, used for one robot at a time.
        good: Output: number of good steps of each robot, shape (N,).
    """
    m, lanes, h, steps = state.shape[2], robots.lanes, robots.timestep, span.steps
    step_input, curve = space.step_input, sent.curve
    n = m // lanes
    around = _Around(bodies, world, FreeStep(np.empty(n), np.empty((n, n)), np.empty(n)), np.empty(n))
    for b in range(span.first, span.last):
        for e in range(m):
            step_input[Q * m + e], step_input[V * m + e] = state[POSITION, b, e], state[VELOCITY, b, e]
            step_input[FEEDFORWARD_TORQUE * m + e] = 0.0
            step_input[LOAD * m + e] = state[FROM_OUTSIDE, b, e]
            if span.kind == HELD_COMMANDS:
                state[COMMAND, b, e], state[COMMAND_SPEED, b, e] = state[TARGET, b, e], 0.0
            way, speed = state[TARGET, b, e] - state[COMMAND, b, e], state[COMMAND_SPEED, b, e]
            time = max(time_to_target(way, speed, sent.limits[0, e], sent.limits[1, e]), h)
            bend, turn = 3.0 * way - 2.0 * speed * time, speed * time - 2.0 * way
            if span.kind == LINEAR:
                time, speed, bend, turn = steps * h, way / (steps * h), 0.0, 0.0
            curve[0, e], curve[1, e] = time, speed
            curve[2, e], curve[3, e] = bend / (time * time), turn / (time * time * time)
        for e in range(robots.constant.shape[1]):
            step_input[CONSTANT * m + e] = robots.constant[b, e]
        for lane in range(lanes):
            space.flags[ALIVE, lane] = True
            if b * lanes + lane < good.size:
                good[b * lanes + lane] = steps
            if b * lanes + lane < len(bodies.wrench):
                for i in range(bodies.wrench.shape[1]):
                    bodies.wrench[b * lanes + lane, i] = 0.0
        _advance(b, span, robots, space, state, sent, around, good)
        t = steps * h
        for e in range(m):
            state[POSITION, b, e], state[VELOCITY, b, e] = step_input[Q * m + e], step_input[V * m + e]
            state[EFFORT, b, e] = space.step_output[TORQUE * m + e]
            state[COMMAND_SPEED, b, e] = _speed(curve, e, t)
            state[COMMAND, b, e] += _way(curve, e, t)


@compiled(lean=True, inline=True)
def _way(curve: Floats2, e: int, time: float) -> float:
    """Return a command's displacement after a time; curve: T, u and coefficients of t^2 and t^3, (4, m)."""
    t = min(time, curve[0, e])
    return t * (curve[1, e] + t * (curve[2, e] + t * curve[3, e]))


@compiled(lean=True, inline=True)
def _speed(curve: Floats2, e: int, time: float) -> float:
    """Return a command's speed after a time; curve: T, u and coefficients of t^2 and t^3, (4, m)."""
    t = min(time, curve[0, e])
    return curve[1, e] + t * (2.0 * curve[2, e] + t * 3.0 * curve[3, e])


@compiled(lean=True)
def _advance(
    b: int, span: Steps, robots: RobotTables, space: StepWorkspace, state: Floats3, sent: Sent,
    around: _Around, good: Ints1,
) -> None:  # fmt: skip
    """Step one block along its commands."""
    begin, outer, curve = state[COMMAND, b], state[FROM_OUTSIDE, b], sent.curve
    coupled = len(around.bodies.wrench)
    m, h, step_input, step_output = begin.size, robots.timestep, space.step_input, space.step_output
    stateful, any_stopped, touched = remembers(robots.law), False, False
    for k in range(span.steps):
        for e in range(m):
            step_input[Q_REF * m + e] = begin[e] + _way(curve, e, (k + 1) * h)
            step_input[V_REF * m + e] = _speed(curve, e, (k + 1) * h)
        if len(sent.waiting) > 0:
            _exchange(b, (span.clock + k) % len(sent.waiting), sent, step_input)
        if stateful:
            hold_in_play(b, robots.law, step_input)
        calm = implicit_step(b, robots, space)
        if coupled > 0:
            write_segments(b, robots, space)
            touched = _meet_worlds(b, k, robots, space, around, good)
            if touched:
                calm = implicit_step(b, robots, space)
            for e in range(m):
                step_input[LOAD * m + e] = outer[e]
        if any_stopped or touched or (not calm and not all_sound(space)):
            any_stopped = _stop_unsound(b, k, robots, space, good)
        if stateful:
            remember(b, robots, space)
        for e in range(2 * m):
            step_input[e] = step_output[e]


@compiled(lean=True)
def _meet_worlds(
    b: int, k: int, robots: RobotTables, space: StepWorkspace, around: _Around, good: Ints1
) -> bool:
    """Take step k of the worlds of a block; return whether the robots' step has to be repeated."""
    m, lanes, again, bodies, world = space.solve_output.size, robots.lanes, False, around.bodies, around.world
    for lane in range(lanes):
        robot = b * lanes + lane
        if robot >= good.size or not space.flags[ALIVE, lane]:
            continue
        for j in range(around.position.size):
            around.position[j] = space.step_input[j * lanes + lane]
            around.equation.velocity[j] = space.step_input[V * m + j * lanes + lane]
        _enter(robot, bodies, world)
        moved = _moved(robot, bodies, world, around.equation.velocity, robots.timestep)
        # The step before has moved the robot, and this one may.
        near = not bodies.apart[robot] - 2.0 * moved > MARGIN
        outcome, pushed, apart = couple(b, lane, robots, space, world, around.equation, around.position, near)
        bodies.outcome[robot], bodies.apart[robot] = outcome, apart if near else bodies.apart[robot] - moved
        if outcome != SOLVED:
            space.flags[ALIVE, lane], good[robot], again = False, k, True
            continue
        again = again or pushed
        _leave(robot, bodies, world)
        for i in range(6):
            bodies.wrench[robot, i] += (world.state.wrench[0, i] - bodies.wrench[robot, i]) / (k + 1)
    return again


@compiled(lean=True)
def _exchange(b: int, now: int, sent: Sent, step_input: Floats1) -> None:
    """Store the commands of a step in row `now`, and replace them in `step_input` by those that arrive."""
    m, ring = sent.delay.shape[1], len(sent.waiting)
    for e in range(m):
        sent.waiting[now, 2 * b, e] = step_input[Q_REF * m + e]
        sent.waiting[now, 2 * b + 1, e] = step_input[V_REF * m + e]
    for e in range(m):
        due = (now - sent.delay[b, e] + ring) % ring
        step_input[Q_REF * m + e] = sent.waiting[due, 2 * b, e]
        step_input[V_REF * m + e] = sent.waiting[due, 2 * b + 1, e]


@compiled(lean=True)
def _moved(robot: int, bodies: RobotWorlds, world: WorldTables, v: Floats1, h: float) -> float:
    """Return a bound on the approach of robot and bodies in h [m], at velocities v, shape (n,)."""
    fastest, turning = 0.0, 0.0
    for j in range(v.size):
        turning += abs(v[j]) * bodies.lever[j]
    for body in range(bodies.rows.shape[1]):
        row = bodies.rows[robot, body]
        shape = len(world.shapes.mover) - bodies.rows.shape[1] + body
        linear, angular, far = 0.0, 0.0, world.shapes.ball[shape, 3]
        for i in range(3):
            linear += row[MOTION + i] * row[MOTION + i]
            angular += row[MOTION + 3 + i] * row[MOTION + 3 + i]
            far += abs(world.shapes.own_middle[shape, i])
        fastest = max(fastest, math.sqrt(linear) + math.sqrt(angular) * far)
    return h * (turning + fastest)


@compiled(lean=True)
def _enter(robot: int, bodies: RobotWorlds, world: WorldTables) -> None:
    """Copy a robot's bodies into the tables of the world, and set the wrench to zero."""
    rows, table, shapes = bodies.rows, world.bodies, world.shapes
    for body in range(rows.shape[1]):
        row = rows[robot, body]
        for i in range(3):
            table.position[body, i], table.inertia[body, i] = row[i], row[INERTIA + i]
            for k in range(3):
                table.rotation[body, i, k] = row[ROTATION + 3 * i + k]
        for i in range(6):
            table.velocity[body, i] = row[MOTION + i]
        table.mass[body] = row[MASS]
        shapes.friction[len(shapes.friction) - rows.shape[1] + body] = row[FRICTION]
    for i in range(6):
        world.state.wrench[0, i] = 0.0
    world.state.numbers[4] = 0


@compiled(lean=True)
def _leave(robot: int, bodies: RobotWorlds, world: WorldTables) -> None:
    """Copy a robot's bodies back from the tables of the world."""
    rows, table = bodies.rows, world.bodies
    for body in range(rows.shape[1]):
        row = rows[robot, body]
        for i in range(3):
            row[i] = table.position[body, i]
            for k in range(3):
                row[ROTATION + 3 * i + k] = table.rotation[body, i, k]
        for i in range(6):
            row[MOTION + i] = table.velocity[body, i]


@compiled(lean=True)
def _stop_unsound(b: int, k: int, robots: RobotTables, space: StepWorkspace, good: Ints1) -> bool:
    """Keep the state of robots that stopped or whose new state is not sound; return whether there are any."""
    m, lanes, stopped = space.solve_output.size, robots.lanes, False
    for lane in range(lanes):
        if space.flags[ALIVE, lane] and not is_sound(lane, lanes, space):
            space.flags[ALIVE, lane] = False
            if b * lanes + lane < good.size:
                good[b * lanes + lane] = k
        if not space.flags[ALIVE, lane]:
            stopped = True
            for e in range(lane, 2 * m, lanes):
                space.step_output[e] = space.step_input[e]
    return stopped
