"""Actuator model: force on one joint as a function of its velocity at the end of the step.

With step h, position q and velocity w = v+ at its end (q+ = q + h w), the force on a joint, besides its
rotor, is

    F(w) = tau(w) - D w - friction(w) - stop(w)

* tau = clip(u, lower, upper), with u by the mode, e.g. Kp (q_ref - q+) + Kd (v_ref - w) + f.
* The motor gives at most upper(w) = clip(stall (1 - w / no_load), -limit, limit) and at least
  lower(w) = clip(stall (-1 - w / no_load), -limit, limit): current limit and voltage limit.  Above the
  no-load speed the supply brakes.
* Everything up to here is multiplied by the strength (the stiffness of NAOqi).
* friction = C clip(w / e, -1, 1), e = 1e-8 rad/s (m/s): Coulomb's law except for a creep of at most e
  where the joint sticks.
* stop = max(0, Ks (q+ - upper) + Ds w) + min(0, Ks (q+ - lower) + Ds w): springs that only push, with a
  damper Ds once the joint is beyond the limit.

Each part is nonincreasing in w and piecewise linear, F(w) = c - k w with k >= 0 on each segment.

`servo_feedback`, `servo_gain`, `encoder_reading`, `friction_segment` and `drive_segment` can also be traced
with symbols (`pepper_kin.twin.step_kernel`), with other definitions of `select` and of the names next to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.signatures import Floats1, Floats2

CREEP = 1e-8
"""Maximum speed of a joint that sticks [rad/s or m/s]."""


class ActuatorTable(NamedTuple):
    """Parameters of the joints; each has the shape of the joints, (n,) or (robots, n).

    Attributes:
        kp: Strength times Kp [N m/rad or N/m], 0 unless in position mode.
        kd: Strength times Kd [N m s/rad or N s/m], 0 in torque mode.
        strength: Strength, 0 to 1.
        feedforward: Factor on feed-forward torques: strength, 0 in torque mode.
        limit: Strength times the torque limit [N m or N], inf for none.
        stall: Strength times the stall torque [N m or N], inf for none.
        line: Strength times stall / no_load [N m s/rad or N s/m], 0 for none.
        viscous: D [N m s/rad or N s/m].
        coulomb: C [N m or N].
        rotor: Inertia of the rotor [kg m^2 or kg].
        upper: Upper position limit [rad or m].
        lower: Lower position limit [rad or m].
        stop_stiffness: Ks [N m/rad or N/m].
        stop_damping: Ds [N m s/rad or N s/m].
        resolution: Resolution of the encoder [rad or m], 0 for exact.
        play: Half the backlash [rad or m], 0 unless in position mode; see `drive_state`.
        continuous_torque: Maximum torque that does not overheat the motor [N m or N], inf for any.
        thermal_time: Time constant of the motor's heating [s], inf for none.
    """

    kp: Array
    kd: Array
    strength: Array
    feedforward: Array
    limit: Array
    stall: Array
    line: Array
    viscous: Array
    coulomb: Array
    rotor: Array
    upper: Array
    lower: Array
    stop_stiffness: Array
    stop_damping: Array
    resolution: Array
    play: Array
    continuous_torque: Array
    thermal_time: Array


# Row indices of the parameters of many joints, in the order of `ActuatorTable`.
KP, KD, STRENGTH, FEEDFORWARD, LIMIT, STALL, LINE, VISCOUS, COULOMB, ROTOR, UPPER, LOWER = range(12)
STOP_STIFFNESS, STOP_DAMPING, RESOLUTION, PLAY, CONTINUOUS, THERMAL_TIME = 12, 13, 14, 15, 16, 17


@compiled(lean=True, inline=True)
def select(condition: bool, first: float, second: float) -> float:
    """Return the first number where the condition holds, else the second."""
    return first if condition else second


@compiled(lean=True, inline=True)
def servo_feedback(kp: float, kd: float, error: float, v_ref: float) -> float:
    """Return Kp (q_ref - q) + Kd v_ref, a servo's torque at w = 0; `error` is q_ref minus the read q."""
    return kp * error + kd * v_ref


@compiled(lean=True, inline=True)
def servo_gain(h: float, kp: float, kd: float) -> float:
    """Return the decrease of a servo's torque demand per unit of w."""
    return h * kp + kd


@compiled(lean=True, inline=True)
def encoder_reading(resolution: float, q: float) -> float:
    """Return the position that an encoder reads: the nearest multiple of its resolution."""
    step = resolution + (resolution == 0.0)
    return select(resolution == 0.0, q, step * floor(q / step + 0.5))


@compiled(lean=True, inline=True)
def floor(x: float) -> float:
    """Return the greatest integer that is not above x."""
    return float(np.floor(x))


