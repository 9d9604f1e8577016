"""A base that drives to a place past obstacles that its lasers see."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from pepper_kin import collision
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.core.episodes import Score
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.task import STEPS, RobotTask, by_kind, places_of, planned_path, touching
from pepper_kin.model import PepperModel, kept_for_robot, load_pepper
from pepper_kin.twin.base import BaseController, OmniBase
from pepper_kin.twin.sensors.batch import BatchRanges

if TYPE_CHECKING:
    from pepper_kin.learning.vector_env import PepperVectorEnv

ROOMS = 8
BASE = ("BaseX", "BaseY", "BaseYaw")
_SIZE, _WALL, _HIGH = 4.0, 0.1, 1.2  # of a room [m]
_PATHS, _TRIED = 40, 300  # in each room
_SPARE = 0.06  # [m] by which things are larger to the planner on every side
_CRUISE = 0.85  # of the speed that commands use, of the planned motions
_LEAD = 0.1  # [s] by which the oracle is ahead
_FARTHEST = 3.0  # [m] that lasers see
_BASE = OmniBase()


@dataclass(frozen=True)
class DriveTask(RobotTask):
    """A base to within 15 cm of a place in one of eight rooms with five boxes each; to touch is to fail.

    An action is the twist in the base's axes, 1 for its limits times `speed`, in which the base follows
    within its accelerations.  The arms hold still.  What is observed besides are the distances that the three
    lasers measure over 3 m, 45 of them, the way to go in the base's axes, and the twist.
    """

    horizon: int = 500
    threshold: float = 0.15
    view: ClassVar[tuple[tuple[float, ...], tuple[float, ...]]] = ((-1.1, 0.0, 4.2), (0.3, 0.0, 0.0))

    def robot(self) -> PepperModel:
        """Return Pepper on a base that moves in the plane."""
        return load_pepper(base="planar")

    def joints(self, pepper: PepperModel) -> np.ndarray:
        """Return the places of the joints of the base, shape (3,)."""
        return places_of(pepper, list(BASE))

    def room(self, kind: int, grown: float = 0.0) -> Scene:
        """Return a room, by its number from 0 to `ROOMS` - 1, with things so much larger [m]."""
        return _furnished(kind, grown)

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return goals [m], poses at the start [m, rad], rooms and paths, shape (m, 8)."""
        return drives_of(pepper, self, speed, period, seed)[0]

    def begin(self, env: PepperVectorEnv, rows: np.ndarray) -> None:
        """Put robots to rest where their episodes begin; see `RobotTask.begin`."""
        q = np.tile(env.pepper.neutral(), (len(rows), 1))
        q[:, env.joints] = env.episode[rows, 3:6]
        env.twins.reset(q, rows=rows)
        _bases(env).reset(env.episode[rows, 3:6], rows=rows)

    def advance(self, env: PepperVectorEnv, moves: Array) -> np.ndarray:
        """Let the bases go for twists, shape (N, 3), for a step; see `RobotTask.advance`."""
        bases = _bases(env)
        bases.command(moves * _limits(env.speed))
        bases.step(env.period)
        targets = np.tile(env.pepper.neutral(), (env.num_envs, 1))
        targets[:, env.joints] = bases.pose
        return env.twins.step(targets, STEPS, commands="linear", threads=env.threads)

    def places(self, env: PepperVectorEnv) -> Array:
        """Return where the bases are [m], shape (N, 1, 3)."""
        return (env.twins.position[:, env.joints] * (1.0, 1.0, 0.0))[:, np.newaxis]

    def goals(self, env: PepperVectorEnv) -> Array:
        """Return where they should be [m], shape (N, 1, 3)."""
        return env.episode[:, np.newaxis, :3].copy()

    def extra(self, env: PepperVectorEnv) -> Array:
        """Return what the class says, shape (N, 51)."""
        ranges, q = np.empty((env.num_envs, 45)), env.twins.position
        for kind, rows in by_kind(env.episode[:, 6]):
            ranges[rows] = _lasers(env.pepper, self, kind).read(q[rows])
        seen = np.clip(np.where(ranges == -np.inf, 0.0, ranges), 0.0, _FARTHEST) / _FARTHEST
        way = self.goals(env)[:, 0] - self.places(env)[:, 0]
        return np.concatenate([seen, _turned(way, q[:, env.joints[2]]), _bases(env).twist], axis=1)

    def score(self, env: PepperVectorEnv, places: Array, goals: Array) -> Score:
        """Return how far the bases have to go, and which robots touch anything; see `RobotTask.score`."""
        found, q = super().score(env, places, goals), env.twins.position
        return found._replace(failed=touching(env.pepper, q, env.episode[:, 6], self.room))

    def wanted(self, env: PepperVectorEnv) -> Array:
        """Follow the planned motions; see `RobotTask.wanted`."""
        paths = drives_of(env.pepper, self, env.speed, env.period, env.goal_seed)[1]
        step = np.minimum(env.elapsed + round(_LEAD / env.period), paths.shape[1] - 1)
        pose = _bases(env).pose
        away = paths[env.episode[:, 7].astype(np.int64), step] - pose
        twist = np.column_stack([_turned(away, pose[:, 2])[:, :2], away[:, 2]]) / _LEAD
        return np.clip(twist / _limits(env.speed), -1.0, 1.0)

    def shown(self, env: PepperVectorEnv, row: int) -> Scene:
        """Return the room and the goal."""
        x, y, _ = self.goals(env)[row, 0]
        return self.room(int(env.episode[row, 6])).add_sphere("goal 1", 0.1, (x, y, 0.1))


@cache
def _furnished(kind: int, grown: float) -> Scene:
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
        InvalidValueError: where the episodes are too short for any.
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


def _bases(env: PepperVectorEnv) -> BaseController:
    return env.made("bases", lambda: BaseController(_BASE, count=env.num_envs))


def _limits(speed: float) -> Array:
    geometry = _BASE.geometry
    return speed * np.array([geometry.linear_velocity, geometry.linear_velocity, geometry.angular_velocity])


def _turned(way: Array, yaw: Array) -> Array:
    """Return ways, shape (N, 3), in the axes of bases that are turned by a yaw [rad], shape (N,)."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y = way[:, 0], way[:, 1]
    return np.column_stack([cos * x + sin * y, cos * y - sin * x, way[:, 2]])
