"""PPO of stable-baselines3 on Reach: `python benchmarks/learning_ppo.py [SEEDS]`, which needs torch.

For each seed, shares of goals reached against processor time, and, at the end, by actions without noise on
goals that were never seen.
"""

import os
import sys
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from stable_baselines3 import PPO

from pepper_kin.learning import PepperVectorEnv, to_sb3

ROBOTS, ROUNDS, STEPS = 256, 8, 153_600
SETTINGS = {
    "n_steps": 50, "batch_size": 3200, "n_epochs": 6, "learning_rate": 1e-3, "gamma": 0.95, "gae_lambda": 0.9,
    "policy_kwargs": {"net_arch": [128, 128]},
}  # fmt: skip


def reached(policy):
    """Return the share of new goals that are reached."""
    env = PepperVectorEnv(1024, "Reach", autoreset_mode="SameStep", goal_seed=1)
    observations, _ = env.reset(seed=1)
    for _ in range(env.task.horizon):
        actions, _ = policy.predict(observations, deterministic=True)
        observations, *_, infos = env.step(actions)
    return infos["final_info"]["is_success"].mean()


def main():
    torch.set_num_threads(1)
    for seed in range(int(sys.argv[1]) if len(sys.argv) > 1 else 5):
        env = to_sb3(PepperVectorEnv(ROBOTS, "Reach", autoreset_mode="SameStep"))
        learner, begin, curve = PPO("MlpPolicy", env, seed=seed, **SETTINGS), time.process_time(), []
        for _ in range(ROUNDS):
            learner.learn(STEPS, reset_num_timesteps=False)
            share = np.mean(learner.ep_success_buffer)
            curve.append(f"{share:.2f} after {time.process_time() - begin:.0f} s")
        print(f"seed {seed}: {', '.join(curve)}; new goals {reached(learner):.3f}", flush=True)


if __name__ == "__main__":
    main()
