"""Task of a hand that reaches a point among objects that must not be touched."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from pepper_kin import collision
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.core.episodes import Score
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.reach_task import ReachTask, postures_of
from pepper_kin.learning.task import TaskState, planned_path, touching, with_goals
from pepper_kin.model import PepperModel, kept_for_robot

SCENES = 8
_GOALS = 96  # number of goals in each scene
_TRIED = 800  # number of goals tried in each scene
_SPARE = 0.02  # enlargement of objects for the planner on every side [m]
_LEAD = 0.1  # lead of the oracle, for the lag of shaped commands [s]
_BOXES = ((0.3, 0.5, 0.04), (0.08, 0.08, 0.25), (0.1, 0.2, 0.1))


@dataclass(frozen=True)
class ClearTask(ReachTask):
    """Reach a point past a shelf, a post and a box, in one of eight arrangements; a touch is a failure."""

    horizon: int = 100

    def arrangement(self, kind: int, grown: float = 0.0) -> Scene:
        """Return an arrangement of objects, by its index from 0 to `SCENES` - 1, enlarged by `grown` [m]."""
        return _arranged(self.hands[0] == "left", kind, grown)

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return goals [m] and indices of arrangement and path, shape (m, 5).

        Each goal has a collision-free path; see `ReachTask.episodes`.
        """
        return paths_of(pepper, self, speed, period, seed)[0]

    def extra_observation(self, state: TaskState) -> Array:
        """Return the vectors from the hand to the centers of the three objects [m], shape (N, 9)."""
        kinds, hand = state.episode[:, 3].astype(np.int64), self.achieved_goal(state)
        middles = np.array([_middles(self.arrangement(kind)) for kind in range(SCENES)])
        return (middles[kinds] - hand).reshape(len(hand), -1)

    def score(self, state: TaskState, achieved: Array, desired: Array) -> Score:
        """Return the scores, with robots that touch anything as failed; see `RobotTask.score`."""
        touch = touching(state.pepper, state.position, state.episode[:, 3], self.arrangement)
        return super().score(state, achieved, desired)._replace(failed=touch)

    def expert_targets(self, state: TaskState, before: Array, just_reset: np.ndarray) -> Array:
        """Follow the planned paths; see `RobotTask.expert_targets`."""
        paths = paths_of(state.pepper, self, state.speed, state.period, state.goal_seed)[1]
        step = np.rint((state.time + _LEAD) / state.period).astype(np.int64)
        return paths[state.episode[:, 4].astype(np.int64), np.minimum(step, paths.shape[1] - 1)]

    def scene(self, state: TaskState, row: int) -> Scene:
        """Return the goal and the objects."""
        return with_goals(self.arrangement(int(state.episode[row, 3])), self.desired_goal(state)[row])


@kept_for_robot(most=8)
def paths_of(
    pepper: PepperModel, task: ClearTask, speed: float, period: float, seed: int
) -> tuple[Array, Array]:
    """Return episodes, shape (m, 5), and joint positions in each step along their paths, shape (m, T, n)."""
    postures = postures_of(pepper, ReachTask(task.name, hands=task.hands), speed, period, seed)
    points, times = task.hands_at(pepper, postures)[:, 0], period * np.arange(task.horizon + 1)
    rows: list[list[float]] = []
    paths: list[Array] = []
    for kind in range(SCENES):
        scene, found = task.arrangement(kind, 2 * _SPARE), 0
        order = np.random.default_rng([seed, kind]).permutation(len(postures))[:_TRIED]
        free = ~collision.in_collision(pepper, postures[order], scene)
        near = np.linalg.norm(points[order] - _middles(scene).mean(axis=0), axis=1) < 0.35
        for k in order[free & near]:
            ends, shares = (pepper.neutral(), postures[k]), (0.6 * speed, 0.3)
            path = planned_path(pepper, ends, scene, times, shares, timeout=0.3)
            if path is None:
                continue
            rows.append([*points[k], kind, len(paths)])
            paths.append(path)
            found += 1
            if found == _GOALS:
                break
    if not rows:
        raise InvalidValueError("speed", speed, f"more: no goal of {task.name} is reached within an episode")
    return np.array(rows), np.array(paths)


@cache
def _arranged(left: bool, kind: int, grown: float) -> Scene:
    """Return an arrangement on the side of the left or right hand, drawn by its index; cached."""
    drawn, scene = np.random.default_rng([7, kind]), Scene()
    x, y = drawn.uniform(0.3, 0.45, 3), drawn.uniform(0.05, 0.4, 3)
    z = drawn.uniform((0.75, 0.75, 0.7), (1.05, 0.95, 1.1))
    for k, size in enumerate(_BOXES):
        place = (x[k], y[k] if left else -y[k], z[k])
        scene = scene.add_box(f"box {k + 1}", np.add(size, grown), place)
    return scene


def _middles(scene: Scene) -> Array:
    """Return the centers of the objects of a scene [m], shape (k, 3)."""
    return np.array([item.transform_object_to_world[:3, 3] for item in scene.objects.values()])
