"""The force on one joint as a function of its own velocity at the end of the step.

With step h, position q and velocity w = v+ at its end (q+ = q + h w), and the parameters of
`ActuatorParameters`, the force on a joint, besides its rotor, is

    F(w) = tau(w) - D w - friction(w) - stop(w)

* tau = clip(u, low, high), with u as the mode says, e.g. Kp (q_ref - q+) + Kd (v_ref - w) + f.
* The motor gives at most high(w) = clip(stall (1 - w / no_load), -limit, limit) and at least
  low(w) = clip(stall (-1 - w / no_load), -limit, limit): current limit and voltage limit.  Above the
  no-load speed the supply brakes.
* Everything up to here is multiplied by the strength (the stiffness of NAOqi).
* friction = C clip(w / e, -1, 1), e = 1e-8 rad/s (m/s): Coulomb's law but for a creep of at most e where
  the joint sticks.
* stop = max(0, Ks (q+ - upper) + Ds w) + min(0, Ks (q+ - lower) + Ds w): springs that only push, with a
  damper Ds once the joint is beyond the limit.

Each part never rises with w and consists of straight pieces, F(w) = c - k w with k >= 0 on each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.twin.actuators import POSITION, TORQUE, ActuatorParameters

Array = NDArray[np.float64]

CREEP = 1e-8  # [rad/s or m/s] fastest motion of a joint that sticks
_FAR = 1e12  # [rad or m] stands for infinity in a joint's range, so that 0 times it is 0


class LawTable(NamedTuple):
    """Parameters as the law needs them; each of the shape of the joints, (n,) or (robots, n).

    Attributes:
        kp: strength Kp, 0 unless in position mode.
        kd: strength Kd, 0 in torque mode.
        strength: 0 to 1.
        feedforward: strength, 0 in torque mode.
        limit: strength times the torque limit, inf for none.
        stall: strength times the stall torque, inf for none.
        line: strength times stall / no_load, 0 for none.
        viscous: D.
        coulomb: C.
        rotor: Rotor inertia.
        upper: Upper position limit.
        lower: Lower position limit.
        stop_stiffness: Ks.
        stop_damping: Ds.
        resolution: Of the encoder, 0 for exact.
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


class Piece(NamedTuple):
    """A straight piece of the law.

    Attributes:
        torque: tau at w.
        intercept: c of F(w) = c - k w.
        slope: k.
    """

    torque: Array
    intercept: Array
    slope: Array


def law_table(pepper: PepperModel, actuators: ActuatorParameters) -> LawTable:
    """Return the parameters of a robot's joints, each of shape (n,).

    Args:
        pepper: The robot.
        actuators: Of its joints; those of k robots, one after the other, give the shape (k n,).
    """
    strength = np.array(actuators.strength)
    robots = strength.size // pepper.n
    servo = np.where(actuators.in_mode(TORQUE), 0.0, strength)
    with np.errstate(invalid="ignore"):
        stall = np.where(strength > 0, strength * actuators.stall_torque, 0.0)
        limit = np.where(strength > 0, strength * actuators.torque_limit, 0.0)
        line = np.where(np.isfinite(actuators.no_load_speed), stall / actuators.no_load_speed, 0.0)
    return LawTable(
        kp=np.where(actuators.in_mode(POSITION), strength * actuators.stiffness, 0.0),
        kd=servo * actuators.damping,
        strength=strength,
        feedforward=servo,
        limit=limit,
        stall=stall,
        line=line,
        viscous=np.array(actuators.viscous_friction),
        coulomb=np.array(actuators.coulomb_friction),
        rotor=np.array(actuators.rotor_inertia),
        upper=np.tile(np.minimum(pepper.upper_limits, _FAR), robots),
        lower=np.tile(np.maximum(pepper.lower_limits, -_FAR), robots),
        stop_stiffness=np.array(actuators.stop_stiffness),
        stop_damping=np.array(actuators.stop_damping),
        resolution=np.array(actuators.encoder_resolution),
    )


