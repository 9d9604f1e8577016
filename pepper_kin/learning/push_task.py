"""Task of a hand that pushes a box on a table to a goal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.learning.reach_task import ReachTask
from pepper_kin.learning.task import BANK, TaskState, with_goals
from pepper_kin.model import PepperModel, kept_for_robot
from pepper_kin.model.poses import rpy_from_rotation
from pepper_kin.twin import Twin, TwinBatch
from pepper_kin.twin.batch_world import BatchBodies
from pepper_kin.twin.world import World

_TABLE, _TOP = (0.5, 0.7, 0.04), 0.6  # size of the table, and height of its top [m]
_BOX, _MASS = (0.12, 0.16, 0.16), 0.3  # size [m] and mass [kg] of the box
_BEHIND = 0.125  # distance from the center of the box to the hand that pushes it [m]
_STEEPEST = 0.25  # maximum angle of the oracle's pushes to straight ahead [rad]


@dataclass(frozen=True)
class PushTask(ReachTask):
    """Push a box over a table, away from the robot, to within 3 cm of a goal.

    The simulation has contacts of the robot with box and table, and of the box with the table.
    """

    horizon: int = 150
    threshold: float = 0.03

    def _side(self) -> float:
        """Sign of y on the side of the hand."""
        return 1.0 if self.hands[0] == "left" else -1.0

    def world(self, pepper: PepperModel) -> World:
        """Return table and box."""
        scene = Scene().add_box("table", _TABLE, (0.18 + _TABLE[0] / 2, 0.0, _TOP - _TABLE[2] / 2))
        world = World(pepper, scene, friction=0.3)
        world.add_box("box", _BOX, _MASS, (0.36, 0.15 * self._side(), _TOP + _BOX[2] / 2))
        return world

    def twins(self, pepper: PepperModel, count: int, options: dict[str, Any]) -> TwinBatch:
        """Return robots, each at its table; see `RobotTask.twins`."""
        return TwinBatch(pepper, count, **options, world=self.world(pepper))

    def twin(self, pepper: PepperModel) -> Twin:
        """Return a robot at such a table."""
        return Twin(pepper, world=self.world(pepper))

    def home(self, pepper: PepperModel) -> Array:
        """Return the start posture [rad or m], shape (n,): the hand above the near edge of the table."""
        return _home(pepper, self.hands[0], self._side())

    def measure(self, twins: TwinBatch, base: Any) -> BatchBodies:
        """Return the states of the boxes."""
        return twins.body("box")

    def reset(self, state: TaskState, rows: np.ndarray, twins: TwinBatch, base: Any) -> None:
        """Set robots and boxes to the start of their episodes; see `RobotTask.reset`."""
        super().reset(state, rows, twins, base)
        place = np.column_stack([state.episode[rows, 3:5], np.full(len(rows), _TOP + _BOX[2] / 2)])
        twins.place("box", place, rows=rows)

    def episodes(self, pepper: PepperModel, speed: float, period: float, seed: int) -> Array:
        """Return desired positions (x, y, z) and initial positions (x, y) of the boxes [m], shape (m, 5)."""
        drawn = np.random.default_rng(seed)
        start = np.array([0.36, 0.15 * self._side()]) + drawn.uniform(-0.015, 0.015, (BANK, 2))
        angle, way = drawn.uniform(-0.15, 0.15, BANK), drawn.uniform(0.055, 0.08, BANK)
        end = start + way[:, np.newaxis] * np.column_stack([np.cos(angle), np.sin(angle)])
        return np.column_stack([end, np.full(BANK, _TOP + _BOX[2] / 2), start])

    def achieved_goal(self, state: TaskState) -> Array:
        """Return the positions of the boxes [m], shape (N, 1, 3)."""
        position: Array = state.measured.position
        return position[:, np.newaxis]

    def extra_observation(self, state: TaskState) -> Array:
        """Return the vectors from the hands to the boxes [m] and the boxes' x axes, shape (N, 5)."""
        box, hand = state.measured, self.hands_at(state.pepper, state.position)[:, 0]
        return np.concatenate([box.position - hand, box.rotation[:, :2, 0]], axis=1)

    def expert_targets(self, state: TaskState, before: Array, just_reset: np.ndarray) -> Array:
        """Move the hand behind the box, and push it towards its goal through its center; see `RobotTask`."""
        start = np.where(just_reset[:, np.newaxis], self.home(state.pepper), before)
        box, goal = state.measured.position, self.desired_goal(state)[:, 0]
        hand = self.hands_at(state.pepper, state.position)[:, 0]
        way = (goal - box)[:, :2]
        left = np.linalg.norm(way, axis=1, keepdims=True)
        angle = np.clip(np.arctan2(way[:, 1], np.maximum(way[:, 0], 1e-3)), -_STEEPEST, _STEEPEST)
        along = np.column_stack([np.cos(angle), np.sin(angle)])
        behind = box[:, :2] - _BEHIND * along
        gap = hand[:, :2] - behind
        ahead = (gap * along).sum(axis=1, keepdims=True)
        aside = np.linalg.norm(gap - ahead * along, axis=1, keepdims=True)
        low = (hand[:, 2:] < _TOP + 0.16) & ((aside < 0.02) | (ahead > -0.025))
        far = (left > 0.5 * self.threshold) & (way[:, :1] > 0.002)
        target = np.where(low, behind + np.minimum(0.5 * left + 0.006, 0.02) * along, behind - 0.035 * along)
        target = np.where(far, target, hand[:, :2])
        height = np.full((len(box), 1), _TOP + 0.13)
        tasks = ik.HandPosition(self.hands[0], np.concatenate([target, height], axis=1))
        names = f"{self.hands[0]}_arm"
        return ik.solve_batch(state.pepper, tasks, start, joints=names, restarts=0, collisions=False).q

    def scene(self, state: TaskState, row: int) -> Scene:
        """Return table, box and goal."""
        box, world = state.measured, self.world(state.pepper)
        world.place("box", box.position[row], rpy_from_rotation(box.rotation[row]))
        return with_goals(world.snapshot(), self.desired_goal(state)[row])


@kept_for_robot(most=8)
def _home(pepper: PepperModel, hand: str, side: float) -> Array:
    point = (0.11, 0.15 * side, _TOP + 0.2)
    return ik.solve(pepper, ik.HandPosition(hand, point), joints=f"{hand}_arm").q
