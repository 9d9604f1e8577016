"""The force law of the joints, compiled: the counterpart of `pepper_kin.twin.joint_law`."""

from __future__ import annotations

import numpy as np
from numba import njit

from pepper_kin.twin.joint_law import CREEP, LawTable

Array = np.ndarray

# Rows of the parameters, in the order of `LawTable`.
KP, KD, STRENGTH, LIMIT, STALL, LINE, VISCOUS, COULOMB, ROTOR, UPPER, LOWER, STOP_STIFFNESS, STOP_DAMPING = (
    LawTable._fields.index(name)
    for name in (
        "kp",
        "kd",
        "strength",
        "limit",
        "stall",
        "line",
        "viscous",
        "coulomb",
        "rotor",
        "upper",
        "lower",
        "stop_stiffness",
        "stop_damping",
    )
)


@njit(cache=True, nogil=True, error_model="numpy")
def piece_at(
    law: Array, e: int, h: float, q: float, w: float, servo: float, before: float
) -> tuple[float, float, float]:
    """Return torque, intercept and slope of the law of element e; see `joint_law.piece_at`.

    Args:
        law: Parameters, one row for each of `LawTable`, shape (rows, m).
        e: The element.
        h: Timestep [s].
        q: Position at the start of the step.
        w: Velocity at its end.
        servo: What the actuator wants at w = 0.
        before: Another velocity, or w itself.
    """
    gain = h * law[KP, e] + law[KD, e]
    wanted = servo - gain * w
    torque, intercept, slope = wanted, servo, gain
    limit, stall, line = law[LIMIT, e], law[STALL, e], law[LINE, e]
    upper_line, lower_line = stall - line * w, -stall - line * w
    upper, lower = min(max(upper_line, -limit), limit), min(max(lower_line, -limit), limit)
    if wanted > upper:
        on_line = -limit < upper_line < limit
        torque, slope, intercept = upper, line if on_line else 0.0, stall if on_line else upper
    if wanted < lower:
        on_line = -limit < lower_line < limit
        torque, slope, intercept = lower, line if on_line else 0.0, -stall if on_line else lower
    coulomb = law[COULOMB, e]
    friction, stick = friction_at(coulomb, w)
    if w * before < 0.0 and min(abs(w), abs(before)) > CREEP and coulomb > 0.0:
        friction, stick = 0.0, coulomb / CREEP
    push, stiff = _stops_at(law, e, h, q, w)
    return torque, intercept - friction - push, slope + law[VISCOUS, e] + stick + stiff


@njit(cache=True, nogil=True, error_model="numpy")
def friction_at(coulomb: float, w: float) -> tuple[float, float]:
    """Return c and k of Coulomb's friction."""
    if abs(w) <= CREEP:
        return 0.0, coulomb / CREEP
    return (coulomb if w > 0.0 else -coulomb), 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _stops_at(law: Array, e: int, h: float, q: float, w: float) -> tuple[float, float]:
    """Return c and k of the stops."""
    stiffness, damping = law[STOP_STIFFNESS, e], law[STOP_DAMPING, e]
    push, slope = 0.0, 0.0
    for sign in (1.0, -1.0):
        beyond = q - (law[UPPER, e] if sign > 0.0 else law[LOWER, e])
        base, stiff = stiffness * beyond, h * stiffness + (damping if sign * beyond > 0.0 else 0.0)
        if sign * (base + stiff * w) > 0.0:
            push += base
            slope += stiff
    return push, slope