def seen(table: LawTable, q: Array) -> Array:
    """Return the positions that the encoders give: to the nearest multiple of their resolution."""
    if not table.resolution.any():
        return q
    step = np.where(table.resolution > 0, table.resolution, 1.0)
    return np.where(table.resolution > 0, step * np.floor(q / step + 0.5), q)


def first_piece(table: LawTable, h: float, v: Array, servo: Array) -> Piece:
    """Return the piece to begin with: nothing clipped, no stop touched, friction as for the old velocity.

    Args:
        table: The parameters.
        h: Timestep [s].
        v: Velocity at the start of the step.
        servo: Kp (q_ref - q) + Kd v_ref + f: what the servo wants at w = 0.
    """
    friction, stick = _friction(table, v)
    return Piece(servo, servo - friction, h * table.kp + table.kd + table.viscous + stick)


def holds_unclipped(table: LawTable, h: float, q: Array, w: Array, servo: Array) -> bool:
    """Return whether no motor is at its limit and no joint at a stop, for joints without friction and line.

    Args:
        table: The parameters.
        h: Timestep [s].
        q: Position at the start of the step.
        w: Velocity at its end.
        servo: What the servo wants at w = 0.
    """
    q_next = q + h * w
    beyond = (q_next > table.upper) | (q_next < table.lower) | (q > table.upper) | (q < table.lower)
    clipped = abs(servo - (h * table.kp + table.kd) * w) > np.minimum(table.limit, table.stall)
    return not (beyond | clipped).any()


def piece_at(
    table: LawTable, h: float, q: Array, w: Array, servo: Array, before: Array | None = None
) -> Piece:
    """Return the torque and the piece of the law at a velocity.

    Args:
        table: The parameters.
        h: Timestep [s].
        q: Position at the start of the step.
        w: Velocity at its end.
        servo: Kp (q_ref - q) + Kd v_ref + f.
        before: Another velocity; a joint that has turned round between the two gets the piece on which
            friction holds it.
    """
    gain = h * table.kp + table.kd
    wanted = servo - gain * w
    torque, intercept, slope = wanted, servo, gain
    for sign in (1.0, -1.0):
        line = sign * table.stall - table.line * w
        bound = np.clip(line, -table.limit, table.limit)
        clipped = wanted > bound if sign > 0 else wanted < bound
        on_line = (line < table.limit) & (line > -table.limit)
        torque = np.where(clipped, bound, torque)
        slope = np.where(clipped, np.where(on_line, table.line, 0.0), slope)
        intercept = np.where(clipped, np.where(on_line, sign * table.stall, bound), intercept)
    friction, stick = _friction(table, w)
    if before is not None:
        turned = (w * before < 0) & (np.minimum(abs(w), abs(before)) > CREEP) & (table.coulomb > 0)
        friction = np.where(turned, 0.0, friction)
        stick = np.where(turned, table.coulomb / CREEP, stick)
    push, stiff = _stops(table, h, q, w)
    return Piece(torque, intercept - friction - push, slope + table.viscous + stick + stiff)


def _friction(table: LawTable, w: Array) -> tuple[Array, Array]:
    """Return c and k of Coulomb's friction."""
    sticks = abs(w) <= CREEP
    return (
        np.where(sticks, 0.0, np.copysign(table.coulomb, w)),
        np.where(sticks, table.coulomb / CREEP, 0.0),
    )


def _stops(table: LawTable, h: float, q: Array, w: Array) -> tuple[Array, Array]:
    """Return c and k of the stops."""
    push, stiff = np.zeros_like(w), np.zeros_like(w)
    for sign, limit in ((1.0, table.upper), (-1.0, table.lower)):
        damper = np.where(sign * (q - limit) > 0, table.stop_damping, 0.0)
        base, slope = table.stop_stiffness * (q - limit), h * table.stop_stiffness + damper
        touched = sign * (base + slope * w) > 0
        push = push + np.where(touched, base, 0.0)
        stiff = stiff + np.where(touched, slope, 0.0)
    return push, stiff
