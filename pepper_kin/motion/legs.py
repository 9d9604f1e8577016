"""Motions in legs: constraints, costs and worlds that hold from one goal to the next."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin.arrays import Array, FrozenArrays, read_only
from pepper_kin.collision import Scene, in_collision
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import Task, TaskGroup, solutions
from pepper_kin.kernels.working_time import working_time
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import shown
from pepper_kin.model.requirements import Balance, TorqueScale
from pepper_kin.motion.constraints import as_constraints, with_constraints
from pepper_kin.motion.path_costs import PathCost
from pepper_kin.motion.plan_request import PlanOptions, are_tasks
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.planning import plan
from pepper_kin.motion.problem import check_robot, checked_start
from pepper_kin.motion.static_limits import static_limits
from pepper_kin.trajectory import Certificate, Trajectory, retime

ATTEMPTS = 4
"""Maximum number of attempts: a solution of one goal may leave no path to the next."""

_APART = 7919  # difference of the seeds of successive attempts
_SOLUTIONS = 32  # number of solutions of a goal, from which the next leg's starts are chosen

SceneOfLeg: TypeAlias = Scene | Callable[[Scene, Array], Scene]
"""A scene, or a function from the previous scene and joint positions [rad or m], shape (n,), to a scene."""


@dataclass(frozen=True, eq=False)
class Leg:
    """A leg of a motion: its goal, and what holds until the goal.

    Attributes:
        goal: Goal configuration [rad or m], shape (n,), several, shape (m, n), or IK tasks.
        constraints: Tasks that stay met along this leg, including both ends; empty for none.
        costs: Soft costs along this leg; empty for none.
        joints: Joints that may move, by names of joints and groups; None for the `joints` of `plan_legs`.
        scene: World from the beginning of this leg on, for example after an object is picked up or put down;
            or a function that returns it from the previous world and the configuration in which the leg
            begins [rad or m], shape (n,); None for no change.  With `lambda scene, q: scene.attach("cup",
            "l_gripper", pepper=pepper, q=q, mass=0.3)` the hand grasps the cup where it stands, with `lambda
            scene, q: scene.release("cup", pepper, q)` it releases the cup.
    """

    goal: ArrayLike | Sequence[Any]
    constraints: Sequence[Task | TaskGroup] = ()
    costs: Sequence[PathCost | Task | TaskGroup] = ()
    joints: str | Sequence[str] | None = None
    scene: SceneOfLeg | None = None


@dataclass(frozen=True, eq=False)
class PlanInLegs(FrozenArrays):
    """Result of planning in legs.

    Attributes:
        plans: Plan of each leg, the last of which failed unless `success`.
        count: Number of requested legs.
        time: Wall time [s].
        scenes: World of each plan, with attached objects.
    """

    plans: tuple[Plan, ...]
    count: int
    time: float
    scenes: tuple[Scene, ...]

    @property
    def status(self) -> PlanStatus:
        """Status of the last leg that was planned."""
        return self.plans[-1].status

    @property
    def success(self) -> bool:
        """Whether there is a path for every leg."""
        return self.status is PlanStatus.SOLVED

    @property
    def path(self) -> Array | None:
        """Waypoints of all legs [rad or m], shape (k, n), common ends once, read-only; or None."""
        if not self.success:
            return None
        paths = [one.path for one in self.plans if one.path is not None]
        return read_only(np.concatenate([paths[0], *(path[1:] for path in paths[1:])]))

    @property
    def constraint_errors(self) -> tuple[tuple[float, ...], ...]:
        """Largest error of each constraint along the leg's curve [m or rad], for each leg."""
        return tuple(one.constraint_errors for one in self.plans)

    def retime(self, pepper: PepperModel, **options: Any) -> Trajectory:
        """Time the curve of each leg, and join them: the robot rests where legs meet.

        Args:
            pepper: The robot.
            **options: Options of `trajectory.retime`, for each leg.  Attached objects count on the legs on
                which they are attached.

        Raises:
            InvalidValueError: for a plan that is not solved, or in which nothing moves.
            InfeasibleError: if a leg cannot be timed within limits.
        """
        moving = [one for one in self.retime_legs(pepper, **options) if one is not None]
        if not moving:
            raise InvalidValueError(
                "plan", "legs in which nothing moves", "a plan in which at least one joint moves"
            )
        return functools.reduce(Trajectory.then, moving)

    def retime_legs(self, pepper: PepperModel, **options: Any) -> tuple[Trajectory | None, ...]:
        """Time the curve of each leg separately, for example to close a hand between legs.

        Args:
            pepper: The robot.
            **options: Options of `retime`.

        Returns:
            The trajectory of each leg, from rest to rest; None for a leg in which nothing moves.

        Raises:
            InvalidValueError: for a plan that is not solved.
            InfeasibleError: if a leg cannot be timed within limits.
        """
        if not self.success:
            raise InvalidValueError(
                "plan",
                f"Leg {len(self.plans)} of {self.count}: {self.plans[-1].message}",
                "a solved plan",
            )
        return tuple(None if one.curve is None else retime(pepper, one, **options) for one in self.plans)

    def check(
        self, pepper: PepperModel, trajectories: Sequence[Trajectory | None], **limits: Any
    ) -> tuple[Certificate | None, ...]:
        """Check the trajectory of each leg in the world of that leg, with attached objects.

        Args:
            pepper: The robot.
            trajectories: Trajectories of the legs, as `retime_legs` returns them.
            **limits: Options of `trajectory.check`.

        Returns:
            The certificate of each leg; None for a leg without trajectory.

        Raises:
            InvalidValueError: if the numbers of trajectories and legs differ, or an option is not allowed.
        """
        timed = list(trajectories) if isinstance(trajectories, (list, tuple)) else []
        known = all(one is None or isinstance(one, Trajectory) for one in timed)
        if not known or len(timed) != len(self.plans):
            raise InvalidValueError(
                "trajectories", shown(trajectories), f"{len(self.plans)}, as retime_legs returns them"
            )
        return tuple(
            None if one is None else one.check(pepper, scene, **limits)
            for one, scene in zip(timed, self.scenes, strict=True)
        )

    def report(self) -> str:
        """Return in words the result of each leg, and for a failed leg the reason and what to try."""
        lines = [f"Leg {k + 1} of {self.count}: {one.report()}" for k, one in enumerate(self.plans)]
        return "\n".join(lines)


