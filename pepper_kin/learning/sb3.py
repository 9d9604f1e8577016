"""Environments for stable-baselines3."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from pepper_kin.exceptions import InvalidValueError, optional
from pepper_kin.learning.imitation import Round
from pepper_kin.learning.policy import Policy
from pepper_kin.learning.vector_env import PepperVectorEnv
from pepper_kin.model.joint_vectors import check_seed, check_whole

_ROUND = 600  # number of steps of each robot in a round
_SETTINGS: dict[str, Any] = {
    "n_steps": 50, "n_epochs": 6, "learning_rate": 1e-3, "gamma": 0.95, "gae_lambda": 0.9,
    "policy_kwargs": {"net_arch": [128, 128], "log_std_init": -0.7},
}  # fmt: skip


def train_by_ppo(
    env: PepperVectorEnv,
    *,
    rounds: int = 8,
    seed: int = 0,
    on_round: Callable[[Round], object] = lambda found: None,
) -> Policy:
    """Return a policy trained by PPO of stable-baselines3, with settings that were tried on Reach.

    Observations are centered and scaled.

    Args:
        env: The environments, with `autoreset_mode=AutoresetMode.SAME_STEP` and without `goal_form`; 256 of
            them were tried.
        rounds: Number of rounds of 12 episodes of each robot; 8 rounds of 256 robots take about a minute.
        seed: Seed of goals, initial weights and noise.
        on_round: Function that is called after each round, as by `imitate`; its `success` includes the noise
            of training.

    Raises:
        InvalidValueError: for another mode or form, or a number below 1.
        MissingDependencyError: without stable-baselines3.
    """
    if env.goal_form:
        raise InvalidValueError("goal_form", True, "False: policies take arrays")
    check_whole("rounds", rounds)
    check_seed(seed)
    environments = to_sb3(env)
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    normalized = VecNormalize(environments, norm_reward=False)
    batch = max(2, 25 * env.num_envs // 2)
    learner = PPO("MlpPolicy", normalized, seed=seed, batch_size=batch, **_SETTINGS)
    policy = Policy.of_sb3(learner, env.task.name)
    for number in range(rounds):
        learner.learn(_ROUND * env.num_envs, reset_num_timesteps=False)
        policy = Policy.of_sb3(learner, env.task.name)
        on_round(Round(number + 1, rounds, float(np.mean(learner.ep_success_buffer)), policy))
    return policy


def to_sb3(env: PepperVectorEnv) -> Any:
    """Return environments as a `VecEnv` of stable-baselines3, for its `PPO("MlpPolicy", ...)` and others.

    The infos of an ended episode have `terminal_observation`, `TimeLimit.truncated`, `episode` (sum of
    rewards and length) and `is_success`; all other infos are one empty dictionary.

    Args:
        env: The environments, with `autoreset_mode=AutoresetMode.SAME_STEP`.

    Raises:
        InvalidValueError: for another mode.
        MissingDependencyError: without stable-baselines3.
    """
    if env.autoreset_mode is not AutoresetMode.SAME_STEP:
        raise InvalidValueError("autoreset_mode", env.autoreset_mode.value, "AutoresetMode.SAME_STEP")
    command = "pip install stable-baselines3"
    base: Any = optional("stable_baselines3.common.vec_env", command=command, need="to_sb3").VecEnv

    class Sb3VecEnv(_Sb3Batch, base):
        """See `to_sb3`."""

    return Sb3VecEnv(env)


class _Sb3Batch:
    """Implementation of stable-baselines3's abstract `VecEnv` by environments in one batch.

    Args:
        env: The environments.
    """

    _seeds: list[int | None]
    _reset_seeds: Callable[[], None]
    _get_indices: Callable[[Any], Sequence[int]]

    def __init__(self, env: PepperVectorEnv) -> None:
        self._env = env  # set first, since `VecEnv` reads its `render_mode`
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)  # type: ignore[call-arg]
        self._actions, self._returns = np.zeros(0), np.zeros(env.num_envs)
        self._lengths = np.zeros(env.num_envs, np.int64)

    def reset(self) -> Any:
        """Begin new episodes, with the seeds that `seed` has set."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, _ = self._env.reset(seed=seeds)
        self._reset_seeds()
        self._returns[:], self._lengths[:] = 0.0, 0
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Return observations, rewards, which episodes ended, and infos."""
        observations, rewards, terminated, truncated, found = self._env.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        ended = terminated | truncated
        infos: list[dict[str, Any]] = [{}] * self._env.num_envs
        for row in np.flatnonzero(ended):
            last = found["final_obs"]
            infos[row] = {
                "terminal_observation": {k: v[row] for k, v in last.items()}
                if isinstance(last, dict)
                else last[row],
                "TimeLimit.truncated": bool(truncated[row]),
                "is_success": bool(found["final_info"]["is_success"][row]),
                "episode": {"r": float(self._returns[row]), "l": int(self._lengths[row]), "t": 0.0},
            }
        self._returns[ended], self._lengths[ended] = 0.0, 0
        return observations, rewards.astype(np.float32), ended, infos

    def close(self) -> None:
        """Close the environments."""
        self._env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the batch once per requested environment."""
        return [getattr(self._env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the whole batch."""
        setattr(self._env, attr_name, value)

    def env_method(self, method_name: str, *arguments: Any, indices: Any = None, **options: Any) -> list[Any]:
        """Call a method of the batch once, and return its result once per requested environment."""
        result = getattr(self._env, method_name)(*arguments, **options)
        return [result] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each environment: none is wrapped."""
        return [False] * len(list(self._get_indices(indices)))
