"""A network learns to reach from inverse kinematics, in NumPy: it acts, and is told what was right."""

import os
import tempfile
from itertools import pairwise
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of small matrices threads wait for each other

import numpy as np

from pepper_kin.learning import Oracle, PepperVectorEnv

ROBOTS, ROUNDS, KEPT, BATCHES, BATCH = 512, 12, 12, 60, 4096
rng = np.random.default_rng(0)


class Network:
    """Two layers of 128 tanh, trained by Adam (Kingma and Ba, 2015) on squared errors."""

    def __init__(self, inputs, outputs):
        sizes = inputs, 128, 128, outputs
        weights = [rng.normal(0.0, a**-0.5, (a, b)) for a, b in pairwise(sizes)]
        self.values = [np.float32(x) for x in (*weights, *(np.zeros(b) for b in sizes[1:]))]
        self.mean, self.square = ([np.zeros_like(x) for x in self.values] for _ in range(2))
        self.steps = 0

    def layers(self, x):
        """Return the inputs and what each layer makes of them, shape (N, .) each."""
        found = [x]
        for k in range(3):
            x = x @ self.values[k] + self.values[3 + k]
            x = np.tanh(x) if k < 2 else x
            found.append(x)
        return found

    def __call__(self, x):
        """Return the actions for observations, shape (N, k)."""
        return self.layers(x)[-1]

    def learn(self, x, right, rate):
        """Take a step toward actions that are right, shape (N, k)."""
        layers, slopes = self.layers(x), [None] * 6
        error = 2.0 * (layers[-1] - right) / len(x)
        for k in (2, 1, 0):
            slopes[k], slopes[3 + k] = layers[k].T @ error, error.sum(axis=0)
            error = (error @ self.values[k].T) * (1.0 - layers[k] ** 2)
        self.steps += 1
        for value, slope, mean, square in zip(self.values, slopes, self.mean, self.square, strict=True):
            mean += 0.1 * (slope - mean)
            square += 0.001 * (slope**2 - square)
            size = np.sqrt(square / (1.0 - 0.999**self.steps)) + 1e-8
            value -= rate * mean / (1.0 - 0.9**self.steps) / size


def success(env, act):
    """Return the share of goals that are reached in one episode of all robots."""
    observations, _ = env.reset(seed=1)
    for _ in range(env.task.horizon):
        observations, *_, infos = env.step(act(observations))
    return infos["final_info"]["is_success"].mean()


env = PepperVectorEnv(ROBOTS, "Reach", autoreset_mode="SameStep")
teacher, network = Oracle(env), Network(env.single_observation_space.shape[0], env.joints.size)
seen, taught, curve = [], [], []
observations, _ = env.reset(seed=0)
for round_ in range(ROUNDS):
    alone = min(
        1.0, round_ / 4
    )  # at first the teacher acts, then ever more the network (Ross and others, 2011)
    for _ in range(env.task.horizon):
        right = np.float32(teacher())
        seen.append(observations)
        taught.append(right)
        acts = rng.random((ROBOTS, 1)) < alone
        observations, *_, infos = env.step(np.where(acts, network(observations), right))
    curve.append(infos["final_info"]["is_success"].mean())
    seen, taught = (x[-KEPT * env.task.horizon :] for x in (seen, taught))
    states, answers = np.concatenate(seen), np.concatenate(taught)
    for _ in range(BATCHES):
        rows = rng.integers(0, len(states), BATCH)
        network.learn(states[rows], answers[rows], 2e-3 * (1.0 - round_ / ROUNDS))

others = PepperVectorEnv(ROBOTS, "Reach", autoreset_mode="SameStep", goal_seed=1)  # goals never seen
best, learned = success(others, lambda _: Oracle(others)()), success(others, network)
print(f"goals reached: {learned:.3f} by the network, {best:.3f} by its teacher")
with tempfile.TemporaryDirectory() as folder:
    np.savez(Path(folder) / "policy.npz", *network.values)
    with np.load(Path(folder) / "policy.npz") as file:
        again = Network(env.single_observation_space.shape[0], env.joints.size)
        again.values = [file[name] for name in file.files]
np.testing.assert_array_equal(again(observations), network(observations))

assert best > 0.98
assert learned > 0.95 * best
