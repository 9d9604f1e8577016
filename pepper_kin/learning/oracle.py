"""A policy that knows the robot and the task: by inverse kinematics, plans and planned pushes."""

from __future__ import annotations

from pepper_kin.arrays import Array
from pepper_kin.learning.vector_env import PepperVectorEnv


class Oracle:
    """Solves the episodes by the methods of this library.

    Its score is what a task allows: where it is low, the task cannot be solved.

    Args:
        env: The environments.
    """

    def __init__(self, env: PepperVectorEnv) -> None:
        self._env = env

    def __call__(self) -> Array:
        """Return the actions for the present states, shape (N, k)."""
        return self._env.task.wanted(self._env)
