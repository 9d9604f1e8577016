"""Wrench of the floor on the robot, and the zero-moment point."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.inverse_dynamics import Wrench, body_wrenches
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.motion import collect, force_and_moment, world_motion
from pepper_kin.symbolic.scalars import reciprocal
from pepper_kin.symbolic.states import State, new_state
from pepper_kin.symbolic.vectors import add

if TYPE_CHECKING:
    import casadi


@remembered
def base_wrench(pepper: PepperModel) -> casadi.Function:
    """Return the function (q, v, a) -> wrench that the floor exerts on the robot.

    It is the rate of change of the momentum of all links about the world's origin minus the wrench of
    gravity; links fixed to the floor are included.

    Args:
        pepper: The robot.

    Returns:
        Function of q, v, a (n each); output `wrench` (6): force [N], then moment about the world's origin
        [N m], in world axes.
    """
    state, symbols = new_state(pepper, "q", "v", "a")
    force, torque = _floor_wrench(state)
    return symbols.function("base_wrench", wrench=[[x] for x in (*force, *torque)])


@remembered
def zero_moment_point(pepper: PepperModel) -> casadi.Function:
    """Return the function (q, v, a) -> zero-moment point (-n_y, n_x) / f_z of the base wrench (f, n).

    Where the floor would have to pull (f_z <= 0) there is no such point; the function then returns the value
    of the formula without a warning.

    Args:
        pepper: The robot.

    Returns:
        Function of q, v, a (n each); output `point` (2): x and y on the floor [m].
    """
    state, symbols = new_state(pepper, "q", "v", "a")
    force, torque = _floor_wrench(state)
    share = reciprocal(force[2])
    rows = [[-torque[1] * share], [torque[0] * share]]
    return symbols.function("zero_moment_point", point=rows)


def _floor_wrench(state: State) -> Wrench:
    """Return force [N] and moment about the world's origin [N m], in world axes."""
    _, (force, torque) = collect(state, body_wrenches(state))
    resting = world_motion(state.tree.gravity)
    for inertia in (state.tree.ground, state.tree.still):
        f, n = force_and_moment(resting, inertia)
        force, torque = add(force, f), add(torque, n)
    return force, torque
