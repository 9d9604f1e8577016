"""Share of its limits that a motion uses, and the slowdown that would be needed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.model import PepperModel
from pepper_kin.trajectory.extremes import extremes_of
from pepper_kin.trajectory.limits import LimitedQuantities, Limits, share_of
from pepper_kin.trajectory.sampling import State
from pepper_kin.trajectory.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class LimitUse:
    """Greatest shares of the limits over some states.

    Attributes:
        share: Quantity -> share of its limit that each joint (or limited frame) uses, shape (n,).
        stretch: Least k >= 1 such that a motion k times as slow obeys all limits; inf if none does.
    """

    share: dict[str, Array]
    stretch: float


def measure_use(pepper: PepperModel, state: State, limits: Limits) -> LimitUse:
    """Compare states with limits.

    Made k times as slow, a motion has velocity v / k, acceleration a / k^2 and torque g + (tau - g) / k^2.

    Args:
        pepper: The robot.
        state: Arrays of shape (T, n).
        limits: The limits.

    Returns:
        The shares used and how much slower the motion would have to be.
    """
    share = {
        "velocity": share_of(np.abs(state.velocity).max(axis=0), limits.velocity),
        "acceleration": share_of(np.abs(state.acceleration).max(axis=0), limits.acceleration),
    }
    square = max(1.0, float(share["velocity"].max()) ** 2, float(share["acceleration"].max()))
    quantities, q = LimitedQuantities(pepper, limits), state.position
    if quantities.frames:
        share["frame speed"] = quantities.speed(q, state.velocity).max(axis=0)
        square = max(square, float(share["frame speed"].max()) ** 2)
    if quantities.torque_limit.size:
        torque = quantities.torque(*state)
        share["torque"] = share_of(np.abs(torque).max(axis=0), quantities.torque_limit)
        over = (np.abs(torque) > quantities.torque_limit).any(axis=1)
        if over.any():
            still = np.zeros_like(q[over])
            gravity = quantities.torque(q[over], still, still)
            square = max(square, _square_stretch(torque[over], gravity, quantities.torque_limit))
    if quantities.edges:
        moving = quantities.moments(*state)
        tipping = (moving < 0).any(axis=1)
        if tipping.any():
            still = np.zeros_like(q[tipping])
            resting = quantities.moments(q[tipping], still, still)
            square = max(square, _square_stretch_to_stand(moving[tipping], resting))
    return LimitUse(share, float(np.sqrt(square)))


def stretch_at_extremes(trajectory: Trajectory, limits: Limits) -> float:
    """Return the least k >= 1 such that a motion k times as slow keeps velocity, acceleration and jerk.

    They are compared where they are greatest, wherever that is; made k times as slow, jerk is j / k^3.

    Args:
        trajectory: The motion.
        limits: The limits, of which those of the joints' motion count.
    """
    stretch = 1.0
    for order, bound in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
        if bound is None:
            continue
        found = extremes_of(trajectory.breaks, trajectory.coefficients, order)
        greatest = np.maximum(found.high, -found.low)
        stretch = max(stretch, float(np.max(share_of(greatest, bound))) ** (1 / order))
    return stretch


def _square_stretch_to_stand(moving: Array, resting: Array) -> float:
    """Return the least k^2 such that r + (m - r) / k^2 >= 0 for all edge moments, shape (T, k) each."""
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = (resting - moving) / resting
    needed = np.where(resting > 0, needed, np.inf)
    return float(np.where(moving < 0, needed, 1.0).max())


def _square_stretch(torque: Array, gravity: Array, limit: Array) -> float:
    """Return the least k^2 such that |g + (tau - g) / k^2| <= limit for all, shape (T, n) each."""
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = (torque - gravity) / (np.sign(torque) * limit - gravity)
    needed = np.where(np.abs(gravity) < limit, needed, np.inf)
    return float(np.where(np.abs(torque) > limit, needed, 1.0).max())
