"""Task of a base that drives to a goal past obstacles that its lasers measure."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import ClassVar, NamedTuple

import numpy as np

from pepper_kin import collision
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.core.episodes import Score
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.task import (
    STEPS,
    RobotTask,
    TaskState,
    by_kind,
    joint_indices,
    planned_path,
    touching,
)
from pepper_kin.model import PepperModel, kept_for_robot, load_pepper
from pepper_kin.twin import TwinBatch
from pepper_kin.twin.base import BaseController, OmniBase
from pepper_kin.twin.sensors.batch import BatchRanges

ROOMS = 8
BASE = ("BaseX", "BaseY", "BaseYaw")
_SIZE, _WALL, _HIGH = 4.0, 0.1, 1.2  # side of a room, thickness of a wall, height of walls and boxes [m]
_PATHS, _TRIED = 40, 300  # number of paths, and of attempts, in each room
_SPARE = 0.06  # enlargement of objects for the planner on every side [m]
_CRUISE = 0.85  # speed of the planned motions relative to the speed that commands use
_LEAD = 0.1  # lead of the oracle [s]
_FARTHEST = 3.0  # maximum range of the lasers [m]
_BASE = OmniBase()


class BaseMotion(NamedTuple):
    """Poses and twists of N bases.

    Attributes:
        pose: x, y [m] and yaw [rad] in the world, shape (N, 3).
        twist: Twists in the bases' axes [m/s, rad/s], shape (N, 3).
    """

    pose: Array
    twist: Array


@dataclass(frozen=True)
class DriveTask(RobotTask):
    """Drive to within 15 cm of a goal in one of eight rooms with five boxes each; a touch is a failure.

    An action is the twist in the base's axes, 1 for its limits times `speed`; the base follows it within its
    accelerations.  The arms do not move.  Further observations are the 45 distances of the three lasers over
    3 m, the vector to the goal in the base's axes, and the twist.
    """

    horizon: int = 500
    threshold: float = 0.15
    view: ClassVar[tuple[tuple[float, ...], tuple[float, ...]]] = ((-1.1, 0.0, 4.2), (0.3, 0.0, 0.0))

    def robot(self) -> PepperModel:
        """Return Pepper on a base that moves in the plane."""
        return load_pepper(base="planar")

    def joints(self, pepper: PepperModel) -> np.ndarray:
        """Return the indices of the joints of the base, shape (3,)."""
        return joint_indices(pepper, list(BASE))

    def room(self, kind: int, grown: float = 0.0) -> Scene:
        """Return a room, by its index from 0 to `ROOMS` - 1, with objects enlarged by `grown` [m]."""
        return _furnished(kind, grown)

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return goals [m], poses at the start [m, rad], indices of rooms and paths, shape (m, 8)."""
        return drives_of(pepper, self, speed, period, seed)[0]

    def base(self, pepper: PepperModel, count: int) -> BaseController:
        """Return the controller that limits the accelerations of N bases."""
        return BaseController(_BASE, count=count)

    def measure(self, twins: TwinBatch, base: BaseController) -> BaseMotion:
        """Return poses and twists of the bases."""
        return BaseMotion(base.pose, base.twist)

    def reset(self, state: TaskState, rows: np.ndarray, twins: TwinBatch, base: BaseController) -> None:
        """Set robots at rest to the start of their episodes; see `RobotTask.reset`."""
        pose, q = state.episode[rows, 3:6], np.tile(self.home(state.pepper), (len(rows), 1))
        q[:, state.joints] = pose
        twins.reset(q, rows=rows)
        base.reset(pose, rows=rows)

    def simulate(
        self, state: TaskState, actions: Array, twins: TwinBatch, base: BaseController
    ) -> np.ndarray:
        """Simulate a step of the bases with commanded twists, shape (N, 3); see `RobotTask.simulate`."""
        base.command(actions * _limits(state.speed))
        base.step(state.period)
        targets = np.tile(self.home(state.pepper), (len(actions), 1))
        targets[:, state.joints] = base.pose
        return twins.step(targets, STEPS, commands="linear", threads=state.threads)

    def achieved_goal(self, state: TaskState) -> Array:
        """Return the positions of the bases [m], shape (N, 1, 3)."""
        return (state.position[:, state.joints] * (1.0, 1.0, 0.0))[:, np.newaxis]

    def desired_goal(self, state: TaskState) -> Array:
        """Return the desired positions of the bases [m], shape (N, 1, 3)."""
        return state.episode[:, np.newaxis, :3].copy()

    def extra_observation(self, state: TaskState) -> Array:
        """Return laser distances over 3 m, vector to the goal and twist in the base's axes, shape (N, 51)."""
        q, yaw = state.position, state.position[:, state.joints[2]]
        ranges = np.empty((len(q), 45))
        for kind, rows in by_kind(state.episode[:, 6]):
            ranges[rows] = _lasers(state.pepper, self, kind).read(q[rows])
        seen = np.clip(np.where(ranges == -np.inf, 0.0, ranges), 0.0, _FARTHEST) / _FARTHEST
        way = self.desired_goal(state)[:, 0] - self.achieved_goal(state)[:, 0]
        return np.concatenate([seen, _turned(way, yaw), state.measured.twist], axis=1)

    def score(self, state: TaskState, achieved: Array, desired: Array) -> Score:
        """Return the scores, with robots that touch anything as failed; see `RobotTask.score`."""
        touch = touching(state.pepper, state.position, state.episode[:, 6], self.room)
        return super().score(state, achieved, desired)._replace(failed=touch)

    def expert_targets(self, state: TaskState, before: Array, just_reset: np.ndarray) -> Array:
        """Follow the planned motions; see `RobotTask.expert_targets`."""
        paths = drives_of(state.pepper, self, state.speed, state.period, state.goal_seed)[1]
        step = np.minimum(state.elapsed + round(_LEAD / state.period), paths.shape[1] - 1)
        targets = np.tile(self.home(state.pepper), (len(step), 1))
        targets[:, state.joints] = paths[state.episode[:, 7].astype(np.int64), step]
        return targets

    def expert_action(self, state: TaskState, targets: Array) -> Array:
        """Return the twists that lead to the targets; see `RobotTask.expert_action`."""
        pose = state.measured.pose
        away = targets[:, state.joints] - pose
        twist = np.column_stack([_turned(away, pose[:, 2])[:, :2], away[:, 2]]) / _LEAD
        return np.clip(twist / _limits(state.speed), -1.0, 1.0)

    def scene(self, state: TaskState, row: int) -> Scene:
        """Return the room and the goal."""
        x, y, _ = self.desired_goal(state)[row, 0]
        return self.room(int(state.episode[row, 6])).add_sphere("goal 1", 0.1, (x, y, 0.1))


