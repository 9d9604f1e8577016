"""Examination of a trajectory by code other than what made it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin import kinematics
from pepper_kin.arrays import Array
from pepper_kin.collision.checked_shapes import PairsTo
from pepper_kin.collision.checked_world import LEFT_EMPTY, checked_world, is_left_empty
from pepper_kin.collision.loads import carrying
from pepper_kin.collision.solids import not_negative
from pepper_kin.dynamics import inverse_dynamics
from pepper_kin.dynamics.load import Loads
from pepper_kin.dynamics.newton_euler import newton_euler_of_motion
from pepper_kin.dynamics.support_polygon import checked_balance
from pepper_kin.model import PepperModel
from pepper_kin.model.at_frames import AtFrames
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.trajectory.balance import WheelLimits, floor_wrench, margin_of_wrench, support_polygon
from pepper_kin.trajectory.certificate import Certificate, LimitCheck, ScalarCheck
from pepper_kin.trajectory.examined_states import (
    ALLOWANCE,
    RELATIVE_TOLERANCE,
    Examined,
    Pieces,
    derivatives,
    examined_states,
    extremes_of,
    proven_clearance,
)
from pepper_kin.trajectory.limits import JerkLike, MotionLimits, jerk_limits, motion_limits, wheel_speeds
from pepper_kin.trajectory.path import LIMIT_TOLERANCE
from pepper_kin.trajectory.samples import State, refuse_other_joints, sample_times, unit_of
from pepper_kin.trajectory.stop import JUMP_TOLERANCE

if TYPE_CHECKING:
    from pepper_kin.collision import Scene
    from pepper_kin.trajectory.trajectory import Trajectory


BALANCE_TOLERANCE = 1e-7  # [m]
BALANCE_ALLOWANCE = 1e-4
"""What the bound on the zero-moment point may lack between the states examined [m]."""
_TOUCH = 1e-9  # [m] depth stated for a contact whose depth is not known


def check(
    pepper: PepperModel,
    trajectory: Trajectory,
    *,
    scene: Scene | None = None,
    start_time: float = 0.0,
    collisions: bool = True,
    margin: float = 0.0,
    jerk: JerkLike | None = None,
    balance: Balance = 0.0,
    hand_speed: float | Mapping[str, float] | None = None,
    payload: Mapping[str, float] | None = None,
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
    torque_scale: TorqueScale = 1.0,
) -> Certificate:
    """Examine a trajectory: polynomials at their extremes, all else closely and with bounds between.

    Position, velocity, acceleration and jerk are compared with the robot's limits where they are extreme,
    wherever that is (`pepper_kin.trajectory.examined_states`).  Torques are computed by
    `pepper_kin.dynamics.newton_euler`, like balance and the speeds of hands and wheels, every millisecond and
    on both sides of every knot; what each may be worse by in between is proven and stated as `resolution`
    (`pepper_kin.trajectory.examined_states`), and counts: a bound may be 0.1 % of a torque's or speed's limit
    beyond it, and lack 0.1 mm of balance.  Where a millisecond is too long to prove that, parts of it down to
    a sixteenth are looked at.  Nothing of this shares code with the core that times trajectories.
    Positions and velocities (and accelerations, where jerk is limited) must be continuous at knots; the
    zero-moment point must lie in the triangle of the wheels.

    Args:
        pepper: The robot.
        trajectory: The trajectory; its joints must be the robot's.
        scene: The `pepper_kin.collision.Scene` around the robot; None for nothing.  The clearance of
            the robot from itself is measured in any case.  The mass of attached objects counts.  Obstacles
            that move are where they are at each time, and what their uncertainty has grown by is taken off.
        start_time: Time of the scene at which the motion begins [s], 0 or more.
        collisions: Whether collisions are examined; False leaves them out, and the result says so.
        margin: Distance that is to be kept from the scene's objects [m]; the robot's own parts must not
            touch.
        jerk: As in `retime`.
        balance: As in `retime` [m]: the edge of the triangle unless more is asked; not looked at for a robot
            without wheels.
        hand_speed: As in `retime` [m/s].
        payload: As in `retime` [kg].
        velocity_scale: Share of the velocity limits that the motion may use, as in `retime`; of wheels, too.
        acceleration_scale: The same of accelerations; limits of jerk stay what they are, as in `retime`.
        torque_scale: The same of effort limits: all of them unless less is asked.

    Returns:
        The certificate, whose limits are the shares.

    Raises:
        InvalidValueError: where the trajectory's joints are not the robot's, in its order; or for an option
            out of range.
    """
    refuse_other_joints(pepper, trajectory.joint_names)
    world, kept_away = checked_world(scene, collisions), not_negative("margin", margin)
    kept = checked_balance(pepper, balance, if_wheeled=True)
    limits = motion_limits(
        pepper, velocity_scale=velocity_scale, acceleration_scale=acceleration_scale,
        torque_scale=torque_scale, balance=kept, hand_speed=hand_speed, payload=payload, scene=scene,
    )  # fmt: skip
    examined = examined_states(pepper, trajectory, limits.loads)
    rate = None if jerk is None else jerk_limits(pepper, jerk)
    polygon = None if kept is None else support_polygon(pepper)
    allowed = limits.of(pepper, pepper.acceleration_limits, drives=True)
    speeds = limits.speeds + wheel_speeds(pepper)

    def against(quantity: str, order: int, lower: Array, upper: Array) -> LimitCheck:
        """Compare a derivative of the positions with its limits, shape (n,) each."""
        return _at_extremes(pepper, quantity, trajectory, order, lower, upper)

    v, a, effort = allowed.velocity, allowed.acceleration, pepper.effort_limits * (limits.torque or 1.0)
    return Certificate(
        duration=trajectory.duration,
        samples=examined.time.size,
        step=examined.step,
        position=against("position", 0, pepper.lower_limits, pepper.upper_limits),
        velocity=against("velocity", 1, -v, v),
        acceleration=against("acceleration", 2, -a, a),
        torque=_torque(pepper, examined, limits.loads, effort),
        position_continuity=_continuity(trajectory, 0),
        velocity_continuity=_continuity(trajectory, 1),
        balance=None if polygon is None else _balance(pepper, polygon, examined, limits),
        obstacle_clearance=None
        if world is None or not world.objects
        else _clearance(pepper, trajectory, examined, world, start_time, kept_away),
        self_clearance=None
        if world is None
        else _clearance(pepper, trajectory, examined, world, start_time, None),
        jerk=None if rate is None else against("jerk", 3, -rate, rate),
        acceleration_continuity=None if rate is None else _continuity(trajectory, 2),
        hand_speed=_speed(pepper, examined, speeds) if speeds else None,
        **({} if allowed.wheels is None else _wheels(examined, allowed.wheels)),
    )


def _at_extremes(
    pepper: PepperModel, quantity: str, trajectory: Trajectory, order: int, lower: Array, upper: Array
) -> LimitCheck:
    """Compare a derivative of the positions with limits, shape (n,) each, where it is extreme."""
    found = extremes_of(trajectory.breaks, trajectory.coefficients, order)
    above = upper - found.high < found.low - lower
    value = np.where(above, found.high, found.low)
    time = np.where(above, found.high_time, found.low_time)
    margin = np.minimum(upper - found.high, found.low - lower)
    return _limit_check(pepper, quantity, (margin, value, time), lower, upper, np.zeros(pepper.n))


def _torque(pepper: PepperModel, examined: Examined, loads: Loads, limit: Array) -> LimitCheck:
    """Compare torques with limits, shape (n,) [N m or N]."""
    carrier = None if pepper.solvers == "fast" else carrying(pepper, loads)

    def torque_of(state: State) -> Array:
        """Return the torques of states, shape (T, n) [N m or N]."""
        if carrier is None:
            return np.asarray(newton_euler_of_motion(pepper, *state, loads))
        return np.asarray(inverse_dynamics(carrier, *state))

    joints, torque = np.arange(pepper.n), torque_of(examined.state)
    at = np.argmax(np.abs(torque), axis=0)
    value = torque[at, joints]
    worst = limit - np.abs(value), value, examined.time[at]
    second = examined.bounds.torque()
    between = examined.between(lambda state: np.abs(torque_of(state)), np.abs(torque), second, limit)
    return _limit_check(pepper, "torque", worst, -limit, limit, np.where(np.isfinite(limit), between, 0.0))


def _limit_check(
    pepper: PepperModel,
    quantity: str,
    worst: tuple[Array, Array, Array],
    lower: Array,
    upper: Array,
    resolution: Array,
) -> LimitCheck:
    """Return what was found; `worst` are margins, values and times, shape (n,) each."""
    units = tuple(unit_of(quantity, unit) for unit in pepper.joint_units)
    with np.errstate(invalid="ignore"):
        tolerance = np.where(np.isfinite(upper - lower), RELATIVE_TOLERANCE * (upper - lower) / 2, 0.0)
    if quantity == "position":
        tolerance = np.maximum(tolerance, LIMIT_TOLERANCE)
    margin, value, time = worst
    return LimitCheck(
        quantity=quantity,
        joint_names=pepper.joint_names,
        units=units,
        margin=margin,
        value=value,
        lower=lower,
        upper=upper,
        time=time,
        tolerance=tolerance,
        resolution=resolution,
        allowance=np.where(np.isfinite(upper), ALLOWANCE * upper, 0.0) if quantity == "torque" else 0 * value,
    )


def _continuity(trajectory: Trajectory, order: int) -> ScalarCheck:
    quantity = ("position", "velocity", "acceleration")[order]
    step, segments = np.diff(trajectory.knots), np.arange(trajectory.knots.size - 1)
    before = derivatives(trajectory, segments[:-1], step[:-1], order + 1)[-1]
    after = derivatives(trajectory, segments[1:], 0.0 * step[1:], order + 1)[-1]
    jumps = np.abs(after - before)
    worst, time, joint = 0.0, 0.0, trajectory.joint_names[0]
    if jumps.size:
        knot, index = np.unravel_index(int(np.argmax(jumps)), jumps.shape)
        worst, time = float(jumps[knot, index]), float(trajectory.knots[knot + 1])
        joint = trajectory.joint_names[index]
    unit = ("rad or m", "rad/s or m/s", "rad/s^2 or m/s^2")[order]
    detail = f"is the greatest jump at a knot ({joint})"
    return ScalarCheck(f"{quantity} continuity", JUMP_TOLERANCE - worst, worst, time, unit, detail)


def _balance(pepper: PepperModel, polygon: Array, examined: Examined, limits: MotionLimits) -> ScalarCheck:
    """Find the least distance of the zero-moment point from the edges of a polygon [m], shape (3, 2)."""

    def margins(of: Examined) -> tuple[Array, Array]:
        """Return the distances at states [m], and the floor's force there [N], shape (T,) each."""
        wrench = floor_wrench(pepper, *of.state, limits.loads)
        return np.asarray(margin_of_wrench(pepper, polygon, of.state.position, wrench)), wrench[:, 2]

    def bound(of: Examined) -> Array:
        """Return bounds on -distance on the pieces [m], shape (m, 1)."""
        return -_least_balance(polygon, of, *margins(of))[:, None]

    margin, force = margins(examined)
    at = int(np.argmin(margin))
    worst, least = float(margin[at]), limits.balance or 0.0
    most = BALANCE_ALLOWANCE - least if worst - least + BALANCE_TOLERANCE >= 0 else np.inf
    proven = examined.proven(
        -_least_balance(polygon, examined, margin, force)[:, None], bound, np.array([most])
    )
    detail = "from the zero-moment point to the edge of the wheels' triangle (negative: outside)"
    return ScalarCheck(
        "balance", worst - least + BALANCE_TOLERANCE, worst, float(examined.time[at]), "m",
        detail, max(float(proven[0]) + worst, 0.0), allowance=BALANCE_ALLOWANCE,
    )  # fmt: skip


