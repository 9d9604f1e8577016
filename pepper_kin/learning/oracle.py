"""Oracle: a policy that knows the robot and the task, by inverse kinematics, plans and planned pushes."""

from __future__ import annotations

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.learning.vector_env import PepperVectorEnv


class Oracle:
    """Policy that solves episodes by the methods of this library.

    Its score is the best expected on a task: if it is low, the task cannot be solved.

    Args:
        env: The environments.
    """

    def __init__(self, env: PepperVectorEnv) -> None:
        self._env, self._targets, self._begun = env, env.twins.position, np.full(env.num_envs, -1)

    def __call__(self) -> Array:
        """Return the actions for the present states, shape (N, k)."""
        state, task = self._env.state, self._env.task
        self._targets = task.expert_targets(state, self._targets, state.begun != self._begun)
        self._begun = state.begun
        return task.expert_action(state, self._targets)
