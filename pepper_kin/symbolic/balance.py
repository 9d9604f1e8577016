"""Wrench of the floor on the robot, and the zero-moment point."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.inverse_dynamics import Wrench, body_wrenches, torques_of
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.motion import collect, force_and_moment, world_motion
from pepper_kin.symbolic.scalars import reciprocal
from pepper_kin.symbolic.states import StateExpressions, gather, new_state
from pepper_kin.symbolic.vectors import add

if TYPE_CHECKING:
    import casadi


@remembered
def base_wrench(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function (q, v, a) -> wrench that the floor exerts on the robot.

    It is the rate of change of the momentum of all links about the world's origin minus the wrench of
    gravity; links fixed to the floor are included.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q, v, a (n each); output `wrench` (6): force [N], then moment about the world's origin
        [N m], in world axes.
    """
    state, symbols = new_state(pepper, "q", "v", "a")
    force, torque = _floor_wrench(state, collect(state, body_wrenches(state))[1])
    return symbols.function("base_wrench", wrench=[[x] for x in (*force, *torque)])


@remembered
def zero_moment_point(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function (q, v, a) -> zero-moment point (-n_y, n_x) / f_z of the base wrench (f, n).

    If the floor had to pull (f_z <= 0) the point is not defined; the function then returns the value of the
    formula without a warning.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q, v, a (n each); output `point` (2): x and y on the floor [m].
    """
    state, symbols = new_state(pepper, "q", "v", "a")
    force, torque = _floor_wrench(state, collect(state, body_wrenches(state))[1])
    share = reciprocal(force[2])
    rows = [[-torque[1] * share], [torque[0] * share]]
    return symbols.function("zero_moment_point", point=rows)


def torques_and_wrench(pepper: PepperModel) -> casadi.Function:
    """Return the function (q, v, a) -> torques and wrench of the floor, by a common recursion.

    Args:
        pepper: The robot.

    Returns:
        Function of q, v, a (n each); output `effects` (n + 6): `tau` of `inverse_dynamics`, then `wrench` of
        `base_wrench`.
    """
    state, symbols = new_state(pepper, "q", "v", "a")
    totals, carried = collect(state, body_wrenches(state))
    force, torque = _floor_wrench(state, carried)
    tau = gather(state.tree.full_map, torques_of(state, totals))
    return symbols.function("torques_and_wrench", effects=[[x] for x in (*tau, *force, *torque)])


def _floor_wrench(state: StateExpressions, carried: Wrench) -> Wrench:
    """Return force [N] and moment about the world's origin [N m], in world axes.

    Args:
        state: The state.
        carried: Force and moment of the moving links.
    """
    force, torque = carried
    resting = world_motion(state.tree.gravity)
    for inertia in (state.tree.ground, state.tree.still):
        f, n = force_and_moment(resting, inertia)
        force, torque = add(force, f), add(torque, n)
    return force, torque
