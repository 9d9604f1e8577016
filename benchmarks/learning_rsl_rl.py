"""PPO of RSL-RL on Reach, which needs rsl-rl-lib 5 and torch."""

import contextlib
import io
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

from collections.abc import Iterator

import torch
from harness import figures
from rsl_rl.runners import OnPolicyRunner
from tensordict import TensorDict

from pepper_kin.learning import PepperVectorEnv, success_rate, to_rsl_rl

ROBOTS, ITERATIONS = 512, 40
NETWORK = {
    "class_name": "MLPModel", "hidden_dims": [128, 128], "activation": "tanh", "obs_normalization": True,
}  # fmt: skip
NOISE = {"class_name": "GaussianDistribution", "init_std": 0.5, "std_type": "scalar"}
SETTINGS = {
    "num_steps_per_env": 24, "save_interval": 1000, "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
    "actor": {**NETWORK, "distribution_cfg": NOISE}, "critic": NETWORK,
    "algorithm": {
        "class_name": "PPO", "learning_rate": 1e-3, "schedule": "adaptive", "desired_kl": 0.01,
        "gamma": 0.95, "lam": 0.9, "num_learning_epochs": 5, "num_mini_batches": 4, "entropy_coef": 0.0,
    },
}  # fmt: skip


@figures("learning.md", "torch and rsl-rl-lib 5", seeds=1, rounds=1)
def learning_rsl_rl(seeds: int = 3, rounds: int = 3) -> Iterator[str]:
    """PPO of RSL-RL on Reach: the share of goals never seen that are reached, against processor time."""
    torch.set_num_threads(1)
    others = PepperVectorEnv(1024, "Reach", autoreset_mode="SameStep", goal_seed=1)
    for seed in range(seeds):
        torch.manual_seed(seed)
        env = PepperVectorEnv(ROBOTS, "Reach", autoreset_mode="SameStep")
        env.reset(seed=seed)
        with contextlib.redirect_stdout(io.StringIO()):
            runner = OnPolicyRunner(to_rsl_rl(env), SETTINGS)
        begin, curve = time.process_time(), []
        for _ in range(rounds):
            with contextlib.redirect_stdout(io.StringIO()):
                runner.learn(ITERATIONS, init_at_random_ep_len=True)
            act = runner.get_inference_policy()

            @torch.inference_mode()
            def policy(observations, act=act):
                seen = torch.as_tensor(observations)
                return act(TensorDict({"policy": seen}, batch_size=[len(seen)])).numpy()

            spent = time.process_time() - begin
            curve.append(f"{success_rate(others, policy):.3f} after {spent:.0f} s")
        yield f"seed {seed}: {', '.join(curve)}"