@compiled(lean=True, inline=True)
def friction_segment(coulomb: float, w: float) -> tuple[float, float]:
    """Return c and k of Coulomb friction at velocity w."""
    sticks = abs(w) <= CREEP
    return select(sticks, 0.0, copysign(coulomb, w)), select(sticks, coulomb / CREEP, 0.0)


@compiled(lean=True, inline=True)
def copysign(x: float, sign: float) -> float:
    """Return x >= 0 with the sign of `sign`."""
    return math.copysign(x, sign)


@compiled(lean=True, inline=True)
def speed_torque_line(stall: float, line: float, w: float) -> tuple[float, float]:
    """Return the minimum and the maximum torque that the supply voltage allows at velocity w."""
    return -stall - line * w, stall - line * w


@compiled(lean=True, inline=True)
def drive_segment(
    servo: float, gain: float, limit: float, stall: float, line: float, w: float
) -> tuple[float, float, float]:
    """Return torque, intercept c and slope k of a motor at velocity w.

    Args:
        servo: Torque demand at w = 0 [N m or N].
        gain: Decrease of the demand per unit of w.
        limit: Torque limit [N m or N].
        stall: Stall torque [N m or N].
        line: Stall torque over no-load speed.
        w: Velocity [rad/s or m/s].
    """
    wanted = servo - gain * w
    lower_line, upper_line = speed_torque_line(stall, line, w)
    upper, lower = min(max(upper_line, -limit), limit), min(max(lower_line, -limit), limit)
    torque = min(max(wanted, lower), upper)
    clipped, below = abs(wanted - torque) > 0.0, wanted < lower
    on_line = abs(select(below, lower_line, upper_line)) < limit
    intercept = select(on_line, select(below, -stall, stall), select(below, lower, upper))
    slope = select(on_line, line, 0.0)
    return torque, select(clipped, intercept, servo), select(clipped, slope, gain)


@compiled(lean=True, inline=True)
def segment_at(
    law: Floats2, e: int, h: float, q: float, w: float, servo: float
) -> tuple[float, float, float]:
    """Return torque, intercept c and slope k of the model of element e at a velocity, without branches.

    Args:
        law: Parameters, one row for each of `ActuatorTable`, shape (rows, m).
        e: Index of the element.
        h: Timestep [s].
        q: Position at the start of the step [rad or m].
        w: Velocity at the end of the step [rad/s or m/s].
        servo: Torque demand at w = 0: Kp (q_ref - q) + Kd v_ref + f [N m or N].
    """
    gain = servo_gain(h, law[KP, e], law[KD, e])
    torque, intercept, slope = drive_segment(servo, gain, law[LIMIT, e], law[STALL, e], law[LINE, e], w)
    friction, stick = friction_segment(law[COULOMB, e], w)
    push, stiff = _stop_at(law, h, e, q - law[UPPER, e], w, 1.0)
    other, more = _stop_at(law, h, e, q - law[LOWER, e], w, -1.0)
    return torque, intercept - friction - push - other, slope + law[VISCOUS, e] + stick + stiff + more


@compiled(lean=True, inline=True)
def when_turned(coulomb: float, w: float, before: float) -> tuple[float, float]:
    """Return the changes of c and k for a joint that has reversed since `before`: friction holds it."""
    friction, stick = friction_segment(coulomb, w)
    turned = (w * before < 0.0) & (min(abs(w), abs(before)) > CREEP)
    return select(turned, friction, 0.0), select(turned, coulomb / CREEP - stick, 0.0)


@compiled(lean=True, inline=True)
def _stop_at(law: Floats2, h: float, e: int, beyond: float, w: float, sign: float) -> tuple[float, float]:
    """Return c and k of a stop of element e, exceeded by `beyond` [rad or m]; law: shape (rows, m)."""
    stiffness, damping = law[STOP_STIFFNESS, e], law[STOP_DAMPING, e]
    base, stiff = stiffness * beyond, h * stiffness + select(sign * beyond > 0.0, damping, 0.0)
    pushes = sign * (base + stiff * w) > 0.0
    return select(pushes, base, 0.0), select(pushes, stiff, 0.0)


@compiled("void(float64[:, ::1], float64[:, ::1], float64[::1], float64[::1])")
def present_torques(law: Floats2, state: Floats2, feedforward: Floats1, torque: Floats1) -> None:
    """Write the torques of m actuators at a state, instead of at the end of a step.

    Args:
        law: Parameters, shape (rows, m).
        state: Positions, velocities, and references of both [rad or m and per second], shape (4, m).
        feedforward: Feed-forward torques times the strength [N m or N], shape (m,).
        torque: Output [N m or N], shape (m,).
    """
    for e in range(len(torque)):
        q, v = state[0, e], state[1, e]
        error = state[2, e] - encoder_reading(law[RESOLUTION, e], q)
        servo = servo_feedback(law[KP, e], law[KD, e], error, state[3, e]) + feedforward[e]
        torque[e] = segment_at(law, e, 0.0, q, v, servo)[0]