@cache
def _furnished(kind: int, grown: float) -> Scene:
    """Return a room with four walls and five boxes, drawn by its index, enlarged by `grown` [m]; cached."""
    drawn, scene, half = np.random.default_rng([11, kind]), Scene(), _SIZE / 2
    for k, (x, y) in enumerate(((half, 0.0), (-half, 0.0), (0.0, half), (0.0, -half))):
        size = np.add((_WALL, _SIZE, _HIGH) if x else (_SIZE, _WALL, _HIGH), grown)
        scene = scene.add_box(f"wall {k + 1}", size, (x, y, _HIGH / 2))
    for k in range(5):
        x, y = drawn.uniform(-1.4, 1.4, 2)
        size = np.add((*drawn.uniform(0.2, 0.6, 2), _HIGH), grown)
        scene = scene.add_box(f"box {k + 1}", size, (x, y, _HIGH / 2), (0.0, 0.0, drawn.uniform(0, np.pi)))
    return scene


@kept_for_robot(most=32)
def _lasers(pepper: PepperModel, task: DriveTask, kind: int) -> BatchRanges:
    return BatchRanges(pepper, task.room(kind))


@kept_for_robot(most=8)
def drives_of(
    pepper: PepperModel, task: DriveTask, speed: float, period: float, seed: int
) -> tuple[Array, Array]:
    """Return episodes, shape (m, 8), and poses in each step along their paths [m, rad], shape (m, T, 3).

    Raises:
        InvalidValueError: if the episodes are too short for any path.
    """
    joints, times = task.joints(pepper), period * np.arange(task.horizon + 1)
    shares = (_CRUISE * speed, _CRUISE)
    rows: list[list[float]] = []
    paths: list[Array] = []
    for kind in range(ROOMS):
        room, found = task.room(kind, 2 * _SPARE), 0
        drawn = np.random.default_rng([seed, kind])
        ends = np.tile(pepper.neutral(), (2 * _TRIED, 1))
        ends[:, joints] = drawn.uniform((-1.5, -1.5, -np.pi), (1.5, 1.5, np.pi), (2 * _TRIED, 3))
        free = ~collision.in_collision(pepper, ends, room)
        for start, end in ends.reshape(_TRIED, 2, -1)[free.reshape(_TRIED, 2).all(axis=1)]:
            way = np.linalg.norm((end - start)[joints[:2]])
            if not 0.6 <= way <= 1.2:
                continue
            end[joints[2]] = start[joints[2]]
            path = planned_path(pepper, (start, end), room, times, shares, joints=list(BASE), timeout=0.05)
            if path is None:
                continue
            rows.append([*end[joints[:2]], 0.0, *start[joints], kind, len(paths)])
            paths.append(path[:, joints])
            found += 1
            if found == _PATHS:
                break
    if not rows:
        raise InvalidValueError("speed", speed, f"more: no goal of {task.name} is reached within an episode")
    return np.array(rows), np.array(paths)


def _limits(speed: float) -> Array:
    """Return the limits of the twist at a speed ratio [m/s, m/s, rad/s], shape (3,)."""
    geometry = _BASE.geometry
    return speed * np.array([geometry.linear_velocity, geometry.linear_velocity, geometry.angular_velocity])


def _turned(way: Array, yaw: Array) -> Array:
    """Return vectors, shape (N, 3), in the axes of bases with a yaw [rad], shape (N,)."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y = way[:, 0], way[:, 1]
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, way[:, 2]])
