"""Mechanical energy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.composite import first_moments
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.momentum import velocities
from pepper_kin.symbolic.scalars import Value
from pepper_kin.symbolic.states import new_state
from pepper_kin.symbolic.vectors import cross, dot

if TYPE_CHECKING:
    import casadi


@remembered
def kinetic_energy(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function (q, v) -> v^T M(q) v / 2.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q, v (n each); output `energy` (1) [J].
    """
    state, symbols = new_state(pepper, "q", "v")
    total: Value = 0.0
    for (omega, velocity), body in zip(velocities(state), state.tree.bodies, strict=True):
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = body.inertia.second
        x, y, z = omega
        # omega . (tr(Sigma) - Sigma) omega / 2, with its constants collected.
        spin = x * ((0.5 * (yy + zz)) * x - xy * y - xz * z) + y * ((0.5 * (xx + zz)) * y - yz * z)
        spin = spin + (0.5 * (xx + yy)) * (z * z)
        drift = (0.5 * body.inertia.mass) * dot(velocity, velocity)
        total = total + spin + drift + dot(velocity, cross(omega, body.inertia.first))
    for armature, v in zip(state.tree.armature, state.v, strict=True):
        total = total + (0.5 * armature) * (v * v)
    return symbols.function("kinetic_energy", energy=[[total]])


@remembered
def potential_energy(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function q -> -sum(m_i g . c_i) over the moving links; zero if their center is at z = 0.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q (n); output `energy` (1) [J].
    """
    state, symbols = new_state(pepper, "q")
    _, _, moment = first_moments(state)
    return symbols.function("potential_energy", energy=[[-dot(state.tree.gravity, moment)]])
