"""The loop over time, compiled: the counterpart of `pepper_kin.twin.integrator`.

Robots stand side by side in blocks of W, as many as a vector register holds (1 for a single robot).  Joint j
of the robot in lane l of a block is element e = j W + l; m = n W.

Numba renews the machine code of this file when it changes, but not when only `law.py` or `settle.py` do:
after work on those, remove `__pycache__`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pepper_kin.twin.fast.law import STRENGTH
from pepper_kin.twin.fast.native import call_kernel
from pepper_kin.twin.fast.settle import ALIVE, LOAD, NEXT_V, TORQUE, Room, settle
from pepper_kin.twin.integrator import RUNAWAY

Array = np.ndarray

# Parts of the step kernel's input besides those of `settle.py`.
Q_REF, V_REF, GIVEN, CONSTANT = 2, 3, 4, 6


class Inputs(NamedTuple):
    """What robots are told, shape (N, T, n) each, or in the order of elements and for all, (1, T, m).

    Attributes:
        position: Reference for the end of each step.
        velocity: Reference.
        given: Feed-forward or effort; T may be 1, for all steps.
        load: From outside; T may be 1, for all steps.
    """

    position: Array
    velocity: Array
    given: Array
    load: Array


class Log(NamedTuple):
    """What robots did.

    Attributes:
        position: At the start and after every `every`-th step, and in the row after the last good one the
            state that diverged, shape (robots, 1 + ceil(T / every), n).
        velocity: The same.
        torque: The same.
        good: Number of good steps of each robot, shape (robots,).
    """

    position: Array
    velocity: Array
    torque: Array
    good: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def roll(
    span: tuple[int, int, int, int, int],
    h: float,
    addresses: np.ndarray,
    law: Array,
    constant: Array,
    room: Room,
    inputs: Inputs,
    state: Array,
    log: Log,
) -> None:
    """Advance some blocks by a number of steps.

    Args:
        span: Number of steps, steps between rows of the log, W, first block, and the block after the last.
        h: Timestep [s].
        addresses: Of the kernels of a step and of a solution.
        law: Parameters of the joints, shape (blocks, rows, m).
        constant: What does not change in the step kernel's input, shape (blocks, .).
        room: Arrays to write to.
        inputs: What robots are told.
        state: Position, velocity and torque, shape (3, blocks, m); the result too.
        log: What to write.
    """
    steps, every, lanes, first, last = span
    m, given, result = state.shape[2], room.given, room.result
    strange = result.size - lanes
    for b in range(first, last):
        for e in range(2 * m):  # assigning slices would take seconds to compile
            given[e] = state[e // m, b, e % m]
        for e in range(constant.shape[1]):
            given[CONSTANT * m + e] = constant[b, e]
        for lane in range(lanes):
            room.flags[ALIVE, lane] = True
        left = lanes
        for k in range(steps):
            _tell(b, k, lanes, law[b], given, inputs)
            call_kernel(addresses[0], given.ctypes.data, result.ctypes.data, room.work.ctypes.data)
            calm = True
            for lane in range(lanes):
                calm = calm and result[strange + lane] <= 0.0
            if not calm:
                settle(h, addresses[1], lanes, law[b], room)
            if not calm or left < lanes:
                left = _survey(b, k, every, lanes, room, log)
                if left == 0:
                    break
            _copy(result[: 2 * m], given[: 2 * m])
            if (k + 1) % every == 0:
                _write(b, (k + 1) // every, lanes, room, log)
        for e in range(m):
            state[0, b, e], state[1, b, e] = given[e], given[m + e]
            if steps > 0:
                state[2, b, e] = result[TORQUE * m + e]


@njit(cache=True, nogil=True, error_model="numpy")
def _tell(b: int, k: int, lanes: int, law: Array, given: Array, inputs: Inputs) -> None:
    """Write a step's references into the kernel's input.

    What is constant in time is written in the first step only.
    """
    m = law.shape[1]
    _spread(b, k, lanes, inputs.position, given, Q_REF * m)
    _spread(b, k, lanes, inputs.velocity, given, V_REF * m)
    if k == 0 or inputs.given.shape[1] > 1:
        _spread(b, k, lanes, inputs.given, given, GIVEN * m)
        for e in range(m):
            given[GIVEN * m + e] *= law[STRENGTH, e]
    if k == 0 or inputs.load.shape[1] > 1:
        _spread(b, k, lanes, inputs.load, given, LOAD * m)


@njit(cache=True, nogil=True, error_model="numpy")
def _copy(source: Array, target: Array) -> None:
    """Copy an array; known lengths and no offset let the compiler use vectors."""
    for e in range(source.size):
        target[e] = source[e]


@njit(cache=True, nogil=True, error_model="numpy")
def _spread(b: int, k: int, lanes: int, values: Array, given: Array, place: int) -> None:
    """Write one step's values of a block's robots in the order of elements."""
    robots, steps, n = values.shape
    row = min(k, steps - 1)
    if robots == 1:
        _copy(values[0, row], given[place : place + n])
        return
    for lane in range(lanes):
        robot = min(b * lanes + lane, robots - 1)
        for j in range(n):
            given[place + j * lanes + lane] = values[robot, row, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _survey(b: int, k: int, every: int, lanes: int, room: Room, log: Log) -> int:
    """Stop robots whose new state is absurd, and return how many of the block's are left."""
    m, result, flags = room.answer.size, room.result, room.flags
    left = 0
    for lane in range(lanes):
        if flags[ALIVE, lane]:
            for e in range(lane, m, lanes):
                if not (abs(result[NEXT_V * m + e]) < RUNAWAY and abs(result[TORQUE * m + e]) < np.inf):
                    flags[ALIVE, lane] = False
            robot = b * lanes + lane
            if not flags[ALIVE, lane] and robot < log.good.size:
                log.good[robot] = k
                _write_lane(robot, lane, 1 + k // every, lanes, room, log)
        if flags[ALIVE, lane]:
            left += 1
        else:  # it stays where it was last seen well
            for e in range(lane, 2 * m, lanes):
                result[e] = room.given[e]
    return left


@njit(cache=True, nogil=True, error_model="numpy")
def _write(b: int, row: int, lanes: int, room: Room, log: Log) -> None:
    for lane in range(lanes):
        robot = b * lanes + lane
        if robot < log.good.size and room.flags[ALIVE, lane]:
            _write_lane(robot, lane, row, lanes, room, log)


@njit(cache=True, nogil=True, error_model="numpy")
def _write_lane(robot: int, lane: int, row: int, lanes: int, room: Room, log: Log) -> None:
    m, n = room.answer.size, log.position.shape[2]
    for j in range(n):
        e = j * lanes + lane
        log.position[robot, row, j] = room.result[e]
        log.velocity[robot, row, j] = room.result[NEXT_V * m + e]
        log.torque[robot, row, j] = room.result[TORQUE * m + e]


@njit(cache=True, nogil=True, error_model="numpy")
def roll_alone(
    h: float,
    addresses: np.ndarray,
    law: Array,
    room: Room,
    position: Array,
    velocity: Array,
    more: Array,
    load: Array,
    log: Array,
) -> int:
    """Advance one robot, W = 1, by a step for each row of its log but the first: `roll` without its lanes.

    Args:
        h: Timestep [s].
        addresses: Of the kernels of a step and of a solution.
        law: Parameters of the joints, shape (rows, n).
        room: Arrays to write to; what does not change in the step kernel's input is there already.
        position: Reference for the end of each step, shape (T, n).
        velocity: Reference, shape (T, n).
        more: Feed-forward or effort, shape (T, n).
        load: From outside, shape (T, n) or (1, n).
        log: Position, velocity and torque, shape (3, 1 + T, n); the first row is the start.

    Returns:
        Number of good steps; the row after them, if any, is the state that diverged.
    """
    given, result = room.given, room.result
    n = law.shape[1]
    for e in range(n):
        given[e], given[n + e] = log[0, 0, e], log[1, 0, e]
    for k in range(position.shape[0]):
        row = min(k, load.shape[0] - 1)
        for e in range(n):
            given[Q_REF * n + e] = position[k, e]
        for e in range(n):
            given[V_REF * n + e] = velocity[k, e]
        for e in range(n):
            given[GIVEN * n + e] = more[k, e] * law[STRENGTH, e]
        for e in range(n):
            given[LOAD * n + e] = load[row, e]
        call_kernel(addresses[0], given.ctypes.data, result.ctypes.data, room.work.ctypes.data)
        calm = result[result.size - 1] <= 0.0  # what is strange; False for NaN
        if not calm:
            settle(h, addresses[1], 1, law, room)
        for e in range(n):
            log[0, k + 1, e] = result[e]
        for e in range(n):
            log[1, k + 1, e] = result[NEXT_V * n + e]
        for e in range(n):
            log[2, k + 1, e] = result[TORQUE * n + e]
        if not calm:
            for e in range(n):
                w, torque = result[NEXT_V * n + e], result[TORQUE * n + e]
                if not (abs(w) < RUNAWAY and abs(torque) < np.inf):
                    return k
        for e in range(2 * n):
            given[e] = result[e]
    return position.shape[0]
