"""Examination of a trajectory by code independent of what made it."""

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
"""Amount by which the bound on balance between the states examined may miss the requirement [m]."""
_TOUCH = 1e-9  # depth stated for a contact whose depth is not known [m]


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
    """Examine a trajectory: polynomials at their extremes, all else at close states with bounds between.

    The exact extremes of position, velocity, acceleration and jerk are compared with the robot's limits.
    Torques (by `pepper_kin.dynamics.newton_euler`), balance and the speeds of hands and wheels are computed
    every millisecond and on both sides of every knot.  A bound on how much worse each may be in between is
    proven, stated as `resolution` (`pepper_kin.trajectory.examined_states`), and counts: the bound may exceed
    a limit of torque or speed by 0.1 %, and miss the balance margin by 0.1 mm.  Where a millisecond is too
    long to prove that, the gap is divided into up to 16 parts.  None of this code is shared with the core
    that times trajectories.  Positions and velocities (and accelerations, where jerk is limited) must be
    continuous at knots; the zero-moment point must lie in the triangle of the wheels.

    Args:
        pepper: The robot.
        trajectory: The trajectory; its joints must be the robot's.
        scene: The `pepper_kin.collision.Scene` around the robot; None for no obstacles.  Clearance of the
            robot from itself is measured in any case.  Masses of attached objects count.  Moving obstacles
            are placed where they are at each time, and the growth of their uncertainty is subtracted from the
            distance.
        start_time: Time of the scene at which the motion begins [s], 0 or more.
        collisions: Whether collisions are examined; False leaves them out, and the result says so.
        margin: Distance to be kept from the scene's objects [m]; the robot's own parts must not touch.
        jerk: Jerk limits, by a name or number that `retime` takes; None to leave jerk out.
        balance: Distance that the zero-moment point is to keep from the edges of the wheels' triangle [m]; it
            is not examined for a robot without wheels, nor with None.
        hand_speed: Maximum speed of both hands' effectors, or of "left", "right" or a frame by name [m/s].
        payload: Point masses held at "left", "right" or a frame by name [kg].
        velocity_scale: Fraction of the velocity limits that the motion may use, also for wheels, in (0, 1].
        acceleration_scale: Fraction of the acceleration limits that the motion may use, in (0, 1]; jerk
            limits are not scaled.
        torque_scale: Fraction of the effort limits that the motion may use, in (0, 1].

    Returns:
        The certificate; its limits include the scales.

    Raises:
        InvalidValueError: if the trajectory's joints are not the robot's, in its order; or for an option out
            of range.
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
        """Compare the extremes of a derivative of the positions with its limits, shape (n,) each."""
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
    """Compare the extremes of a derivative of the positions with limits, shape (n,) each."""
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
    """Return the check of a quantity; `worst` are margins, values and times, shape (n,) each."""
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
    """Find the minimum distance of the zero-moment point from the edges of a polygon [m], shape (3, 2)."""

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
    """Return lower bounds on the zero-moment point's distance from an edge on the pieces [m], shape (m,).

    The distance is h / f, an edge moment over the floor's force.  Between two states, each deviates from
    linear interpolation by at most e = b g^2 / 8, with b the bound on its second derivative and g the gap.
    The quotient of the two interpolants is nowhere below the smaller value d at both ends, so that the
    distance is at least d - (e_h + |d| e_f) / (f - e_f); -inf where the floor's force may vanish.

    Args:
        polygon: Corners of the support polygon [m], shape (3, 2).
        examined: The states.
        margin: Distance at each state [m], shape (T,).
        force: Force of the floor at each state [N], shape (T,).
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
    """Compare speeds of frames, by Jacobians, with their limits; return the check nearest to its limit."""
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
        """Return the check of absolute values, shape (T, w), with bounds on second derivatives, (m, w)."""
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
    """Find the minimum distance to obstacles, or, if `margin` [m] is None, between the robot's own parts.

    Neighboring links that are decided by joint ranges have no distance: they touch or they do not.
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