def _least_balance(polygon: Array, examined: Examined, margin: Array, force: Array) -> Array:
    """Return what the zero-moment point's distance from an edge is at least on the pieces [m], shape (m,).

    It is h / f, of an edge moment over the floor's force, both of which lie between their values at two
    states to b g^2 / 8, with b the bound on the second derivative and g the gap.  The quotient of the lines
    between these values is nowhere below its lesser end d, so that the distance is at least
    d - (e_h + |d| e_f) / (f - e_f); -inf where the floor's force may vanish.

    Args:
        polygon: Corners of the support polygon [m], shape (3, 2).
        examined: The states.
        margin: Distances at the states [m], shape (T,).
        force: The floor's force there [N], shape (T,).
    """
    pull, moment = examined.bounds.floor()
    reach = float(np.linalg.norm(polygon, axis=1).max())  # no edge is farther from the base's origin
    share = examined.gap**2 / 8
    edge_error, force_error = share * (moment + reach * pull), share * pull
    nearest, lightest = np.full(share.size, np.inf), np.full(share.size, np.inf)
    np.minimum.at(nearest, examined.part, margin)
    np.minimum.at(lightest, examined.part, force)
    left = lightest - force_error
    known = np.isfinite(nearest) & (left > 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(known, nearest - (edge_error + np.abs(nearest) * force_error) / left, -np.inf)


def _speed(pepper: PepperModel, examined: Examined, speeds: AtFrames) -> ScalarCheck:
    """Compare the speeds of frames, by Jacobians, with their limits; report the one that uses most."""
    found = []
    for frame, limit in speeds:

        def speed_of(state: State, frame: str = frame) -> Array:
            """Return the frame's speed at states [m/s], shape (T, 1)."""
            jacobian = kinematics.frame_jacobian(pepper, state.position, frame)[:, :3]
            return np.linalg.norm(np.einsum("tij,tj->ti", jacobian, state.velocity), axis=1, keepdims=True)

        size, second = speed_of(examined.state), examined.bounds.frame_speed(frame)[:, None]
        speed, most = size[:, 0], np.array([limit])
        at = int(np.argmax(speed))
        between = float(examined.between(speed_of, size, second, most)[0])
        found.append(
            (float(speed[at]) / limit, float(speed[at]), limit, float(examined.time[at]), frame, between)
        )
    _, value, limit, time_at, frame, between = max(found)
    margin = limit * (1 + RELATIVE_TOLERANCE) - value
    return ScalarCheck(
        "hand speed", margin, value, time_at, "m/s", f"of {frame}", between, limit, ALLOWANCE * limit
    )


def _wheels(examined: Examined, wheels: WheelLimits) -> dict[str, ScalarCheck]:
    """Compare speeds and accelerations of wheels, and the speed of the base, with their limits."""
    along, side = np.hypot(wheels.rows[:, 0], wheels.rows[:, 1]), np.abs(wheels.rows[:, 2])

    def worst(
        name: str,
        of: Callable[[State], Array],
        second: Array,
        limit: float,
        names: tuple[str, ...],
        unit: str,
    ) -> Any:
        """Return the check of sizes, shape (T, w), with second derivatives of at most `second`, (m, w)."""
        size = of(examined.state)
        at, row = np.unravel_index(int(np.argmax(size)), size.shape)
        most = np.full(size.shape[1], limit)
        value, between = float(size[at, row]), examined.between(of, size, second, most)
        highest = size.max(axis=0) + between
        margin = limit * (1 + RELATIVE_TOLERANCE) - value
        when, which = float(examined.time[at]), f"of {names[row]}"
        beyond = float(highest.max()) - value
        return ScalarCheck(name, margin, value, when, unit, which, beyond, limit, ALLOWANCE * limit)

    found = {}
    for name, size_of, order, limit in (
        ("wheel speed", lambda state: np.abs(wheels.speeds(*state[:2])), 2, wheels.speed),
        ("wheel acceleration", lambda state: np.abs(wheels.accelerations(*state)), 3, wheels.acceleration),
    ):
        linear, turning = examined.bounds.twist(order)
        second = linear[:, None] * along + turning[:, None] * side
        unit = f"{wheels.unit}/s" + ("^2" if order == 3 else "")
        found[name.replace(" ", "_")] = worst(name, size_of, second, limit, wheels.names, unit)
    linear, turning = examined.bounds.twist(2)
    second = (linear + wheels.lever * turning)[:, None]

    def base_speed(state: State) -> Array:
        """Return the base's speed, shape (T, 1) [m/s]."""
        return np.asarray(wheels.base_speeds(*state[:2]))[:, None]

    found["base_speed"] = worst("base speed", base_speed, second, wheels.base_speed, ("the base",), "m/s")
    return found


def _clearance(
    pepper: PepperModel,
    trajectory: Trajectory,
    examined: Examined,
    scene: Scene,
    start_time: float,
    margin: float | None,
) -> ScalarCheck:
    """Find the least distance to obstacles, or, without a margin [m], to itself; see `proven_clearance`.

    Neighbors decided by joint ranges count as yes or no.
    """
    to: PairsTo = "self" if margin is None else "obstacles"
    least = margin or 0.0
    count = sample_times(trajectory.duration, examined.step).size
    begin = not_negative("start_time", start_time)
    pieces = Pieces(examined.breaks, examined.rates)
    times = examined.time[:count]
    found, time, bound, forbidden = proven_clearance(
        pepper, trajectory, times, pieces, scene, begin, to, least
    )
    worst = found.distance
    pair = "" if found.pair is None else " between " + " and ".join(found.pair.names)
    detail = f"is the least distance{pair}"
    if forbidden is not None and worst > 0:
        worst, bound, time = -_TOUCH, -_TOUCH, forbidden
        detail = "two neighboring links touch, by their joint ranges"
    if bound <= least < worst:
        detail += ", too small to prove that " + (f"{least:g} m are kept" if least else "nothing touches")
    if to == "self" and is_left_empty(scene):
        detail += f" ({LEFT_EMPTY})"
    name = "obstacle_clearance" if to == "obstacles" else "self_clearance"
    between = worst - bound if np.isfinite(worst) else 0.0
    return ScalarCheck(name, bound - least, worst, time, "m", detail, between, least or None)
