"""Motion of a hand along straight lines and arcs, with the rest of the body free."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from pepper_kin import ik
from pepper_kin.arrays import Array, BriefRepr, read_only
from pepper_kin.collision import Clearance, Scene, checker_for, clearance_along
from pepper_kin.exceptions import suspect_millimeters
from pepper_kin.ik.problem import joints_used, moved_aside
from pepper_kin.kinematics import frame_pose
from pepper_kin.model import PepperModel
from pepper_kin.model.joint_vectors import (
    as_joint_vector,
    check_positive,
    check_within_limits,
)
from pepper_kin.motion.curves import HandCurve, Route
from pepper_kin.motion.follow_result import words_for_aside
from pepper_kin.motion.goals import fault_of
from pepper_kin.motion.problem import checked_margin
from pepper_kin.motion.static_limits import static_limits
from pepper_kin.status import ResultStatus

JUMP = 0.35
"""Largest change of a joint from one stop to the next [rad or m]: a larger one is a jump of posture."""

DIRECTION_WEIGHT = 0.3
"""Weight of the direction task, relative to STAY_WEIGHT of the posture; the position is a hard task."""

TURN = 0.1
"""Largest rotation toward the target direction from one stop to the next [rad]."""

FINER = 32
"""Maximum refinement: step size over the smallest distance between stops, where a joint moves fast."""

STAY_WEIGHT = 0.02
"""Weight of the previous posture: among all postures for the hand, the nearest one is chosen."""


class CartesianStatus(ResultStatus):
    """Status of following a curve."""

    DONE = "done", "Time the path with retime()."
    START_INVALID = "start_invalid", "Start from a posture that is free and that the joints can hold."
    OUT_OF_REACH = "out_of_reach", "Shorten the line, let more joints move, or move the base."
    BLOCKED_BY_LIMITS = "blocked_by_limits", "Start from another posture, or let more joints move."
    IN_COLLISION = "in_collision", "Move the line or the obstacle, or plan with plan(), which goes around it."
    TORQUE_LIMIT = "torque_limit", "Start from another posture, or keep the hand nearer to the body."
    JUMP = "jump", "Start from another posture: from this one the arm would have to change its configuration."


@dataclass(frozen=True, eq=False)
class CartesianPath(BriefRepr):
    """Joint positions along curves of a hand, as far as the hand could follow.

    Attributes:
        status: Status of the result.
        message: What happened, in a sentence with names and numbers.
        fraction: Completed fraction of the length, 0 to 1.
        path: Joint positions at the stops [rad or m], shape (k, n), read-only; the first is the start.
        distances: Length along the curves at each stop [m], shape (k,).
        position_error: Largest distance of the hand from the curve at the stops [m], recomputed.
        direction_error: Largest angle between the hand and the target direction at the stops [rad],
            recomputed; nan without a direction.
        clearance: Minimum distances at the stops to obstacles and of the robot to itself [m], by coal.
        time: Wall time [s].
    """

    status: CartesianStatus
    message: str
    fraction: float
    path: Array
    distances: Array
    position_error: float
    direction_error: float
    clearance: Clearance
    time: float

    @property
    def success(self) -> bool:
        """Whether the hand followed the curves completely."""
        return self.status is CartesianStatus.DONE

    @property
    def advice(self) -> str:
        """Advice on what to try, as a sentence."""
        return self.status.advice

    def report(self) -> str:
        """Return the result in plain words."""
        lines = [self.message]
        if len(self.path) > 1:
            lines.append(
                f"{len(self.path)} stops over {100 * self.distances[-1]:.1f} cm; the hand is at most "
                f"{1000 * self.position_error:.2f} mm from the curve; "
                f"clearance: {self.clearance.sentence()}"
            )
        if np.isfinite(self.direction_error):
            lines.append(f"direction off by at most {np.degrees(self.direction_error):.1f} deg")
        return "\n".join([*lines, self.advice])


def cartesian_path(
    pepper: PepperModel,
    start: ArrayLike,
    hand: str,
    curves: HandCurve | Sequence[HandCurve],
    scene: Scene | None = None,
    *,
    direction: ArrayLike | None = None,
    joints: str | Sequence[str] | None = None,
    step: float = 0.005,
    margin: float = 0.0,
    tolerance: float = 0.001,
) -> CartesianPath:
    """Move a hand along curves, by inverse kinematics at every stop from the previous posture.

    The position is met at every stop to the tolerance, the direction as closely as possible.  If the whole
    body would touch something, the arm is tried alone, and then the body with collision avoidance.  Between
    stops the hand leaves the curve by about step^2 / 8 times its curvature in joint space, far below a
    millimeter.

    Args:
        pepper: The robot.
        start: Initial joint positions [rad or m], shape (n,).
        hand: "left" or "right".
        curves: `Line` and `Arc`; the first one begins where the hand is at `start`.
        scene: The world around the robot; collisions of the robot with itself are always checked.  Masses of
            attached objects count for the holding torques.
        direction: Direction in the world in which the hand should point, shape (3,), not zero; None for any.
        joints: Joints that may move, by names of joints and groups; the others keep `start`.  None for all.
        step: Largest distance between stops [m]; stops are closer where a joint moves fast.
        margin: Distance to keep to the scene [m]; its own parts must not touch.
        tolerance: Largest distance of the hand from the curve at a stop [m].

    Returns:
        The path; `fraction` is its completed part, `status` and `message` tell why it ends.

    Raises:
        InvalidValueError: for no curve, NaN, or an argument that is not a number.
        UnknownNameError: for an unknown hand, joint or group.
        LimitError: for a start outside the joint limits.
    """
    begin = time.perf_counter()
    q = as_joint_vector(pepper, start, "start")
    check_within_limits(pepper, q, "start")
    check_positive("step", step, "[m]")
    direction_task = None if direction is None else ik.Point(hand, direction)
    frame = ik.HandPosition(hand, np.zeros(3)).frame or ""
    route = Route.of(frame_pose(pepper, q, frame)[:3, 3], curves)
    heading = None if direction_task is None else direction_task.direction
    follower = _Follower(
        pepper, hand, frame, heading, scene, joints, margin=margin,
        tolerance=check_positive("tolerance", tolerance, "[m]"), least_step=step / FINER,
    )  # fmt: skip
    first = np.clip(q, pepper.lower_limits, pepper.upper_limits)
    path, done, status, message = follower.follow(first, route.stops(step), route)
    fraction = float(done[-1] / route.length) if route.length else 1.0
    message += words_for_aside(moved_aside(pepper, follower.idle, np.ptp(path, axis=0)))
    if status not in (CartesianStatus.DONE, CartesianStatus.START_INVALID):
        message = f"{hand} hand stops after {100 * done[-1]:.1f} of {100 * route.length:.1f} cm: {message}"
        message += f" {suspect_millimeters(route.length)}".rstrip()
    hands = frame_pose(pepper, path, frame)[:, :3, 3]
    return CartesianPath(
        status=status,
        message=message,
        fraction=fraction,
        path=read_only(path),
        distances=read_only(done),
        position_error=float(np.linalg.norm(hands - route(done), axis=1).max()),
        direction_error=float("nan")
        if direction_task is None
        else max(direction_task.error(pepper, state) for state in path),
        clearance=clearance_along(pepper, path, follower.checker.scene),
        time=time.perf_counter() - begin,
    )


class _Follower:
    """Inverse kinematics from stop to stop.

    Args:
        pepper: The robot.
        hand: "left" or "right".
        frame: Name of the hand's frame.
        direction: Direction in the world in which the hand should point, a unit vector, shape (3,); None for
            any.
        scene: The world; None for the robot alone.
        joints: Joints that may move, by joints and groups; None for all.
        margin: Distance to keep from obstacles [m].
        tolerance: Tolerance of the hand's position [m].
        least_step: Minimum distance between stops [m].
    """

    def __init__(
        self,
        pepper: PepperModel,
        hand: str,
        frame: str,
        direction: Array | None,
        scene: Scene | None,
        joints: str | Sequence[str] | None,
        *,
        margin: float,
        tolerance: float,
        least_step: float,
    ) -> None:
        self.pepper, self.hand, self.frame = pepper, hand, frame
        self.direction, self.joints = direction, joints
        self.tolerance, self.least_step = tolerance, least_step
        arm_only = joints is None and f"{hand}_arm" in pepper.group_names
        margin = checked_margin(margin)
        world = (scene or Scene()).padded(margin)
        asked: list[ik.Task] = [ik.HandPosition(hand, np.zeros(3))]
        asked += [] if direction is None else [ik.Point(hand, direction)]
        self.idle = ~joints_used(pepper, asked)
        names = pepper.resolve_joints(joints)
        used = [name for name in names if not self.idle[pepper.joint_index(name)]]
        # Joints that move, and the scene they avoid, tried in turn: first no scene, which is quick and
        # checked afterwards; joints that do not move the hand rest as long as possible.
        self.ways: list[tuple[str | Sequence[str] | None, Scene | None]] = [(used, None)]
        self.ways += [(f"{hand}_arm", None)] if arm_only else []
        self.ways += [(used, world), (joints, world)]
        self.checker = checker_for(pepper, scene, margin)
        self.exact = checker_for(pepper, scene)
        self.statics = static_limits(pepper, "robot", None, scene)

    def follow(self, q: Array, stops: Array, route: Route) -> tuple[Array, Array, CartesianStatus, str]:
        """Move the hand from stop to stop.

        Args:
            q: Joint positions at the start [rad or m], shape (n,).
            stops: Distances of the stops along the route [m], increasing from 0, shape (k,).
            route: The hand's route.

        Returns:
            Joint positions at the stops reached, including the start and inserted stops, shape (m, n); the
            stops' distances [m], shape (m,); status and message.
        """
        path, done = [q], [0.0]
        fault = fault_of(self.exact, q, "start", self.statics)
        if fault is not None:
            return np.array(path), np.array(done), CartesianStatus.START_INVALID, fault[1]
        ahead = list(stops[:0:-1])
        while ahead:
            point = route(ahead[-1])
            found = self._step(path[-1], point)
            if not isinstance(found, tuple):
                path.append(found)
                done.append(ahead.pop())
            elif found[0] is CartesianStatus.JUMP and ahead[-1] - done[-1] > self.least_step:
                ahead.append((ahead[-1] + done[-1]) / 2)  # fast joints need more stops
            else:
                return np.array(path), np.array(done), *found
        message = f"{self.hand} hand did all {100 * route.length:.1f} cm."
        return np.array(path), np.array(done), CartesianStatus.DONE, message

    def _step(self, before: Array, point: Array) -> Array | tuple[CartesianStatus, str]:
        """Return the joint positions [rad or m] at the next stop, shape (n,), or status and reason.

        Args:
            before: Joint positions at the last stop [rad or m], shape (n,).
            point: The hand's next position in the world [m], shape (3,).
        """
        tasks: list[ik.Task] = [
            ik.HandPosition(self.hand, point, tolerance=self.tolerance, hard=True),
            ik.JointPosture(before, weight=STAY_WEIGHT, tolerance=np.inf),
        ]
        if self.direction is not None:
            tasks.append(ik.Point(self.hand, self._turned(before), weight=DIRECTION_WEIGHT, tolerance=np.pi))
        reasons = []
        for joints, scene in self.ways:
            result = ik.solve(
                self.pepper, tasks, start=before, joints=joints, scene=scene,
                collisions=scene is not None, restarts=0,
            )  # fmt: skip
            fault = self._fault(result, before)
            if fault is None:
                return result.q
            reasons.append(fault)
        # A reason that names an obstacle is more informative than other reasons.
        objects = self.exact.scene.names
        return next((r for r in reasons if any(name in r[1] for name in objects)), reasons[0])

    def _turned(self, before: Array) -> Array:
        """Return the next target direction, shape (3,), from joint positions `before` [rad or m], shape (n,).

        It is rotated toward the final direction by at most `TURN`.
        """
        now = frame_pose(self.pepper, before, self.frame)[:3, 0]
        direction_task = cast("Array", self.direction)
        angle = float(np.arccos(np.clip(now @ direction_task, -1.0, 1.0)))
        if angle <= TURN:
            return direction_task
        across = direction_task - (now @ direction_task) * now
        if np.linalg.norm(across) < 1e-6:  # opposite: rotate about any axis
            across = np.cross(now, np.eye(3)[np.argmin(np.abs(now))])
        return np.asarray(np.cos(TURN) * now + np.sin(TURN) * across / np.linalg.norm(across))

    def _fault(self, result: ik.IKResult, before: Array) -> tuple[CartesianStatus, str] | None:
        """Return why a step from joint positions `before` [rad or m], shape (n,), fails, or None."""
        if not result.hard_met:
            limited = result.status is ik.IKStatus.CLOSEST_LIMITS
            status = CartesianStatus.BLOCKED_BY_LIMITS if limited else CartesianStatus.OUT_OF_REACH
            limits = result.blocking_limits
            return status, result.errors[0].shortfall + (
                f", {', '.join(limits)} at a limit." if limits else "."
            )
        jump = np.abs(result.q - before)
        worst = int(np.argmax(jump))
        if jump[worst] > JUMP:
            name, unit = self.pepper.joint_names[worst], self.pepper.joint_units[worst]
            return CartesianStatus.JUMP, f"{name} would jump by {jump[worst]:.2f} {unit}."
        return self._contact(result.q)

    def _contact(self, q: Array) -> tuple[CartesianStatus, str] | None:
        """Return why contact or torque forbids joint positions q [rad or m], shape (n,), or None."""
        if self.checker.in_collision(q):
            fault = fault_of(self.exact, q, "next stop", self.statics)
            if fault is not None:
                return CartesianStatus.IN_COLLISION, fault[1]
            near = "".join(f": {' and '.join(names)} come too near" for names in self.checker.contacts(q)[:1])
            return CartesianStatus.IN_COLLISION, f"the margin would not be kept{near}."
        fault = fault_of(self.exact, q, "next stop", self.statics)
        return None if fault is None else (CartesianStatus.TORQUE_LIMIT, fault[1])
