"""Hands to points, and the gaze on them: goals that can be reached in the time, and how states are scored."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pepper_kin import collision, dynamics, ik, kinematics
from pepper_kin.arrays import Array
from pepper_kin.collision import Scene
from pepper_kin.core.simulation.target_following import time_to_target
from pepper_kin.exceptions import InvalidValueError, UnknownNameError
from pepper_kin.model import PepperModel, Sphere, kept_for_robot

CAMERA = "CameraTop_optical_frame"
BANK = 2048
_DRAWN = 8 * BANK
_SPARE = 0.05  # of the joints' ranges, that goals stay away from their ends
_IN_TIME = 0.6  # of an episode, in which a straight way of the joints leads to a goal
_BALL, _ORANGE = Sphere(0.025), (0.93, 0.36, 0.20, 1.0)
_HELD = 0.9  # of the efforts


class Score(NamedTuple):
    """How N states meet their goals.

    Attributes:
        distance: Greatest distance of a hand from its goal [m], shape (N,).
        angle: Between the gaze and the first goal [rad], shape (N,); 0 for tasks without gaze.
        success: Whether both are within the thresholds, shape (N,).
    """

    distance: Array
    angle: Array
    success: np.ndarray


@dataclass(frozen=True)
class ReachTask:
    """What is asked of the robot.

    Attributes:
        name: Its name.
        hands: "left", "right" or both: the hands that have a goal each.
        gaze: Whether the camera should look at the first hand's goal.
        threshold: Greatest distance of a hand that has reached its goal [m].
        gaze_threshold: Greatest angle of the gaze [rad].
        horizon: Steps of an episode.
    """

    name: str
    hands: tuple[str, ...]
    gaze: bool = False
    threshold: float = 0.05
    gaze_threshold: float = np.radians(5.0)
    horizon: int = 50

    def joints(self, pepper: PepperModel) -> np.ndarray:
        """Return the places of the joints that actions move, shape (k,)."""
        groups = [f"{hand}_arm" for hand in self.hands] + (["head"] if self.gaze else [])
        return np.array([pepper.joint_index(name) for name in pepper.resolve_joints(groups)])

    def places(self, pepper: PepperModel, q: Array) -> Array:
        """Return where the hands are [m], shape (N, hands, 3), at joint positions q, shape (N, n)."""
        frames = [ik.HandPosition(hand, np.zeros(3)).frame or "" for hand in self.hands]
        return np.stack([kinematics.frame_pose(pepper, q, frame)[:, :3, 3] for frame in frames], axis=1)

    def score(self, pepper: PepperModel, q: Array, places: Array, goals: Array) -> Score:
        """Return how states meet goals.

        Args:
            pepper: The robot.
            q: Joint positions [rad or m], shape (N, n).
            places: Where the hands are there [m], shape (N, hands, 3).
            goals: Where they should be [m], shape (N, hands, 3).
        """
        distance = np.linalg.norm(goals - places, axis=2).max(axis=1)
        angle = np.zeros(len(q))
        if self.gaze:
            camera = kinematics.frame_pose(pepper, q, CAMERA)
            line = np.einsum("nji,nj->ni", camera[:, :3, :3], goals[:, 0] - camera[:, :3, 3])
            angle = np.arctan2(np.hypot(line[:, 0], line[:, 1]), line[:, 2])
        return Score(distance, angle, (distance < self.threshold) & (angle <= self.gaze_threshold))

    def shown(self, goals: Array) -> Scene:
        """Return what pictures show of goals [m], shape (hands, 3): balls, which nothing touches."""
        scene = Scene()
        for hand, goal in zip(self.hands, goals, strict=True):
            scene = scene.add(f"goal of the {hand} hand", _BALL, goal, color=_ORANGE)
        return scene


TASKS = {
    "Reach": ReachTask("Reach", ("left",)),
    "ReachBoth": ReachTask("ReachBoth", ("left", "right")),
    "GazeReach": ReachTask("GazeReach", ("left",), gaze=True),
}


def task_named(task: str | ReachTask) -> ReachTask:
    """Return a task, by its name or as it is.

    Raises:
        UnknownNameError: listing the tasks.
        InvalidValueError: for something else.
    """
    if isinstance(task, ReachTask):
        return task
    if not isinstance(task, str):
        raise InvalidValueError("task", repr(task), f"a ReachTask, or one of {', '.join(TASKS)}")
    if task not in TASKS:
        raise UnknownNameError("task", task, TASKS)
    return TASKS[task]


@kept_for_robot(most=16)
def goals_of(pepper: PepperModel, task: ReachTask, speed: float, period: float, seed: int) -> Array:
    """Return goals that can be reached from the neutral posture in the time of an episode [m], (m, hands, 3).

    They are where the hands are in postures that touch nothing, that the joints can hold, and to which
    commands lead in six tenths of the time; with gaze the head can look at them too.

    Args:
        pepper: The robot.
        task: The task.
        speed: Share of the velocity limits that commands use.
        period: Time of a step [s].
        seed: Draws the postures.

    Raises:
        InvalidValueError: where the episodes are too short for any.
    """
    joints, home = task.joints(pepper), pepper.neutral()
    low, high = pepper.lower_limits[joints], pepper.upper_limits[joints]
    spare = _SPARE * (high - low)
    drawn = np.random.default_rng(seed).uniform(low + spare, high - spare, (_DRAWN, joints.size))
    fastest, strongest = speed * pepper.velocity_limits[joints], pepper.acceleration_limits[joints]
    q = np.tile(home, (_DRAWN, 1))
    q[:, joints] = drawn
    if task.gaze:
        points = task.places(pepper, q)[:, 0]
        found = ik.solve_batch(pepper, ik.LookAt(points), q, joints="head", restarts=0, collisions=False)
        q = found.q[found.success]
    way = np.abs(q[:, joints] - home[joints])
    longest = np.array(
        [
            max(time_to_target(d, 0.0, v, a) for d, v, a in zip(row, fastest, strongest, strict=True))
            for row in way.tolist()
        ]
    )
    q = q[longest <= _IN_TIME * task.horizon * period]
    q = q[~collision.in_collision(pepper, q)]
    share = np.abs(dynamics.gravity_torque(pepper, q)) / np.where(
        pepper.effort_limits > 0, pepper.effort_limits, np.inf
    )
    q = q[(share <= _HELD).all(axis=1)][:BANK]
    if not len(q):
        raise InvalidValueError("speed", speed, f"more: no goal of {task.name} is reached within an episode")
    return task.places(pepper, q)
