"""From a path or a motion to a shorter and smoother motion within all limits."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pepper_kin.collision import Scene, checker_for
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_choice, check_positive
from pepper_kin.motion.optimisation.cost import Cost, Figures, figures_of
from pepper_kin.motion.optimisation.optimised import Optimised, OptimisedStatus
from pepper_kin.motion.optimisation.spline_problem import SplineProblem
from pepper_kin.motion.plan_result import Plan
from pepper_kin.planners.optimisation import Descent, OptimisationStatus
from pepper_kin.trajectory import Trajectory, retime
from pepper_kin.trajectory.limit_use import Limits, measure_use
from pepper_kin.trajectory.path import PathLike
from pepper_kin.trajectory.time_law import slower
from pepper_kin.trajectory.trajectory import sample_times

Array = NDArray[np.float64]

SOLVERS = ("newton",)
_STEP = 0.001  # [s], between the states at which the result is examined
_COAL_STATES = 40  # of them, the nearest to anything, are measured by coal
_MORE = 1.0 + 1e-6
_KEPT = 0.5  # share of the margin that the motion between samples must keep


def optimise(
    pepper: PepperModel,
    path: Plan | Trajectory | PathLike,
    scene: Scene | None = None,
    *,
    cost: Cost | None = None,
    duration: float | None = None,
    margin: float = 0.01,
    intervals: int = 20,
    velocity_scale: float = 1.0,
    acceleration_scale: float = 1.0,
    torque_scale: float = 1.0,
    max_iterations: int = 40,
    timeout: float = 5.0,
    solver: str = "newton",
) -> Optimised:
    """Make a motion cheaper: path and timing together, within all limits.

    The motion is a cubic B-spline from rest to rest, with continuous accelerations that begin and end at
    zero.  Unknowns are its control points and its duration.  Limits of position and velocity hold at control
    points and so everywhere, those of acceleration at knots, where it is extreme; torques hold at knots,
    clearances at four samples in each interval.  A feasible interior-point method
    (`planners.optimisation.descend`) lowers the cost; torques, distances and their exact derivatives come
    from compiled code for all samples at once.  The result is then examined every millisecond: time is
    stretched where a torque is exceeded, and where distances are not kept, or nothing was gained, the motion
    before is returned.

    Args:
        pepper: The robot.
        path: A plan, a trajectory, or a path as `retime` takes it (two configurations: a straight line).
            Joints that do not move in it stay still.
        scene: The world around the robot.
        cost: Weights of time, jerk, effort and closeness; by default time and a little jerk.
        duration: Duration that the motion shall have [s]; by default it is free.
        margin: Distance to keep to the scene and between parts of the robot [m]; less where the path to
            start from is nearer than that, and never less than half of that in between samples.
        intervals: Pieces of the spline, at least 4: more can follow sharper turns, and take longer.
        velocity_scale: Share of the velocity limits to use, in (0, 1].
        acceleration_scale: Share of the acceleration limits to use, in (0, 1].
        torque_scale: Share of the effort limits to use, in (0, 1].
        max_iterations: Newton steps at most.
        timeout: Wall time of the search after which the best motion so far is taken [s].
        solver: "newton".

    Returns:
        The result; its trajectory is never worse than the one to start from.

    Raises:
        InvalidValueError: for an option out of range, a plan without a path, or a wrong path.
        LimitError: where the path leaves the position limits, naming the joint.
        InfeasibleError: where torque limits forbid the path to start from.
    """
    begin = time.perf_counter()
    check_choice("solver", solver, SOLVERS)
    if not (np.isfinite(margin) and margin >= 0):
        raise InvalidValueError("margin", margin, "a finite distance of 0 or more [m]")
    weights, world = cost or Cost(), scene if scene is not None else Scene()
    wanted = None if duration is None else check_positive("duration", duration, "s")
    check_positive("timeout", timeout, "s")
    scales = {
        "velocity_scale": velocity_scale,
        "acceleration_scale": acceleration_scale,
        "torque_scale": torque_scale,
    }
    before = _timed(pepper, path, scales)
    limits = Limits(
        pepper.velocity_limits * velocity_scale,
        pepper.acceleration_limits * acceleration_scale,
        pepper.effort_limits * torque_scale,
    )
    problem = SplineProblem(pepper, before, world, weights, limits, margin, intervals)
    descent = problem.descend(wanted, max_iterations, timeout)
    judged = _judge(pepper, problem, descent, before, world, weights, limits, margin, wanted)
    return Optimised(
        judged.status, judged.message, judged.trajectory or before, before,
        judged.figures or judged.figures_before, judged.figures_before, weights, judged.clearance, descent,
        time.perf_counter() - begin,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Verdict:
    status: OptimisedStatus
    message: str
    figures_before: Figures
    trajectory: Trajectory | None = None
    figures: Figures | None = None
    clearance: float = float("nan")


def _timed(pepper: PepperModel, path: Plan | Trajectory | PathLike, scales: dict[str, float]) -> Trajectory:
    if isinstance(path, Trajectory):
        if path.joint_names != pepper.joint_names:
            raise InvalidValueError("joints of the trajectory", path.joint_names, pepper.joint_names)
        return path
    if isinstance(path, Plan):
        if path.path is None:
            raise InvalidValueError("path", f"a plan that is {path.status.value}", "a plan with a path")
        path = path.path
    return retime(pepper, path, **scales)  # type: ignore[arg-type]


def _judge(
    pepper: PepperModel,
    problem: SplineProblem,
    descent: Descent,
    before: Trajectory,
    scene: Scene,
    cost: Cost,
    limits: Limits,
    margin: float,
    wanted: float | None,
) -> _Verdict:
    """Examine what the search found; return it if it is clear and cheaper than the motion before."""
    old = figures_of(pepper, before)
    if descent.status is OptimisationStatus.START_INFEASIBLE:
        what = "No slow motion near the path" if wanted is None else f"No motion of {wanted:.3g} s near the path"
        return _Verdict(OptimisedStatus.NO_ROOM, f"{what} keeps all limits.", old)
    found = problem.trajectory(descent)
    q = found(sample_times(found.duration, _STEP))
    stretch = measure_use(pepper, q, limits).stretch
    if not np.isfinite(stretch):
        return _Verdict(OptimisedStatus.NO_ROOM, "Between knots the joints cannot hold the motion.", old)
    if stretch > 1.0:
        found = slower(found, stretch * _MORE)
    clearance = _clearance(pepper, problem, scene, q.position)
    needed = min(_KEPT * margin, 0.9 * problem.clearance_before)
    if not clearance > max(needed, 0.0):
        text = f"The optimised motion comes as near as {clearance * 1000:.1f} mm to something."
        return _Verdict(OptimisedStatus.NOT_CLEAR, text, old)
    new = figures_of(pepper, found)
    gain = f"{before.duration:.3f} s to {found.duration:.3f} s, jerk from {old.jerk:.3g} to {new.jerk:.3g} /s"
    if wanted is None and not new.cost(cost) < old.cost(cost) and cost.clearance == 0:
        return _Verdict(OptimisedStatus.NOT_CHEAPER, f"The best found would go from {gain}.", old)
    message = f"Went from {gain} in {descent.iterations} steps."
    return _Verdict(OptimisedStatus.IMPROVED, message, old, found, new, clearance)


def _clearance(pepper: PepperModel, problem: SplineProblem, scene: Scene, q: Array) -> float:
    """Return the least distance along a motion [m] by coal; -inf where neighbouring bodies touch."""
    if any(table.violated(q).any() for table in dependent_ranges(pepper)):
        return -float("inf")
    nearest = np.argsort(problem.distances(q), kind="stable")[:_COAL_STATES]
    return float(checker_for(pepper, scene).clearance(q[nearest]).min(initial=np.inf))
