"""From a path to the fastest trajectory along it that every limit allows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pepper_kin.exceptions import InfeasibleError, InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_choice, check_positive
from pepper_kin.trajectory.limit_use import Limits, measure_use
from pepper_kin.trajectory.path import CubicPath, PathLike, as_cubic_path
from pepper_kin.trajectory.path_limits import Grid, PathLimits, make_grid, path_limits
from pepper_kin.trajectory.time_law import compose, slower
from pepper_kin.trajectory.toppra_solver import fastest_speed
from pepper_kin.trajectory.trajectory import Trajectory, sample_times

Array = NDArray[np.float64]

SOLVERS = ("toppra",)
CHECK_STEP = 0.001  # [s] the limits hold at every multiple of it
_ROUNDS = 4  # solutions with tightened limits before settling for a slower one
_SMALL_STRETCH = 1e-3  # slowing down by less than this is cheaper than solving again
_INSIDE = (0.25, 0.5, 0.75)  # of each interval, where limits are looked at besides its ends
_MORE = 1.0 + 2e-6  # stretch a little further: the instants looked at next are others
_TOLERANCE = 1e-9  # of a limit, for rounding


def retime(
    pepper: PepperModel,
    path: PathLike,
    *,
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
    torque_scale: float = 1.0,
    torque: bool = True,
    balance: float | None = None,
    gridpoints: int = 200,
    solver: str = "toppra",
) -> Trajectory:
    """Return the time-optimal trajectory along a path, from rest to rest.

    On a grid that keeps all breaks of the path, the path's acceleration u = d2s/dt2 is constant between grid
    points and the fastest that keeps |q'(s) ds/dt|, |q'(s) u + q''(s) x| and |a(s) u + b(s) x + c(s)|,
    x = (ds/dt)^2, within the limits of velocity, acceleration and torque at both ends of every interval
    (TOPP-RA: H. Pham and Q.-C. Pham, IEEE Trans. Robotics 34, 2018).  s(t) is then quadratic on each
    interval and q(s(t)) a polynomial of degree 6, which is what is returned: positions lie on the path
    exactly, velocities are continuous, accelerations jump.

    Between grid points the limits could be exceeded slightly.  Therefore the result is examined there and at
    every millisecond, the limits are tightened where need be, and a last excess is removed by
    stretching time: at grid points and at every multiple of 1 ms all limits hold.

    Args:
        pepper: The robot, which gives the limits; infinite ones do not act.
        path: Way-points [rad or m], shape (k, n), joined by a cubic spline that leaves the polyline between
            them (see `pepper_kin.trajectory.path.as_cubic_path`), or a piecewise cubic curve such as
            `pepper_kin.planners.SmoothPath`, which is followed exactly.
        velocity_scale: Share of the velocity limits to use, in (0, 1].
        acceleration_scale: Share of the acceleration limits to use, in (0, 1].
        torque_scale: Share of the effort limits to use, in (0, 1].
        torque: Whether to keep within the effort limits.
        balance: Distance that the zero-moment point keeps from the edges of the wheels' triangle [m]; None
            lets the base be held from below.
        gridpoints: Least number of intervals of the grid, at least 2.  The duration's excess over the optimum
            falls as one over it: on random five-point paths of the whole body 1.4 % with 100, 0.6 % with 200,
            0.2 % with 400.
        solver: "toppra".

    Returns:
        The trajectory.

    Raises:
        InvalidValueError: for an option out of range; one way-point, repeated way-points or a path of zero
            length; NaN; or a path that no limit bounds.
        LimitError: where the path leaves the position limits, naming the joint.
        InfeasibleError: where torque limits forbid the path, naming joint, static torque, limit and place; or
            where the robot would tip over even at rest.
    """
    check_choice("solver", solver, SOLVERS)
    limits = Limits(
        pepper.velocity_limits * _share("velocity_scale", velocity_scale),
        pepper.acceleration_limits * _share("acceleration_scale", acceleration_scale),
        pepper.effort_limits * _share("torque_scale", torque_scale) if torque else None,
        None if balance is None else _distance(balance),
    )
    if isinstance(gridpoints, bool) or not isinstance(gridpoints, (int, np.integer)) or gridpoints < 2:
        raise InvalidValueError("gridpoints", gridpoints, "a whole number of at least 2")
    curve = as_cubic_path(pepper, path)
    return _within_limits(pepper, curve, limits, int(gridpoints))


def _share(quantity: str, value: float) -> float:
    share = check_positive(quantity, value)
    if share > 1.0:
        raise InvalidValueError(quantity, value, "a number in (0, 1]")
    return share


def _distance(balance: float) -> float:
    if isinstance(balance, bool) or not (np.isfinite(balance) and balance >= 0):
        raise InvalidValueError("balance", balance, "a finite distance of 0 or more [m], or None")
    return float(balance)


def _within_limits(pepper: PepperModel, curve: CubicPath, limits: Limits, intervals: int) -> Trajectory:
    """Solve, examine and tighten until the limits hold or nearly so, then stretch time until they do."""
    grid = make_grid(curve, intervals)
    rows = path_limits(pepper, grid, limits)
    _refuse_unbounded(rows)
    row_scale, velocity_scale = np.ones(len(rows.names)), np.ones(pepper.n)
    best: Trajectory | None = None
    failed_at: int | None = None
    for _ in range(_ROUNDS):
        profile = fastest_speed(grid, rows, row_scale, velocity_scale)
        failed_at = profile.failed_at
        if profile.speed is None:
            break
        candidate = compose(pepper, grid, profile.speed)
        use = measure_use(pepper, candidate.at_pieces(*_inspection_points(candidate)), limits)
        if np.isfinite(use.stretch) and (best is None or candidate.duration * use.stretch < best.duration):
            best = slower(candidate, use.stretch * _MORE)
        if use.stretch <= 1.0 + _SMALL_STRETCH:
            break
        velocity_scale = velocity_scale / np.maximum(1.0, use.share["velocity"])
        row_scale = row_scale / [
            1.0 if quantity == "balance" else max(1.0, use.share[quantity][pepper.joint_index(joint)])
            for quantity, joint in rows.names
        ]
    if best is None:
        raise _infeasible(grid, rows, failed_at)
    return _hold_every_millisecond(pepper, best, limits)


def _inspection_points(trajectory: Trajectory) -> tuple[NDArray[np.intp], Array]:
    """Return pieces and local times: both ends of every piece and some points inside."""
    h = np.diff(trajectory.breaks)
    share = np.array([0.0, *_INSIDE, 1.0])
    return np.repeat(np.arange(h.size), share.size), (h[:, None] * share).ravel()


def _hold_every_millisecond(pepper: PepperModel, trajectory: Trajectory, limits: Limits) -> Trajectory:
    """Slow down, where need be, until all limits hold at every multiple of 1 ms."""
    while True:
        state = trajectory(sample_times(trajectory.duration, CHECK_STEP))
        stretch = measure_use(pepper, state, limits).stretch
        if stretch <= 1.0 + _TOLERANCE:
            return trajectory
        if not np.isfinite(stretch):
            raise InfeasibleError(
                "trajectory",
                "between grid points the path passes where the torque limits do not hold the robot still",
                "use more grid points",
            )
        trajectory = slower(trajectory, stretch * _MORE)


def _refuse_unbounded(rows: PathLimits) -> None:
    moving = np.abs(rows.derivative).max(axis=(0, 1)) > 0
    rows_act = np.abs(rows.a).max(axis=(0, 1)) > 0
    if not rows_act.any() and not np.isfinite(rows.velocity[moving]).any():
        raise InvalidValueError(
            "limits",
            "no finite velocity, acceleration or torque limit of a joint that moves",
            "a robot with at least one",
        )


def _infeasible(grid: Grid, rows: PathLimits, failed_at: int | None) -> InfeasibleError:
    """Say why there is no trajectory: with velocity and acceleration alone there always is one."""
    torque = [i for i, (quantity, _) in enumerate(rows.names) if quantity == "torque"]
    use = np.abs(rows.c[..., torque]) / rows.bound[torque]
    end, interval, row = np.unravel_index(int(np.argmax(use)), use.shape) if torque else (0, 0, 0)
    total = grid.s[-1] - grid.s[0]
    if torque and use[end, interval, row] >= 1.0:
        joint = rows.names[torque[row]][1]
        share = (grid.s[interval + int(end)] - grid.s[0]) / total
        held, limit = rows.c[end, interval, torque[row]], rows.bound[torque[row]]
        reason = (
            f"{joint} needs {held:.4g} N m to hold still against gravity {share:.0%} along the path, "
            f"and its limit is {limit:.4g} N m"
        )
        return InfeasibleError("trajectory", reason, "choose a path with less load on that joint")
    tipping = [i for i, (quantity, _) in enumerate(rows.names) if quantity == "balance"]
    lean = (rows.c + rows.bound)[..., tipping]
    if tipping and lean.min() < 0:
        end, interval, _ = np.unravel_index(int(np.argmin(lean)), lean.shape)
        share = (grid.s[interval + int(end)] - grid.s[0]) / total
        reason = f"{share:.0%} along the path the robot would tip over even at rest"
        return InfeasibleError("trajectory", reason, "choose a path that leans less, or a smaller margin")
    where = "" if failed_at is None else f" from {(grid.s[failed_at] - grid.s[0]) / total:.0%} of it on"
    return InfeasibleError(
        "trajectory",
        f"no speed along the path obeys all limits{where}",
        "raise the scales, use more grid points, or smooth the path",
    )
