"""Environments for RSL-RL."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from pepper_kin.exceptions import InvalidValueError, optional
from pepper_kin.learning.vector_env import PepperVectorEnv


def to_rsl_rl(env: PepperVectorEnv, device: str = "cpu") -> Any:
    """Return environments as a `VecEnv` of RSL-RL (rsl-rl-lib 5), for its `OnPolicyRunner`.

    Observations are a TensorDict with `policy`, shape (N, obs).  `extras` have `time_outs`, since all
    episodes end by time, and in steps where episodes end `log` with their `/success`.  Writing to
    `episode_length_buf` sets the ages of the episodes in steps.

    Args:
        env: The environments, with `autoreset_mode=AutoresetMode.SAME_STEP` and without `goal_form`.
        device: Device of the tensors.

    Raises:
        InvalidValueError: for another mode or form.
        MissingDependencyError: without RSL-RL.
    """
    if env.autoreset_mode is not AutoresetMode.SAME_STEP:
        raise InvalidValueError("autoreset_mode", env.autoreset_mode.value, "AutoresetMode.SAME_STEP")
    if env.goal_form:
        raise InvalidValueError("goal_form", True, "False: RSL-RL's networks take arrays")
    base: Any = optional("rsl_rl.env", command="pip install rsl-rl-lib", need="to_rsl_rl").VecEnv
    import torch
    from tensordict import TensorDict

    class RslRlVecEnv(_RslRlBatch, base):
        """See `to_rsl_rl`."""

    return RslRlVecEnv(env, torch.as_tensor, TensorDict, device)


class _RslRlBatch:
    """Implementation of RSL-RL's abstract `VecEnv` by environments in one batch.

    Args:
        env: The environments.
        tensor: Function that makes a tensor of an array.
        tensors: Function that makes a TensorDict.
        device: Device of the tensors.
    """

    def __init__(
        self, env: PepperVectorEnv, tensor: Callable[..., Any], tensors: Callable[..., Any], device: str
    ) -> None:
        self._env, self._tensor, self._tensors = env, partial(tensor, device=device), tensors
        self.num_envs, self.num_actions = env.num_envs, int(np.prod(env.single_action_space.shape or ()))
        self.max_episode_length, self.device = env.task.horizon, device
        self.cfg = {"task": env.task.name, "speed": env.speed, "sparse": env.sparse}
        self._observations, _ = env.reset()

    @property
    def episode_length_buf(self) -> Any:
        """Steps since each episode began, shape (N,)."""
        return self._tensor(self._env.elapsed.copy())

    @episode_length_buf.setter
    def episode_length_buf(self, lengths: Any) -> None:
        self._env.elapsed[:] = lengths.cpu().numpy()

    def reset(self) -> Any:
        """Begin new episodes."""
        self._observations, _ = self._env.reset()
        return self.get_observations()

    def get_observations(self) -> Any:
        """Return the present observations."""
        return self._tensors({"policy": self._tensor(self._observations)}, batch_size=[self.num_envs])

    def step(self, actions: Any) -> tuple[Any, Any, Any, dict[str, Any]]:
        """Return observations, rewards, which episodes ended, and extras."""
        moves = actions.detach().cpu().numpy()
        self._observations, rewards, terminated, truncated, found = self._env.step(moves)
        extras: dict[str, Any] = {"time_outs": self._tensor(truncated)}
        ended = terminated | truncated
        if ended.any():
            extras["log"] = {"/success": float(found["final_info"]["is_success"][ended].mean())}
        return self.get_observations(), self._tensor(rewards.astype(np.float32)), self._tensor(ended), extras
