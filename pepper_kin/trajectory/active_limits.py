"""Fractions of its limits that a motion uses: the slowdown needed, and the limit that acts at each time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array, BriefRepr, read_only
from pepper_kin.dynamics.support_polygon import inner_radius
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import as_batch, as_finite
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.trajectory.balance import balance_margin, moves_base, support_polygon
from pepper_kin.trajectory.examined_states import extremes_of
from pepper_kin.trajectory.limits import (
    JerkLike,
    LimitedQuantities,
    Limits,
    jerk_limits,
    motion_limits,
    share_of,
    wheel_speeds,
)
from pepper_kin.trajectory.samples import State, examination_step, refuse_other_joints, sample_times

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.trajectory.trajectory import Trajectory

_ACTS = 0.99  # minimum fraction of a limit at which it counts as active


@dataclass(frozen=True, eq=False)
class LimitUse:
    """Maximum fractions of the limits that some states use.

    Attributes:
        share: Quantity -> fraction of its limit that each joint (or limited frame) uses, shape (n,).
        stretch: Minimum k >= 1 such that a motion k times as slow obeys all limits; inf if none does.
    """

    share: dict[str, Array]
    stretch: float


def measure_use(pepper: PepperModel, state: State, limits: Limits) -> LimitUse:
    """Return the fractions of limits that states use, and the slowdown needed.

    Made k times as slow, a motion has velocity v / k, acceleration a / k^2 and torque g + (tau - g) / k^2.

    Args:
        pepper: The robot.
        state: Positions, velocities and accelerations, shape (T, n) each.
        limits: The limits.

    Returns:
        The fractions used, and the factor by which the motion would have to be slower.
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
    """Return the minimum k >= 1 such that a motion k times as slow keeps velocity, acceleration and jerk.

    Extremes of the polynomials are compared, not samples; made k times as slow, a motion has jerk j / k^3.

    Args:
        trajectory: The motion.
        limits: The limits; only the joints' velocity, acceleration and jerk limits count.
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
    """Return the minimum k^2 such that r + (m - r) / k^2 >= 0 for all edge moments, shape (T, k) each."""
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = (resting - moving) / resting
    needed = np.where(resting > 0, needed, np.inf)
    return float(np.where(moving < 0, needed, 1.0).max())


def _square_stretch(torque: Array, gravity: Array, limit: Array) -> float:
    """Return the minimum k^2 such that |g + (tau - g) / k^2| <= limit for all, shape (T, n) each."""
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = (torque - gravity) / (np.sign(torque) * limit - gravity)
    needed = np.where(np.abs(gravity) < limit, needed, np.inf)
    return float(np.where(np.abs(torque) > limit, needed, 1.0).max())


@dataclass(frozen=True, eq=False)
class ActiveLimits(BriefRepr):
    """The limit that is used most at each instant; arrays are read-only.

    Attributes:
        time: Times [s], shape (T,).
        names: Quantity and joint (or frame), such as "velocity LElbowYaw", shape (T,).
        share: Fraction of that limit that is used, shape (T,).
    """

    time: Array
    names: NDArray[np.str_]
    share: Array

    @property
    def active(self) -> NDArray[np.bool_]:
        """Whether the limit is used to 99 % or more, so that it holds the motion back, shape (T,)."""
        return self.share >= _ACTS

    def report(self) -> str:
        """Return for each limit the fraction of the time at which it is active, as text with a line each."""
        active, total = self.active, self.time.size
        names, counts = np.unique(self.names[active], return_counts=True)
        lines = [
            f"  {count / total:6.1%}  {name}"
            for name, count in sorted(zip(names, counts, strict=True), key=lambda pair: -pair[1])
        ]
        return "\n".join([f"A limit acts for {active.mean():.1%} of the time:", *lines])


def active_limits(
    pepper: PepperModel,
    trajectory: Trajectory,
    t: ArrayLike | None = None,
    *,
    torque: bool = True,
    balance: Balance = "robot",
    hand_speed: float | Mapping[str, float] | None = None,
    payload: Mapping[str, float] | None = None,
    jerk: JerkLike | None = None,
    scene: Scene | None = None,
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
    torque_scale: TorqueScale = "robot",
) -> ActiveLimits:
    """Return the limit that is used most at each instant of a trajectory.

    The fractions used are |v| / v_max, |a| / a_max, |tau| / tau_max, speed over its limit and |j| / j_max;
    for balance 1 - (d - d_min) / (r - d_min), with d the distance of the zero-moment point from the nearest
    edge, d_min the distance to be kept and r the inradius of the wheels' triangle.  For a base on wheels, the
    speeds and accelerations of the wheels and the speed of the base count, too.

    Args:
        pepper: The robot.
        trajectory: The trajectory.
        t: Times [s], shape (T,); every millisecond if omitted.
        torque: Whether torque limits count.
        balance: Distance that the zero-moment point is to keep from the edges of the wheels' triangle [m];
            "robot" for the robot's requirement, None to leave balance out.
        hand_speed: Maximum speed of both hands' effectors, or of "left", "right" or a frame by name [m/s].
        payload: Point masses held at "left", "right" or a frame by name [kg].
        jerk: Jerk limits, by a name or number that `retime` takes; None to leave jerk out.
        scene: The scene whose attached objects count with their mass; None for none.
        velocity_scale: Fraction of the velocity limits that counts as the limit, in (0, 1].
        acceleration_scale: Fraction of the acceleration limits that counts as the limit, in (0, 1].
        torque_scale: Fraction of the effort limits that counts as the limit, in (0, 1]; "robot" for the
            robot's requirement.

    Returns:
        Times, names of the limits and fractions used.

    Raises:
        InvalidValueError: for another robot's trajectory, times that are not finite numbers, or an option
            that is not allowed.
    """
    refuse_other_joints(pepper, trajectory.joint_names)
    step = examination_step(trajectory.duration)
    if t is None:
        time = sample_times(trajectory.duration, step)
    else:
        time = as_finite(np.atleast_1d(as_batch(t, "t", ())), "t", (None,))
    state = trajectory(time)
    allowed = motion_limits(
        pepper, velocity_scale=velocity_scale, acceleration_scale=acceleration_scale,
        torque_scale=torque_scale, torque=torque, balance=balance, hand_speed=hand_speed, payload=payload,
        scene=scene,
    )  # fmt: skip
    allowed = allowed._replace(speeds=allowed.speeds + wheel_speeds(pepper))
    limits = allowed.of(pepper, pepper.acceleration_limits, drives=moves_base(pepper))
    columns = _shares(pepper, limits, state)
    if jerk is not None:
        rate = share_of(np.abs(trajectory.jerk(time)), jerk_limits(pepper, jerk))
        columns += _named("jerk", pepper.joint_names, rate)
    polygon = support_polygon(pepper)
    if limits.balance is not None and polygon is not None:
        margin = balance_margin(pepper, polygon, *state, limits.loads) - limits.balance
        columns.append(("balance", 1.0 - margin / (inner_radius(polygon) - limits.balance)))
    table = np.stack([share for _, share in columns], axis=1)
    most = np.argmax(table, axis=1)
    names = np.array([name for name, _ in columns])[most]
    names.setflags(write=False)
    return ActiveLimits(read_only(time), names, read_only(table[np.arange(time.size), most]))


def _shares(pepper: PepperModel, limits: Limits, state: State) -> list[tuple[str, Array]]:
    """Return for each limit its name and the fraction of it that is used, shape (T,)."""
    quantities, joints, n = LimitedQuantities(pepper, limits), pepper.joint_names, pepper.n
    columns = _named("velocity", joints, share_of(np.abs(state.velocity), limits.velocity))
    columns += _named("acceleration", joints, share_of(np.abs(state.acceleration), limits.acceleration))
    wheels = () if limits.wheels is None else limits.wheels.names
    if quantities.torque_limit.size:
        use = share_of(np.abs(quantities.torque(*state)), quantities.torque_limit)
        rows = len(wheels)
        columns += _named("torque", joints if use.shape[1] == n + rows else (), use)
        columns += _named("acceleration", wheels, use[:, use.shape[1] - rows :])
    if quantities.frames:
        names = (*(frame for frame, _ in limits.speed), *wheels, *(("the base",) if wheels else ()))
        columns += _named("speed", names, quantities.speed(state.position, state.velocity))
    return columns


def _named(quantity: str, names: Iterable[str], shares: Array) -> list[tuple[str, Array]]:
    """Return (quantity and name, column) pairs for the columns of `shares`, shape (T, k or more)."""
    return [(f"{quantity} {name}", shares[:, k]) for k, name in enumerate(names)]
