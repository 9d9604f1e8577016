"""How much of its limits a motion uses, and how much slower it would have to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.model import PepperModel
from pepper_kin.trajectory.balance import edge_moments, support_polygon
from pepper_kin.trajectory.payload import AtFrames, frame_speed_shares, joint_torque
from pepper_kin.trajectory.trajectory import State

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Limits:
    """What a trajectory may use; inf where there is no limit.

    Attributes:
        velocity: [rad/s or m/s], shape (n,).
        acceleration: [rad/s^2 or m/s^2], shape (n,).
        torque: [N m or N], shape (n,); None to leave torque out.
        balance: Distance of the zero-moment point from the edges of the support polygon [m]; None to leave
            balance out.
        payload: Masses held, by frame [kg]; they act on torque and balance.
        speed: Greatest speeds of frames' origins [m/s].
    """

    velocity: Array
    acceleration: Array
    torque: Array | None
    balance: float | None = None
    payload: AtFrames = ()
    speed: AtFrames = ()


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
        "velocity": np.abs(state.velocity).max(axis=0) / limits.velocity,
        "acceleration": np.abs(state.acceleration).max(axis=0) / limits.acceleration,
    }
    square = max(1.0, float(share["velocity"].max()) ** 2, float(share["acceleration"].max()))
    if limits.speed:
        share["frame speed"] = frame_speed_shares(pepper, limits.speed, *state[:2]).max(axis=0)
        square = max(square, float(share["frame speed"].max()) ** 2)
    if limits.torque is not None and np.isfinite(limits.torque).any():
        torque = joint_torque(pepper, limits.payload, *state)
        share["torque"] = np.abs(torque).max(axis=0) / limits.torque
        over = (np.abs(torque) > limits.torque).any(axis=1)
        if over.any():
            q = state.position[over]
            gravity = joint_torque(pepper, limits.payload, q, np.zeros_like(q), np.zeros_like(q))
            square = max(square, _square_stretch(torque[over], gravity, limits.torque))
    polygon = support_polygon(pepper) if limits.balance is not None else None
    if polygon is not None and limits.balance is not None:
        moving = edge_moments(pepper, polygon, *state, limits.balance, limits.payload)
        tipping = (moving < 0).any(axis=1)
        if tipping.any():
            still = np.zeros_like(state.position[tipping])
            q = state.position[tipping]
            resting = edge_moments(pepper, polygon, q, still, still, limits.balance, limits.payload)
            square = max(square, _square_stretch_to_stand(moving[tipping], resting))
    return LimitUse(share, float(np.sqrt(square)))


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
