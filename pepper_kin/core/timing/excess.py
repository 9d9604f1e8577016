"""Violations of torque and edge moment limits by a motion, and the joints whose accelerations cause them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.core.kernel_batch import evaluate_batch
from pepper_kin.core.splines import evaluate_at_times, evaluate_on_segments
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2, Ints1

ROUNDING = 1e-9
"""Tolerance relative to a torque limit."""

BLAMED, FEWEST = 0.5, 0.4
"""Ratio of a contribution to the maximum one from which on a joint is slowed down, and minimum ratio of its
acceleration that is left."""

TORQUE, MOMENT = 1, 2
"""Kinds of violation; their sum if both are violated."""


class EffectKernel(NamedTuple):
    """Kernel of torques and of the floor's wrench, and their limits.

    Attributes:
        address: Address of the `batch` of a kernel from q, v and a to torques and, if there are edges, the
            wrench of the floor.
        work: Workspace of the kernel, shape (>= work_size,).
        words: Workspace, shape (8,).
        torque_limit: Torque limits of the joints, or none, shape (n or 0,) [N m or N].
        moment_of_wrench: Matrix that maps a wrench to the moments about e edges, shape (6, e).
    """

    address: int
    work: Floats1
    words: Ints1
    torque_limit: Floats1
    moment_of_wrench: Floats2


@compiled
def _write_excess(kernel: EffectKernel, states: Array, excess: Array) -> int:
    """Write the violations of limits; return TORQUE, MOMENT, their sum, or 0.

    Args:
        kernel: Kernel of torques and wrenches.
        states: q, v and a, shape (3, T, n).
        excess: Output: violations of torque and edge moment limits, negative inside, shape (T, k + e).
    """
    torques, edges, n, found = kernel.torque_limit.size, kernel.moment_of_wrench.shape[1], states.shape[2], 0
    effects = np.empty((states.shape[1], n + 6 if edges > 0 else n))
    evaluate_batch(kernel.address, states[0], states[1], states[2], effects, kernel.work, kernel.words)
    for t in range(effects.shape[0]):
        for k in range(torques):
            excess[t, k] = abs(effects[t, k]) - kernel.torque_limit[k] * (1.0 + ROUNDING)
            if excess[t, k] > 0.0:
                found |= TORQUE
        for k in range(edges):
            moment = 0.0
            for i in range(6):
                moment += effects[t, n + i] * kernel.moment_of_wrench[i, k]
            excess[t, torques + k] = -moment
            if moment < 0.0:
                found |= MOMENT
    return found


@compiled
def _blame(kernel: EffectKernel, states: Array, excess: Array, used: Array) -> None:
    """Write the accelerations with which the limits would just be kept; see `find_excess`.

    Args:
        kernel: Kernel of torques and wrenches.
        states: q, v and a, shape (3, T, n).
        excess: Violations at these states, see `_write_excess`, shape (T, k + e).
        used: Output, shape (n,).
    """
    n = used.size
    without, left, gain = np.empty((3, n, n)), np.empty((n, excess.shape[1])), np.empty(n)
    for column in range(excess.shape[1]):
        worst = 0
        for t in range(excess.shape[0]):
            if excess[t, column] > excess[worst, column]:
                worst = t
        over = excess[worst, column]
        if over <= 0.0:
            continue
        for j in range(n):
            for i in range(3):
                without[i, j] = states[i, worst]
            without[2, j, j] = 0.0
        _write_excess(kernel, without, left)
        most, total = ROUNDING, 0.0
        for j in range(n):
            gain[j] = over - left[j, column]
            most = max(most, gain[j])
        for j in range(n):
            if gain[j] > BLAMED * most:
                total += gain[j]
        enough = min(max(1.0 - over / max(total, ROUNDING), FEWEST), 1.0)
        for j in range(n):
            if gain[j] > BLAMED * most:
                used[j] = min(used[j], enough * abs(states[2, worst, j]))


@compiled("int64(EffectKernel, float64[::1], float64[:, :, ::1], float64[::1], float64[::1])")
def find_excess(kernel: EffectKernel, breaks: Array, coefficients: Array, times: Array, used: Array) -> int:
    """Find the violations of a motion next to its knots or, if there are none, at given times.

    A joint's contribution to a torque or edge moment, where its violation is greatest, is the decrease
    without the joint's acceleration.

    Args:
        kernel: Kernel of torques and wrenches.
        breaks: Ends of the segments, shape (m + 1,) [s].
        coefficients: Constant term first, shape (m, k, n).
        times: Ascending times, shape (T,) [s].
        used: Output: for each joint that contributes at least half as much as any other, the size of its
            acceleration with which the limit would just be kept if all these joints were reduced by the same
            ratio, at least 0.4 of the present one; inf for other joints, shape (n,) [rad/s^2 or m/s^2].

    Returns:
        TORQUE, MOMENT, their sum, or 0.
    """
    segments, n = coefficients.shape[0], coefficients.shape[2]
    columns = kernel.torque_limit.size + kernel.moment_of_wrench.shape[1]
    used[:] = np.inf
    index, local = np.empty(2 * segments, dtype=np.int64), np.zeros(2 * segments)
    for i in range(segments):
        index[i] = index[segments + i] = i
        local[segments + i] = breaks[i + 1] - breaks[i]
    for turn in range(2):
        count = 2 * segments if turn == 0 else times.size
        states, excess = np.empty((3, count, n)), np.empty((count, columns))
        if turn == 0:
            evaluate_on_segments(coefficients, index, local, states)
        else:
            evaluate_at_times(breaks, coefficients, times, states)
        found = _write_excess(kernel, states, excess)
        if found:
            _blame(kernel, states, excess, used)
            return found
    return 0
