"""The search over several starts for many targets, compiled: the counterpart of `pepper_kin.ik.search`.

Numba keeps the machine code beside this file (or in its own cache folder) and renews it when this file
changes, but not when only `descent.py` or `box.py` do: after work on those, remove `__pycache__`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pepper_kin.ik.descent import SMALL_GAIN
from pepper_kin.ik.fast.descent import (
    CAUTIOUS_STEPS,
    REFLECTIONS,
    Room,
    Setting,
    descend,
    evaluate,
    fraction_of_tolerance,
    make_room,
    reflect,
)
from pepper_kin.ik.fast.lean import lean_alone
from pepper_kin.ik.restarts import REACH, is_chosen
from pepper_kin.ik.search import AGREEING_STARTS, AGREEMENT
from pepper_kin.ik.tasks.task import Array
from pepper_kin.kernels.compilation import Compilation
from pepper_kin.kernels.native import call_kernel

_compilation = Compilation("the fast IK solver")

NEAR, FAR = REACH
NEAR_STARTS = len(REACH)
_is_chosen = njit(inline="always")(is_chosen)

# What `answers` holds after q and the squared errors.
STATUS, ITERATIONS, RESTARTS = 0, 1, 2

SOLVED, UNREACHABLE, LIMITS = 0.0, 1.0, 2.0

# Starts and steps for the question whether the joints without limits would reach the target.
STARTS_WITHOUT_LIMITS = 3
STEPS_WITHOUT_LIMITS = 60

# Descents end sooner than elsewhere, when a step gains less than this part of the cost; only the best of them
# is brought to its very end.
SEARCH_GAIN = 3e-3

# So many descents for each joint at least before their agreement counts.
DESCENTS_A_JOINT = 5

# Below this weighted distance, what descents agree on may be a near miss of a target whose way in is narrow.
# After so many for each joint starts are taken as they come, until none is left, and in place of reflections,
# which lead from the same minimum to the same end, further points of their numbers.
NEAR_MISS = 0.1
DESCENTS_NEAR_A_JOINT = 2

# A solution that the motors cannot hold leans too far.  With the joints that carry much put back to where q0
# has them, or beyond, it is near another that mostly can be held; then further starts are tried.
STRAIGHTENED = (1.0, 1.5)
STARTS_FOR_TORQUE = 3

# Rows of `bounds`.
ROW_LOW, ROW_HIGH, ROW_SCALE, ROW_HEAVY, ROW_MOVES = 0, 1, 2, 3, 4

# Places in `numbers`.
TASKS_ADDRESS, GRAVITY_ADDRESS, WORK_SIZE, STOP_WHEN_MET = 0, 1, 2, 3


class Wishes(NamedTuple):
    """What a search needs besides the problem.

    Attributes:
        gravity: Address of the kernel of the gravity torque.
        effort: 1 / effort limit, 0 where there is none, shape (n,).
        torque: Room, shape (n,).
        heavy: Above 0 for joints that carry much, shape (k,).
        points: Of the restarts, in the unit cube, shape (restarts, candidates, k).
        costs: Room, one for each descent.
    """

    gravity: int
    effort: Array
    torque: Array
    heavy: Array
    points: Array
    costs: Array


@lean_alone
def _start(setting: Setting, wishes: Wishes, room: Room, number: int, only: int) -> None:
    """Write the start of a number into `given`; see `pepper_kin.ik.restarts.starts`.

    Where `only` is not negative, it is this one of the number's points as it stands.
    """
    index, low, high, trial = setting.joints, setting.low, setting.high, room.trial
    near = number < NEAR_STARTS
    reach = 1.0
    if near:
        reach = NEAR if number == 0 else FAR
    first, candidates = max(only, 0), 1
    if _is_chosen(number) and only < 0:
        candidates = wishes.points.shape[1]
    least = math.inf
    for c in range(first, first + candidates):
        for i in range(index.size):
            q0 = setting.reference[index[i]]
            if low[i] == high[i] or (number % 2 == 1 and wishes.heavy[i] > 0 and only < 0):
                trial[index[i]] = q0
                continue
            bottom, top = max(low[i], q0 - math.pi), min(high[i], q0 + math.pi)
            way = reach * (bottom + wishes.points[number, c, i] * (top - bottom) - q0)
            trial[index[i]] = min(max(q0 + way, low[i]), high[i])
        cost = 0.0
        if candidates > 1:
            evaluate(setting, trial, room.other)
            cost = room.other[setting.tolerance.size]
        if cost < least:
            least = cost
            for i in range(index.size):
                room.given[index[i]] = trial[index[i]]


@lean_alone
def _straighten(setting: Setting, wishes: Wishes, room: Room, part: float, answer: Array) -> None:
    """Write the best solution so far into `given`, the joints that carry much moved back by a part to q0."""
    for i in range(setting.joints.size):
        j = setting.joints[i]
        back = part if wishes.heavy[i] > 0 else 0.0
        q = answer[j] + back * (setting.reference[j] - answer[j])
        room.given[j] = min(max(q, setting.low[i]), setting.high[i])


@lean_alone
def _held(setting: Setting, wishes: Wishes, q: Array) -> bool:
    """Whether the motors hold q: |g_i| <= effort limit for every joint."""
    call_kernel(wishes.gravity, q.ctypes.data, wishes.torque.ctypes.data, setting.work.ctypes.data)
    worst = 0.0
    for i in range(wishes.effort.size):
        worst = max(worst, abs(wishes.torque[i]) * wishes.effort[i])
    return worst <= 1.0


@lean_alone
def _agree(costs: Array, count: int, least_count: int) -> bool:
    """Whether the least weighted distance was found often enough to be believed."""
    if count < least_count:
        return False
    least = costs[0]
    for i in range(1, count):
        least = min(least, costs[i])
    least, agreeing = math.sqrt(2 * least), 0
    for i in range(count):
        if math.sqrt(2 * costs[i]) < least + AGREEMENT:
            agreeing += 1
    return agreeing >= AGREEING_STARTS


@lean_alone
def _motion(setting: Setting, q: Array) -> float:
    """Return |diag(d) (q - q0)|^2."""
    total = 0.0
    for i in range(setting.joints.size):
        shift = q[setting.joints[i]] - setting.reference[setting.joints[i]]
        total += setting.scale[i] * shift * shift
    return total


@lean_alone
def _keep(room: Room, answer: Array, n: int, t: int) -> None:
    for i in range(n):
        answer[i] = room.given[i]
    for i in range(t):
        answer[n + i] = room.result[i]


@lean_alone
def _search(setting: Setting, wishes: Wishes, room: Room, max_iterations: int, answer: Array) -> bool:
    """Descend from the start in `given` and, until a good find, from further starts."""
    n, t, tolerance = setting.reference.size, setting.tolerance.size, setting.tolerance
    evaluate(setting, room.given, room.result)
    best_met = fraction_of_tolerance(room.result, tolerance) <= 1.0
    best_held = best_met and _held(setting, wishes, room.given)
    best_value = 0.0 if best_met else room.result[t]
    _keep(room, answer, n, t)
    iterations, first_met, used, tries, agreed, near = 0, 0, 0, 0, False, False
    for used in range(wishes.points.shape[0] + 1):
        if first_met > 0 and used - first_met < len(STRAIGHTENED):
            _straighten(setting, wishes, room, STRAIGHTENED[used - first_met], answer)
        elif used > 0:
            _start(setting, wishes, room, used - 1, 0 if agreed else -1)
        steps_left = max_iterations
        for turn in range(REFLECTIONS + 1):
            if turn > 0 and agreed:
                _start(setting, wishes, room, used - 1, turn)
            elif turn > 0:
                reflect(setting, room.given)
            steps = descend(setting, room, steps_left, SEARCH_GAIN, CAUTIOUS_STEPS)
            iterations, steps_left = iterations + steps, steps_left - steps
            met = fraction_of_tolerance(room.result, tolerance) <= 1.0
            held = met and _held(setting, wishes, room.given)
            value = _motion(setting, room.given) if met else room.result[t]
            wishes.costs[tries] = room.result[t]
            tries += 1
            better = met and not best_met
            if met == best_met:
                better = (held and not best_held) or (held == best_held and value < best_value)
            if better:
                best_met, best_held, best_value = met, held, value
                _keep(room, answer, n, t)
            near = not best_met and best_value < 0.5 * NEAR_MISS**2
            enough = (DESCENTS_NEAR_A_JOINT if near else DESCENTS_A_JOINT) * setting.joints.size
            agreed = _agree(wishes.costs, tries, enough)
            if met or steps_left <= 0 or (agreed and not near):
                break
        if best_met and first_met == 0:
            first_met = used + 1
        tried_for_torque = first_met > 0 and used + 1 - first_met >= STARTS_FOR_TORQUE
        if (best_met and best_held) or tried_for_torque or (agreed and not near):
            break
    if not (best_met and setting.stop_when_met):
        for i in range(n):
            room.given[i] = answer[i]
        iterations += descend(setting, room, max_iterations, SMALL_GAIN, 0)
        best_met = fraction_of_tolerance(room.result, tolerance) <= 1.0
        _keep(room, answer, n, t)
    answer[n + t + ITERATIONS] += iterations
    answer[n + t + RESTARTS] += used
    return best_met


@njit(cache=True, nogil=True, error_model="numpy")
def _met_without_limits(
    setting: Setting, wishes: Wishes, room: Room, moves: Array, max_iterations: int, answer: Array
) -> bool:
    """Whether the same joints meet the tasks once their limits are taken away."""
    low = np.where(moves > 0, -math.inf, setting.low)
    high = np.where(moves > 0, math.inf, setting.high)
    free = Setting(
        setting.address, setting.work, setting.joints, low, high, setting.scale, setting.reference,
        setting.tolerance, setting.stop_when_met,
    )  # fmt: skip
    n = setting.reference.size
    for number in range(STARTS_WITHOUT_LIMITS + 2):
        if number == 0:
            room.given[:n] = answer[:n]
        elif number == 1:
            room.given[:n] = setting.reference
        elif number - 2 < wishes.points.shape[0]:
            _start(free, wishes, room, number - 2, -1)
        else:
            break
        descend(free, room, min(STEPS_WITHOUT_LIMITS, max_iterations), SMALL_GAIN, 0)
        if fraction_of_tolerance(room.result, setting.tolerance) <= 1.0:
            return True
    return False


@njit(
    "void(int64[::1], int64[::1], float64[:, ::1], float64[::1], float64[::1], float64[:, :, ::1], int64, "
    "float64[:, ::1], float64[:, ::1], int64, int64)",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def solve_rows(
    numbers: np.ndarray,
    index: np.ndarray,
    bounds: Array,
    effort: Array,
    tolerance: Array,
    points: Array,
    max_iterations: int,
    given: Array,
    answers: Array,
    begin: int,
    end: int,
) -> None:
    """Solve for each row of `given` from `begin` to `end`.

    Args:
        numbers: Addresses of the task's and gravity's kernels, room for their work, whether to stop once met.
        index: Places of the joints that the tasks' kernel knows, shape (k,).
        bounds: Lower and upper bounds, d^2, whether the joint carries much, whether it moves, shape (5, k).
        effort: 1 / effort limit, 0 where there is none, shape (n,).
        tolerance: Squared tolerances, shape (t,).
        points: Of the restarts, in the unit cube, shape (restarts, candidates, k).
        max_iterations: Steps from each start.
        given: q0, weights and targets, shape (N, ...).
        answers: q, squared errors, and EXTRA numbers, shape (N, n + t + EXTRA), written.
        begin: First row.
        end: One after the last row.
    """
    k, t, n = index.size, tolerance.size, effort.size
    setting = Setting(
        numbers[TASKS_ADDRESS], np.empty(numbers[WORK_SIZE]), index, bounds[ROW_LOW].copy(),
        bounds[ROW_HIGH].copy(), bounds[ROW_SCALE].copy(), np.empty(n), tolerance, numbers[STOP_WHEN_MET] > 0,
    )  # fmt: skip
    wishes = Wishes(
        numbers[GRAVITY_ADDRESS],
        effort,
        np.empty(n),
        bounds[ROW_HEAVY],
        points,
        np.empty((points.shape[0] + 1) * (REFLECTIONS + 1)),
    )
    room = make_room(given[begin], k, t)
    for i in range(begin, end):
        answer = answers[i]
        answer[n + t :] = 0.0
        setting.reference[:] = given[i, :n]
        room.given[:] = given[i]
        room.trial[:] = given[i]
        for j in range(k):
            if bounds[ROW_MOVES, j] == 0:
                setting.low[j] = setting.high[j] = given[i, index[j]]
        if not _search(setting, wishes, room, max_iterations, answer):
            met = _met_without_limits(setting, wishes, room, bounds[ROW_MOVES], max_iterations, answer)
            answer[n + t + STATUS] = LIMITS if met else UNREACHABLE


@njit(
    "int64(int64[::1], int64[::1], float64[:, ::1], float64[::1], int64, float64[::1], float64[::1])",
    cache=True,
    nogil=True,
    error_model="numpy",
)
def descend_row(
    numbers: np.ndarray,
    index: np.ndarray,
    bounds: Array,
    tolerance: Array,
    max_iterations: int,
    given: Array,
    reference: Array,
) -> int:
    """Descend from the start in a row of input, which becomes the result; returns the steps proposed."""
    setting = Setting(
        numbers[TASKS_ADDRESS], np.empty(numbers[WORK_SIZE]), index, bounds[ROW_LOW].copy(),
        bounds[ROW_HIGH].copy(), bounds[ROW_SCALE].copy(), reference, tolerance, numbers[STOP_WHEN_MET] > 0,
    )  # fmt: skip
    room = make_room(given, index.size, tolerance.size)
    iterations = descend(setting, room, max_iterations, SMALL_GAIN, CAUTIOUS_STEPS)
    given[:] = room.given
    return iterations


_compilation.end(compiled=bool(descend_row.stats.cache_misses))
