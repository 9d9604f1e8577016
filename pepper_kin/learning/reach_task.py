"""Tasks of hands that reach points, with gaze, follow moving points, or carry an object level."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin import collision, dynamics, ik, kinematics
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.collision.loads import inverse_dynamics_with, loads_of
from pepper_kin.core.episodes import Score
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.ik.tasks.hands import HAND_FRAMES
from pepper_kin.ik.tasks.task import Task
from pepper_kin.learning.task import BANK, RobotTask, TaskState, duration_of, joint_indices, with_goals
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.twin import Twin, TwinBatch

CAMERA = "CameraTop_optical_frame"
_DRAWN = 8 * BANK
_SPARE = 0.05  # distance of goals from the ends of the joints' ranges, relative to the ranges
_IN_TIME = 0.6  # fraction of an episode in which a straight joint motion reaches a goal
_HELD = 0.9  # maximum ratio of the effort limits that a goal posture needs
_GAZE = 0.2  # cost of the angle of the gaze in the reward [m/rad]
_TILT = 0.2  # cost of the tilt of the carried object in the reward [m/rad]


@dataclass(frozen=True)
class ReachTask(RobotTask):
    """Reach points with hands; the points can be reached in the time of an episode.

    Attributes:
        hands: "left", "right" or both: hands with a goal each.
        gaze: Whether the camera should look at the first hand's goal.
        gaze_threshold: Maximum angle between the gaze and the goal [rad].
    """

    hands: tuple[str, ...] = ("left",)
    gaze: bool = False
    gaze_threshold: float = np.radians(5.0)

    def joints(self, pepper: PepperModel) -> np.ndarray:
        """Return the indices of the joints that actions move, shape (k,)."""
        return joint_indices(pepper, [f"{hand}_arm" for hand in self.hands] + ["head"] * self.gaze)

    def hands_at(self, pepper: PepperModel, q: Array) -> Array:
        """Return the positions of the hands [m], shape (N, hands, 3), at joint positions q, shape (N, n)."""
        return np.stack([hand_pose(pepper, q, hand)[:, :3, 3] for hand in self.hands], 1)

    def achieved_goal(self, state: TaskState) -> Array:
        """Return the positions of the hands [m], shape (N, hands, 3)."""
        return self.hands_at(state.pepper, state.position)

    def desired_goal(self, state: TaskState) -> Array:
        """Return the desired positions of the hands [m], shape (N, hands, 3)."""
        return state.episode[:, : 3 * len(self.hands)].reshape(len(state.episode), -1, 3)

    def score(self, state: TaskState, achieved: Array, desired: Array) -> Score:
        """Return how states meet goals; see `RobotTask.score`."""
        found = super().score(state, achieved, desired)
        if not self.gaze:
            return found
        camera = kinematics.frame_pose(state.pepper, state.position, CAMERA)
        line = np.einsum("nji,nj->ni", camera[:, :3, :3], desired[:, 0] - camera[:, :3, 3])
        angle = np.arctan2(np.hypot(line[:, 0], line[:, 1]), line[:, 2])
        return found._replace(cost=_GAZE * angle, success=found.success & (angle <= self.gaze_threshold))

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return goals [m], shape (m, 3 hands); see `RobotTask.episodes`.

        Goals are positions of the hands in collision-free postures that the joints can hold and that commands
        reach from the neutral posture in six tenths of the time; with gaze the head can look at them.
        """
        q = postures_of(pepper, self, speed, period, seed)
        return self.hands_at(pepper, q).reshape(len(q), -1)

    def tasks(self, state: TaskState, rows: np.ndarray) -> list[Task]:
        """Return the inverse kinematics tasks of the goals of some robots, shape (k,)."""
        goals = self.desired_goal(state)[rows]
        found: list[Task] = [ik.HandPosition(hand, goals[:, k]) for k, hand in enumerate(self.hands)]
        return found + ([ik.LookAt(goals[:, 0])] if self.gaze else [])

    def expert_targets(self, state: TaskState, before: Array, just_reset: np.ndarray) -> Array:
        """Solve each goal once, from the start posture; see `RobotTask.expert_targets`."""
        found, rows = before.copy(), np.flatnonzero(just_reset)
        if rows.size:
            found[rows] = self.solved(state, rows, np.tile(self.home(state.pepper), (len(rows), 1)))
        return found

    def solved(self, state: TaskState, rows: np.ndarray, start: Array, restarts: int = 32) -> Array:
        """Return joint positions that meet the goals of some robots, shape (k, n), searched from `start`."""
        names = [state.pepper.joint_names[j] for j in state.joints]
        tasks = self.tasks(state, rows)
        return ik.solve_batch(state.pepper, tasks, start, joints=names, restarts=restarts).q

    def scene(self, state: TaskState, row: int) -> Scene:
        """Return the goals as small spheres."""
        return with_goals(Scene(), self.desired_goal(state)[row])


