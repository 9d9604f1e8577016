"""Damped steps down to the nearest minimum, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pepper_kin.ik.descent import SMALL_GAIN, SMALL_STEP
from pepper_kin.ik.fast.box import FREE, HIGH, LOW, solve_box, solve_free
from pepper_kin.ik.fast.lean import lean, lean_alone
from pepper_kin.ik.problem import CLOSE, POSTURE_WEIGHT
from pepper_kin.ik.solvers.step_solver import STEP_BOUND
from pepper_kin.ik.tasks.task import Array
from pepper_kin.kernels.native import call_kernel

FIRST_DAMPING = 1e-3
LEAST_DAMPING = 1e-9
MOST_DAMPING = 1e4
RAISE = 4.0
LOWER = 5.0

# In its first steps a descent goes only this part of the way to a bound: it then finds round many a local
# minimum on the bounds that it would be caught in.
CAUTION = 0.4
CAUTIOUS_STEPS = 10

# A descent that a local minimum has caught is put back through the middle of the joint ranges, this much of
# the distance to the middle beyond it.  Such minima lie on the bounds, and what they hide lies in the other
# half of the range: nine in ten descents from there succeed.
REFLECTION = 0.3
REFLECTIONS = 2

_CLOSE = CLOSE**2

# The posture only decides where the tasks leave freedom; as weak as this it costs no step near the goal.
_POSTURE = (0.1 * POSTURE_WEIGHT) ** 2


class Setting(NamedTuple):
    """One problem, as compiled code sees it.

    Attributes:
        address: Address of the kernel of `task_function`.
        work: The kernel's room.
        joints: Places of the joints that the kernel differentiates by, shape (k,).
        low: Their lower bounds, shape (k,).
        high: Their upper bounds, shape (k,).
        scale: d_i^2, shape (k,).
        reference: q_ref of the posture term, shape (n,).
        tolerance: Squared tolerances of the tasks, shape (t,).
        stop_when_met: Whether nothing is left to gain once all tasks are well met.
    """

    address: int
    work: Array
    joints: np.ndarray
    low: Array
    high: Array
    scale: Array
    reference: Array
    tolerance: Array
    stop_when_met: bool


class Room(NamedTuple):
    """Arrays that descents write to; k joints, t tasks.

    Attributes:
        given: The kernel's input at q: q, weights and targets.
        trial: The same at the configuration to try.
        result: The kernel's output at q.
        other: The same at the configuration to try.
        matrix: Shape (k, k).
        factor: Shape (k, k + 1).
        gradient: Shape (k,).
        step: Shape (k,).
        least: Lower bounds of the step, shape (k,).
        most: Upper bounds of the step, shape (k,).
        state: Active bounds, shape (k,).
    """

    given: Array
    trial: Array
    result: Array
    other: Array
    matrix: Array
    factor: Array
    gradient: Array
    step: Array
    least: Array
    most: Array
    state: np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def make_room(row: Array, k: int, t: int) -> Room:
    """Return room for a row of input, k joints and t tasks."""
    outputs = t + 1 + k + k * (k + 1) // 2
    return Room(
        row.copy(),
        row.copy(),
        np.empty(outputs),
        np.empty(outputs),
        np.empty((k, k)),
        np.empty((k, k + 1)),
        np.empty(k),
        np.empty(k),
        np.empty(k),
        np.empty(k),
        np.empty(k, np.int64),
    )


@lean
def fraction_of_tolerance(result: Array, tolerance: Array) -> float:
    """Return the largest of error^2 / tolerance^2."""
    worst = 0.0
    for i in range(tolerance.size):
        worst = max(worst, result[i] / tolerance[i])
    return worst


@lean_alone
def descend(setting: Setting, room: Room, max_iterations: int, small_gain: float, cautious_steps: int) -> int:
    """Search from a start by Levenberg-Marquardt steps within the bounds; see `pepper_kin.ik.descent`.

    Args:
        setting: The problem.
        room: `given` holds the start, and afterwards the result; `result` the kernel's output there.
        max_iterations: Number of steps proposed at most.
        small_gain: A step that gains less than this part of the cost is the last; where it is more than
            SMALL_GAIN, the minimum is not looked for to its very end.
        cautious_steps: How many steps keep away from the bounds.

    Returns:
        Number of steps proposed.
    """
    given, trial, result, other, index = room.given, room.trial, room.result, room.other, setting.joints
    t, to_the_end = setting.tolerance.size, small_gain <= SMALL_GAIN
    evaluate(setting, given, result)
    cost = result[t] + _posture_cost(setting, given)
    damping, backed, cautious, iterations = FIRST_DAMPING, False, cautious_steps > 0, 0
    while iterations < max_iterations and damping < MOST_DAMPING:
        if setting.stop_when_met and fraction_of_tolerance(result, setting.tolerance) <= _CLOSE:
            break
        iterations += 1
        cautious = cautious and iterations <= cautious_steps
        _linearise(setting, room, damping, cautious)
        if not _propose(setting, room, cautious):
            damping *= 10
            continue
        size = 0.0
        for i in range(index.size):
            size = max(size, abs(trial[index[i]] - given[index[i]]))
        evaluate(setting, trial, other)
        new_cost = other[t] + _posture_cost(setting, trial)
        gain = cost - new_cost
        if gain > 0:
            for i in range(index.size):
                given[index[i]] = trial[index[i]]
            for i in range(result.size):
                result[i] = other[i]
            cost = new_cost
            damping, backed = (damping if backed else max(damping / LOWER, LEAST_DAMPING)), False
        elif size >= SMALL_STEP:
            damping, backed = max(RAISE * damping, FIRST_DAMPING), True
            continue
        if size < SMALL_STEP or gain < small_gain * cost:
            if not (cautious and to_the_end):
                break
            cautious = False
    return iterations


@lean_alone
def reflect(setting: Setting, given: Array) -> None:
    """Put each joint from q to c - REFLECTION (q - c), c the middle of its range; see `REFLECTION`.

    A joint without bounds stays where it is.
    """
    for i in range(setting.joints.size):
        middle = 0.5 * (setting.low[i] + setting.high[i])
        if abs(middle) < np.inf:
            given[setting.joints[i]] = middle - REFLECTION * (given[setting.joints[i]] - middle)


@lean
def evaluate(setting: Setting, given: Array, result: Array) -> None:
    """Call the kernel."""
    call_kernel(setting.address, given.ctypes.data, result.ctypes.data, setting.work.ctypes.data)


@lean
def _linearise(setting: Setting, room: Room, damping: float, cautious: bool) -> None:
    """Write the step's quadratic programme: H + lambda diag(d)^2 + eps^2, g, and the bounds of the step.

    A cautious step has a term |g_i| / (distance to the bound that joint i moves towards) on the diagonal
    (Coleman and Li, An interior trust region approach for nonlinear minimization subject to bounds, 1996).
    """
    index, low, high = setting.joints, setting.low, setting.high
    matrix, gradient, least, most = room.matrix, room.gradient, room.least, room.most
    k = index.size
    part = CAUTION if cautious else 1.0
    start = setting.tolerance.size + 1
    place = start + k
    for i in range(k):
        q = room.given[index[i]]
        slope = room.result[start + i] + _POSTURE * (q - setting.reference[index[i]])
        for j in range(i, k):
            matrix[i, j] = room.result[place]
            place += 1
        matrix[i, i] += _POSTURE + damping * setting.scale[i]
        if cautious and low[i] < high[i]:
            matrix[i, i] += slope / max(q - low[i], 1e-9) if slope > 0 else -slope / max(high[i] - q, 1e-9)
        least[i] = max(part * (low[i] - q), -STEP_BOUND)
        most[i] = min(part * (high[i] - q), STEP_BOUND)
        gradient[i] = slope
        room.state[i] = FREE
        if cautious:
            room.state[i] = FREE if low[i] < high[i] else LOW
        elif least[i] > -1e-12 and slope > 0:
            room.state[i] = LOW
        elif most[i] < 1e-12 and slope < 0:
            room.state[i] = HIGH


@lean
def _propose(setting: Setting, room: Room, cautious: bool) -> bool:
    """Write the configuration to try; the result tells whether there is one."""
    matrix, gradient, step, least, most = room.matrix, room.gradient, room.step, room.least, room.most
    if cautious:
        good = solve_free(matrix, gradient, least, most, step, room.state, room.factor)
    else:
        good = solve_box(matrix, gradient, least, most, step, room.state, room.factor)
    for i in range(step.size):
        q = room.given[setting.joints[i]] + min(max(step[i], least[i]), most[i])
        room.trial[setting.joints[i]] = min(max(q, setting.low[i]), setting.high[i])
    return good


@lean
def _posture_cost(setting: Setting, given: Array) -> float:
    total = 0.0
    for i in range(setting.joints.size):
        shift = given[setting.joints[i]] - setting.reference[setting.joints[i]]
        total += shift * shift
    return 0.5 * _POSTURE * total
