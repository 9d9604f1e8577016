"""The step with clipped motors, sticking joints and touched stops, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pepper_kin.twin.fast.law import COULOMB, KD, KP, ROTOR, VISCOUS, friction_at, piece_at
from pepper_kin.twin.fast.native import call_kernel
from pepper_kin.twin.integrator import HALVINGS, MOST_ROUNDS, NEWTON_ROUNDS, SAME_FORCE

Array = np.ndarray


class Room(NamedTuple):
    """Arrays that a thread writes to; n joints, W lanes, m = n W, p entries of the mass matrix.

    Attributes:
        given: Input of the step kernel, beginning with position, velocity, references, feed-forward, load.
        result: Its output: next position, velocity and torque, servo, bias (m each), mass (p W), strange (W).
        work: Work of the kernels.
        ask: Input of the kernel that solves: mass (p W), extra and right (m each).
        answer: Its output, shape (m,).
        rows: Intercept and slope of each joint's piece, velocities of the round before, and M times the way
            to the next guess and M times what was gone, shape (5, m).
        flags: Which lanes are done, and which robots go on, shape (2, W).
        places: Row and column of each entry of the mass matrix, shape (2, p).
    """

    given: Array
    result: Array
    work: Array
    ask: Array
    answer: Array
    rows: Array
    flags: np.ndarray
    places: np.ndarray


# Parts of `given` and `result`, m values each.
Q, V, LOAD = 0, 1, 5
NEXT_Q, NEXT_V, TORQUE, SERVO, BIAS, MASS = 0, 1, 2, 3, 4, 5
# Rows of `rows` and `flags`.
INTERCEPT, SLOPE, BEFORE, WAY, GONE = 0, 1, 2, 3, 4
SETTLED, ALIVE = 0, 1


@njit(cache=True, nogil=True, error_model="numpy")
def settle(h: float, address: int, lanes: int, law: Array, room: Room) -> None:
    """Finish a step whose first guess may be wrong; see `Integrator._solve`.

    Args:
        h: Timestep [s].
        address: Of the kernel that solves.
        lanes: W.
        law: Parameters of the block, shape (rows, m).
        room: `result` holds the first guess, and is where the result goes.
    """
    m = room.answer.size
    _first_pieces(h, law, room)
    entries = room.places.shape[1] * lanes
    for p in range(entries):  # assigning slices would take seconds to compile
        room.ask[p] = room.result[MASS * m + p]
    for round_ in range(MOST_ROUNDS):
        if round_ > 0:
            _next_guess(h, address, lanes, law, room)
        if _all_agree(h, lanes, law, room):
            return
        for lane in range(lanes):
            if not room.flags[SETTLED, lane]:
                if round_ >= NEWTON_ROUNDS:
                    _go_to_the_least(h, lane, lanes, law, room)
                _look_up(h, lane, lanes, 0 < round_ < NEWTON_ROUNDS, law, room)


@njit(cache=True, nogil=True, error_model="numpy")
def _first_pieces(h: float, law: Array, room: Room) -> None:
    """Write the pieces of the first guess."""
    m = room.answer.size
    for lane in range(room.flags.shape[1]):
        room.flags[SETTLED, lane] = False
    for e in range(m):
        v = room.given[V * m + e]
        friction, stick = friction_at(law[COULOMB, e], v)
        room.rows[INTERCEPT, e] = room.result[SERVO * m + e] - friction
        room.rows[SLOPE, e] = h * law[KP, e] + law[KD, e] + law[VISCOUS, e] + stick
        room.rows[BEFORE, e] = v


@njit(cache=True, nogil=True, error_model="numpy")
def _all_agree(h: float, lanes: int, law: Array, room: Room) -> bool:
    """Write the torques, and mark the lanes whose forces agree with the law; return whether all do."""
    m = room.answer.size
    all_agree = True
    for lane in range(lanes):
        if room.flags[SETTLED, lane]:
            continue
        agrees = True
        for e in range(lane, m, lanes):
            w = room.result[NEXT_V * m + e]
            torque, c, k = piece_at(law, e, h, room.given[e], w, room.result[SERVO * m + e], w)
            due = room.rows[INTERCEPT, e] - room.rows[SLOPE, e] * w
            if abs(c - k * w - due) > SAME_FORCE * (1.0 + abs(due)):
                agrees = False
            room.result[TORQUE * m + e] = torque
        room.flags[SETTLED, lane] = agrees
        all_agree = all_agree and agrees
    return all_agree


@njit(cache=True, nogil=True, error_model="numpy")
def _look_up(h: float, lane: int, lanes: int, turns: bool, law: Array, room: Room) -> None:
    """Look up the torques and pieces at the present velocities of a lane."""
    m = room.answer.size
    for e in range(lane, m, lanes):
        w = room.result[NEXT_V * m + e]
        before = room.rows[BEFORE, e] if turns else w
        torque, c, k = piece_at(law, e, h, room.given[e], w, room.result[SERVO * m + e], before)
        room.result[TORQUE * m + e], room.rows[INTERCEPT, e], room.rows[SLOPE, e] = torque, c, k


@njit(cache=True, nogil=True, error_model="numpy")
def _next_guess(h: float, address: int, lanes: int, law: Array, room: Room) -> None:
    """Solve the step on the present pieces for the lanes that are not settled."""
    m = room.answer.size
    start = room.places.shape[1] * lanes
    for e in range(m):
        c, k = room.rows[INTERCEPT, e], room.rows[SLOPE, e]
        force = c - k * room.given[V * m + e] + room.given[LOAD * m + e]
        room.ask[start + e] = law[ROTOR, e] + h * k
        room.ask[start + m + e] = force - room.result[BIAS * m + e]
    call_kernel(address, room.ask.ctypes.data, room.answer.ctypes.data, room.work.ctypes.data)
    for e in range(m):
        if not room.flags[SETTLED, e % lanes]:
            w = room.given[V * m + e] + h * room.answer[e]
            room.rows[BEFORE, e] = room.result[NEXT_V * m + e]
            room.result[NEXT_V * m + e] = w
            room.result[NEXT_Q * m + e] = room.given[e] + h * w


@njit(cache=True, nogil=True, error_model="numpy")
def _go_to_the_least(h: float, lane: int, lanes: int, law: Array, room: Room) -> None:
    """Go back on the way of a lane to where the step's convex function is least."""
    m, given, result, rows = room.answer.size, room.given, room.result, room.rows
    _weigh(lane, lanes, law, room)
    slope, curvature = 0.0, 0.0
    for e in range(lane, m, lanes):
        way = result[NEXT_V * m + e] - rows[BEFORE, e]
        slope += way * (rows[GONE, e] / h + result[BIAS * m + e] - given[LOAD * m + e])
        curvature += way * rows[WAY, e] / h
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        t = (low + high) / 2
        rise = slope + t * curvature
        for e in range(lane, m, lanes):
            way = result[NEXT_V * m + e] - rows[BEFORE, e]
            w = rows[BEFORE, e] + t * way
            _, c, k = piece_at(law, e, h, given[e], w, result[SERVO * m + e], w)
            rise -= way * (c - k * w)
        if rise < 0.0:
            low = t
        else:
            high = t
    for e in range(lane, m, lanes):
        w = rows[BEFORE, e] + high * (result[NEXT_V * m + e] - rows[BEFORE, e])
        result[NEXT_V * m + e] = w
        result[NEXT_Q * m + e] = given[e] + h * w


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(lane: int, lanes: int, law: Array, room: Room) -> None:
    """Write (M + J) (w+ - w) and (M + J) (w - v), where w+ is the new guess and w the one before."""
    m, given, result, rows = room.answer.size, room.given, room.result, room.rows
    for e in range(lane, m, lanes):
        rows[WAY, e] = law[ROTOR, e] * (result[NEXT_V * m + e] - rows[BEFORE, e])
        rows[GONE, e] = law[ROTOR, e] * (rows[BEFORE, e] - given[V * m + e])
    for p in range(room.places.shape[1]):
        mass = room.ask[p * lanes + lane]
        i, j = room.places[0, p] * lanes + lane, room.places[1, p] * lanes + lane
        rows[WAY, i] += mass * (result[NEXT_V * m + j] - rows[BEFORE, j])
        rows[GONE, i] += mass * (rows[BEFORE, j] - given[V * m + j])
        if i != j:
            rows[WAY, j] += mass * (result[NEXT_V * m + i] - rows[BEFORE, i])
            rows[GONE, j] += mass * (rows[BEFORE, i] - given[V * m + i])
