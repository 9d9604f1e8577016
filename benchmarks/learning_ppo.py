"""PPO of stable-baselines3 on Reach, which needs torch."""

import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

from collections.abc import Iterator

import numpy as np
import torch
from harness import figures
from stable_baselines3 import PPO

from pepper_kin.learning import PepperVectorEnv, success_rate, to_sb3

ROBOTS, STEPS = 256, 153_600
SETTINGS = {
    "n_steps": 50, "batch_size": 3200, "n_epochs": 6, "learning_rate": 1e-3, "gamma": 0.95, "gae_lambda": 0.9,
    "policy_kwargs": {"net_arch": [128, 128]},
}  # fmt: skip


@figures("learning.md", "torch and stable-baselines3", seeds=1, rounds=1)
def learning_ppo(seeds: int = 5, rounds: int = 8) -> Iterator[str]:
    """PPO of stable-baselines3 on Reach.

    For each seed, shares of goals reached against processor time, and, at the end, by actions without noise
    on goals that were never seen.
    """
    torch.set_num_threads(1)
    for seed in range(seeds):
        env = to_sb3(PepperVectorEnv(ROBOTS, "Reach", autoreset_mode="SameStep"))
        learner, begin, curve = PPO("MlpPolicy", env, seed=seed, **SETTINGS), time.process_time(), []
        for _ in range(rounds):
            learner.learn(STEPS, reset_num_timesteps=False)
            share = np.mean(learner.ep_success_buffer)
            curve.append(f"{share:.2f} after {time.process_time() - begin:.0f} s")
        others = PepperVectorEnv(1024, "Reach", autoreset_mode="SameStep", goal_seed=1)
        share = success_rate(others, lambda seen, act=learner: act.predict(seen, deterministic=True)[0])
        yield f"seed {seed}: {', '.join(curve)}; new goals {share:.3f}"
