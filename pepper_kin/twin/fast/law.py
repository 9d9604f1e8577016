"""The force law of the joints, compiled: the counterpart of `pepper_kin.twin.joint_law`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from pepper_kin.twin.joint_law import CREEP, LawTable

Array = np.ndarray


class Derived(NamedTuple):
    """What does not change from step to step; shape (blocks, m) each, but for the two choices.

    Attributes:
        gain: h Kp + Kd.
        extra: J + h (h Kp + Kd + D), what is added to the mass matrix without friction and stops.
        has_friction: Whether any joint has Coulomb friction.
        has_encoder: Whether any encoder has a resolution.
    """

    gain: Array
    extra: Array
    has_friction: bool
    has_encoder: bool


def derived(law: LawTable, h: float) -> Derived:
    """Return what follows from the parameters and the timestep."""
    gain = h * law.kp + law.kd
    extra = law.rotor + h * (gain + law.viscous)
    return Derived(gain, extra, bool(law.coulomb.any()), bool(law.resolution.any()))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def seen_at(resolution: float, q: float) -> float:
    """Return the position that an encoder gives."""
    return resolution * np.floor(q / resolution + 0.5) if resolution > 0.0 else q


@njit(cache=True, nogil=True, error_model="numpy")
def friction_at(coulomb: float, w: float) -> tuple[float, float]:
    """Return c and k of Coulomb's friction."""
    if abs(w) <= CREEP:
        return 0.0, coulomb / CREEP
    return (coulomb if w > 0.0 else -coulomb), 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def piece_at(
    law: LawTable, b: int, e: int, h: float, q: float, w: float, servo: float, before: float
) -> tuple[float, float, float]:
    """Return torque, intercept and slope of the law of joint e of block b; see `joint_law.piece_at`.

    `before` is another velocity, or w itself.
    """
    gain = h * law.kp[b, e] + law.kd[b, e]
    wanted = servo - gain * w
    torque, intercept, slope = wanted, servo, gain
    limit, stall, line = law.limit[b, e], law.stall[b, e], law.line[b, e]
    upper_line, lower_line = stall - line * w, -stall - line * w
    upper, lower = min(max(upper_line, -limit), limit), min(max(lower_line, -limit), limit)
    if wanted > upper:
        on_line = -limit < upper_line < limit
        torque, slope, intercept = upper, line if on_line else 0.0, stall if on_line else upper
    if wanted < lower:
        on_line = -limit < lower_line < limit
        torque, slope, intercept = lower, line if on_line else 0.0, -stall if on_line else lower
    coulomb = law.coulomb[b, e]
    friction, stick = friction_at(coulomb, w)
    if w * before < 0.0 and min(abs(w), abs(before)) > CREEP and coulomb > 0.0:
        friction, stick = 0.0, coulomb / CREEP
    intercept -= friction
    slope += law.viscous[b, e] + stick
    stiffness, damping = law.stop_stiffness[b, e], law.stop_damping[b, e]
    beyond = q - law.upper[b, e]
    base, stiff = stiffness * beyond, h * stiffness + (damping if beyond > 0.0 else 0.0)
    if base + stiff * w > 0.0:
        intercept -= base
        slope += stiff
    beyond = q - law.lower[b, e]
    base, stiff = stiffness * beyond, h * stiffness + (damping if beyond < 0.0 else 0.0)
    if base + stiff * w < 0.0:
        intercept -= base
        slope += stiff
    return torque, intercept, slope
