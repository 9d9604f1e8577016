"""Optimization problem of a robot's motion as a spline."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.dynamics.load import Loads
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import Task
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import check_whole
from pepper_kin.motion.optimization.balance_term import BalanceTerm
from pepper_kin.motion.optimization.carried import carrying_kernels
from pepper_kin.motion.optimization.clearance_term import ClearanceTerm, clearance_rows, least_distance
from pepper_kin.motion.optimization.cost import Cost, jerk_scale
from pepper_kin.motion.optimization.held_term import HeldTerm
from pepper_kin.motion.optimization.kernel_term import kernel_rows
from pepper_kin.motion.optimization.moving import Moving, free_joints
from pepper_kin.motion.optimization.range_term import RangeTerm, range_rows
from pepper_kin.motion.optimization.torque_term import TorqueTerm
from pepper_kin.motion.optimization.wheel_term import WheelTerm
from pepper_kin.planners.compiled import load_code, measure_cost, measure_motion
from pepper_kin.planners.compiled import search_spline as search
from pepper_kin.planners.optimization import (
    Bounds,
    LocalResult,
    Objective,
    RestSpline,
    Term,
    Weights,
    descend,
    descend_by,
)
from pepper_kin.trajectory import Trajectory
from pepper_kin.trajectory.limits import Limits

GENERAL_STEPS = 10
"""Number of steps that a general solver may take for each Newton step."""

MOST_INTERVALS = 3_000
"""Maximum number of pieces of a spline."""

_STILL = 1e-9  # range of a joint up to which it counts as resting [rad or m]
_FIT_SAMPLES = 12  # samples of the first motion for each interval
_TORQUE_SHARE = 0.99  # fraction of the limit at knots: between them torques may rise slightly
_FIRST_STRETCH, _STRETCH, _MOST_STRETCHES = 0.9, 1.1, 50
_SPARE_TIME = 1.02  # factor on the first duration that keeps all limits
_SMOOTHNESS = 0.3  # smoothness of the first motion, see `RestSpline.fit`
_DEEPEST = 0.5  # fraction of the margin that the smooth first motion may use up
_INSIDE = 1e-4  # distance of the first control points from position limits, relative to the range
_RANGE_MARGIN = 0.002  # distance between neighboring bodies [m]; their ranges change in steps between samples
_SMALL = 1e-9  # weight of the jerk if only time counts, so that the problem is well posed
_LIMITS = ("position", "velocity", "acceleration", "jerk")
_WHAT = {
    "ClearanceTerm": "the distance to things",
    "RangeTerm": "neighboring bodies apart",
    "HeldTerm": "the tasks",
    "BalanceTerm": "the balance",
    "WheelTerm": "the limits of the wheels",
}
_SHORT = 0.995  # fraction of the wanted duration at which the first search stops


def load_search(pepper: PepperModel, loads: Loads, balanced: bool) -> None:
    """Load or compile the search and its terms, before any clock starts."""
    _load_search()
    for quantity in ("inverse_dynamics", "base_wrench")[: 1 + balanced] if loads else ():
        carrying_kernels(pepper, quantity, loads)


@cache
def _load_search() -> None:
    load_code(search, measure_motion, measure_cost, least_distance)
    for term in (clearance_rows, range_rows, kernel_rows):
        term.address  # noqa: B018


class SplineProblem:
    """The control points and the duration of a motion, with all its limits.

    Args:
        pepper: The robot.
        before: The initial motion.
        scene: The world around the robot; None to leave out collisions, also of the robot with itself.
        cost: Weights of the cost.
        limits: The limits, with carried loads.
        margin: Distance to keep [m].
        intervals: Number of pieces of the spline.
        tasks: IK tasks that stay met along the motion.
        all_joints: Whether joints that rest in the initial motion may move, too.

    Attributes:
        clearance_before: Minimum distance of the initial motion at samples [m]; see `least_distance`.
    """

    def __init__(
        self,
        pepper: PepperModel,
        before: Trajectory,
        scene: Scene | None,
        cost: Cost,
        limits: Limits,
        margin: float,
        intervals: int,
        *,
        tasks: Sequence[Task] = (),
        all_joints: bool = False,
    ) -> None:
        intervals = check_whole("intervals", intervals, 4, MOST_INTERVALS)
        path = before(np.linspace(0.0, before.duration, _FIT_SAMPLES * intervals + 1)).position
        joints = np.flatnonzero(np.ptp(path, axis=0) > _STILL)
        if joints.size == 0:
            raise InvalidValueError("path", "a path of zero length", "start and goal that differ")
        if all_joints:
            joints = np.union1d(joints, np.flatnonzero(free_joints(pepper, limits)))
        self._moving = Moving(pepper, joints, path[0])
        self._spline = RestSpline(path[0, joints], path[-1, joints], intervals)
        self._before, self._cost, self._limits = before, cost, limits
        self._margin = margin
        lower, upper = pepper.lower_limits[joints], pepper.upper_limits[joints]
        inside = np.where(np.isfinite(upper - lower), _INSIDE * (upper - lower), 0.0)
        # With tasks, the path is not smoothed, since it keeps them; else a smoother motion is nearer to the
        # optimum.
        self._firsts = [
            np.clip(self._spline.fit(path[:, joints], smoothness), lower + inside, upper - inside)
            for smoothness in ((0.0,) if tasks else (_SMOOTHNESS, 0.0))
        ]
        efforts = pepper.effort_limits if limits.torque is None else limits.torque
        torque = TorqueTerm(self._moving, _TORQUE_SHARE * efforts, 1, limits.loads)
        self._apart = ClearanceTerm(self._moving, scene or Scene(), margin, 4, only_moving=True)
        everything = ClearanceTerm(self._moving, scene or Scene(), margin, 4)
        self._at_rest = everything.least_distance(path[:1, joints])
        constraints: list[RangeTerm | ClearanceTerm | HeldTerm] = [HeldTerm(self._moving, tasks, 4)]
        if scene is not None:
            constraints += [RangeTerm(self._moving, _RANGE_MARGIN, 4), self._apart]
        costs: list[tuple[float, Term]] = []
        if cost.effort > 0:
            costs.append((cost.effort, TorqueTerm(self._moving, pepper.effort_limits, 1, limits.loads)))
        if cost.clearance > 0:
            near = ClearanceTerm(self._moving, scene or Scene(), 0.0, 2, closeness=True)
            costs.append((cost.clearance, near))
        self._floors = [term for term in constraints if term.rows_count]
        standing = (
            [] if limits.balance is None else [BalanceTerm(self._moving, limits.balance, 1, limits.loads)]
        )
        rolling = [] if limits.wheels is None else [WheelTerm(self._moving, limits.wheels, _TORQUE_SHARE, 4)]
        velocity, acceleration = limits.velocity[joints], limits.acceleration[joints]
        jerk = None if limits.jerk is None else limits.jerk[joints]
        self._objective = Objective(
            self._spline,
            Bounds(lower, upper, velocity, acceleration, jerk),
            Weights(cost.time, max(cost.jerk, _SMALL), jerk_scale(pepper)[joints]),
            [torque, *standing, *rolling, *self._floors],
            costs,
        )
        self.clearance_before = self.least_distance(path[:: _FIT_SAMPLES // 4])

    def least_distance(self, q: Array) -> float:
        """Return the minimum distance at whole configurations, shape (m, n) [m].

        It is at most `margin + INFLUENCE`.
        """
        found = self._apart.least_distance(q[:, self._moving.joints])
        return min(found, self._at_rest) + self._margin  # other pairs stay as they are at rest

    def descend(
        self, wanted: float | None, max_iterations: int, timeout: float, solver: str = "newton"
    ) -> LocalResult:
        """Search from the first motion, slowed down to keep all limits.

        Args:
            wanted: Requested duration [s]; None if it is free.
            max_iterations: Maximum number of Newton steps; general solvers take up to `GENERAL_STEPS` times
                as many.
            timeout: Wall time [s].
            solver: "newton", or a general solver of `planners.optimization.descend_by`.

        Returns:
            The descent.
        """
        objective, spline = self._objective, self._spline
        for first in self._firsts:
            control = spline.control_points(first)
            for term in self._floors:
                term.start_from(objective.samples(term, control))
            if self._apart.floor.min(initial=0.0) >= -_DEEPEST * self._margin:
                break
        duration = self._feasible_duration(control)
        if solver != "newton":
            return descend_by(
                objective, first, wanted or duration, solver=solver, free_duration=wanted is None,
                max_iterations=GENERAL_STEPS * max_iterations, timeout=timeout,
            )  # fmt: skip
        if wanted is None:
            return descend(objective, first, duration, max_iterations=max_iterations, timeout=timeout)
        x = first
        if duration >= wanted:
            hurry = Objective(
                spline, objective.bounds, Weights(1.0, _SMALL, objective.weights.jerk_scale),
                objective.constraints,
            )  # fmt: skip
            short = descend(
                hurry, x, duration, max_iterations=max_iterations, timeout=timeout, stop_below=_SHORT * wanted
            )
            x = short.unknowns
        return descend(
            objective, x, wanted, free_duration=False, max_iterations=max_iterations, timeout=timeout
        )

    def trajectory(self, descent: LocalResult) -> Trajectory:
        """Return the motion of all joints that a descent found."""
        pepper, moving = self._moving.pepper, self._moving
        breaks, segments = self._spline.segments(descent.unknowns, descent.duration)
        coefficients = np.zeros((len(segments), segments.shape[1], pepper.n))
        coefficients[:, 0] = moving.rest
        coefficients[:, :, moving.joints] = segments
        return Trajectory(pepper.joint_names, breaks, coefficients, pepper.joint_units)

    def _feasible_duration(self, control: Array) -> float:
        """Return a duration in which a motion keeps all limits with some slack, if there is one [s].

        Args:
            control: All control points of the moving joints [rad or m], shape (M + p, k), see `RestSpline`.
        """
        duration = _FIRST_STRETCH * self._before.duration
        for _ in range(_MOST_STRETCHES):
            if self._objective.measure(control, duration)[1] < np.inf:
                break
            duration *= _STRETCH
        return _SPARE_TIME * duration

    def broken(self, descent: LocalResult) -> str:
        """Return in words the limit or constraint that the motion of a descent violates most, and where."""
        objective = self._objective
        control = self._spline.control_points(descent.unknowns)
        share, order, joint = objective.worst_slack(control, descent.duration)
        if share <= 0.0:
            name = self._moving.pepper.joint_names[self._moving.joints[joint]]
            return f"It breaks the {_LIMITS[order]} limit of {name} by {-share:.1%}."
        for term in objective.constraints:
            values = term.values(*objective.states(term, control, descent.duration))
            if not np.isfinite(term.barrier_bound.barrier(values)):
                sample, row = np.unravel_index(np.argmax(np.abs(values)), values.shape)
                if isinstance(term, TorqueTerm):
                    return (
                        f"It takes {abs(values[sample, row]):.1%} of the torque of {term.joint_names[row]}."
                    )
                at = float(np.argmin(values.min(axis=1))) / len(values)
                return f"It does not keep {_WHAT[type(term).__name__]} after {at:.0%} of its duration."
        return "It keeps them at samples only."
