"""Options of planning as one value, and requests of planning before and after checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.ik.problem import flatten_tasks
from pepper_kin.ik.tasks.carrying import with_loads
from pepper_kin.ik.tasks.structure import known_structures
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.model.wheels import BASE_JOINTS
from pepper_kin.motion.checks import Checks, checks_for
from pepper_kin.motion.constraints import as_constraints, with_constraints
from pepper_kin.motion.goal_search import load_tasks, search_nearby
from pepper_kin.motion.margins import checked_least
from pepper_kin.motion.path_costs import PathCost, PathCosts
from pepper_kin.motion.path_search import run
from pepper_kin.motion.plan_result import Ending
from pepper_kin.motion.problem import check_robot, checked_start
from pepper_kin.motion.static_limits import static_limits
from pepper_kin.planners.compiled import (
    descend,
    drop_flat,
    edges_hold,
    first_round,
    grow,
    grow_by_cost,
    grow_on_manifold,
    last_valid_step,
    load_code,
    measure_costs,
    measure_rows,
    price_at,
    project_rows,
    seed_number,
    shorten,
    shorten_by_cost,
    shortest_end,
    trace,
    walk,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanOptions:
    """Options of `plan`, which describes them in full; `PlanProblem` and other planning functions share them.

    Attributes:
        planner: The planner's name.
        joints: Joints that may move, by names of joints and groups; None: joints in which start and goals
            differ.
        constraints: IK tasks kept along the whole path.
        costs: Soft costs to be minimized together with the length.
        margin: Requested distance to all bodies [m].
        least_margin: Distance that the curve has to keep from the scene [m].
        seed: Seed of all random choices.
        timeout: Time budget [s].
        gap: Relative excess over the straight line at which "aorrtc" stops.
        balance: Minimum distance of the center of mass from the edges of the wheels' triangle [m].
        torque_scale: Fraction of the effort limits.
        payload: Point masses held at "left", "right" or a frame by name [kg].
        smooth: Whether to compute the motion to execute, too.
        start_velocity: Initial velocity of the motion [rad/s or m/s], shape (n,); None for a path from rest.
    """

    planner: str = "rrt_connect"
    joints: str | Sequence[str] | None = None
    constraints: Sequence[Task | TaskGroup] | None = None
    costs: Sequence[PathCost | Task | TaskGroup] | None = None
    margin: float = 0.01
    least_margin: float = 0.0
    seed: int = 0
    timeout: float = 5.0
    gap: float | None = None
    balance: Balance = "robot"
    torque_scale: TorqueScale = "robot"
    payload: Mapping[str, float] | None = None
    smooth: bool = False
    start_velocity: ArrayLike | None = None

    def keywords(self) -> dict[str, Any]:
        """Return the options as keywords of `plan`."""
        return {one.name: getattr(self, one.name) for one in fields(PlanOptions)}

    @property
    def margins(self) -> tuple[float, float]:
        """Requested distance to all bodies, and distance that the curve has to keep from the scene [m]."""
        return self.margin, self.least_margin


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """A request of planning, before checks.

    Attributes:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,).
        goal: Goal configuration [rad or m], shape (n,), several, shape (m, n), or IK tasks, or lists of
            tasks.
        scene: The world around the robot.
        options: Options of planning.
        asks_coal: Whether coal decides where machine code cannot, which takes longer.
    """

    pepper: PepperModel
    start: ArrayLike
    goal: Any
    scene: Scene | None
    options: PlanOptions
    asks_coal: bool = False

    def with_options(self, **options: Any) -> PlanRequest:
        """Return the request with other options."""
        return replace(self, options=replace(self.options, **options))

    def checked(self, name: str | None = None, now: Callable[[], float] = working_time) -> CheckedRequest:
        """Check the request, and load the code that it needs.

        Args:
            name: Name of the planner in the plan; None for the name in the options.
            now: Clock of the time budget [s].

        Raises:
            InvalidValueError: for another type than a robot, a wrong shape, NaN, or an option that is not
                allowed.
            LimitError: for a start outside the joint limits, naming the joint.
            UnknownNameError: for an unknown frame.
        """
        pepper, goal, scene, options = self.pepper, self.goal, self.scene, self.options
        check_robot(pepper)
        seed = seed_number(options.seed)
        statics = static_limits(pepper, options.balance, options.payload, scene, options.torque_scale)
        constraints: tuple[Task, ...] = ()
        if options.constraints is not None:
            constraints = as_constraints(pepper, options.constraints, statics.carrying)
        costs = None if options.costs is None else PathCosts.of(pepper, options.costs)
        q_start = checked_start(pepper, self.start, options.margin, options.timeout)
        checked_least(*options.margins)
        checks = checks_for(pepper, scene, statics)
        if self.asks_coal:
            checks = checks.asking_coal
        if are_tasks(goal) and statics.carrying:
            goal = with_loads(flatten_tasks(pepper, cast("Sequence[Task]", goal)), statics.carrying)
        if constraints:
            goal = with_constraints(goal, constraints)
        load_code_for(
            checks, goal, "constraints" if constraints else options.planner if costs is None else "costs"
        )
        kept = options.balance, options.torque_scale
        ended = Ending(pepper, now(), seed, name or options.planner, options.margin, kept)
        return CheckedRequest(checks, q_start, goal, options, seed, constraints, costs, ended, now)


class CheckedRequest(NamedTuple):
    """A request of planning after checks.

    Attributes:
        checks: The robot in its scene, and checks of states.
        start: Start configuration within the limits [rad or m], shape (n,).
        goal: One configuration [rad or m], shape (n,), or several, shape (m, n); or IK tasks, together with
            the constraints; tasks on the center of mass include carried loads.
        options: Options of planning.
        seed: Seed of all random choices.
        constraints: Tasks kept along the whole path, with groups split.
        costs: Soft costs; None for none.
        ended: Function that makes the returned plan; its clock is running.
        now: Clock [s].
    """

    checks: Checks
    start: Array
    goal: Any
    options: PlanOptions
    seed: int
    constraints: tuple[Task, ...]
    costs: PathCosts | None
    ended: Ending
    now: Callable[[], float] = working_time

    @property
    def deadline(self) -> float:
        """Time at which planning has to end, on the clock of `working_time` [s]."""
        return self.ended.begin + self.options.timeout

    def left(self, share: float = 1.0) -> float:
        """Return the remaining time of a fraction of the time budget [s], above zero."""
        return max(self.ended.begin + share * self.options.timeout - self.now(), 1e-3)


@kept_for_robot(most=64)
def base_places(pepper: PepperModel) -> NDArray[np.int64]:
    """Return the joint indices of x, y and yaw of a differential base, shape (3,); empty for other robots."""
    if pepper.wheels is None or not pepper.wheels.differential:
        return np.empty(0, np.int64)
    places = np.array([pepper.joint_index(name) for name in BASE_JOINTS], dtype=np.int64)
    places.setflags(write=False)
    return places


def moves_base(pepper: PepperModel, free: NDArray[np.int64]) -> bool:
    """Return whether joints of a differential base are among the joints that move, shape (k,)."""
    base = base_places(pepper)
    return bool(base.size and np.isin(base, free).any())


def refuse_what_cannot_drive(
    pepper: PepperModel, joints: str | Sequence[str] | None, planner: str, constrained: bool
) -> None:
    """Refuse options that would let a differential base move sideways.

    Raises:
        InvalidValueError: for constraints or another planner while the base may move, or another type than a
            robot.
    """
    check_robot(pepper)
    if not base_places(pepper).size or (planner == "rrt_connect" and not constrained):
        return
    if set(pepper.resolve_joints(joints)) & set(BASE_JOINTS):
        what = "constraints or costs" if constrained else "planner"
        raise InvalidValueError(
            what, "given, while the differential base may move", f"joints= without {', '.join(BASE_JOINTS)}"
        )


def are_tasks(goal: object) -> bool:
    """Return whether a goal is a sequence of IK tasks instead of configurations."""
    return isinstance(goal, Sequence) and len(goal) > 0 and isinstance(goal[0], (Task, TaskGroup))


def are_known_to_fast(pepper: PepperModel, tasks: Sequence[Any]) -> bool:
    """Return whether the robot uses the fast solver of inverse kinematics and it has code for the tasks."""
    if pepper.solvers != "fast":
        return False
    parts = [part for task in tasks for part in (task.parts if isinstance(task, TaskGroup) else [task])]
    return known_structures(parts) is not None


def load_code_for(checks: Checks, goal: Any, kind: str) -> None:
    """Load or compile the code that a planner and a goal of tasks need, before any clock starts.

    Args:
        checks: The robot in its scene.
        goal: Joint positions [rad or m], shape (n,) or (m, n), or tasks; see `plan`.
        kind: The planner's name, or "costs" or "constraints".

    Raises:
        InvalidValueError: for a mixture of tasks and other types.
    """
    _load_code_of(kind)
    if not are_tasks(goal):
        return
    tasks = flatten_tasks(checks.pepper, cast("Sequence[Task]", goal))
    if are_known_to_fast(checks.pepper, tasks):
        load_tasks(checks.pepper, tasks)


@cache
def _load_code_of(kind: str) -> None:
    """Load or compile the code of all planning, and the additional code of a planner.

    Args:
        kind: "aorrtc", "costs" or "constraints"; other kinds need no additional code.
    """
    load_code(search_nearby, run)
    if kind in ("aorrtc", "costs"):
        load_code(first_round, grow, drop_flat, shorten, shortest_end)
    if kind in ("costs", "constraints"):
        load_code(shorten_by_cost, descend, measure_costs, grow_by_cost, price_at, last_valid_step, trace)
    if kind == "constraints":
        load_code(grow_on_manifold, walk, measure_rows, project_rows, edges_hold)
