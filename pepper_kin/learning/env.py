"""One environment: a batch of one, with the interface of `gymnasium.Env`."""

from __future__ import annotations

from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode

from pepper_kin.arrays import Array
from pepper_kin.learning.vector_env import PepperVectorEnv


class PepperEnv(gymnasium.Env[Any, Any]):
    """Environment of one Pepper with a goal; its options are those of `PepperVectorEnv`."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012

    def __init__(self, **options: Any) -> None:
        self.batch = PepperVectorEnv(1, autoreset_mode=AutoresetMode.DISABLED, **options)
        self.render_mode = self.batch.render_mode
        self.action_space, self.observation_space = (
            self.batch.single_action_space,
            self.batch.single_observation_space,
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin a new episode."""
        super().reset(seed=seed)
        observation, _ = self.batch.reset(seed=seed)
        return _first(observation), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Move the joints towards new targets for 20 ms.

        Raises:
            InvalidValueError: for NaN or another shape.
        """
        observation, reward, terminated, truncated, infos = self.batch.step([action])
        info = {"is_success": bool(infos["is_success"][0]), "distance": float(infos["distance"][0])}
        return _first(observation), float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> Any:
        """Return a picture, shape (320, 320, 3); None without `render_mode="rgb_array"`."""
        pictures = self.batch.render()
        return None if pictures is None else pictures[0]

    def compute_reward(self, achieved_goal: Any, desired_goal: Any, info: Any) -> Array:
        """Return the rewards of achieved goals for desired goals; see `PepperVectorEnv`."""
        return self.batch.compute_reward(achieved_goal, desired_goal, info)


def _first(observation: Any) -> Any:
    if isinstance(observation, dict):
        return {name: part[0] for name, part in observation.items()}
    return observation[0]