def plan_legs(
    pepper: PepperModel,
    start: ArrayLike,
    legs: Sequence[Leg],
    scene: Scene | None = None,
    *,
    joints: str | Sequence[str] | None = None,
    margin: float = 0.01,
    least_margin: float = 0.0,
    seed: int = 0,
    timeout: float = 10.0,
    balance: Balance = "robot",
    torque_scale: TorqueScale = "robot",
    payload: Mapping[str, float] | None = None,
) -> PlanInLegs:
    """Plan through several goals, with separate constraints, soft costs and changes of the world.

    Where legs meet, the configuration meets the constraints of both; goals that are tasks are solved with
    both.  The curve of every leg is examined as by `plan`, including its constraints; the robot rests in
    between.  If the next leg cannot be planned from a goal's solution, or the robot cannot hold there the
    object that it picks up, the legs are planned again with other seeds.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,), which meets the constraints of the first leg.
        legs: The legs, in order.
        scene: The world around the robot, until a leg changes it.
        joints: Joints that may move on legs that name none; None: joints in which a leg's start and goals
            differ.
        margin: Requested distance to all bodies, for all legs [m]; it is relaxed if necessary, as by `plan`.
        least_margin: Distance that all curves are proven to keep from the scene [m], from 0 to `margin`.
        seed: Seed of all random choices.
        timeout: Time budget [s], shared by the legs.
        balance: Distance that the center of mass keeps from the edges of the wheels' triangle [m]; "robot"
            for the robot's requirement; None to leave balance out.
        torque_scale: Fraction of the effort limits for holding torques; "robot" for the robot's requirement.
        payload: Point masses held at "left", "right" or a frame by name [kg], in addition to attached
            objects.

    Returns:
        The plans of all legs up to the first that failed, of the attempt that got farthest.

    Raises:
        InvalidValueError: for no leg, a `Leg.scene` that is or returns no scene, or an argument that `plan`
            refuses.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint, frame or group.
    """
    check_robot(pepper)
    legs = _checked(legs)
    kept = [as_constraints(pepper, leg.constraints) if len(leg.constraints) else () for leg in legs]
    q_start, begin = checked_start(pepper, start, margin, timeout), working_time()
    options = PlanOptions(
        joints=joints, margin=margin, least_margin=least_margin, balance=balance, torque_scale=torque_scale,
        payload=payload,
    )  # fmt: skip
    search = _LegSearch(pepper, legs, kept, begin + timeout, options)
    best: list[tuple[Plan, Scene]] = []
    for attempt in range(ATTEMPTS):
        found = search.attempt(
            q_start, Scene() if scene is None else scene, seed + _APART * attempt, attempt > 0
        )
        best = max(best, found, key=lambda made: (sum(one.success for one, _ in made), len(made)))
        # If the first leg fails, no other solution of a goal helps; or the time may be up.
        if found[-1][0].success or len(found) == 1 or working_time() >= begin + timeout:
            break
    plans, scenes = zip(*best, strict=True)
    return PlanInLegs(plans, len(legs), working_time() - begin, scenes)


