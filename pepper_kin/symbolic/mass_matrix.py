"""The joint-space mass matrix and its inverse."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.composite import coupled_entries, mass_entries, symmetric_rows
from pepper_kin.symbolic.factorization import factorize
from pepper_kin.symbolic.functions import make_function
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.states import make_state, new_inputs
from pepper_kin.symbolic.tree import read_tree

if TYPE_CHECKING:
    import casadi


@remembered
def mass_matrix(pepper: PepperModel) -> casadi.Function:
    """Return the function q -> M(q), symmetric and positive definite.

    Composite-rigid-body algorithm (Walker and Orin, 1982) on base parameters.  Joints that do not carry one
    another have structural zeros.

    Args:
        pepper: The robot.

    Returns:
        Function of q (n); output `mass` (n, n) [kg m^2, kg m or kg].
    """
    tree = read_tree(pepper, compact=True)
    graph, inputs = new_inputs(tree, "q")
    state = make_state(tree, inputs["q"])
    entries = coupled_entries(state, mass_entries(state))
    return make_function("mass_matrix", graph, inputs, {"mass": symmetric_rows(entries, pepper.n)})


@remembered
def inverse_mass_matrix(pepper: PepperModel) -> casadi.Function:
    """Return the function q -> M(q)^-1, by M = L^T D L with the zeros of the tree.

    Args:
        pepper: The robot.

    Returns:
        Function of q (n); output `inverse_mass` (n, n).

    Raises:
        ModelError: naming joints that move no mass.
    """
    tree = read_tree(pepper, compact=True)
    graph, inputs = new_inputs(tree, "q")
    state = make_state(tree, inputs["q"])
    entries = coupled_entries(state, mass_entries(state))
    inverse = factorize(entries, pepper.joint_names).inverse_entries()
    rows = symmetric_rows(inverse, pepper.n)
    return make_function("inverse_mass_matrix", graph, inputs, {"inverse_mass": rows})
