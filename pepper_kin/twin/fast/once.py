"""One step of one robot in arrays that are kept, and the linear equation that it solves, compiled.

The arrays are those of `settle.Room` for W = 1; what the step is told is already in `given`.  Numba renews
the machine code of this file when it changes, but not when only `law.py` or `settle.py` do: see `loop.py`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pepper_kin.twin.fast.law import ROTOR
from pepper_kin.twin.fast.native import call_kernel
from pepper_kin.twin.fast.settle import (
    BIAS,
    INTERCEPT,
    LOAD,
    MASS,
    NEXT_V,
    SLOPE,
    TORQUE,
    Room,
    V,
    first_pieces,
    settle,
)
from pepper_kin.twin.integrator import RUNAWAY

Array = np.ndarray


@njit(cache=True, nogil=True, error_model="numpy")
def step_once(
    h: float,
    addresses: np.ndarray,
    law: Array,
    given: Array,
    result: Array,
    work: Array,
    ask: Array,
    answer: Array,
    rows: Array,
    flags: np.ndarray,
    places: np.ndarray,
    mass_hat: Array,
    force: Array,
) -> bool:
    """Take a step, and write mass_hat a = force where there is room for it; see `Integrator.linearised`.

    Args:
        h: Timestep [s].
        addresses: Of the kernels of a step and of a solution.
        law: Parameters of the joints, shape (rows, n).
        given: Input of the step kernel.
        result: Its output, and where the step goes.
        work: Work of the kernels; this and the next as in `Room`.
        ask: Input of the kernel that solves.
        answer: Its output, shape (n,).
        rows: Pieces of the law, shape (5, n).
        flags: Shape (2, 1).
        places: Row and column of each entry of the mass matrix, shape (2, p).
        mass_hat: Written, shape (n, n); or (0, 0), and there is no equation.
        force: Written, shape (n,).

    Returns:
        Whether the state is sound.
    """
    room = Room(given, result, work, ask, answer, rows, flags, places)
    call_kernel(addresses[0], given.ctypes.data, result.ctypes.data, work.ctypes.data)
    calm = result[result.size - 1] <= 0.0  # what is strange; False for NaN
    if not calm:
        settle(h, addresses[1], 1, law, room)
    if mass_hat.size > 0:
        if calm:
            first_pieces(h, law, room)
        _equation(h, law, room, mass_hat, force)
    good = True
    if not calm:
        for e in range(answer.size):
            w, torque = result[NEXT_V * answer.size + e], result[TORQUE * answer.size + e]
            if not (abs(w) < RUNAWAY and abs(torque) < np.inf):
                good = False
    return good


@njit(cache=True, nogil=True, error_model="numpy")
def _equation(h: float, law: Array, room: Room, mass_hat: Array, force: Array) -> None:
    """Write M + J + h diag(k) and c - k v - b + load on the pieces that the step was solved on."""
    n = room.answer.size
    for i in range(n):
        for j in range(n):
            mass_hat[i, j] = 0.0
    for p in range(room.places.shape[1]):
        i, j = room.places[0, p], room.places[1, p]
        mass_hat[i, j] = mass_hat[j, i] = room.result[MASS * n + p]
    for e in range(n):
        slope = room.rows[SLOPE, e]
        mass_hat[e, e] += law[ROTOR, e] + h * slope
        pull = room.rows[INTERCEPT, e] - slope * room.given[V * n + e] - room.result[BIAS * n + e]
        force[e] = pull + room.given[LOAD * n + e]
