"""Result of planning."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field, fields, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.arrays import BriefRepr, read_only
from pepper_kin.collision import Clearance, CollisionChecker, Scene, clearance_along
from pepper_kin.collision.loads import loads_of
from pepper_kin.core.splines import polyline_length
from pepper_kin.dynamics.load import Loads
from pepper_kin.ik import IKResult
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model import PepperModel
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.motion.margins import proven_margin
from pepper_kin.planners import Result
from pepper_kin.status import ResultStatus
from pepper_kin.trajectory.path import CubicPath, as_cubic_path

if TYPE_CHECKING:
    from pepper_kin.motion.optimization.optimized import Optimized
    from pepper_kin.motion.path_costs import CostAlong
    from pepper_kin.trajectory import Splice, Trajectory


class PlanStatus(ResultStatus):
    """Status of planning; `advice` says what to try."""

    SOLVED = "solved", "Time the path with retime()."
    START_IN_COLLISION = (
        "start_in_collision",
        "Start from a posture that touches nothing, or move the obstacle away.",
    )
    START_TORQUE_LIMIT = (
        "start_torque_limit",
        "Start from a posture that the joints can hold against gravity.",
    )
    START_TIPS_OVER = (
        "start_tips_over",
        "Start with the center of mass nearer to the middle of the wheels, carry less, or reduce balance.",
    )
    START_TOO_NEAR = "start_too_near", "Move the robot or the obstacle apart, or reduce least_margin."
    START_TOO_FAST = "start_too_fast", "Begin more slowly, or farther away from what is named."
    GOAL_IN_COLLISION = (
        "goal_in_collision",
        "Give another goal, or IK tasks: collision-free goals are then searched.",
    )
    GOAL_TORQUE_LIMIT = "goal_torque_limit", "Give a goal that the joints can hold against gravity."
    GOAL_TIPS_OVER = (
        "goal_tips_over",
        "Give a goal whose center of mass is nearer to the wheels, or reduce balance.",
    )
    GOAL_TOO_NEAR = "goal_too_near", "Give another goal, or reduce least_margin."
    START_OFF_CONSTRAINT = (
        "start_off_constraint",
        "Start from a posture that meets the constraints; ik.solve finds one.",
    )
    GOAL_OFF_CONSTRAINT = (
        "goal_off_constraint",
        "Give IK tasks as the goal: they are solved with the constraints.",
    )
    NO_IK = "no_ik", "Move the target, free more joints, or raise the timeout."
    START_SHUT_IN = (
        "start_shut_in",
        "Hardly any motion leads away from the start: move away what is named, free more joints, or "
        "reduce the margin.",
    )
    GOAL_SHUT_IN = (
        "goal_shut_in",
        "Hardly any motion leads up to the goal: move away what is named, free more joints, reduce "
        "the margin, or give another goal.",
    )
    NO_PATH_IN_TIME = "no_path_in_time", "Raise the timeout, try another seed, or free more joints."
    PATH_INVALID = "path_invalid", "Plan between its ends with plan()."


TIMED = "Examine its trajectory with check()."
RESTS = "Nothing has to move, so there is nothing to time."


@dataclass(frozen=True, eq=False)
class Plan(BriefRepr):
    """Result of planning.

    Attributes:
        status: Status of planning.
        message: What happened, in a sentence with names and numbers.
        joint_names: Order of the joints.
        path: Waypoints [rad or m], shape (k, n), read-only; None unless solved.
        curve: The curve through the waypoints, which was examined against the scene everywhere; `retime`
            follows exactly this curve.  None unless solved, if the start is the goal, and with
            `start_velocity`, where the trajectory was examined instead.
        goal: Configuration reached [rad or m], shape (n,); None unless solved.
        ik: Result of inverse kinematics if the goal was given as tasks.
        alternative: Index of the list of tasks that the goal meets, counted from 0; None if there were not
            several.
        search: Result of the planner: path before smoothing, length and lower bound in its metric, reason of
            its end, sizes of its trees; None if nothing was searched, and with constraints.
        length: Length of the path in joint space [rad and m mixed]; nan unless solved.
        constraint_errors: Largest error of each constraint along the spline, recomputed with Pinocchio, with
            groups split [m or rad]; empty without constraints.
        costs: Each soft cost along the curve; empty without costs.
        trajectory: With `start_velocity`, the motion to execute; with `smooth=True`, the motion from rest to
            rest: optimized, with path and curve of the optimum, or retimed if that is not better.  None
            otherwise, and if no timing is within the limits: the message says why.
        splice: With `start_velocity`, the continuation of the motion: straight, joined to the planned motion,
            or after a stop.  None otherwise.
        optimized: Result of the optimization; None without one.
        loads: Attached objects with mass in the scene of the plan; `retime` counts them.
        balance: Requested balance, which `retime` keeps by default [m].
        torque_scale: Requested fraction of the effort limits, which `retime` keeps by default.
        states_checked: Number of configurations checked.
        time: Wall time [s], without loading or compiling code.
        seed: Seed of all random choices: the same problem and seed give the same plan.
    """

    status: PlanStatus
    message: str
    joint_names: tuple[str, ...]
    path: NDArray[np.float64] | None = None
    goal: NDArray[np.float64] | None = None
    ik: IKResult | None = None
    length: float = float("nan")
    states_checked: int = 0
    time: float = 0.0
    seed: int = 0
    planner: str = "rrt_connect"
    constraint_errors: tuple[float, ...] = ()
    curve: CubicPath | None = None
    costs: tuple[CostAlong, ...] = ()
    search: Result | None = None
    trajectory: Trajectory | None = None
    splice: Splice | None = None
    optimized: Optimized | None = None
    loads: Loads = ()
    balance: Balance = "robot"
    torque_scale: TorqueScale = "robot"
    alternative: int | None = None
    evidence: Callable[[], Clearance] | None = field(default=None, repr=False)
    proof: Callable[[], float] | None = field(default=None, repr=False)

    @cached_property
    def clearance(self) -> Clearance:
        """Minimum distances to obstacles and of the robot to itself along the curve [m], measured by coal.

        Both are nan unless solved.
        """
        return Clearance(math.nan, math.nan) if self.evidence is None else self.evidence()

    @cached_property
    def margin(self) -> float:
        """Distance that the whole curve is proven to keep from the scene, at most the requested margin [m].

        It is computed at its first use, by the compiled check and bounds on how far the body moves; see
        `pepper_kin.motion.margins.proven_margin`.  nan unless solved.
        """
        return float("nan") if self.proof is None else self.proof()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for pickling, with clearance and margin computed."""
        known = {"clearance": self.clearance, "margin": self.margin}
        return {**self.__dict__, **known, "evidence": None, "proof": None}

    @property
    def success(self) -> bool:
        """Whether a path was found."""
        return self.status is PlanStatus.SOLVED

    @property
    def advice(self) -> str:
        """Advice on what to try, as a sentence."""
        if self.trajectory is not None:
            return TIMED
        return RESTS if self.success and self.curve is None else self.status.advice

    def report(self) -> str:
        """Return the result in plain words, or the reason of a failure and what to try."""
        suffix = ""
        if self.success:
            suffix = f" Clearance: {self.clearance.sentence()}."
        return f"{self.message}{suffix} {self.advice}"


