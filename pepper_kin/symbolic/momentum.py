"""Momentum about the center of mass."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.center_of_mass import center_of_all, total_mass
from pepper_kin.symbolic.composite import composite_inertias, unit_wrench
from pepper_kin.symbolic.jacobians import Columns, reduced_rows
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.motion import collect
from pepper_kin.symbolic.poses import world_poses
from pepper_kin.symbolic.states import StateExpressions, new_state
from pepper_kin.symbolic.vectors import (
    ZERO,
    Vector,
    add,
    add_matrices,
    cross,
    outer,
    scale,
    subtract,
    times,
    trace,
)

if TYPE_CHECKING:
    import casadi


@remembered
def centroidal_momentum(
    pepper: PepperModel, *, payload: Mapping[str, float] | None = None
) -> casadi.Function:
    """Return the function (q, v) -> momentum of the robot about the center of mass of all its links.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q, v (n each); output `momentum` (6): linear [kg m/s], then angular [kg m^2/s], in world
        axes.
    """
    state, symbols = new_state(pepper, "q", "v")
    momenta = []
    for (omega, velocity), body in zip(velocities(state), state.tree.bodies, strict=True):
        h, second = body.inertia.first, body.inertia.second
        linear = add(scale(body.inertia.mass, velocity), cross(omega, h))
        spin = subtract(scale(trace(second), omega), times(second, omega))
        momenta.append((linear, add(cross(h, velocity), spin)))
    _, (linear, angular) = collect(state, momenta)
    about_center = subtract(angular, cross(center_of_all(state), linear))
    rows = [[x] for x in (*linear, *about_center)]
    return symbols.function("centroidal_momentum", momentum=rows)


@remembered
def centroidal_map(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function q -> A(q) with centroidal momentum = A(q) v (Orin and Goswami, 2008).

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q (n); output `map` (6, n), linear rows first, in world axes.
    """
    state, symbols = new_state(pepper, "q")
    inertias, _ = composite_inertias(state)
    tree, center = state.tree, center_of_all(state)
    columns: Columns = []
    for body, (rotation, origin), inertia in zip(tree.bodies, world_poses(state), inertias, strict=True):
        force, torque = (times(rotation, u) for u in unit_wrench(body.slides, inertia))
        columns.append((*force, *add(torque, cross(subtract(origin, center), force))))
    rows = reduced_rows(tree.full_map, columns)
    return symbols.function("centroidal_map", map=rows)


@remembered
def centroidal_inertia(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function q -> inertia of all links about their center of mass, as if joints were locked.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q (n); output `inertia` (3, 3) in world axes [kg m^2].
    """
    state, symbols = new_state(pepper, "q")
    moving, still = composite_inertias(state)[1], state.tree.still
    center, mass = center_of_all(state), total_mass(state.tree)
    second = add_matrices(moving.second, still.second)
    second = add_matrices(second, outer(scale(-mass, center), center))
    whole = trace(second)
    rows = [[(whole if i == k else 0.0) - second[i][k] for k in range(3)] for i in range(3)]
    return symbols.function("centroidal_inertia", inertia=rows)


def velocities(state: StateExpressions) -> list[tuple[Vector, Vector]]:
    """Return the angular velocity of every body and the velocity of its origin, in the body's axes."""
    result: list[tuple[Vector, Vector]] = []
    parts = zip(state.tree.bodies, state.turns, state.translations, state.v, strict=True)
    for body, turn, r, v in parts:
        omega, velocity = result[body.parent] if body.parent >= 0 else (ZERO, ZERO)
        omega, velocity = turn.inward(omega), turn.inward(add(velocity, cross(omega, r)))
        if body.slides:
            velocity = (velocity[0], velocity[1], velocity[2] + v)
        else:
            omega = (omega[0], omega[1], omega[2] + v)
        result.append((omega, velocity))
    return result
