"""Center of mass of the whole robot and its Jacobian."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pepper_kin.exceptions import ModelError
from pepper_kin.model import PepperModel
from pepper_kin.symbolic.composite import first_moments
from pepper_kin.symbolic.jacobians import Columns, reduced_rows
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.poses import world_poses
from pepper_kin.symbolic.states import StateExpressions, new_state
from pepper_kin.symbolic.tree import Tree
from pepper_kin.symbolic.vectors import Vector, add, scale, times, z_cross

if TYPE_CHECKING:
    import casadi


@remembered
def center_of_mass(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function q -> center of mass of all links, including links fixed to the floor.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q (n); output `center` (3) in world coordinates [m].
    """
    state, symbols = new_state(pepper, "q")
    return symbols.function("center_of_mass", center=[[x] for x in center_of_all(state)])


@remembered
def center_of_mass_jacobian(
    pepper: PepperModel, *, payload: Mapping[str, float] | None = None
) -> casadi.Function:
    """Return the function q -> J_c(q): velocity of the center of mass of all links = J_c v.

    Column i is z_i x h_i / m, or z_i m_i / m for a prismatic joint: h_i and m_i are the first moment, about a
    point on the axis, and the mass of the composite body that joint i carries.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q (n); output `jacobian` (3, n) in world axes [m/rad or m/m].
    """
    state, symbols = new_state(pepper, "q")
    moments, masses, _ = first_moments(state)
    columns: Columns = []
    tree = state.tree
    for body, (rotation, _), h, m in zip(tree.bodies, world_poses(state), moments, masses, strict=True):
        local = (0.0, 0.0, m) if body.slides else z_cross(h)
        columns.append(tuple(times(rotation, scale(1.0 / total_mass(tree), local))))
    rows = reduced_rows(tree.full_map, columns)
    return symbols.function("center_of_mass_jacobian", jacobian=rows)


def total_mass(tree: Tree) -> float:
    """Return the mass of all links [kg].

    Raises:
        ModelError: for a robot without mass, which has no center of mass.
    """
    mass = float(tree.moving_mass + tree.still.mass)
    if not mass > 0.0:
        raise ModelError("no link has mass, so the robot has no center of mass")
    return mass


def center_of_all(state: StateExpressions) -> Vector:
    """Return the center of mass of all links in the world [m]."""
    moment = add(first_moments(state)[2], state.tree.still.first)
    return scale(1.0 / total_mass(state.tree), moment)
