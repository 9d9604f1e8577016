"""A policy that knows the robot: inverse kinematics of the goals, and straight to the solution."""

from __future__ import annotations

import numpy as np

from pepper_kin import ik
from pepper_kin.arrays import Array
from pepper_kin.ik.tasks.task import Task
from pepper_kin.learning.vector_env import REACH, PepperVectorEnv


class Oracle:
    """Solves each goal once, by inverse kinematics with the acting joints, and goes there.

    Its score is what a task allows: where it is low, the task cannot be solved.

    Args:
        env: The environments.
    """

    def __init__(self, env: PepperVectorEnv) -> None:
        self._env = env
        self._goals, self._solutions = np.full_like(env.goals, np.nan), env.twins.position

    def __call__(self) -> Array:
        """Return the actions for the present states, shape (N, k)."""
        env = self._env
        rows = np.flatnonzero((self._goals != env.goals).any(axis=(1, 2)))
        if rows.size:
            goals = env.goals[rows]
            tasks: list[Task] = [ik.HandPosition(hand, goals[:, k]) for k, hand in enumerate(env.task.hands)]
            tasks += [ik.LookAt(goals[:, 0])] if env.task.gaze else []
            names = [env.pepper.joint_names[j] for j in env.joints]
            start = np.tile(env.pepper.neutral(), (len(rows), 1))
            self._solutions[rows] = ik.solve_batch(env.pepper, tasks, start, joints=names).q
            self._goals[rows] = goals
        away = (self._solutions - env.twins.position)[:, env.joints]
        return np.clip(away / REACH, -1.0, 1.0)
