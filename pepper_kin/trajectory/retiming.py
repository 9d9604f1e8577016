"""From a path to the fastest trajectory along it that every limit allows.

On a grid that keeps all breaks of the path, the path's acceleration u = d2s/dt2 is constant between grid
points and the fastest that keeps |q'(s) ds/dt|, |q'(s) u + q''(s) x| and |a(s) u + b(s) x + c(s)|,
x = (ds/dt)^2, within the limits of velocity, acceleration and torque at both ends of every interval
(TOPP-RA: H. Pham and Q.-C. Pham, IEEE Trans. Robotics 34, 2018).  s(t) is then quadratic on each interval and
q(s(t)) a polynomial of degree 6, which is what is returned: positions lie on the path exactly, velocities are
continuous, accelerations jump.  The duration's excess over the optimum falls as one over the number of grid
points: on random five-point paths of the whole body 1.4 % with 100, 0.6 % with 200, 0.2 % with 400.

Between grid points the limits could be exceeded slightly.  Therefore the result is examined there, the limits
are tightened where need be, and a last excess is removed by stretching time: at grid points and at every
multiple of 1 ms all limits hold (with this library's own solver, velocity and acceleration at every instant).

With jerk limits, accelerations are continuous too; see `pepper_kin.trajectory.jerk_retiming`.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pepper_kin.core.timing.whole_timing import CHECK_STEP, find_kinks
from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_choice, check_positive
from pepper_kin.model.missing_limits import LimitsLike, completed_limits
from pepper_kin.trajectory.balance import checked_balance
from pepper_kin.trajectory.editing import joined
from pepper_kin.trajectory.jerk_limits import JerkLike, jerk_limits
from pepper_kin.trajectory.limit_use import measure_use
from pepper_kin.trajectory.limits import Limits
from pepper_kin.trajectory.path import CubicPath, PathLike, as_cubic_path
from pepper_kin.trajectory.payload import AtFrames, at_frames, hand_speeds, wheel_speeds
from pepper_kin.trajectory.time_optimal import fastest_motion
from pepper_kin.trajectory.timing_problem import TimingProblem
from pepper_kin.trajectory.trajectory import Trajectory, sample_times

Array = NDArray[np.float64]

SOLVERS = ("fast", "toppra")
_TOLERANCE = 1e-9  # of a limit, for rounding
_KINK = 1e-3  # of the derivative: what is smaller comes from rounding in a file


def retime(
    pepper: PepperModel,
    path: PathLike,
    *,
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
    torque_scale: float = 1.0,
    torque: bool = True,
    balance: float | None = None,
    hand_speed: float | Mapping[str, float] | None = None,
    payload: Mapping[str, float] | None = None,
    jerk: JerkLike | None = None,
    acceleration_limits: LimitsLike | None = None,
    duration: float | None = None,
    gridpoints: int = 200,
    solver: str = "fast",
) -> Trajectory:
    """Return the time-optimal trajectory along a plan or another path, from rest to rest; see the module.

    Args:
        pepper: The robot, which gives the limits; infinite ones of velocity and torque do not act.
        path: A plan, or a piecewise cubic curve such as `Plan.curve` or `pepper_kin.planners.SmoothPath`:
            it is followed exactly, and the motion stops at its kinks.  Or way-points [rad or m], shape
            (k, n), joined by a cubic spline that leaves the polyline between them (see
            `pepper_kin.trajectory.path.as_cubic_path`).
        velocity_scale: Share of the velocity limits to use, in (0, 1].
        acceleration_scale: Share of the acceleration limits to use, in (0, 1].
        torque_scale: Share of the effort limits to use, in (0, 1].
        torque: Whether to keep within the effort limits.
        balance: Distance that the zero-moment point keeps from the edges of the wheels' triangle [m]; None
            lets the base be held from below.
        hand_speed: Greatest speed of both hands' effectors, or of "left", "right" or a frame by name [m/s].
        payload: Point masses held at "left", "right" or a frame by name [kg]; they act on torque and balance.
        jerk: "gentle", "moderate" or "brisk" (5, 10 or 30 times the acceleration limits in a second), another
            such factor [1/s], or limits [rad/s^3 or m/s^3], shape (n,); None for none.
        acceleration_limits: One number for all joints of which the robot knows no acceleration limit, or
            limits by joint name [rad/s^2 or m/s^2]; infinity says that other limits will do.  `load_robot`
            takes the same once for all.
        duration: The wished duration [s]: the fastest motion is made slower evenly, which keeps every limit.
        gridpoints: Least number of intervals of the grid, at least 2.
        solver: "fast", this library's own, or "toppra", the package of that name, as reference.

    Returns:
        The trajectory; its `binding` says which limit acts at each instant.

    Raises:
        InvalidValueError: for an option out of range; one way-point, repeated way-points or a path of zero
            length; NaN; a joint that moves and has no limit of acceleration; or a path that no limit bounds.
        UnknownNameError: for a frame or joint that the robot lacks, or a name of jerk limits.
        LimitError: where the path leaves the position limits, naming the joint.
        InfeasibleError: where torque limits forbid the path, naming joint, static torque, limit and place;
            where the robot would tip over even at rest; where `duration` is less than the least one; or for
            a plan that failed, with its reason.
    """
    check_choice("solver", solver, SOLVERS)
    wished = None if duration is None else check_positive("duration", duration, "s")
    scales = velocity_scale, acceleration_scale, torque_scale if torque else None
    greatest = pepper.acceleration_limits
    if acceleration_limits is not None:
        greatest = completed_limits(pepper.joint_names, greatest, acceleration_limits)
    rate = None if jerk is None else jerk_limits(pepper, jerk, greatest)
    limits = _limits(pepper, greatest, scales, balance, payload, hand_speed)
    curve = as_cubic_path(pepper, path)
    _refuse_missing(pepper, curve.coefficients, acceleration_limits)
    _refuse_unbounded(curve.coefficients, limits)
    count = _intervals(gridpoints)
    timed = [_timed(pepper, part, limits, rate, count, solver) for part in _without_kinks(curve)]
    trajectory = functools.reduce(joined, timed)
    return trajectory if wished is None else _last(pepper, trajectory, wished, limits)


def _limits(
    pepper: PepperModel,
    greatest: Array,
    scales: tuple[float, float, float | None],
    balance: float | None,
    payload: Mapping[str, float] | None,
    hand_speed: float | Mapping[str, float] | None,
) -> Limits:
    """Check what a user says about limits.

    Args:
        pepper: The robot.
        greatest: Acceleration limits, shape (n,).
        scales: Of velocity, acceleration and torque; None leaves torque out.
        balance: See `retime`, as the others.
        payload: See there.
        hand_speed: See there.
    """
    velocity, acceleration, torque = scales
    shares = (
        _share("velocity_scale", velocity),
        _share("acceleration_scale", acceleration),
        None if torque is None else _share("torque_scale", torque),
    )
    room, loads = checked_balance(pepper, balance), at_frames(pepper, "payload", payload, "kg")
    if greatest is pepper.acceleration_limits:
        return _kept_limits(pepper, shares, room, loads, hand_speeds(pepper, hand_speed))
    return _made_limits(pepper, greatest, shares, room, loads, hand_speeds(pepper, hand_speed))


def _made_limits(
    pepper: PepperModel,
    greatest: Array,
    shares: tuple[float, float, float | None],
    balance: float | None,
    payload: AtFrames,
    speeds: AtFrames,
) -> Limits:
    velocity, acceleration, torque = shares
    return Limits(
        pepper.velocity_limits * velocity,
        greatest * acceleration,
        None if torque is None else pepper.effort_limits * torque,
        balance,
        payload,
        speeds + wheel_speeds(pepper),
    )


@functools.lru_cache(maxsize=32)
def _kept_limits(
    pepper: PepperModel,
    shares: tuple[float, float, float | None],
    balance: float | None,
    payload: AtFrames,
    speeds: AtFrames,
) -> Limits:
    """Return limits with the robot's own of acceleration, whose tables are kept with them."""
    return _made_limits(pepper, pepper.acceleration_limits, shares, balance, payload, speeds)