@dataclass(frozen=True)
class FollowTask(ReachTask):
    """Follow a point on a circle with a hand: success if it was within the threshold for some steps.

    Attributes:
        duration: Number of last steps that must all be within the threshold.
    """

    horizon: int = 100
    threshold: float = 0.04
    duration: int = 25  # type: ignore[misc]  # a field here

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return circles, shape (m, 11): center, two radii as vectors [m], rate [rad/s] and phase [rad].

        A hand can follow the circles within the joints' limits; see `ReachTask.episodes`.
        """
        first = postures_of(pepper, self, speed, period, seed)
        drawn = np.random.default_rng([seed, 1])
        turns = np.linalg.qr(drawn.normal(size=(len(first), 3, 3)))[0]
        radius, rate = drawn.uniform(0.03, 0.08, (len(first), 1)), drawn.uniform(1.0, 2.5, (len(first), 1))
        across = radius * turns[:, 0], radius * turns[:, 1]
        phase = drawn.uniform(-np.pi, np.pi, (len(first), 1))
        center = self.hands_at(pepper, first)[:, 0]
        found = np.concatenate([center, *across, rate, phase], axis=1)
        names = [pepper.joint_names[j] for j in self.joints(pepper)]
        fastest = 0.5 * speed * pepper.velocity_limits
        good, before = np.ones(len(found), bool), first
        for k in range(25):
            points = _on_circle(found, np.full(len(found), 2 * np.pi * k / 24) / found[:, 9])
            task = ik.HandPosition(self.hands[0], points)
            solved = ik.solve_batch(pepper, task, before, joints=names, restarts=0, collisions=False)
            time = 2 * np.pi / 24 / found[:, 9:10]
            slow = (np.abs(solved.q - before) <= fastest * time).all(axis=1) | (k == 0)
            good &= solved.success & slow
            good[good] &= ~collision.in_collision(pepper, solved.q[good])
            before = solved.q
        return found[good]

    def desired_goal(self, state: TaskState) -> Array:
        """Return the present positions of the points [m], shape (N, 1, 3)."""
        return self._ahead(state, 0.0)

    def _ahead(self, state: TaskState, time: float) -> Array:
        """Return the positions of the points after a time [s], shape (N, 1, 3)."""
        return _on_circle(state.episode, state.time + time)[:, np.newaxis]

    def extra_observation(self, state: TaskState) -> Array:
        """Return the points' velocities [m/s], shape (N, 3)."""
        return (self._ahead(state, 1e-3) - self._ahead(state, -1e-3))[:, 0] / 2e-3

    def tasks(self, state: TaskState, rows: np.ndarray) -> list[Task]:
        """Return the inverse kinematics tasks of the points' positions after the lag of commands."""
        return [ik.HandPosition(self.hands[0], self._ahead(state, _LEAD)[rows, 0])]

    def expert_targets(self, state: TaskState, before: Array, just_reset: np.ndarray) -> Array:
        """Solve future positions of the points, from the last solutions; see `RobotTask.expert_targets`."""
        start = super().expert_targets(state, before, just_reset)
        return self.solved(state, np.arange(len(start)), start, restarts=0)


_LEAD = 0.12
"""Lead of the oracle, for the lag of shaped commands [s]."""


