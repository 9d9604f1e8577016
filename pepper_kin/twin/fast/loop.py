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

from pepper_kin.twin.fast.law import CREEP, Derived, friction_at, seen_at
from pepper_kin.twin.fast.native import call_kernel
from pepper_kin.twin.fast.settle import Room, settle
from pepper_kin.twin.integrator import RUNAWAY
from pepper_kin.twin.joint_law import LawTable

Array = np.ndarray

# Parts of the step kernel's input, m each.
Q, V, FORCE, EXTRA, SHARE = 0, 1, 2, 3, 4
# Parts of its output, m each, and what follows.
A, BIAS, GRAVITY, MASS = 0, 1, 2, 3


class Inputs(NamedTuple):
    """What robots are told; the first axis has one entry for each robot, or one for all.

    Attributes:
        position: Reference for the end of each step, shape (., T, n).
        velocity: Reference, shape (., T, n).
        given: Feed-forward or effort, shape (., T, n).
        load: From outside, shape (., T, n) or (., 1, n).
    """

    position: Array
    velocity: Array
    given: Array
    load: Array


class Log(NamedTuple):
    """What robots did.

    Attributes:
        position: After every `every`-th step, shape (robots, T // every, n).
        velocity: The same.
        torque: The same.
        every: Steps between rows.
        good: Number of good steps of each robot, shape (robots,).
    """

    position: Array
    velocity: Array
    torque: Array
    every: int
    good: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def roll(
    steps: int,
    h: float,
    addresses: np.ndarray,
    lanes: int,
    first: int,
    last: int,
    law: LawTable,
    fixed: Derived,
    room: Room,
    inputs: Inputs,
    state: Array,
    log: Log,
) -> None:
    """Advance blocks `first` to `last` - 1 by a number of steps.

    Args:
        steps: How many.
        h: Timestep [s].
        addresses: Of the kernels of a step and of a solution.
        lanes: W.
        first: First block.
        last: The block after the last.
        law: Parameters, each of shape (blocks, m).
        fixed: What follows from them.
        room: Arrays to write to; `room.given` holds the constant part of the kernel's input.
        inputs: What robots are told.
        state: Position, velocity and torque, shape (3, blocks, m); the result too.
        log: What to write.
    """
    m = state.shape[2]
    robots = log.good.size
    for b in range(first, last):
        room.given[: 2 * m] = state[:2, b].ravel()
        room.given[SHARE * m : room.constant.shape[1] + SHARE * m] = room.constant[b]
        for lane in range(lanes):
            room.alive[lane] = True
        for k in range(steps):
            _tell(b, k, lanes, room, inputs)
            strange = _step(b, h, addresses, law, fixed, room)
            if strange > 0:
                settle(b, h, addresses[1], lanes, law, fixed, room)
                if not _survey(b, k, lanes, m, room, log):
                    break
            room.given[: 2 * m] = room.next[: 2 * m]
            if (k + 1) % log.every == 0:
                _write(b, k // log.every, lanes, m, robots, room, log)
        state[0, b] = room.given[:m]
        state[1, b] = room.given[m : 2 * m]
        state[2, b] = room.next[2 * m :]


@njit(cache=True, nogil=True, error_model="numpy")
def _tell(b: int, k: int, lanes: int, room: Room, inputs: Inputs) -> None:
    """Write a step's references in the order of elements, shape (4, m)."""
    told, n = room.told, inputs.position.shape[2]
    last = inputs.position.shape[0] - 1
    loads, row = inputs.load.shape[0] - 1, min(k, inputs.load.shape[1] - 1)
    for lane in range(lanes):
        robot = min(b * lanes + lane, last)
        loaded = min(b * lanes + lane, loads)
        for j in range(n):
            e = j * lanes + lane
            told[0, e] = inputs.position[robot, k, j]
            told[1, e] = inputs.velocity[robot, k, j]
            told[2, e] = inputs.given[robot, k, j]
            told[3, e] = inputs.load[loaded, row, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _step(b: int, h: float, addresses: np.ndarray, law: LawTable, fixed: Derived, room: Room) -> int:
    """Take a step on the first guess of pieces and return in how many joints it may be wrong."""
    given, result, following, servo, told = room.given, room.result, room.next, room.servo, room.told
    m = servo.size
    for e in range(m):
        position = given[e]
        if fixed.has_encoder:
            position = seen_at(law.resolution[b, e], position)
        servo[e] = (
            law.kp[b, e] * (told[0, e] - position)
            + law.kd[b, e] * told[1, e]
            + law.strength[b, e] * told[2, e]
        )
        drag = (fixed.gain[b, e] + law.viscous[b, e]) * given[m + e]
        given[FORCE * m + e] = servo[e] - drag + told[3, e]
        given[EXTRA * m + e] = fixed.extra[b, e]
    if fixed.has_friction:
        for e in range(m):
            friction, stick = friction_at(law.coulomb[b, e], given[m + e])
            given[FORCE * m + e] -= friction + stick * given[m + e]
            given[EXTRA * m + e] += h * stick
    call_kernel(addresses[0], given.ctypes.data, result.ctypes.data, room.work.ctypes.data)
    strange = 0
    for e in range(m):
        servo[e] += given[SHARE * m + e] * result[GRAVITY * m + e]
        w = given[m + e] + h * result[A * m + e]
        q = given[e] + h * w
        torque = servo[e] - fixed.gain[b, e] * w
        high = min(law.limit[b, e], law.stall[b, e] - law.line[b, e] * w)
        low = max(-law.limit[b, e], -law.stall[b, e] - law.line[b, e] * w)
        following[e] = q
        following[m + e] = w
        following[2 * m + e] = torque
        inside = (max(q, given[e]) <= law.upper[b, e]) & (min(q, given[e]) >= law.lower[b, e])
        good = inside & (torque <= high) & (torque >= low) & (abs(w) < RUNAWAY)
        strange += 1 - good
    if fixed.has_friction:
        for e in range(m):
            v, w = given[m + e], following[m + e]
            same = (abs(v) <= CREEP) == (abs(w) <= CREEP) and (abs(w) <= CREEP or v * w > 0.0)
            strange += 0 if same or law.coulomb[b, e] == 0.0 else 1
    return strange


@njit(cache=True, nogil=True, error_model="numpy")
def _survey(b: int, k: int, lanes: int, m: int, room: Room, log: Log) -> bool:
    """Stop robots whose new state is absurd; the result tells whether any robot is left."""
    left = False
    for lane in range(lanes):
        if room.alive[lane]:
            for e in range(lane, m, lanes):
                v, torque = room.next[m + e], room.next[2 * m + e]
                if not (abs(v) < RUNAWAY and abs(torque) < np.inf):
                    room.alive[lane] = False
            robot = b * lanes + lane
            if not room.alive[lane] and robot < log.good.size:
                log.good[robot] = k
                row = k // log.every
                if row < log.position.shape[1]:
                    _write_lane(robot, lane, row, lanes, m, room, log)
        if room.alive[lane]:
            left = True
        else:  # it stays where it was last seen well
            for e in range(lane, m, lanes):
                room.next[e] = room.given[e]
                room.next[m + e] = room.given[m + e]
    return left


@njit(cache=True, nogil=True, error_model="numpy")
def _write(b: int, row: int, lanes: int, m: int, robots: int, room: Room, log: Log) -> None:
    for lane in range(lanes):
        robot = b * lanes + lane
        if robot < robots and room.alive[lane]:
            _write_lane(robot, lane, row, lanes, m, room, log)


@njit(cache=True, nogil=True, error_model="numpy")
def _write_lane(robot: int, lane: int, row: int, lanes: int, m: int, room: Room, log: Log) -> None:
    for j in range(m // lanes):
        e = j * lanes + lane
        log.position[robot, row, j] = room.next[e]
        log.velocity[robot, row, j] = room.next[m + e]
        log.torque[robot, row, j] = room.next[2 * m + e]