def _intervals(gridpoints: int) -> int:
    if isinstance(gridpoints, bool) or not isinstance(gridpoints, (int, np.integer)) or gridpoints < 2:
        raise InvalidValueError("gridpoints", gridpoints, "a whole number of at least 2")
    return int(gridpoints)


def _without_kinks(curve: CubicPath) -> list[CubicPath]:
    """Return the parts of a curve between kinks: the motion stops where the path's direction jumps."""
    kinks = np.empty(len(curve.coefficients), np.int64)
    count = find_kinks(curve.breaks, curve.coefficients, _KINK, kinks)
    if not count:
        return [curve]
    kinks = kinks[:count]
    ends = [0, *kinks.tolist(), len(curve.breaks) - 1]
    return [CubicPath(curve.breaks[a : b + 1], curve.coefficients[a:b]) for a, b in itertools.pairwise(ends)]


def _timed(
    pepper: PepperModel, curve: CubicPath, limits: Limits, jerk: Array | None, intervals: int, solver: str
) -> Trajectory:
    """Return the fastest trajectory."""
    problem = TimingProblem(pepper, curve.breaks, curve.coefficients, intervals, limits)
    if solver == "fast":
        trajectory = fastest_motion(problem)
    else:
        from pepper_kin.trajectory.toppra_solver import toppra_motion

        problem.fill()
        trajectory = toppra_motion(pepper, problem, limits)
    if jerk is None:
        return trajectory
    s = problem.grid.s.copy()
    from pepper_kin.trajectory.jerk_retiming import limit_jerk

    return limit_jerk(pepper, curve, trajectory, s, limits, jerk)


