"""Trajectory optimization: a shorter and smoother motion within all limits."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import Clearance, Scene, clearance_along
from pepper_kin.collision.curve_examination import is_clear_along
from pepper_kin.exceptions import InfeasibleError, InvalidValueError, LimitError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    check_choice,
    check_positive,
    check_seed,
    check_whole,
)
from pepper_kin.model.requirements import ROBOT, Balance, TorqueScale
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.constraints import as_constraints
from pepper_kin.motion.optimization.cost import Cost, figures_of
from pepper_kin.motion.optimization.optimized import Optimized, OptimizedStatus
from pepper_kin.motion.plan_result import Plan
from pepper_kin.motion.problem import checked_margin
from pepper_kin.planners.optimization import FATROP, LocalResult, OptimizationStatus, check_no_timeout
from pepper_kin.trajectory import Trajectory, retime
from pepper_kin.trajectory.active_limits import measure_use, stretch_at_extremes
from pepper_kin.trajectory.balance import moves_base
from pepper_kin.trajectory.limits import JerkLike, Limits, MotionLimits, jerk_limits, motion_limits
from pepper_kin.trajectory.path import PathLike
from pepper_kin.trajectory.samples import examination_step, refuse_other_joints, sample_times

if TYPE_CHECKING:
    from pepper_kin.motion.optimization.spline_problem import SplineProblem


SOLVERS = ("newton", "ipopt", FATROP)
_LEAST_TIME = 1e-6  # time of a search that begins late [s]: it returns its initial motion
MOST_STARTS = 10_000
LONGEST = 86_400.0  # [s]
MOST_INTERVALS = 1_000
TIMEOUT = 5.0
"""Default wall time of a search [s]."""
_DISTANCE_STEP = 0.004  # time between states whose distances are measured [s]
_CONSTRAINT_STATES = 301  # number of states at which task errors are computed by Pinocchio
_MORE = 1.0 + 1e-6
_ROUNDING = 1e-9  # violation attributed to rounding, relative to the limit
_SLOWER = 50  # maximum number of slow-downs of a given motion
_DETOUR = 0.25  # maximum deviation of other starts from the straight line, relative to a joint's range
_TORQUE_SPARE = 1.0 - 3e-4  # fraction of the torques that may be used at every millisecond
_KEPT = 0.5  # fraction of the margin that the motion between samples must keep
_FINER = 3  # factor on the number of intervals if the motion is not clear


def optimize(
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
    torque_scale: TorqueScale = "robot",
    balance: Balance = "robot",
    payload: Mapping[str, float] | None = None,
    jerk: JerkLike | None = None,
    constraints: Sequence[Task | TaskGroup] = (),
    max_iterations: int = 40,
    timeout: float | None = None,
    solver: str = "newton",
    starts: int = 1,
    seed: int = 0,
) -> Optimized:
    """Optimize path and timing of a motion together, within all limits.

    The motion is a cubic B-spline from rest to rest whose accelerations are continuous and zero at both ends.
    Unknowns are its control points and its duration.  Position and velocity limits hold at control points and
    so everywhere, acceleration limits at knots, where the extremes are; torques hold at knots, clearances and
    tasks at four samples in each interval.  A feasible interior-point method (`planners.optimization`) lowers
    the cost; values and exact derivatives come from compiled code.  The result is examined every millisecond:
    time is stretched if a torque is exceeded; if distances or tasks are not kept, or nothing was gained, the
    initial motion is returned.

    Args:
        pepper: The robot.
        path: A plan, a path as `retime` takes it (two configurations: a straight line), or a trajectory,
            which is slowed down first if it violates limits.  Joints that do not move in it stay at rest.
        scene: The world around the robot.
        cost: Weights of time, jerk, effort and closeness; by default time and a little jerk.
        duration: Requested duration [s]; free by default.
        margin: Distance to keep to all bodies [m]; less if the initial path is nearer; between samples at
            least half of it.
        intervals: Number of pieces of the spline, 4 to 1,000; three times as many are tried if the motion
            comes too near.
        velocity_scale: Fraction of the velocity limits to use, in (0, 1].
        acceleration_scale: Fraction of the acceleration limits to use, in (0, 1].
        torque_scale: Fraction of the effort limits to use, in (0, 1]; "robot" as in `retime`.
        balance: Distance that the zero-moment point keeps from the edges of the wheels' triangle [m], "robot"
            as in `retime`, or None.  With a base that moves only "robot", which slows down the motion found,
            or None.
        payload: Point masses held at "left", "right" or a frame by name [kg].
        jerk: Jerk limits as `retime` takes them, kept at every instant; None for none.  A path is first timed
            without jerk limits.
        constraints: IK tasks of finite tolerance that stay met along the motion, as `plan` takes them.
        max_iterations: Maximum number of Newton steps; a general solver may take ten times as many.
        timeout: Wall time of the search [s], after which the best motion is returned; `TIMEOUT` if omitted;
            not for "fatrop".
        solver: "newton"; or "ipopt" or "fatrop" for the same problem by a general solver, slower, for
            reference.
        starts: Number of initial motions: the one along the path, then motions of two straight lines through
            a random posture, searched on all cores ("newton").  The cheapest result is returned.
        seed: Seed of the random postures.

    Returns:
        The result; its trajectory is never worse than the initial one (which may collide if that does).

    Raises:
        InvalidValueError: for an option out of range, a plan without a path, or a wrong path.
        LimitError: if the path leaves the position limits, naming the joint.
        InfeasibleError: if torque limits forbid the initial path.
    """
    from pepper_kin.motion.optimization.spline_problem import SplineProblem, load_search  # only here

    allowed = motion_limits(
        pepper, velocity_scale=velocity_scale, acceleration_scale=acceleration_scale,
        torque_scale=torque_scale, balance=balance, payload=payload, scene=scene, along=path,
    )  # fmt: skip
    # With a base that moves, the search ignores balance, and its result is slowed down to keep it.
    searched = allowed._replace(balance=None) if balance == ROBOT and moves_base(pepper) else allowed
    load_search(pepper, allowed.loads, searched.balance is not None)
    begin = working_time()
    wanted, seconds = _checked(margin, timeout, duration, solver, starts, intervals, seed)
    rate = None if jerk is None else _jerk_limits(pepper, jerk, solver)
    limits = replace(allowed.of(pepper, pepper.acceleration_limits, drives=True), jerk=rate)
    weights, world = cost or Cost(), scene if scene is not None else Scene()
    tasks = as_constraints(pepper, constraints, allowed.loads) if constraints else ()
    before = _timed(pepper, path, allowed, payload, scene)
    before = _within_limits(pepper, path, before, limits)

    def posed(motion: Trajectory, segments: int = intervals) -> SplineProblem:
        bounds = replace(limits, balance=searched.balance)
        return SplineProblem(pepper, motion, world, weights, bounds, margin, segments, tasks=tasks)

    problems = [posed(before)]
    judge = _Judge(pepper, problems[0], before, world, weights, limits, margin, wanted, tasks)
    problems += map(posed, _detours(pepper, before, starts, seed, allowed, begin + seconds))
    search = _Descents(wanted, check_whole("max_iterations", max_iterations, 0), begin + seconds, solver)
    best = _cheapest(judge, problems, search, lambda: posed(before, _FINER * intervals))
    return replace(best, time=working_time() - begin)


class _Descents(NamedTuple):
    """Settings of a search.

    Attributes:
        wanted: Requested duration [s]; None if it is free.
        steps: Maximum number of Newton steps.
        end: Time at which a search ends, on the clock of `working_time` [s].
        solver: One of SOLVERS.
    """

    wanted: float | None
    steps: int
    end: float
    solver: str

    def __call__(self, problems: Sequence[SplineProblem]) -> list[LocalResult]:
        """Return the results of all problems; several problems are searched in parallel threads."""
        if len(problems) == 1 or self.solver != SOLVERS[0]:
            return [self._of(problem) for problem in problems]
        with ThreadPoolExecutor(min(len(problems), os.cpu_count() or 1)) as threads:
            return list(threads.map(self._of, problems))

    def _of(self, problem: SplineProblem) -> LocalResult:
        left = max(self.end - working_time(), _LEAST_TIME)
        return problem.descend(self.wanted, self.steps, left, self.solver)


def _cheapest(
    judge: _Judge, problems: Sequence[SplineProblem], search: _Descents, finer: Callable[[], SplineProblem]
) -> Optimized:
    """Return the cheapest acceptable result, or the refused result of the first problem.

    If the first one came too near to something between its samples, a problem of more intervals is searched.
    """
    refused: dict[int, Optimized] = {}
    descents = search(problems)
    for k in sorted(range(len(problems)), key=lambda k: _cost_of(descents[k])):
        found = judge(problems[k], descents[k])
        if found.success:
            return found
        refused[k] = found
    if refused[0].status is OptimizedStatus.NOT_CLEAR and search.solver == SOLVERS[0]:
        problem = finer()
        found = judge(problem, *search([problem]))
    return found if found.success else refused[0]


def _cost_of(descent: LocalResult) -> float:
    """Return the final cost of a search; inf if it had no start."""
    return float("inf") if descent.status is OptimizationStatus.START_INFEASIBLE else descent.cost


def _within_limits(pepper: PepperModel, path: object, motion: Trajectory, limits: Limits) -> Trajectory:
    """Return the initial motion, slowed down if it was given by the caller and violates limits.

    Args:
        pepper: The robot.
        path: Path or motion given by the caller.
        motion: Initial motion; the same object as `path` if the caller gave a motion.
        limits: The limits.

    Raises:
        InfeasibleError: if no slower motion is within the limits.
    """
    if motion is not path:
        return motion
    motion = motion.scaled(stretch_at_extremes(motion, limits))
    for _ in range(_SLOWER):
        state = motion(sample_times(motion.duration, examination_step(motion.duration)))
        stretch = measure_use(pepper, state, limits).stretch
        if stretch <= 1.0 + _ROUNDING:
            return motion
        if not np.isfinite(stretch):
            break
        motion = motion.scaled(stretch * _MORE)
    raise InfeasibleError(
        "trajectory",
        "the given motion passes a posture that the robot cannot hold at rest within these limits",
        "raise torque_scale, carry less, or give another motion",
    )


def _jerk_limits(pepper: PepperModel, jerk: JerkLike, solver: str) -> Array:
    if solver != SOLVERS[0]:
        raise InvalidValueError(
            "jerk", jerk, f"None with solver={solver!r}, which does not support jerk limits"
        )
    return jerk_limits(pepper, jerk)


def _checked(
    margin: float,
    timeout: float | None,
    duration: float | None,
    solver: str,
    starts: int,
    intervals: int,
    seed: int,
) -> tuple[float | None, float]:
    """Check options; return the requested duration, if any, and the time of the search [s]."""
    check_choice("solver", solver, SOLVERS)
    checked_margin(margin)
    check_whole("starts", starts, 1, MOST_STARTS)
    check_seed(seed)
    if duration is not None and check_positive("duration", duration, "s") > LONGEST:
        raise InvalidValueError("duration", duration, f"at most {LONGEST:g} s")
    check_whole("intervals", intervals, 4, MOST_INTERVALS)
    if timeout is not None:
        check_positive("timeout", timeout, "s")
    if solver == FATROP:
        check_no_timeout(timeout)
        seconds = float("inf")
    else:
        seconds = TIMEOUT if timeout is None else timeout
    return None if duration is None else check_positive("duration", duration, "s"), seconds


def _timed(
    pepper: PepperModel,
    path: Plan | Trajectory | PathLike,
    allowed: MotionLimits,
    payload: Mapping[str, float] | None = None,
    scene: Scene | None = None,
) -> Trajectory:
    """Return the initial motion: the given one, or the time-optimal motion along a path."""
    if isinstance(path, Trajectory):
        refuse_other_joints(pepper, path.joint_names)
        return path
    if isinstance(path, Plan) and path.path is None:
        raise InvalidValueError("path", f"a plan that is {path.status.value}", "a plan with a path")
    return retime(
        pepper, path, velocity_scale=allowed.velocity, acceleration_scale=allowed.acceleration,
        torque_scale=1.0 if allowed.torque is None else allowed.torque, balance=allowed.balance,
        payload=payload, scene=scene,
    )  # fmt: skip


def _detours(
    pepper: PepperModel, before: Trajectory, starts: int, seed: int, allowed: MotionLimits, end: float
) -> Iterator[Trajectory]:
    """Yield motions along two straight lines from start to goal through random postures of moving joints.

    No further motions follow after the time `end` [s].
    """
    rng, first, last = np.random.default_rng(seed), before.start, before.end
    moving = first != last
    spare = np.where(np.isfinite(pepper.upper_limits - pepper.lower_limits), 0.0, np.pi)
    low = np.where(spare > 0, np.minimum(first, last) - spare, pepper.lower_limits)
    high = np.where(spare > 0, np.maximum(first, last) + spare, pepper.upper_limits)
    for _ in range(starts - 1):
        share = _DETOUR * rng.uniform(-1.0, 1.0, pepper.n)
        middle = np.where(moving, np.clip((first + last) / 2 + share * (high - low), low, high), first)
        try:
            motion = _timed(pepper, np.stack([first, middle, last]), allowed._replace(balance=None))
        except (InfeasibleError, LimitError):
            continue
        if working_time() >= end:
            return
        yield motion


@dataclass(frozen=True, eq=False)
class _Judge:
    """Examination of a search's motion, which is accepted if it is clear and cheaper than the initial one."""

    pepper: PepperModel
    problem_data: SplineProblem
    before: Trajectory
    scene: Scene
    cost: Cost
    limits: Limits
    margin: float
    wanted: float | None
    tasks: tuple[Task, ...]

    def __call__(self, problem: SplineProblem, descent: LocalResult) -> Optimized:
        """Return the result of a descent on a problem."""
        old = figures_of(self.pepper, self.before, self.limits.loads)

        def refused(status: OptimizedStatus, message: str) -> Optimized:
            return Optimized(
                status, message, self.before, self.before, old, old, self.cost, self._measured(self.before),
                descent, 0.0, self._errors(self.before),
            )  # fmt: skip

        if descent.status is OptimizationStatus.START_INFEASIBLE:
            what = "slow motion" if self.wanted is None else f"motion of {self.wanted:.3g} s"
            why = problem.broken(descent)
            return refused(OptimizedStatus.NO_ROOM, f"No {what} near the path keeps all limits. {why}")
        found = problem.trajectory(descent)
        if found.duration > LONGEST:  # the search can diverge for very small motions
            return refused(OptimizedStatus.NOT_CHEAPER, f"The best found takes {found.duration:.3g} s.")
        states = found(sample_times(found.duration, examination_step(found.duration)))
        limits = replace(self.limits, torque=_TORQUE_SPARE * np.asarray(self.limits.torque))
        stretch = measure_use(self.pepper, states, limits).stretch
        stretch = max(stretch, stretch_at_extremes(found, limits))
        if not np.isfinite(stretch):
            return refused(OptimizedStatus.NO_ROOM, "Between knots the joints cannot hold the motion.")
        if stretch > 1.0:
            found = found.scaled(stretch * _MORE)
        clearance = self._clearance(problem, found)
        if not clearance > max(min(_KEPT * self.margin, 0.9 * problem.clearance_before), 0.0):
            near = f"comes as near as {clearance * 1000:.1f} mm to something"
            text = near if np.isfinite(clearance) else "touches something, or may do so"
            return refused(OptimizedStatus.NOT_CLEAR, f"The optimized motion {text}.")
        errors = self._errors(found)
        for task, error in zip(self.tasks, errors, strict=True):
            if error > task.tolerance * _MORE:
                words = f"{error:.3g} {task.unit_on(self.pepper)} of {task.tolerance:.3g}"
                return refused(OptimizedStatus.OFF_CONSTRAINT, f"{task.name} is not kept: {words}.")
        new = figures_of(self.pepper, found, self.limits.loads)
        gain = (
            f"{self.before.duration:.3f} s to {found.duration:.3f} s, "
            f"jerk from {old.jerk:.3g} to {new.jerk:.3g} /s"
        )
        free = self.wanted is None and self.cost.clearance == 0 and self.limits.jerk is None
        dearer = free and not new.cost(self.cost) < old.cost(self.cost)
        if dearer and self._before_is_clear():
            return refused(OptimizedStatus.NOT_CHEAPER, f"The best found would go from {gain}.")
        message = f"Went from {gain} in {descent.iterations} steps."
        return Optimized(
            OptimizedStatus.IMPROVED, message, found, self.before, new, old, self.cost,
            self._measured(found), descent, 0.0, errors,
        )  # fmt: skip

    def _before_is_clear(self) -> bool:
        kept = zip(self.tasks, self._errors(self.before), strict=True)
        if any(error > task.tolerance * _MORE for task, error in kept):
            return False
        return self.problem_data.clearance_before > 0 and is_clear_along(
            Checks(self.pepper, self.scene), self.before, held=False
        )

    def _errors(self, motion: Trajectory) -> tuple[float, ...]:
        """Return the largest error of each task along a motion, by Pinocchio."""
        if not self.tasks:
            return ()
        times = np.linspace(0.0, motion.duration, _CONSTRAINT_STATES)
        q = motion(times).position
        return tuple(max(task.error(self.pepper, state) for state in q) for task in self.tasks)

    def _measured(self, motion: Trajectory) -> Callable[[], Clearance]:
        """Return a function that measures the minimum distances along a motion every millisecond, by coal."""
        times = sample_times(motion.duration, examination_step(motion.duration))
        return lambda: clearance_along(self.pepper, motion(times).position, self.scene)

    def _clearance(self, problem: SplineProblem, motion: Trajectory) -> float:
        """Return the minimum distance along a motion [m], by the search's code; -inf if something touches.

        Freedom of contact is proven along the whole motion; distances are measured every 4 ms.
        """
        if not is_clear_along(Checks(self.pepper, self.scene), motion, held=False):
            return -float("inf")
        step = max(_DISTANCE_STEP, examination_step(motion.duration))
        times = sample_times(motion.duration, step)
        return problem.least_distance(motion(times).position)
