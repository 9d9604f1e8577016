"""Velocities and accelerations of frames, summed from the frame to the world."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.model import PepperModel
from pepper_kin.symbolic.memory import remembered
from pepper_kin.symbolic.states import StateExpressions, new_state
from pepper_kin.symbolic.vectors import ZERO, Vector, add, scale, z_cross

if TYPE_CHECKING:
    import casadi


@remembered
def frame_velocity(pepper: PepperModel, frame: str) -> casadi.Function:
    """Return the function (q, v) -> velocity of a frame.

    Args:
        pepper: The robot.
        frame: Name of a frame, see `pepper.frame_names`.

    Returns:
        Function of q, v (n each); output `velocity` (6): velocity of the frame's origin [m/s], then angular
        velocity [rad/s], both in world axes.

    Raises:
        UnknownNameError: for a frame that the robot lacks.
    """
    state, symbols = new_state(pepper, "q", "v")
    return symbols.function("frame_velocity", velocity=[[x] for x in _tip_motion(state, frame)[0]])


@remembered
def frame_acceleration(pepper: PepperModel, frame: str) -> casadi.Function:
    """Return the function (q, v, a) -> acceleration of a frame.

    Args:
        pepper: The robot.
        frame: Name of a frame, see `pepper.frame_names`.

    Returns:
        Function of q, v, a (n each); output `acceleration` (6): second derivative of the position of the
        frame's origin [m/s^2], then angular acceleration [rad/s^2], both in world axes.

    Raises:
        UnknownNameError: for a frame that the robot lacks.
    """
    state, symbols = new_state(pepper, "q", "v", "a")
    return symbols.function("frame_acceleration", acceleration=[[x] for x in _tip_motion(state, frame)[1]])


def _tip_motion(state: StateExpressions, frame: str) -> tuple[Vector, Vector]:
    """Return velocity and acceleration of a frame, linear components first.

    From the frame inward, rho, velocity, omega, acceleration and alpha describe the frame relative to the
    current body, in the body's axes; each joint adds its contribution. No orientation in the world is needed.
    """
    body, _, rho = state.tree.anchor(frame)
    velocity, omega, acceleration, alpha = ZERO, ZERO, ZERO, ZERO
    for i in reversed(state.tree.path(body)):
        v, rate = state.v[i], state.a[i]
        turn = state.turns[i]
        if state.tree.bodies[i].slides:
            velocity = (velocity[0], velocity[1], velocity[2] + v)
            acceleration = (acceleration[0], acceleration[1], acceleration[2] + rate)
        else:
            before = velocity
            velocity = add(velocity, scale(v, z_cross(rho)))
            # Coriolis and centripetal part: 2 v z x velocity + v^2 z x (z x rho).
            acceleration = add(
                acceleration, scale(rate, z_cross(rho)), scale(v, z_cross(add(before, velocity)))
            )
            alpha = add(alpha, scale(v, z_cross(omega)), (0.0, 0.0, rate))
            omega = (omega[0], omega[1], omega[2] + v)
        rho = add(state.translations[i], turn.outward(rho))
        velocity, omega, acceleration, alpha = map(turn.outward, (velocity, omega, acceleration, alpha))
    return (*velocity, *omega), (*acceleration, *alpha)