_DEFAULTS = {one.name: one.default for one in fields(Plan) if one.default is not MISSING}


class Ending:
    """Factory of the returned plan, with the fields that are common to all results."""

    def __init__(
        self,
        pepper: PepperModel,
        begin: float,
        seed: int,
        planner: str,
        margin: float = 0.0,
        kept: tuple[Balance, TorqueScale] = ("robot", "robot"),
    ) -> None:
        self.joint_names, self.begin, self.seed, self.planner = pepper.joint_names, begin, seed, planner
        self.margin, (self.balance, self.torque_scale) = margin, kept

    def __call__(self, status: PlanStatus, message: str, **more: Any) -> Plan:
        """Return a plan with a status and message; `more` are its other fields."""
        made = object.__new__(Plan)
        made.__dict__.update(
            _DEFAULTS, status=status, message=message, joint_names=self.joint_names,
            time=working_time() - self.begin, seed=self.seed, planner=self.planner,
            balance=self.balance, torque_scale=self.torque_scale,
        )  # fmt: skip
        made.__dict__.update(more)
        return made

    def solved(
        self,
        checker: CollisionChecker,
        path: NDArray[np.float64],
        message: str,
        curve: CubicPath | None = None,
        **more: Any,
    ) -> Plan:
        """Return a solved plan of waypoints, shape (k, n), whose spline or given curve has been examined."""
        if curve is None and len(path) > 1:
            curve = as_cubic_path(checker.pepper, path)
        return self(
            PlanStatus.SOLVED, message, path=read_only(path), goal=read_only(path[-1]),
            length=length_of(path), curve=curve, loads=loads_of(checker.pepper, checker.scene), **more,
            evidence=partial(_clearance_along, checker.pepper, checker.scene, path, curve),
            proof=partial(proven_margin, checker.pepper, checker.scene, path, curve, self.margin),
        )  # fmt: skip


def along_trajectory(
    pepper: PepperModel, plan: Plan, trajectory: Trajectory, scene: Scene | None, margin: float
) -> Plan:
    """Return a plan with path and curve of a cubic motion that has the same ends.

    `margin` is the requested margin [m].
    """
    curve = CubicPath(trajectory.breaks, trajectory.coefficients)
    path = np.concatenate([trajectory.coefficients[:, 0], np.reshape(trajectory.end, (1, -1))])
    world = Scene() if scene is None else scene
    return replace(
        plan, trajectory=trajectory, path=read_only(path), curve=curve, length=length_of(path),
        evidence=partial(_clearance_along, pepper, world, path, curve),
        proof=partial(proven_margin, pepper, world, path, curve, margin),
    )  # fmt: skip


def length_of(path: NDArray[np.float64]) -> float:
    """Return the length of a polyline in joint space, shape (k, n) [rad and m mixed]."""
    return float(polyline_length(np.ascontiguousarray(path, float)))


def _clearance_along(
    pepper: PepperModel, scene: Scene, path: NDArray[np.float64], curve: CubicPath | None
) -> Clearance:
    """Return the minimum distances along a curve through waypoints, at four states for each piece.

    Args:
        pepper: The robot.
        scene: The world around the robot, with attached objects.
        path: Waypoints [rad or m], shape (k, n).
        curve: The curve; None for the waypoints only.
    """
    dense = path
    if curve is not None:
        segments = np.arange(len(curve.breaks) - 1)
        parts = [curve.at(segments, x * np.diff(curve.breaks)) for x in (0.0, 0.25, 0.5, 0.75)]
        dense = np.concatenate([*parts, path[-1:]])
    return clearance_along(pepper, dense, scene)
