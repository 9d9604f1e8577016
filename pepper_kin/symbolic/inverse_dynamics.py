"""Inverse dynamics: torques of a motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.composite import first_moments
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.motion import (
    along_joints,
    collect,
    force_and_moment,
    motions,
    turn_towards,
)
from pepper_kin.symbolic.scalars import Value
from pepper_kin.symbolic.states import StateExpressions, gather, new_state
from pepper_kin.symbolic.vectors import Vector, add, cross, subtract

if TYPE_CHECKING:
    import casadi

Wrench = tuple[Vector, Vector]


@remembered
def inverse_dynamics(
    pepper: PepperModel, contact_frame: str | None = None, *, payload: Mapping[str, float] | None = None
) -> casadi.Function:
    """Return the function (q, v, a) -> tau = M(q) a + C(q, v) v + g(q).

    Recursive Newton-Euler (Luh, Walker and Paul, 1980) on base parameters, in body frames.

    Args:
        pepper: The robot.
        contact_frame: Frame on which an external force acts. The function then has a fourth input
            `wrench` (6) [N, N m]: force on the robot at the frame's origin, then moment, in world axes;
            J^T wrench is subtracted from tau.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q, v, a (n each); output `tau` (n) [N m or N].

    Raises:
        UnknownNameError: for a frame that the robot lacks.
    """
    state, symbols = new_state(pepper, "q", "v", "a", wrench=contact_frame is not None)
    tau = full_torques(state, contact_frame, symbols.inputs.get("wrench"))
    rows = [[value] for value in gather(state.tree.full_map, tau)]
    return symbols.function("inverse_dynamics", tau=rows)


@remembered
def gravity_torque(pepper: PepperModel, *, payload: Mapping[str, float] | None = None) -> casadi.Function:
    """Return the function q -> g(q), the torques that hold the robot still.

    Each joint holds the weight of its composite body: tau_i = -z . (h_i x g), in the body's axes.

    Args:
        pepper: The robot.
        payload: Point masses at "left", "right" or a frame by name [kg].

    Returns:
        Function of q (n); output `tau` (n) [N m or N].
    """
    state, symbols = new_state(pepper, "q")
    rows = [[value] for value in gather(state.tree.full_map, full_gravity(state))]
    return symbols.function("gravity_torque", tau=rows)


def full_gravity(state: StateExpressions) -> list[Value]:
    """Return g for all coordinates of `pinocchio_model`, see `gravity_torque`."""
    moments, masses, _ = first_moments(state)
    pulls: list[Vector] = []
    tau: list[Value] = []
    for body, turn, (x, y, _), mass in zip(state.tree.bodies, state.turns, moments, masses, strict=True):
        pull = turn.inward(pulls[body.parent] if body.parent >= 0 else state.tree.gravity)
        pulls.append(pull)
        tau.append(-mass * pull[2] if body.slides else y * pull[0] - x * pull[1])
    return tau


def body_wrenches(state: StateExpressions) -> list[Wrench]:
    """Return the net wrench on each body, in the body's axes about its origin."""
    moved = zip(motions(state), state.tree.bodies, strict=True)
    return [force_and_moment(motion, body.inertia) for motion, body in moved]


def full_torques(
    state: StateExpressions, contact_frame: str | None = None, wrench: Sequence[Value] | None = None
) -> list[Value]:
    """Return the torques of all coordinates of `pinocchio_model`."""
    wrenches = body_wrenches(state)
    if contact_frame is not None and wrench is not None:
        add_contact(state, wrenches, contact_frame, wrench)
    return torques_of(state, collect(state, wrenches)[0])


def torques_of(state: StateExpressions, totals: Sequence[Wrench]) -> list[Value]:
    """Return the torques of all coordinates from the wrenches at the joints, with the rotors' torques."""
    rotors = (j * a for j, a in zip(state.tree.armature, state.a, strict=True))
    return [t + rotor for t, rotor in zip(along_joints(state, totals), rotors, strict=True)]


def add_contact(state: StateExpressions, wrenches: list[Wrench], frame: str, wrench: Sequence[Value]) -> None:
    """Subtract an external wrench, in world axes at a frame's origin, from the wrench of the frame's body."""
    body, _, place = state.tree.anchor(frame)
    if body < 0:
        return
    force = turn_towards(state, body, tuple(wrench[:3]))
    torque = add(turn_towards(state, body, tuple(wrench[3:])), cross(place, force))
    f, n = wrenches[body]
    wrenches[body] = (subtract(f, force), subtract(n, torque))
