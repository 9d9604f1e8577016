"""Motions in legs: constraints and costs that hold on a part of the way, from one goal to the next."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pepper_kin.collision import Scene
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik import Task, TaskGroup
from pepper_kin.model import PepperModel
from pepper_kin.model.shapes import read_only
from pepper_kin.motion.constraints import as_constraints, with_constraints
from pepper_kin.motion.path_costs import PathCost
from pepper_kin.motion.plan_result import Plan, PlanStatus
from pepper_kin.motion.planning import plan
from pepper_kin.motion.problem import checked_start
from pepper_kin.trajectory import Trajectory, retime

Array = NDArray[np.float64]

ATTEMPTS = 4
"""Ways through all goals that are tried: a solution of one goal may leave no way to the next."""

_APART = 7919  # seeds of two attempts


@dataclass(frozen=True, eq=False)
class Leg:
    """A part of a motion: where it ends, and what holds until then.

    Attributes:
        goal: A configuration [rad or m], shape (n,), several, shape (m, n), or IK tasks.
        constraints: Tasks that stay met along this leg, both ends included; empty for none.
        costs: Soft costs along this leg; empty for none.
        joints: Joints that may move: names of joints and groups; None: those of `plan_legs`.
    """

    goal: ArrayLike | Sequence[Any]
    constraints: Sequence[Task | TaskGroup] = ()
    costs: Sequence[PathCost | Task | TaskGroup] = ()
    joints: str | Sequence[str] | None = None


@dataclass(frozen=True, eq=False)
class PlanInLegs:
    """The outcome of planning in legs.

    Attributes:
        plans: The plan of each leg, the last of which failed unless `success`.
        count: Number of legs asked for.
        time: Wall time [s].
    """

    plans: tuple[Plan, ...]
    count: int
    time: float

    @property
    def status(self) -> PlanStatus:
        """How the last leg that was planned ended."""
        return self.plans[-1].status

    @property
    def success(self) -> bool:
        """Whether there is a path for every leg."""
        return self.status is PlanStatus.SOLVED

    @property
    def path(self) -> Array | None:
        """Way-points of all legs, shape (k, n), where legs meet once, read-only; None unless solved."""
        if not self.success:
            return None
        paths = [one.path for one in self.plans if one.path is not None]
        return read_only(np.concatenate([paths[0], *(path[1:] for path in paths[1:])]))

    @property
    def constraint_errors(self) -> tuple[tuple[float, ...], ...]:
        """Of each leg the largest error of each of its constraints along its curve [m or rad]."""
        return tuple(one.constraint_errors for one in self.plans)

    def retime(self, pepper: PepperModel, **options: Any) -> Trajectory:
        """Time the curve of each leg, and join them: the robot rests where legs meet.

        Args:
            pepper: The robot.
            **options: As of `trajectory.retime`, for each leg.

        Raises:
            InvalidValueError: for a plan that is not solved, or in which nothing moves.
            InfeasibleError: as `retime` does.
        """
        if not self.success:
            raise InvalidValueError(
                "plan",
                f"Leg {len(self.plans)} of {self.count}: {self.plans[-1].message}",
                "a solved plan",
            )
        moving = [one for one in self.plans if one.curve is not None]
        if not moving:
            raise InvalidValueError(
                "plan", "legs in which nothing moves", "a plan in which at least one joint moves"
            )
        trajectory = retime(pepper, moving[0], **options)
        for one in moving[1:]:
            trajectory = trajectory.then(retime(pepper, one, **options))
        return trajectory

    def report(self) -> str:
        """Say what was found for each leg, or which leg failed, why and what to try."""
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
    balance: float | None = None,
    payload: Mapping[str, float] | None = None,
) -> PlanInLegs:
    """Plan through several goals, with separate constraints and soft costs on the way to each.

    Where legs meet, the configuration meets the constraints of both: goals that are tasks are solved with
    them.  Every leg has a curve that was examined as `plan` does, for its constraints too; the robot rests
    in between.  Where there is no way on from a goal's solution, the legs are planned again from other seeds.

    Args:
        pepper: The robot.
        start: Start configuration [rad or m], shape (n,), which meets the constraints of the first leg.
        legs: What to do, one after the other.
        scene: The world around the robot, the same for all legs.
        joints: Joints that may move: names of joints and groups. None: those in which the ends of a leg
            differ.
        margin: Distance requested to the scene and to the robot itself [m].
        least_margin: As of `plan`, for all legs.
        seed: Seed of all random choices.
        timeout: Time budget [s], shared by the legs.
        balance: As of `plan`, for all legs.
        payload: As of `plan`, for all legs.

    Returns:
        The plans of all legs up to the first that failed, of the attempt that got farthest.

    Raises:
        InvalidValueError: for no leg, or what `plan` refuses.
        LimitError: for a start or goal outside the joint limits, naming the joint.
        UnknownNameError: for an unknown joint, frame or group.
    """
    legs = list(legs)
    if not legs or not all(isinstance(leg, Leg) for leg in legs):
        raise InvalidValueError("legs", repr(legs), "one or more of motion.Leg")
    kept = [as_constraints(pepper, leg.constraints) if len(leg.constraints) else () for leg in legs]
    q_start, begin = checked_start(pepper, start, margin, timeout), time.perf_counter()
    best: list[Plan] = []
    for attempt in range(ATTEMPTS):
        found: list[Plan] = []
        q = q_start
        for k, leg in enumerate(legs):
            after = [task for task in (kept[k + 1] if k + 1 < len(legs) else ()) if task not in kept[k]]
            left = timeout - (time.perf_counter() - begin)
            one = plan(
                pepper, q, with_constraints(leg.goal, after), scene,
                joints=joints if leg.joints is None else leg.joints,
                constraints=kept[k] or None, costs=leg.costs if len(leg.costs) else None,
                margin=margin, seed=seed + _APART * attempt, timeout=max(left / (len(legs) - k), 0.01),
                least_margin=least_margin, balance=balance, payload=payload,
            )  # fmt: skip
            found.append(one)
            if one.goal is None:
                break
            q = one.goal
        best = max(best, found, key=lambda plans: (sum(one.success for one in plans), len(plans)))
        # Where the first leg fails, no other solution of a goal will help; nor is there always time for one.
        if found[-1].success or len(found) == 1 or time.perf_counter() - begin >= timeout:
            break
    return PlanInLegs(tuple(best), len(legs), time.perf_counter() - begin)
