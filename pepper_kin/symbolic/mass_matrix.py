"""Joint-space mass matrix and its inverse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.composite import coupled_entries, mass_entries, symmetric_rows
from pepper_kin.symbolic.factorization import factorize
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.states import new_state

if TYPE_CHECKING:
    import casadi


@remembered
def mass_matrix(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function q -> M(q), symmetric and positive definite.

    Composite-rigid-body algorithm (Walker and Orin, 1982) on base parameters.  Entries of two joints of which
    neither carries the other are structural zeros.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q (n); output `mass` (n, n) [kg m^2, kg m or kg].
    """
    state, symbols = new_state(pepper, "q")
    entries = coupled_entries(state, mass_entries(state))
    return symbols.function("mass_matrix", mass=symmetric_rows(entries, pepper.n))


@remembered
def inverse_mass_matrix(
    pepper: PepperModel, *, payload: Mapping[str, float] | None = None
) -> casadi.Function:
    """Return the function q -> M(q)^-1, by M = L^T D L with the zeros of the tree.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q (n); output `inverse_mass` (n, n).

    Raises:
        ModelError: naming joints that move no mass.
    """
    state, symbols = new_state(pepper, "q")
    entries = coupled_entries(state, mass_entries(state))
    inverse = factorize(entries, pepper.joint_names).inverse_entries()
    rows = symmetric_rows(inverse, pepper.n)
    return symbols.function("inverse_mass_matrix", inverse_mass=rows)
