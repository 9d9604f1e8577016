"""A network learns to reach from inverse kinematics, in NumPy: it acts, its teacher labels what it meets."""

import os
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of small matrices threads wait for each other

import numpy as np

from pepper_kin.learning import Oracle, PepperVectorEnv, imitate, load_policy, success_rate

env = PepperVectorEnv(512, "Reach", autoreset_mode="SameStep")
curve = []
policy = imitate(env, on_round=lambda found: curve.append(found.success))

others = PepperVectorEnv(512, "Reach", autoreset_mode="SameStep", goal_seed=1)  # goals never seen
teacher = Oracle(others)
best, learned = success_rate(others, lambda _: teacher()), success_rate(others, policy)
print(f"goals reached: {learned:.3f} by the network, {best:.3f} by its teacher")
with tempfile.TemporaryDirectory() as folder:
    again = load_policy(policy.save(Path(folder) / "reach.npz"))
observations, _ = others.reset(seed=2)
np.testing.assert_array_equal(again(observations), policy(observations))

assert best > 0.98
assert learned > 0.97 * best
