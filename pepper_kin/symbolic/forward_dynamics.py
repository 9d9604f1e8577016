"""Forward dynamics: accelerations from torques."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.composite import coupled_entries, mass_entries
from pepper_kin.symbolic.factorization import factorize
from pepper_kin.symbolic.inverse_dynamics import full_torques
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.states import gather, new_state

if TYPE_CHECKING:
    import casadi


@remembered
def forward_dynamics(
    pepper: PepperModel, contact_frame: str | None = None, *, payload: Mapping[str, float] | None = None
) -> casadi.Function:
    """Return the function (q, v, tau) -> a = M(q)^-1 (tau - C(q, v) v - g(q)).

    Composite-rigid-body algorithm and recursive Newton-Euler on base parameters, then M = L^T D L with the
    zeros of the tree: for robots of this size fewer operations than the articulated-body algorithm.

    Args:
        pepper: The robot.
        contact_frame: Frame on which an external force acts; the function then has a fourth input `wrench`
            (6) [N, N m], as in `inverse_dynamics`.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q, v, tau (n each); output `a` (n) [rad/s^2 or m/s^2].

    Raises:
        UnknownNameError: for a frame that the robot lacks.
        ModelError: naming joints that move no mass.
    """
    state, symbols = new_state(pepper, "q", "v", "tau", wrench=contact_frame is not None)
    bias = gather(state.tree.full_map, full_torques(state, contact_frame, symbols.inputs.get("wrench")))
    factors = factorize(coupled_entries(state, mass_entries(state)), pepper.joint_names)
    a = factors.solve([tau - b for tau, b in zip(symbols.inputs["tau"], bias, strict=True)])
    return symbols.function("forward_dynamics", a=[[value] for value in a])
