"""The step with clipped motors, sticking joints and touched stops, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pepper_kin.twin.fast.law import Derived, friction_at, piece_at
from pepper_kin.twin.fast.native import call_kernel
from pepper_kin.twin.integrator import HALVINGS, MOST_ROUNDS, NEWTON_ROUNDS, SAME_FORCE
from pepper_kin.twin.joint_law import LawTable

Array = np.ndarray


class Room(NamedTuple):
    """Arrays that a thread writes to; n joints, W lanes, m = n W, p entries of the mass matrix.

    Attributes:
        given: Input of the step kernel, beginning with position and velocity.
        constant: Its part from the feed-forward's shares on, which stays, shape (blocks, .).
        result: Output of the step kernel: a, bias, gravity (m each), mass (p W).
        work: Work of the kernels.
        told: References, feed-forward and load, shape (4, m).
        servo: What the actuators want at w = 0, shape (m,).
        next: Position, velocity and torque after the step, shape (3 m,).
        ask: Input of the kernel that solves: mass, extra, right.
        answer: Its output, shape (m,).
        piece: Intercept and slope of each joint's piece, shape (2, m).
        before: Velocities of the round before, shape (m,).
        way: M times the way to the next guess, and M times what was gone, shape (2, m).
        settled: Which lanes are done, shape (W,).
        alive: Which robots go on, shape (W,).
        places: Row and column of each entry of the mass matrix, shape (2, p).
    """

    given: Array
    constant: Array
    result: Array
    work: Array
    told: Array
    servo: Array
    next: Array
    ask: Array
    answer: Array
    piece: Array
    before: Array
    way: Array
    settled: np.ndarray
    alive: np.ndarray
    places: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def settle(b: int, h: float, address: int, lanes: int, law: LawTable, fixed: Derived, room: Room) -> None:
    """Finish a step whose first guess may be wrong; see `Integrator._solve`.

    `room` holds the first guess in `next`, the terms of the equation in `result`, and in `servo` all that the
    actuators want; `next` is the result.
    """
    _first_pieces(b, h, law, fixed, room)
    room.ask[: room.result.size - 3 * room.servo.size] = room.result[3 * room.servo.size :]
    for round_ in range(MOST_ROUNDS):
        if round_ > 0:
            _next_guess(b, h, address, lanes, law, room)
        if _all_agree(b, h, lanes, law, room):
            return
        for lane in range(lanes):
            if not room.settled[lane]:
                if round_ >= NEWTON_ROUNDS:
                    _go_to_the_least(b, h, lane, lanes, law, room)
                _look_up(b, h, lane, lanes, 0 < round_ < NEWTON_ROUNDS, law, room)


@njit(cache=True, nogil=True, error_model="numpy")
def _first_pieces(b: int, h: float, law: LawTable, fixed: Derived, room: Room) -> None:
    m = room.servo.size
    room.settled[:] = False
    for e in range(m):
        friction, stick = friction_at(law.coulomb[b, e], room.given[m + e])
        room.piece[0, e] = room.servo[e] - friction
        room.piece[1, e] = fixed.gain[b, e] + law.viscous[b, e] + stick
        room.before[e] = room.given[m + e]


@njit(cache=True, nogil=True, error_model="numpy")
def _all_agree(b: int, h: float, lanes: int, law: LawTable, room: Room) -> bool:
    """Write the torques, and mark the lanes whose forces agree with the law; return whether all do."""
    m = room.servo.size
    all_agree = True
    for lane in range(lanes):
        if room.settled[lane]:
            continue
        agrees = True
        for e in range(lane, m, lanes):
            w = room.next[m + e]
            torque, c, k = piece_at(law, b, e, h, room.given[e], w, room.servo[e], w)
            due = room.piece[0, e] - room.piece[1, e] * w
            if abs(c - k * w - due) > SAME_FORCE * (1.0 + abs(due)):
                agrees = False
            room.next[2 * m + e] = torque
        room.settled[lane] = agrees
        all_agree = all_agree and agrees
    return all_agree


@njit(cache=True, nogil=True, error_model="numpy")
def _look_up(b: int, h: float, lane: int, lanes: int, turns: bool, law: LawTable, room: Room) -> None:
    """Look up the torques and pieces at the present velocities of a lane."""
    m = room.servo.size
    for e in range(lane, m, lanes):
        w = room.next[m + e]
        before = room.before[e] if turns else w
        torque, c, k = piece_at(law, b, e, h, room.given[e], w, room.servo[e], before)
        room.next[2 * m + e], room.piece[0, e], room.piece[1, e] = torque, c, k


@njit(cache=True, nogil=True, error_model="numpy")
def _next_guess(b: int, h: float, address: int, lanes: int, law: LawTable, room: Room) -> None:
    """Solve the step on the present pieces for the lanes that are not settled."""
    m = room.servo.size
    start = room.result.size - 3 * m
    for e in range(m):
        v = room.given[m + e]
        room.ask[start + e] = law.rotor[b, e] + h * room.piece[1, e]
        force = room.piece[0, e] - room.piece[1, e] * v + room.told[3, e]
        room.ask[start + m + e] = force - room.result[m + e]
    call_kernel(address, room.ask.ctypes.data, room.answer.ctypes.data, room.work.ctypes.data)
    for e in range(m):
        if not room.settled[e % lanes]:
            w = room.given[m + e] + h * room.answer[e]
            room.before[e] = room.next[m + e]
            room.next[m + e] = w
            room.next[e] = room.given[e] + h * w


@njit(cache=True, nogil=True, error_model="numpy")
def _go_to_the_least(b: int, h: float, lane: int, lanes: int, law: LawTable, room: Room) -> None:
    """Go back on the way of a lane to where the step's convex function is least."""
    m = room.servo.size
    _weigh(b, lane, lanes, law, room)
    slope, curvature = 0.0, 0.0
    for e in range(lane, m, lanes):
        way = room.next[m + e] - room.before[e]
        slope += way * (room.way[1, e] / h + room.result[m + e] - room.told[3, e])
        curvature += way * room.way[0, e] / h
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        t = (low + high) / 2
        rise = slope + t * curvature
        for e in range(lane, m, lanes):
            way = room.next[m + e] - room.before[e]
            w = room.before[e] + t * way
            _, c, k = piece_at(law, b, e, h, room.given[e], w, room.servo[e], w)
            rise -= way * (c - k * w)
        if rise < 0.0:
            low = t
        else:
            high = t
    for e in range(lane, m, lanes):
        w = room.before[e] + high * (room.next[m + e] - room.before[e])
        room.next[m + e] = w
        room.next[e] = room.given[e] + h * w


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(b: int, lane: int, lanes: int, law: LawTable, room: Room) -> None:
    """Write (M + J) (w+ - w) and (M + J) (w - v), where w+ is the new guess and w the one before."""
    m, places = room.servo.size, room.places
    for e in range(lane, m, lanes):
        room.way[0, e] = law.rotor[b, e] * (room.next[m + e] - room.before[e])
        room.way[1, e] = law.rotor[b, e] * (room.before[e] - room.given[m + e])
    for p in range(places.shape[1]):
        mass = room.ask[p * lanes + lane]
        i, j = places[0, p] * lanes + lane, places[1, p] * lanes + lane
        room.way[0, i] += mass * (room.next[m + j] - room.before[j])
        room.way[1, i] += mass * (room.before[j] - room.given[m + j])
        if i != j:
            room.way[0, j] += mass * (room.next[m + i] - room.before[i])
            room.way[1, j] += mass * (room.before[i] - room.given[m + i])
