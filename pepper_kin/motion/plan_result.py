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
    """How planning ended; `advice` says what to try."""

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
    """The outcome of planning.

    Attributes:
        status: How it ended.
        message: What happened, in a sentence with names and numbers.
        joint_names: Order of the joints.
        path: Way-points, shape (k, n), read-only [rad or m]; None unless solved.
        curve: The curve through the way-points that was examined against the scene all along, not only at
            the way-points; `retime` times exactly it.  None unless solved, where the start is the goal, and
            with `start_velocity`: the trajectory was examined then.
        goal: The configuration reached, shape (n,); None unless solved.
        ik: Result of inverse kinematics where the goal was given as tasks.
        alternative: Which of several lists of tasks the goal meets, counted from 0; None where there were not
            several.
        search: What the planner returned: its path before it was smoothed, length and lower bound in its own
            metric, why it stopped, the sizes of its trees; None where nothing was searched and with
            constraints.
        length: Length of the path in joint space [rad and m mixed]; nan unless solved.
        constraint_errors: Largest error of each constraint along the spline, recomputed with Pinocchio,
            groups taken apart [m or rad]; empty where there are none.
        costs: Soft costs along the curve, one after the other; empty where there are none.
        trajectory: With `start_velocity` the motion to execute, with `smooth=True` that from rest to rest:
            optimized, and then path and curve are its own, or retimed where that is not better.  None
            otherwise, and where no timing is within the limits: the message says why.
        splice: With `start_velocity` how the motion goes on: straight, joined to the planned one, or after a
            stop.  None otherwise.
        optimized: What the optimization returned; None where there was none.
        loads: What hung on the robot with a mass in the scene of the plan; `retime` counts it.
        balance: As it was asked for, and as `retime` keeps it [m].
        torque_scale: As it was asked for, and as `retime` keeps it.
        states_checked: Number of configurations asked about.
        time: Wall time [s], without the loading or compiling of code.
        seed: Seed: the same problem and seed give the same plan.
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
        """Least distances to obstacles and to itself along the curve [m], by coal, when first asked for.

        Both are nan unless solved.
        """
        return Clearance(math.nan, math.nan) if self.evidence is None else self.evidence()

    @cached_property
    def margin(self) -> float:
        """What the whole curve is proven to keep from the scene, up to the margin asked for [m]; nan without.

        Worked out when first asked for, by the compiled check and bounds on how far the body moves; see
        `pepper_kin.motion.margins.proven_margin`.  nan unless solved.
        """
        return float("nan") if self.proof is None else self.proof()

    def __getstate__(self) -> dict[str, Any]:
        """Travel with clearance and margin instead of the means to compute them."""
        known = {"clearance": self.clearance, "margin": self.margin}
        return {**self.__dict__, **known, "evidence": None, "proof": None}

    @property
    def success(self) -> bool:
        """Whether a path was found."""
        return self.status is PlanStatus.SOLVED

    @property
    def advice(self) -> str:
        """What to try, in a sentence."""
        if self.trajectory is not None:
            return TIMED
        return RESTS if self.success and self.curve is None else self.status.advice

    def report(self) -> str:
        """Say in plain words what was found, or why nothing was and what to try."""
        suffix = ""
        if self.success:
            suffix = f" Clearance: {self.clearance.sentence()}."
        return f"{self.message}{suffix} {self.advice}"


_DEFAULTS = {one.name: one.default for one in fields(Plan) if one.default is not MISSING}


class Ending:
    """Makes the plan that is returned, with what is the same for all endings filled in."""

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
        """Return the plan of an ending; `more` are its other fields."""
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
        """Return the plan of way-points, shape (k, n), whose spline (or another curve) has been examined."""
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
    """Return a plan whose path and curve are those of a cubic motion with the same ends.

    The margin is that which was asked for [m].
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
    """Return the least distances along a curve through way-points, four times between any two.

    Args:
        pepper: The robot.
        scene: The world around it, with what it holds.
        path: Way-points [rad or m], shape (k, n).
        curve: The curve; None for the way-points only.
    """
    dense = path
    if curve is not None:
        segments = np.arange(len(curve.breaks) - 1)
        parts = [curve.at(segments, x * np.diff(curve.breaks)) for x in (0.0, 0.25, 0.5, 0.75)]
        dense = np.concatenate([*parts, path[-1:]])
    return clearance_along(pepper, dense, scene)
