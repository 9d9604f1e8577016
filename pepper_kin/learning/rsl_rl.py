"""The environments as RSL-RL takes them."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from pepper_kin.exceptions import InvalidValueError, optional
from pepper_kin.learning.vector_env import PepperVectorEnv


def to_rsl_rl(env: PepperVectorEnv, device: str = "cpu") -> Any:
    """Return environments as a `VecEnv` of RSL-RL (rsl-rl-lib 5), for its `OnPolicyRunner`.

    Observations are a TensorDict with `policy`, shape (N, obs), as are those of the present states.  `extras`
    have `time_outs`, for all episodes end by time, and where episodes end `log` with their `/success`.
    What is written to `episode_length_buf` is how old the episodes are from then on.

    Args:
        env: The environments, with `autoreset_mode=AutoresetMode.SAME_STEP` and without `goal_form`.
        device: Where the tensors are.

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

    def tensor(values: np.ndarray) -> Any:
        return torch.as_tensor(values, device=device)

    class PepperVecEnv(base):
        """See `to_rsl_rl`."""

        def __init__(self) -> None:
            self.num_envs, self.num_actions = env.num_envs, int(np.prod(env.single_action_space.shape or ()))
            self.max_episode_length, self.device = env.task.horizon, device
            self.cfg = {"task": env.task.name, "speed": env.speed, "sparse": env.sparse}
            self._observations, _ = env.reset()

        @property
        def episode_length_buf(self) -> Any:
            """Steps since each episode began, shape (N,)."""
            return tensor(env.elapsed.copy())

        @episode_length_buf.setter
        def episode_length_buf(self, lengths: Any) -> None:
            env.elapsed[:] = lengths.cpu().numpy()

        def reset(self) -> Any:
            """Begin new episodes."""
            self._observations, _ = env.reset()
            return self.get_observations()

        def get_observations(self) -> Any:
            """Return the present observations."""
            return TensorDict({"policy": tensor(self._observations)}, batch_size=[self.num_envs])

        def step(self, actions: Any) -> tuple[Any, Any, Any, dict[str, Any]]:
            """Return observations, rewards, which episodes ended, and extras."""
            moves = actions.detach().cpu().numpy()
            self._observations, rewards, terminated, truncated, found = env.step(moves)
            extras: dict[str, Any] = {"time_outs": tensor(truncated)}
            ended = terminated | truncated
            if ended.any():
                extras["log"] = {"/success": float(found["final_info"]["is_success"][ended].mean())}
            return self.get_observations(), tensor(rewards.astype(np.float32)), tensor(ended), extras

    return PepperVecEnv()
