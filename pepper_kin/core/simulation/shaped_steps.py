"""Robots that are sent targets, as `setAngles` does: commands are shaped, and robots stepped, in one call."""

from __future__ import annotations

import numpy as np

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
    implicit_step,
    is_sound,
)
from pepper_kin.core.simulation.target_following import time_to_target
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1

# Rows of the state.
POSITION, VELOCITY, EFFORT, COMMAND, COMMAND_SPEED, TARGET = range(6)


@compiled("void(int64[::1], RobotTables, StepWorkspace, float64[:, :, ::1], float64[:, ::1], int64[::1])")
def shaped_steps(
    span: Ints1,
    robots: RobotTables,
    space: StepWorkspace,
    state: Floats3,
    shaping: Floats2,
    good: Ints1,
) -> None:
    """Send robots to their targets for some steps.

    The command of each joint goes to its target along the cubic of `target_following`, from where it is and
    as fast as it is, and the joints follow it.

    Args:
        span: First block, the block after the last, and number of steps.
        robots: The robots, in B blocks.
        space: Arrays to write to.
        state: Position, velocity, torque, command [rad or m], its speed, target, shape (6, B, m); changed.
        shaping: Greatest speed and acceleration of commands of the joints in their lanes, shape (2, m).
        good: Number of good steps of each robot, shape (N,); written.
    """
    m, lanes, h, steps = state.shape[2], robots.lanes, robots.timestep, span[2]
    step_input, curve = space.step_input, np.empty((4, m))
    for b in range(span[0], span[1]):
        for e in range(m):
            step_input[Q * m + e], step_input[V * m + e] = state[POSITION, b, e], state[VELOCITY, b, e]
            step_input[FEEDFORWARD_TORQUE * m + e] = step_input[LOAD * m + e] = 0.0
            way, speed = state[TARGET, b, e] - state[COMMAND, b, e], state[COMMAND_SPEED, b, e]
            time = max(time_to_target(way, speed, shaping[0, e], shaping[1, e]), h)
            curve[0, e], curve[1, e] = time, speed
            curve[2, e] = (3.0 * way - 2.0 * speed * time) / (time * time)
            curve[3, e] = (speed * time - 2.0 * way) / (time * time * time)
        for e in range(robots.constant.shape[1]):
            step_input[CONSTANT * m + e] = robots.constant[b, e]
        for lane in range(lanes):
            space.flags[ALIVE, lane] = True
            if b * lanes + lane < good.size:
                good[b * lanes + lane] = steps
        _advance(b, steps, robots, space, curve, state[COMMAND, b], good)
        t = steps * h
        for e in range(m):
            state[POSITION, b, e], state[VELOCITY, b, e] = step_input[Q * m + e], step_input[V * m + e]
            state[EFFORT, b, e] = space.step_output[TORQUE * m + e]
            state[COMMAND_SPEED, b, e] = _speed(curve, e, t)
            state[COMMAND, b, e] += _way(curve, e, t)


@compiled(lean=True, inline=True)
def _way(curve: Floats2, e: int, time: float) -> float:
    """Return how far a command has gone after a time: T, u and coefficients of t^2 and t^3, (4, m)."""
    t = min(time, curve[0, e])
    return t * (curve[1, e] + t * (curve[2, e] + t * curve[3, e]))


@compiled(lean=True, inline=True)
def _speed(curve: Floats2, e: int, time: float) -> float:
    t = min(time, curve[0, e])
    return curve[1, e] + t * (2.0 * curve[2, e] + t * 3.0 * curve[3, e])


@compiled(lean=True)
def _advance(
    b: int,
    steps: int,
    robots: RobotTables,
    space: StepWorkspace,
    curve: Floats2,
    begin: Floats1,
    good: Ints1,
) -> None:
    """Step one block along commands that begin at `begin`, shape (m,), and go on by `curve`, shape (4, m)."""
    m, h, step_input, step_output = begin.size, robots.timestep, space.step_input, space.step_output
    stateful, any_stopped = remembers(robots.law), False
    for k in range(steps):
        for e in range(m):
            step_input[Q_REF * m + e] = begin[e] + _way(curve, e, (k + 1) * h)
            step_input[V_REF * m + e] = _speed(curve, e, (k + 1) * h)
        if stateful:
            hold_in_play(b, robots.law, step_input)
        calm = implicit_step(b, robots, space)
        if not calm or any_stopped:
            any_stopped = _stop_unsound(b, k, robots, space, good)
        if stateful:
            remember(b, robots, space)
        for e in range(2 * m):
            step_input[e] = step_output[e]


@compiled(lean=True)
def _stop_unsound(b: int, k: int, robots: RobotTables, space: StepWorkspace, good: Ints1) -> bool:
    """Keep robots whose new state is not sound where they were; return whether there are any."""
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