@dataclass(frozen=True, eq=False)
class _LegSearch:
    """A search through all legs.

    Attributes:
        pepper: The robot.
        legs: The legs.
        kept: Constraints of each leg.
        deadline: Time at which planning has to end, on the clock of `working_time` [s].
        options: Options of all legs; `joints` for legs that name none.
    """

    pepper: PepperModel
    legs: list[Leg]
    kept: list[tuple[Task, ...]]
    deadline: float
    options: PlanOptions

    def attempt(self, start: Array, scene: Scene, seed: int, select: bool) -> list[tuple[Plan, Scene]]:
        """Return the plan and the world of each leg up to the first that fails.

        Args:
            start: Start configuration of the first leg [rad or m], shape (n,).
            scene: World before the first leg.
            seed: Seed of all random choices.
            select: Whether goals are replaced by solutions from which the next leg can begin.
        """
        found: list[tuple[Plan, Scene]] = []
        q, world, count = start, scene, len(self.legs)
        for k, leg in enumerate(self.legs):
            world = _scene_of(leg, k, world, q)
            left = self.deadline - working_time()
            options = replace(
                self.options, joints=self._joints_of(leg), constraints=self.kept[k] or None,
                costs=leg.costs if len(leg.costs) else None, seed=seed, timeout=max(left / (count - k), 0.01),
            )  # fmt: skip
            goal = self._goal_of(k, q, world, seed, select)
            one = plan(self.pepper, q, goal, world, **options.keywords())
            found.append((one, world))
            if one.goal is None:
                break
            q = one.goal
        return found

    def _joints_of(self, leg: Leg) -> str | Sequence[str] | None:
        return self.options.joints if leg.joints is None else leg.joints

    def _goal_of(self, k: int, q: Array, world: Scene, seed: int, select: bool) -> Any:
        """Return the goal of leg k, which begins at q [rad or m], shape (n,).

        Tasks are solved with the constraints of the next leg, too.

        Args:
            k: Index of the leg.
            q: Start configuration of the leg [rad or m], shape (n,).
            world: World of the leg.
            seed: Seed of the solutions.
            select: Whether tasks are replaced by solutions from which the next leg can begin, if the world
                changes there and solutions exist.
        """
        leg, more = self.legs[k], self.kept[k + 1] if k + 1 < len(self.legs) else ()
        goal = with_constraints(leg.goal, [task for task in more if task not in self.kept[k]])
        if not (select and are_tasks(goal)) or k + 1 == len(self.legs) or self.legs[k + 1].scene is None:
            return goal
        tasks = with_constraints(goal, self.kept[k])
        for margin in dict.fromkeys(self.options.margins):
            try:
                solved = solutions(
                    self.pepper, tasks, q, count=_SOLUTIONS, scene=world, margin=margin, seed=seed,
                    joints=self._joints_of(leg), payload=self.options.payload,
                )  # fmt: skip
            except InvalidValueError:  # tasks that the fast solver has no code for
                return goal
            good = [one for one in solved if self._can_begin(k + 1, world, one)]
            if good:
                return np.array(good)
        return goal

    def _can_begin(self, k: int, world: Scene, q: Array) -> bool:
        """Return whether leg k can begin at q [rad or m], shape (n,), given the world before its change."""
        scene, options = _scene_of(self.legs[k], k, world, q), self.options
        held = static_limits(self.pepper, options.balance, options.payload, scene, options.torque_scale).hold(
            q[None]
        )
        return bool(held[0]) and not bool(in_collision(self.pepper, q, scene))


def _checked(legs: Sequence[Leg]) -> list[Leg]:
    """Return legs as a list; refuse items of other types."""
    legs = list(legs) if isinstance(legs, Iterable) else [legs]
    if not legs or not all(isinstance(leg, Leg) for leg in legs):
        raise InvalidValueError("legs", repr(legs), "one or more of motion.Leg")
    for k, leg in enumerate(legs):
        if not (leg.scene is None or isinstance(leg.scene, Scene) or callable(leg.scene)):
            raise InvalidValueError(f"scene of leg {k + 1}", shown(leg.scene), "a Scene, a function, or None")
    return legs


def _scene_of(leg: Leg, k: int, before: Scene, q: Array) -> Scene:
    """Return the world of leg k, from the previous leg's world and the start q [rad or m], shape (n,)."""
    if leg.scene is None or isinstance(leg.scene, Scene):
        return before if leg.scene is None else leg.scene
    found = leg.scene(before, q.copy())
    if not isinstance(found, Scene):
        raise InvalidValueError(f"scene of leg {k + 1}", shown(found), "a function that returns a Scene")
    return found
