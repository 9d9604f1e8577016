"""Derivatives of forward dynamics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.composite import coupled_entries, mass_entries, symmetric_rows
from pepper_kin.symbolic.factorization import Factors, factorize
from pepper_kin.symbolic.inverse_dynamics import full_torques
from pepper_kin.symbolic.inverse_dynamics_derivatives import coupled_rows
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.scalars import Value
from pepper_kin.symbolic.states import gather, make_state, new_state
from pepper_kin.symbolic.torque_derivatives import torque_derivatives

if TYPE_CHECKING:
    import casadi


@remembered
def forward_dynamics_derivatives(
    pepper: PepperModel, *, payload: Mapping[str, float] | None = None
) -> casadi.Function:
    """Return the function (q, v, tau) -> derivatives of a = M(q)^-1 (tau - C(q, v) v - g(q)).

    da/dq = -M^-1 dtau/dq and da/dv = -M^-1 dtau/dv, where the derivatives of inverse dynamics are taken at
    the acceleration a (Carpentier and Mansard, 2018); da/dtau = M^-1.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q, v, tau (n each); outputs `da_dq`, `da_dv`, `da_dtau` (n, n).

    Raises:
        ModelError: naming joints that move no mass.
    """
    state, symbols = new_state(pepper, "q", "v", "tau")
    bias = gather(state.tree.full_map, full_torques(state))
    factors = factorize(coupled_entries(state, mass_entries(state)), pepper.joint_names)
    a = factors.solve([tau - b for tau, b in zip(symbols.inputs["tau"], bias, strict=True)])
    derivatives = torque_derivatives(make_state(state.tree, symbols.inputs["q"], symbols.inputs["v"], a))
    outputs = {
        "da_dq": _solved(factors, coupled_rows(state.tree.full_map, derivatives.wrt_q)),
        "da_dv": _solved(factors, coupled_rows(state.tree.full_map, derivatives.wrt_v)),
        "da_dtau": symmetric_rows(factors.inverse_entries(), pepper.n),
    }
    return symbols.function("forward_dynamics_derivatives", **outputs)


def _solved(factors: Factors, rows: list[list[Value]]) -> list[list[Value]]:
    """Return -M^-1 A."""
    columns = [factors.solve([-row[j] for row in rows]) for j in range(len(rows))]
    return [[column[i] for column in columns] for i in range(len(rows))]
