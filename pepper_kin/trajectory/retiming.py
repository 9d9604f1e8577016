"""Time-optimal trajectories along a path within every limit.

On a grid that contains all breaks of the path, the path's acceleration u = d2s/dt2 is constant between grid
points, and the motion is the fastest that keeps |q'(s) ds/dt|, |q'(s) u + q''(s) x| and |a(s) u + b(s) x +
c(s)|, x = (ds/dt)^2, within the limits of velocity, acceleration and torque at both ends of every interval
(TOPP-RA: H. Pham and Q.-C. Pham, IEEE Trans. Robotics 34, 2018).  s(t) is then quadratic on each interval and
q(s(t)) a polynomial of degree 6, which is returned: positions lie on the path exactly, velocities are
continuous, accelerations jump.  The excess of the duration over the optimum is inversely proportional to the
number of grid points: on random five-point paths of the whole body 1.4 % with 100, 0.6 % with 200, 0.2 % with
400.

Between grid points the limits could be exceeded slightly.  Therefore the result is examined there, the limits
are tightened if necessary, and the last excess is removed by stretching time: velocity, acceleration and jerk
keep their limits at every instant, all other quantities at grid points and at every multiple of 1 ms; `check`
bounds the excess in between.

With jerk limits, accelerations are continuous too; see `pepper_kin.trajectory.jerk_retiming`.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array
from pepper_kin.core.timing.kinks import find_kinks
from pepper_kin.core.timing.whole_timing import CHECK_STEP, LONGEST_MOTION
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.joint_vectors import as_joint_vector, check_choice, check_positive, check_whole
from pepper_kin.model.missing_limits import LimitsLike, completed_limits
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.trajectory.active_limits import measure_use
from pepper_kin.trajectory.editing import joined
from pepper_kin.trajectory.limits import (
    JerkLike,
    Limits,
    MotionLimits,
    jerk_limits,
    motion_limits,
    moving_joints,
    refuse_motionless,
    wheel_speeds,
)
from pepper_kin.trajectory.path import CubicPath, PathLike, as_cubic_path, start_rates
from pepper_kin.trajectory.samples import sample_times
from pepper_kin.trajectory.time_optimal import TimingProblem, TooLongError, fastest_motion
from pepper_kin.trajectory.trajectory import Trajectory

if TYPE_CHECKING:
    from pepper_kin.collision import Scene


SOLVERS = ("fast", "toppra")
_MOST_POINTS = 50_000
_TOLERANCE = 1e-9  # violation attributed to rounding, relative to the limit
_KINK = 1e-3  # relative jump of the derivative that counts as a kink; rounding in files makes smaller ones


def retime(
    pepper: PepperModel,
    path: PathLike,
    *,
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
    torque_scale: TorqueScale = "robot",
    torque: bool = True,
    balance: Balance = "robot",
    hand_speed: float | Mapping[str, float] | None = None,
    payload: Mapping[str, float] | None = None,
    jerk: JerkLike | None = None,
    acceleration_limits: LimitsLike | None = None,
    duration: float | None = None,
    gridpoints: int = 200,
    solver: str = "robot",
    scene: Scene | None = None,
    path_speed: float | None = None,
    start_velocity: ArrayLike | None = None,
    start_acceleration: ArrayLike | None = None,
) -> Trajectory:
    """Return the time-optimal trajectory along a plan or another path, to rest.

    Args:
        pepper: The robot, which gives the limits; infinite velocity and effort limits do not act.
        path: A plan, or a piecewise cubic curve such as `Plan.curve` or `pepper_kin.planners.SmoothPath`,
            which is followed exactly, with a stop at each kink; or waypoints [rad or m], shape (k, n),
            joined by a cubic spline that leaves the polyline between them (see
            `pepper_kin.trajectory.path.as_cubic_path`).
        velocity_scale: Fraction of the velocity limits to use, in (0, 1].
        acceleration_scale: Fraction of the acceleration limits to use, in (0, 1].
        torque_scale: Fraction of the effort limits to use, in (0, 1]; "robot" for the value that a plan was
            made with, or else of `pepper.requirements`: 0.9 for Pepper, so that servos can correct errors.
        torque: Whether to keep within the effort limits.
        balance: Distance that the zero-moment point keeps from the edges of the wheels' triangle [m]; "robot"
            as for `torque_scale`, 10 mm for Pepper; None only if the base is held, because the robot may tip
            over.
        hand_speed: Maximum speed of both hands' effectors, or of "left", "right" or a frame by name [m/s].
        payload: Point masses held at "left", "right" or a frame by name [kg], besides attached objects; they
            act on torque and balance.
        jerk: "gentle", "moderate" or "brisk" (5, 10 or 30 times the acceleration limits in a second), another
            such factor [1/s], or limits [rad/s^3 or m/s^3], shape (n,); None for no jerk limits.
        acceleration_limits: One number for all joints without an acceleration limit in the model, or limits
            by joint name [rad/s^2 or m/s^2]; infinity if other limits suffice.  `load_robot` takes this
            option once for all motions.
        duration: Duration of the trajectory [s]: the fastest motion is slowed down evenly, which keeps
            limits; None for the fastest.
        gridpoints: Minimum number of intervals of the grid, 2 to 50,000.
        solver: "fast", this library's own, or "toppra", the package of that name, as reference; "robot" for
            the choice in the robot's `solvers`.
        scene: The scene whose attached objects count with their mass; None for the loads of the plan.
        path_speed: Maximum rate of the curve's parameter [1/s; m/s if the parameter is a length in meters];
            None for no such limit.  Not with `jerk` or solver="toppra".
        start_velocity: Initial velocity [rad/s or m/s], shape (n,), in the initial direction of a curve; a
            spline through waypoints is made to begin in that direction.  Not with `duration` or
            solver="toppra".
        start_acceleration: Initial acceleration of a motion with jerk limits [rad/s^2 or m/s^2], shape (n,):
            the one that a curve's curvature requires at `start_velocity`, plus any along the curve; a spline
            through waypoints is made to fit.  None for d2s/dt2 = 0 at the start.

    Returns:
        The trajectory; `Trajectory.active_limits` tells which limit acts at each instant.

    Raises:
        InvalidValueError: for an option out of range; one waypoint, repeated waypoints or a path of zero
            length; NaN; a joint that moves and has no limit of acceleration; a path along which no limit
            acts; or a path that does not begin along `start_velocity`.
        UnknownNameError: for a frame or joint that the robot lacks, or a name of jerk limits.
        LimitError: if the path leaves the position limits, naming the joint.
        InfeasibleError: if torque limits forbid the path, naming joint, static torque, limit and place; for a
            motion of more than an hour, naming the scales; if the robot would tip over even at rest; if
            `duration` is shorter than the fastest motion; for a `start_velocity` that violates limits, naming
            the factor that would not; or for a plan that failed, with its reason.
    """
    if check_choice("solver", solver, ("robot", *SOLVERS)) == "robot":
        solver = "fast" if pepper.solvers == "fast" else "toppra"
    requested = None if duration is None else check_positive("duration", duration, "s")
    greatest = pepper.acceleration_limits
    if acceleration_limits is not None:
        greatest = completed_limits(pepper.joint_names, greatest, acceleration_limits)
    rate = _jerk_rate(pepper, jerk, greatest)
    allowed = motion_limits(
        pepper, velocity_scale=velocity_scale, acceleration_scale=acceleration_scale,
        torque_scale=torque_scale, torque=torque, balance=balance, hand_speed=hand_speed, payload=payload,
        scene=scene, along=path,
    )  # fmt: skip
    fast = solver == "fast"
    _refuse_together("path_speed", path_speed, rate is not None or not fast)
    _refuse_together("start_velocity", start_velocity, requested is not None or not fast)
    _refuse_together("start_acceleration", start_acceleration, rate is None)
    curve, *start = _begun(pepper, path, start_velocity, start_acceleration)
    limits = _limits_along(pepper, curve, allowed, greatest, acceleration_limits)
    if path_speed is not None:
        limits = replace(limits, path_speed=check_positive("path_speed", path_speed, "1/s"))
    count = check_whole("gridpoints", gridpoints, 2, _MOST_POINTS)
    try:
        parts = [(part, [0.0, 0.0] if k else start) for k, part in enumerate(_without_kinks(curve))]
        timed = [_timed(pepper, part, limits, rate, count, solver, at) for part, at in parts]
    except TooLongError as error:
        raise _too_long(error.duration, allowed[:3]) from None
    trajectory = functools.reduce(joined, timed)
    return trajectory if requested is None else _last(pepper, trajectory, requested, limits)


_TOGETHER = {
    "path_speed": (None, "None with `jerk`, and with another solver"),
    "start_velocity": ("with duration or toppra", "none of these"),
    "start_acceleration": ("without jerk", "with `jerk`: else accelerations jump"),
}
"""Option of `retime` -> the rejected combination (None: the option's value), and what is allowed."""


def _refuse_together(name: str, value: object, wrong: bool) -> None:
    """Refuse an option that is given but cannot be combined with the others.

    Raises:
        InvalidValueError: for such an option, naming it.
    """
    if value is not None and wrong:
        got, allowed = _TOGETHER[name]
        raise InvalidValueError(name, value if got is None else got, allowed)


def _jerk_rate(pepper: PepperModel, jerk: JerkLike | None, acceleration: Array) -> Array | None:
    """Return the jerk limits [rad/s^3 or m/s^3], shape (n,); None if none acts."""
    rate = None if jerk is None else _where_joints_move(jerk_limits(pepper, jerk, acceleration))
    return None if rate is None or np.isinf(rate).all() else rate


def _begun(
    pepper: PepperModel, path: PathLike, velocity: ArrayLike | None, acceleration: ArrayLike | None
) -> tuple[CubicPath, float, float]:
    """Return a path as a curve, and the motion's initial ds/dt and d2s/dt2."""
    if velocity is None and acceleration is None:
        return as_cubic_path(pepper, path), 0.0, 0.0
    first = np.zeros(pepper.n) if velocity is None else as_joint_vector(pepper, velocity, "start_velocity")
    second = None
    if acceleration is not None:
        second = as_joint_vector(pepper, acceleration, "start_acceleration")
    if not (first.any() or (second is not None and second.any())):
        return as_cubic_path(pepper, path), 0.0, 0.0
    curve = as_cubic_path(pepper, path, (first, second))
    return curve, *start_rates(curve, first, second)


def _limits_along(
    pepper: PepperModel, curve: CubicPath, allowed: MotionLimits, greatest: Array, named: LimitsLike | None
) -> Limits:
    """Return the limits of a motion along a curve, after checks that each moving joint has limits.

    Args:
        pepper: The robot.
        curve: The path.
        allowed: Fractions of limits, and further limits, that the caller chose.
        greatest: Acceleration limits [rad/s^2 or m/s^2], shape (n,).
        named: Acceleration limits that the caller named; None for none.

    Raises:
        InfeasibleError: for a joint that moves and whose limit is 0.
        InvalidValueError: for a moving joint without acceleration limit, or if no limit bounds the motion.
    """
    drives = _drives(pepper, curve.coefficients)
    if named is None:
        limits = _kept_limits(pepper, allowed, drives)
        if _has_all_limits(pepper):
            return limits
    else:
        limits = _limits(pepper, greatest, allowed, drives)
    refuse_motionless(pepper, curve.coefficients, greatest, "trajectory")
    _refuse_missing(pepper, curve.coefficients, named)
    _refuse_unbounded(curve.coefficients, limits)
    return limits


def _limits(pepper: PepperModel, greatest: Array, allowed: MotionLimits, drives: bool) -> Limits:
    """Return the limits of a motion.

    Args:
        pepper: The robot.
        greatest: Acceleration limits [rad/s^2 or m/s^2], shape (n,).
        allowed: Fractions of limits, and further limits, that the caller chose.
        drives: Whether the base moves, so that its wheels count.
    """
    made = allowed.of(pepper, greatest, drives=drives)
    return replace(
        made,
        velocity=_where_joints_move(made.velocity),
        acceleration=_where_joints_move(made.acceleration),
        speed=made.speed + (wheel_speeds(pepper) if drives else ()),
    )


@kept_for_robot(most=32)
def _kept_limits(pepper: PepperModel, allowed: MotionLimits, drives: bool) -> Limits:
    """Return limits with the robot's own acceleration limits; cached, so that tables for them are reused."""
    return _limits(pepper, pepper.acceleration_limits, allowed, drives)


@kept_for_robot(most=1)
def _has_all_limits(pepper: PepperModel) -> bool:
    """Whether all joints have limits of velocity and acceleration, finite and above zero."""
    both = np.concatenate([pepper.velocity_limits, pepper.acceleration_limits])
    return bool((np.isfinite(both) & (both > 0)).all())


def _where_joints_move(limits: Array) -> Array:
    """Return limits, shape (n,), with inf in place of zero: joints with zero limits rest."""
    return np.where(limits == 0, np.inf, limits)


def _drives(pepper: PepperModel, coefficients: Array) -> bool:
    """Whether a curve, coefficients of shape (m, 4, n), moves the base."""
    if not set(BASE_JOINTS) <= set(pepper.joint_names):
        return False
    places = [pepper.joint_index(joint) for joint in BASE_JOINTS]
    return bool(np.any(coefficients[:, 1:, places]))


def _too_long(duration: float, shares: tuple[float, float, float | None]) -> InfeasibleError:
    """Return the error for a motion that is too long to be examined, with the scales that cause it."""
    names = ("velocity_scale", "acceleration_scale", "torque_scale")
    asked = ", ".join(
        f"{name}={share:.4g}" for name, share in zip(names, shares, strict=True) if share is not None
    )
    return InfeasibleError(
        "trajectory",
        f"with {asked} it takes {duration:.4g} s or more, and at most {LONGEST_MOTION:.0f} s are "
        "allowed, because limits are checked every millisecond",
        "raise the scales or other limits, leave torque out, or time parts of the path one by one",
    )


def _without_kinks(curve: CubicPath) -> list[CubicPath]:
    """Return the parts of a curve between kinks: the motion stops where the path's direction jumps."""
    kinks = np.empty(len(curve.coefficients), np.int64)
    count = find_kinks(curve.breaks, curve.coefficients, _KINK, kinks)
    if not count:
        return [curve]
    kinks = kinks[:count]
    ends = [0, *kinks.tolist(), len(curve.breaks) - 1]
    return [CubicPath(curve.breaks[a : b + 1], curve.coefficients[a:b]) for a, b in itertools.pairwise(ends)]


def grid_parameters(curve: CubicPath, intervals: int) -> Array:
    """Return the parameters at the knots of the motion that `retime` makes of a curve, shape (N + 1,)."""
    found = [curve.breaks[:1]]
    for part in _without_kinks(curve):
        steps = np.diff(part.breaks)
        counts = np.maximum(1, np.ceil(intervals * steps / (part.breaks[-1] - part.breaks[0]) - 1e-9)).astype(
            int
        )
        for begin, end, count in zip(part.breaks[:-1], part.breaks[1:], counts, strict=True):
            found.append(np.linspace(begin, end, count + 1)[1:])
    return np.concatenate(found)


def _timed(
    pepper: PepperModel, curve: CubicPath, limits: Limits, jerk: Array | None, intervals: int, solver: str,
    start: list[float],
) -> Trajectory:  # fmt: skip
    """Return the fastest trajectory along a smooth curve; `start` is the initial ds/dt and d2s/dt2."""
    problem = TimingProblem(pepper, curve.breaks, curve.coefficients, intervals, limits)
    if solver == "fast":
        trajectory = fastest_motion(problem, start[0] if jerk is None else 0.0)
    else:
        from pepper_kin.trajectory.toppra_solver import toppra_motion

        problem.fill()
        trajectory = toppra_motion(pepper, problem, limits)
    if jerk is None:
        return trajectory
    s = problem.grid.s.copy()
    from pepper_kin.trajectory.jerk_retiming import limit_jerk

    return limit_jerk(pepper, curve, trajectory, s, replace(limits, jerk=jerk), (start[0], start[1]))


def _last(pepper: PepperModel, trajectory: Trajectory, duration: float, limits: Limits) -> Trajectory:
    """Return the trajectory slowed to a duration [s]: torques and edge moments approach those at rest."""
    if duration < trajectory.duration * (1 - _TOLERANCE):
        raise InfeasibleError(
            "trajectory",
            f"the limits require {trajectory.duration:.6g} s along this path, "
            f"and duration is {duration:.6g} s",
            "give a longer duration, or raise the scales of the limits",
        )
    slow = trajectory.with_duration(max(duration, trajectory.duration))
    state = slow(sample_times(slow.duration, max(CHECK_STEP, slow.duration / 2000)))
    if measure_use(pepper, state, limits).stretch > 1.0 + 1e-6:
        raise InfeasibleError(
            "trajectory",
            f"of {duration:.6g} s: the path passes a posture that the robot can move through "
            "but cannot hold at rest",
            "leave the duration out, or choose a path with less load",
        )
    return slow


def _refuse_missing(pepper: PepperModel, coefficients: Array, named: LimitsLike | None) -> None:
    """Refuse a curve, shape (m, 4, n), that moves joints without a stated acceleration limit."""
    missing = ~np.isfinite(pepper.acceleration_limits)
    if not missing.any():
        return
    missing &= moving_joints(coefficients)
    said = named if isinstance(named, Mapping) else pepper.joint_names if named is not None else ()
    names = [pepper.joint_names[j] for j in np.flatnonzero(missing) if pepper.joint_names[j] not in said]
    if names:
        raise InvalidValueError(
            "acceleration_limits",
            f"none for {', '.join(names)}, and the robot's description has none",
            "one number for all, or numbers by joint name [rad/s^2 or m/s^2], here or in load_robot "
            "(infinity where other limits will do)",
        )


def _refuse_unbounded(coefficients: Array, limits: Limits) -> None:
    """Refuse a curve, coefficients of shape (m, 4, n), if no joint that moves has a finite limit."""
    if np.isfinite(limits.velocity).all():
        return
    moving = moving_joints(coefficients)
    bounds = [limits.velocity, limits.acceleration, *([] if limits.torque is None else [limits.torque])]
    if not limits.speed and not any(np.isfinite(bound[moving]).any() for bound in bounds):
        raise InvalidValueError(
            "limits",
            "no finite velocity, acceleration or torque limit of a joint that moves",
            "a robot with at least one",
        )
