"""Rollouts over time: many robots of one kind, or one robot in contact with its world."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.core.simulation.actuator_model import STRENGTH
from pepper_kin.core.simulation.contact_solver import FreeStep
from pepper_kin.core.simulation.contact_step import (
    CALLBACK,
    NO_WORLD,
    SOLVED,
    WorldTables,
    find_points,
    push_apart,
    step_by_callback,
)
from pepper_kin.core.simulation.drive_state import hold_in_play, remember, remembers
from pepper_kin.core.simulation.implicit_step import (
    ALIVE,
    CONSTANT,
    FEEDFORWARD_TORQUE,
    LOAD,
    NEXT_V,
    Q_REF,
    TORQUE,
    V_REF,
    RobotTables,
    StepWorkspace,
    V,
    all_sound,
    implicit_step,
    is_sound,
    write_equation,
    write_segments,
)
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Floats3, Ints1

DONE = -1
"""Result if no step of the world failed."""


class Span(NamedTuple):
    """Range of steps and blocks to process.

    Attributes:
        steps: Number of steps T.
        every: Number of steps between rows of the log.
        first: Index of the first block.
        last: Index after the last block.
    """

    steps: int
    every: int
    first: int
    last: int


class Inputs(NamedTuple):
    """Inputs of the robots, shape (N, T, n) each, or in the order of elements and for all, (1, T, m).

    Attributes:
        position: Reference position for the end of each step [rad or m].
        velocity: Reference velocity [rad/s or m/s].
        feedforward: Feed-forward or effort [N m or N]; T may be 1, for all steps.
        load: External load [N m or N]; T may be 1, for all steps.
    """

    position: Floats3
    velocity: Floats3
    feedforward: Floats3
    load: Floats3


class Log(NamedTuple):
    """Recorded motion of robots.

    Attributes:
        position: Positions at the start and after every `every`-th step; the row after a robot's last good
            one has the state that diverged; shape (N, 1 + ceil(T / every), n); the caller writes the first
            row [rad or m].
        velocity: Velocities in the same rows [rad/s or m/s], shape (N, 1 + ceil(T / every), n).
        torque: Torques in the same rows [N m or N], shape (N, 1 + ceil(T / every), n).
        good: Number of good steps of each robot, shape (N,).
    """

    position: Floats3
    velocity: Floats3
    torque: Floats3
    good: Ints1


@compiled("int64(Span, RobotTables, StepWorkspace, Inputs, float64[:, :, ::1], Log, WorldTables)")
def rollout(
    span: Span,
    robots: RobotTables,
    space: StepWorkspace,
    inputs: Inputs,
    state: Floats3,
    log: Log,
    world: WorldTables,
) -> int:
    """Advance some blocks of robots by a number of steps.

    With a world, there is one robot.  Each step without contacts is passed to the world's step as one linear
    equation.  If the contacts add no load, the step is accepted; otherwise it is repeated with the load.

    Args:
        span: Steps and blocks.
        robots: The robots.
        space: Workspace.
        inputs: Inputs of the robots.
        state: Position, velocity and torque, shape (3, B, m); overwritten by the result.
        log: Output.
        world: World that the robot may touch.

    Returns:
        DONE, or the outcome of the world's step that failed.
    """
    size = state.shape[2] if world.kind != NO_WORLD else 0
    mass_hat, force = np.empty((size, size)), np.empty(size)
    equation = FreeStep(space.step_input[size : 2 * size], mass_hat, force)
    return _advance_blocks(span, robots, space, inputs, state, log, world, equation)


@compiled(lean=True)
def _advance_blocks(
    span: Span, robots: RobotTables, space: StepWorkspace, inputs: Inputs, state: Floats3, log: Log,
    world: WorldTables, equation: FreeStep,
) -> int:  # fmt: skip
    """Carry out `rollout`, with arrays for a step's linear equation; arguments and shapes are the same."""
    m, lanes, status = state.shape[2], robots.lanes, DONE
    step_input, step_output = space.step_input, space.step_output
    coupled = world.kind != NO_WORLD
    stateful = remembers(robots.law)
    for b in range(span.first, span.last):
        for e in range(m):
            step_input[e], step_input[V * m + e] = state[0, b, e], state[1, b, e]
        for e in range(robots.constant.shape[1]):
            step_input[CONSTANT * m + e] = robots.constant[b, e]
        for lane in range(lanes):
            space.flags[ALIVE, lane] = True
        left, good, row, until = lanes, 0, 0, span.every
        for k in range(span.steps):
            _read_inputs(b, k, robots, inputs, step_input)
            if stateful:
                hold_in_play(b, robots.law, step_input)
            calm = implicit_step(b, robots, space)
            if coupled:
                write_segments(b, robots, space)
                outcome, pushed, _ = couple(b, 0, robots, space, world, equation, step_input[:m], True)
                if outcome != SOLVED:
                    status, log.good[0] = outcome, k
                    break
                if pushed:
                    calm = implicit_step(b, robots, space)
            if left < lanes or (not calm and not all_sound(space)):
                left = _stop_unsound(b, k, 1 + k // span.every, robots, space, log)
                if left == 0:
                    break
            if stateful:
                remember(b, robots, space)
            _copy(step_output[: 2 * m], step_input[: 2 * m])
            good += 1
            until -= 1
            if until == 0:
                until, row = span.every, row + 1
                _write_log(b, row, lanes, space, log)
        for e in range(m):
            state[0, b, e], state[1, b, e] = step_input[e], step_input[V * m + e]
            if good > 0:
                state[2, b, e] = step_output[TORQUE * m + e]
    return status


@compiled("boolean(RobotTables, StepWorkspace, float64[:, ::1], float64[::1])")
def linearized_step(robots: RobotTables, space: StepWorkspace, mass_hat: Floats2, force: Floats1) -> bool:
    """Take a step of one robot from `space.step_input`, and write the linear equation that it solves.

    Args:
        robots: The robot.
        space: Arrays of the robot.
        mass_hat: Output, see `write_equation`, shape (n, n).
        force: Output, shape (n,).

    Returns:
        Whether the new state is finite and not diverging.
    """
    if remembers(robots.law):
        hold_in_play(0, robots.law, space.step_input)
    implicit_step(0, robots, space)
    write_segments(0, robots, space)
    write_equation(0, 0, robots, space, mass_hat, force)
    return is_sound(0, 1, space)


@compiled(lean=True)
def couple(
    b: int, lane: int, robots: RobotTables, space: StepWorkspace, world: WorldTables, equation: FreeStep,
    q: Floats1, near: bool,
) -> tuple[int, bool, float]:  # fmt: skip
    """Take the step of a robot's world, and add the contact load to the load of the robot's step.

    Args:
        b: Index of the robot's block.
        lane: Lane of the robot.
        robots: The robots.
        space: Arrays of the step, with its segments; changed.
        world: World that the robot may touch; changed.
        equation: Velocity of the robot, and memory for its linear equation.
        q: Position of the robot [rad or m], shape (n,).
        near: Whether the robot may be near anything.

    Returns:
        The outcome of the world's step, whether the robot's step has to be repeated, and a lower bound of the
        robot's distance from all else [m].
    """
    n, m, lanes, h = q.size, space.solve_output.size, robots.lanes, robots.timestep
    unsound, apart = not is_sound(lane, lanes, space), 0.0
    if unsound or world.kind == CALLBACK:
        write_equation(b, lane, robots, space, equation.mass_hat, equation.force)
        if unsound and not _is_finite(equation.force):
            return SOLVED, False, 0.0  # the robot's own motion diverged, not the contacts
    if world.kind == CALLBACK:
        outcome = step_by_callback(world, q, equation, h)
    else:
        outcome, apart = find_points(world, q, equation.velocity, h, near)
        if outcome == SOLVED:
            if apart <= 0.0 and world.state.numbers[0] > 0:
                write_equation(b, lane, robots, space, equation.mass_hat, equation.force)
            outcome = push_apart(world, equation, h)
    if outcome != SOLVED:
        return outcome, False, 0.0
    pushed = False
    for j in range(n):
        load = world.state.load[j]
        if load != 0.0:
            pushed = True
            space.step_input[LOAD * m + j * lanes + lane] += load
    return SOLVED, pushed, apart


@compiled(lean=True)
def _is_finite(values: Floats1) -> bool:
    """Return whether all numbers, shape (k,), are finite."""
    total = 0.0
    for e in range(values.size):
        total += 0.0 * values[e]
    return total == 0.0


@compiled(lean=True)
def _read_inputs(b: int, k: int, robots: RobotTables, inputs: Inputs, step_input: Floats1) -> None:
    """Write the inputs of step k of block b into the kernel's input, shape (> 6 m,), see `StepWorkspace`.

    Feed-forward that is constant in time is written in the first step only.
    """
    m, lanes = robots.law.shape[2], robots.lanes
    _spread(b, k, lanes, inputs.position, step_input[Q_REF * m : (Q_REF + 1) * m])
    _spread(b, k, lanes, inputs.velocity, step_input[V_REF * m : (V_REF + 1) * m])
    if k == 0 or inputs.feedforward.shape[1] > 1:
        _spread(
            b, k, lanes, inputs.feedforward, step_input[FEEDFORWARD_TORQUE * m : (FEEDFORWARD_TORQUE + 1) * m]
        )
        for e in range(m):
            step_input[FEEDFORWARD_TORQUE * m + e] *= robots.law[b, STRENGTH, e]
    _spread(b, k, lanes, inputs.load, step_input[LOAD * m : (LOAD + 1) * m])


@compiled(lean=True)
def _copy(source: Floats1, target: Floats1) -> None:
    """Copy an array, shape (k,): with known length and no offset, the compiler vectorizes it."""
    for e in range(source.size):
        target[e] = source[e]


@compiled(lean=True)
def _spread(b: int, k: int, lanes: int, values: Floats3, step_input: Floats1) -> None:
    """Write one step's values, shape (N or 1, T or 1, n or m), in the order of elements, shape (m,)."""
    robots, steps, n = values.shape
    row = min(k, steps - 1)
    if robots == 1:
        _copy(values[0, row], step_input)
        return
    for lane in range(lanes):
        robot = min(b * lanes + lane, robots - 1)
        for j in range(n):
            step_input[j * lanes + lane] = values[robot, row, j]


@compiled(lean=True)
def _stop_unsound(b: int, k: int, row: int, robots: RobotTables, space: StepWorkspace, log: Log) -> int:
    """Stop robots whose new state is not sound; return how many of the block's robots are left."""
    m, lanes, step_output, flags = space.solve_output.size, robots.lanes, space.step_output, space.flags
    left = 0
    for lane in range(lanes):
        if flags[ALIVE, lane]:
            flags[ALIVE, lane] = is_sound(lane, lanes, space)
            robot = b * lanes + lane
            if not flags[ALIVE, lane] and robot < log.good.size:
                log.good[robot] = k
                _write_lane(robot, lane, row, lanes, space, log)
        if flags[ALIVE, lane]:
            left += 1
        else:  # the robot keeps its last finite state
            for e in range(lane, 2 * m, lanes):
                step_output[e] = space.step_input[e]
    return left


@compiled(lean=True)
def _write_log(b: int, row: int, lanes: int, space: StepWorkspace, log: Log) -> None:
    """Write the new states of a block's remaining robots to a row of the log."""
    if lanes == 1:
        n = space.solve_output.size
        _copy(space.step_output[:n], log.position[b, row])
        _copy(space.step_output[NEXT_V * n : (NEXT_V + 1) * n], log.velocity[b, row])
        _copy(space.step_output[TORQUE * n : (TORQUE + 1) * n], log.torque[b, row])
        return
    for lane in range(lanes):
        robot = b * lanes + lane
        if robot < log.good.size and space.flags[ALIVE, lane]:
            _write_lane(robot, lane, row, lanes, space, log)


@compiled(lean=True)
def _write_lane(robot: int, lane: int, row: int, lanes: int, space: StepWorkspace, log: Log) -> None:
    """Write the new state of one robot to a row of the log."""
    m, n = space.solve_output.size, log.position.shape[2]
    for j in range(n):
        e = j * lanes + lane
        log.position[robot, row, j] = space.step_output[e]
        log.velocity[robot, row, j] = space.step_output[NEXT_V * m + e]
        log.torque[robot, row, j] = space.step_output[TORQUE * m + e]
