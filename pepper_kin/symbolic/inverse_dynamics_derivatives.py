"""Derivatives of inverse dynamics, and the Coriolis matrix, half of the derivative by velocities."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.composite import coupled_entries, symmetric_rows
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.scalars import Value
from pepper_kin.symbolic.states import new_state
from pepper_kin.symbolic.torque_derivatives import Entries, torque_derivatives

if TYPE_CHECKING:
    import casadi


@remembered
def inverse_dynamics_derivatives(
    pepper: PepperModel, *, payload: Mapping[str, float] | None = None
) -> casadi.Function:
    """Return the function (q, v, a) -> derivatives of tau = M(q) a + C(q, v) v + g(q).

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q, v, a (n each); outputs `dtau_dq`, `dtau_dv` and `dtau_da` = M(q), (n, n) each.
    """
    state, symbols = new_state(pepper, "q", "v", "a")
    derivatives = torque_derivatives(state)
    outputs = {
        "dtau_dq": coupled_rows(state.tree.full_map, derivatives.wrt_q),
        "dtau_dv": coupled_rows(state.tree.full_map, derivatives.wrt_v),
        "dtau_da": symmetric_rows(coupled_entries(state, derivatives.mass), pepper.n),
    }
    return symbols.function("inverse_dynamics_derivatives", **outputs)


@remembered
def coriolis_matrix(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function (q, v) -> C(q, v) of tau = M a + C v + g, by Christoffel symbols.

    C_ij = sum_k (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) v_k / 2.  Christoffel symbols are symmetric in j and
    k, so that d(C v)/dv = 2 C: the matrix is half of the derivative of the torques by the velocities.  With
    this C, dM/dt - 2 C is skew-symmetric.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q, v (n each); output `coriolis` (n, n).
    """
    state, symbols = new_state(pepper, "q", "v")
    derivatives = torque_derivatives(state)
    rows = [[0.5 * x for x in row] for row in coupled_rows(state.tree.full_map, derivatives.wrt_v)]
    return symbols.function("coriolis_matrix", coriolis=rows)


def coupled_rows(full_map: Array, entries: Entries) -> list[list[Value]]:
    """Return E^T A E as n rows of n expressions.

    Args:
        full_map: E, from the robot's n coordinates to the N joints' coordinates, shape (N, n).
        entries: A by row and column; entries that are left out are zero.
    """
    gains = [[(k, gain) for k, gain in enumerate(row) if gain] for row in full_map.tolist()]
    n = full_map.shape[1]
    rows: list[list[Value]] = [[0.0] * n for _ in range(n)]
    for (i, j), value in entries.items():
        for a, gain_a in gains[i]:
            for b, gain_b in gains[j]:
                rows[a][b] = rows[a][b] + (gain_a * gain_b) * value
    return rows