@dataclass(frozen=True)
class CarryTask(ReachTask):
    """Carry a mass to a point with a hand that stays level.

    Attributes:
        tilt_threshold: Maximum tilt of the hand relative to the start [rad].
        spilled: Tilt above which the episode fails [rad].
        payload: Minimum and maximum mass in the hand [kg]; each robot has its own mass.
    """

    tilt_threshold: float = np.radians(10.0)
    spilled: float = np.radians(60.0)
    payload: tuple[float, float] = (0.05, 0.3)

    def home(self, pepper: PepperModel) -> Array:
        """Return the start posture [rad or m], shape (n,): a bent arm, which defines level."""
        q, side = pepper.neutral(), self.hands[0][0].upper()
        sign = 1.0 if side == "L" else -1.0
        for name, value in zip(_CARRYING, _CARRY_ANGLES, strict=True):
            mirrored = name != "ShoulderPitch"
            q[pepper.joint_index(side + name)] = value * (sign if mirrored else 1.0)
        return q

    def axis(self, pepper: PepperModel) -> Array:
        """Return the direction in the hand's frame that points up at the start, shape (3,)."""
        return hand_pose(pepper, self.home(pepper), self.hands[0])[2, :3]

    def twins(self, pepper: PepperModel, count: int, options: dict[str, Any]) -> TwinBatch:
        """Return robots with a mass in the hand, evenly spread; see `RobotTask.twins`."""
        return TwinBatch(pepper, count, **options, payload={self.hands[0]: self._masses(count)})

    def twin(self, pepper: PepperModel) -> Twin:
        """Return a robot with the mass in the hand of a single environment, which is observed."""
        return Twin(pepper, payload={self.hands[0]: float(self._masses(1)[0])})

    def _masses(self, count: int) -> Array:
        """Return masses of N robots, evenly spread over the range [kg], shape (N,)."""
        golden = np.modf(0.5 + np.arange(count) * (np.sqrt(5.0) - 1.0) / 2.0)[0]
        return self.payload[0] + (self.payload[1] - self.payload[0]) * golden

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return goals [m], shape (m, 3), that are reached with the hand level; see `ReachTask.episodes`."""
        q, home = postures_of(pepper, self, speed, period, seed), self.home(pepper)
        points, joints = self.hands_at(pepper, q)[:, 0], self.joints(pepper)
        names = [pepper.joint_names[j] for j in joints]
        start = np.tile(home, (len(q), 1))
        solved = ik.solve_batch(pepper, self._level(pepper, points), start, joints=names, restarts=2)
        time = duration_of(pepper, (solved.q - home)[:, joints], joints, speed)
        loads, rest = loads_of(pepper, None, {self.hands[0]: self.payload[1]}), np.zeros_like(solved.q)
        heavy = inverse_dynamics_with(pepper, loads, solved.q, rest, rest)
        held = (np.abs(heavy) <= _HELD * _efforts(pepper)).all(axis=1)
        return points[solved.success & held & (time <= _IN_TIME * self.horizon * period)]

    def _level(self, pepper: PepperModel, points: Array) -> list[Task]:
        """Return the inverse kinematics tasks of points with the hand level."""
        hand, level = self.hands[0], {"tolerance": np.radians(4.0)}
        up = ik.AxisAlignment(HAND_FRAMES[hand], (0.0, 0.0, 1.0), self.axis(pepper), **level)
        return [ik.HandPosition(hand, points), up]

    def tasks(self, state: TaskState, rows: np.ndarray) -> list[Task]:
        """Return the inverse kinematics tasks of the goals of some robots, with the hand level."""
        return self._level(state.pepper, self.desired_goal(state)[rows, 0])

    def _up(self, state: TaskState) -> Array:
        """Return the direction in the world that is up for the carried object, shape (N, 3)."""
        hand = hand_pose(state.pepper, state.position, self.hands[0])
        return hand[:, :3, :3] @ self.axis(state.pepper)

    def extra_observation(self, state: TaskState) -> Array:
        """Return x and y of the object's up direction, and the mass [kg], shape (N, 3)."""
        up = self._up(state)[:, :2]
        return np.concatenate([up, self._masses(len(up))[:, np.newaxis]], axis=1)

    def score(self, state: TaskState, achieved: Array, desired: Array) -> Score:
        """Return how states meet goals; see `RobotTask.score`."""
        found, up = super().score(state, achieved, desired), self._up(state)
        tilt = np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2])
        level = tilt <= self.tilt_threshold
        return Score(found.distance, _TILT * tilt, found.success & level, tilt > self.spilled)


_CARRYING = ("ShoulderPitch", "ShoulderRoll", "ElbowYaw", "ElbowRoll", "WristYaw")
_CARRY_ANGLES = (0.9, 0.15, -1.2, -1.2, -1.2)


@kept_for_robot(most=16)
def postures_of(pepper: PepperModel, task: ReachTask, speed: float, period: float, seed: int) -> Array:
    """Return postures with the hands at goals [rad or m], shape (m, n); see `ReachTask.episodes`.

    Raises:
        InvalidValueError: if the episodes are too short for any posture.
    """
    joints, home = task.joints(pepper), pepper.neutral()
    low, high = pepper.lower_limits[joints], pepper.upper_limits[joints]
    spare = _SPARE * (high - low)
    drawn = np.random.default_rng(seed).uniform(low + spare, high - spare, (_DRAWN, joints.size))
    q = np.tile(home, (_DRAWN, 1))
    q[:, joints] = drawn
    if task.gaze:
        points = task.hands_at(pepper, q)[:, 0]
        found = ik.solve_batch(pepper, ik.LookAt(points), q, joints="head", restarts=0, collisions=False)
        q = found.q[found.success]
    longest = duration_of(pepper, q[:, joints] - home[joints], joints, speed)
    q = q[longest <= _IN_TIME * task.horizon * period]
    q = q[~collision.in_collision(pepper, q)]
    q = q[(np.abs(dynamics.gravity_torque(pepper, q)) <= _HELD * _efforts(pepper)).all(axis=1)][:BANK]
    if not len(q):
        raise InvalidValueError("speed", speed, f"more: no goal of {task.name} is reached within an episode")
    return q


def _efforts(pepper: PepperModel) -> Array:
    """Return the effort limits [N m or N], inf for none, shape (n,)."""
    return np.where(pepper.effort_limits > 0, pepper.effort_limits, np.inf)


def hand_pose(pepper: PepperModel, q: Array, hand: str) -> Array:
    """Return the pose of a hand at joint positions [rad or m], shape (..., n): shape (..., 4, 4)."""
    return kinematics.frame_pose(pepper, q, HAND_FRAMES[hand])


def _on_circle(circles: Array, time: Array) -> Array:
    """Return points of circles, shape (N, 11), at times [s], shape (N,): shape (N, 3)."""
    angle = (circles[:, 9] * time + circles[:, 10])[:, np.newaxis]
    return circles[:, :3] + np.cos(angle) * circles[:, 3:6] + np.sin(angle) * circles[:, 6:9]