def _last(pepper: PepperModel, trajectory: Trajectory, duration: float, limits: Limits) -> Trajectory:
    """Return the trajectory made slower: torques and edge moments move towards those at rest."""
    if duration < trajectory.duration * (1 - _TOLERANCE):
        raise InfeasibleError(
            "trajectory",
            f"the limits ask for {trajectory.duration:.6g} s along this path, "
            f"and duration is {duration:.6g} s",
            "give a longer duration, or raise the scales of the limits",
        )
    slow = trajectory.with_duration(max(duration, trajectory.duration))
    state = slow(sample_times(slow.duration, max(CHECK_STEP, slow.duration / 2000)))
    if measure_use(pepper, state, limits).stretch > 1.0 + 1e-6:
        raise InfeasibleError(
            "trajectory",
            f"of {duration:.6g} s: the path passes where the robot can swing through, "
            "but not hold itself still",
            "leave the duration out, or choose a path with less load",
        )
    return slow


def _share(quantity: str, value: float) -> float:
    share = check_positive(quantity, value)
    if share > 1.0:
        raise InvalidValueError(quantity, value, "a number in (0, 1]")
    return share


def _refuse_missing(pepper: PepperModel, coefficients: Array, given: LimitsLike | None) -> None:
    """Refuse to time joints whose acceleration nobody has said a word about."""
    missing = ~np.isfinite(pepper.acceleration_limits)
    if not missing.any():
        return
    missing &= _moving(coefficients)
    said = given if isinstance(given, Mapping) else pepper.joint_names if given is not None else ()
    names = [pepper.joint_names[j] for j in np.flatnonzero(missing) if pepper.joint_names[j] not in said]
    if names:
        raise InvalidValueError(
            "acceleration_limits",
            f"none for {', '.join(names)}, and the robot's description gives none",
            "one number for all, or numbers by joint name [rad/s^2 or m/s^2], here or in load_robot "
            "(infinity where other limits will do)",
        )


def _moving(coefficients: Array) -> NDArray[np.bool_]:
    """Return which joints move along a piecewise cubic curve, shape (n,)."""
    return np.asarray(np.abs(coefficients[:, 1:]).max(axis=(0, 1)) > 0)


def _refuse_unbounded(coefficients: Array, limits: Limits) -> None:
    if np.isfinite(limits.velocity).all():
        return
    moving = _moving(coefficients)
    bounds = [limits.velocity, limits.acceleration, *([] if limits.torque is None else [limits.torque])]
    if not limits.speed and not any(np.isfinite(bound[moving]).any() for bound in bounds):
        raise InvalidValueError(
            "limits",
            "no finite velocity, acceleration or torque limit of a joint that moves",
            "a robot with at least one",
        )
