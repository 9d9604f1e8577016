"""Imitation of a teacher: the policy acts, and the teacher corrects it (Ross and others, AISTATS 2011)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from pepper_kin.arrays import Array
from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.oracle import Oracle
from pepper_kin.learning.policy import Floats, Policy
from pepper_kin.learning.vector_env import PepperVectorEnv, ended_values
from pepper_kin.model.joint_vectors import check_seed, check_whole

_KEPT = 12  # maximum number of rounds whose data are used
_BATCHES, _BATCH = 60, 4096
_RATE = 2e-3
_LEAST_SCALE = 0.05  # minimum scale of observations


class Round(NamedTuple):
    """Result of a round of training.

    Attributes:
        done: Number of rounds done.
        total: Number of rounds in all.
        success: Fraction of the round's episodes that ended in success; in the first third of the rounds the
            teacher acts, too.
        policy: The policy after the round.
    """

    done: int
    total: int
    success: float
    policy: Policy


def imitate(
    env: PepperVectorEnv,
    teacher: Callable[[], Array] | None = None,
    *,
    rounds: int = 12,
    hidden: Sequence[int] = (128, 128),
    seed: int = 0,
    on_round: Callable[[Round], object] = lambda found: None,
) -> Policy:
    """Return a policy that imitates a teacher.

    In each round all robots run an episode, at first with the teacher's actions, then ever more with the
    policy's; the policy learns the teacher's actions in the visited states, by Adam (Kingma and Ba, 2015) on
    squared errors.  In one thread, the same seed gives the same policy.  Set `OPENBLAS_NUM_THREADS=1` in the
    process environment before NumPy is loaded: the matrices are so small that threads wait for each other.

    Args:
        env: The environments, without `goal_form`; some hundred robots.
        teacher: Function that returns the right actions for the present states of `env`, shape (N, k); the
            `Oracle` of `env` if omitted.
        rounds: Number of rounds, with an episode of each robot.
        hidden: Sizes of the layers between observations and actions.
        seed: Seed of goals, initial weights and draws.
        on_round: Function that is called after each round; its exception ends the training.

    Raises:
        InvalidValueError: for environments with `goal_form`, or a number below 1.
    """
    if env.goal_form:
        raise InvalidValueError("goal_form", True, "False: policies take arrays")
    check_whole("rounds", rounds)
    rng = np.random.default_rng(check_seed(seed))
    right_ones = Oracle(env) if teacher is None else teacher
    seen: list[Floats] = []
    taught: list[Floats] = []
    student: _Student | None = None
    for number in range(rounds):
        observations, _ = env.reset(seed=None if number else seed)
        alone = min(1.0, 3.0 * number / rounds)
        reached, over = np.zeros(env.num_envs, bool), np.zeros(env.num_envs, bool)
        for _ in range(env.task.horizon):
            right = np.asarray(right_ones(), np.float32)
            seen.append(observations)
            taught.append(right)
            acts = rng.random((env.num_envs, 1)) < alone
            moves = right if student is None else np.where(acts, student.layers(observations)[-1], right)
            observations, _, terminated, truncated, infos = env.step(moves)
            ended = (terminated | truncated) & ~over
            reached, over = reached | (ended_values(infos, "is_success", ended) > 0), over | ended
        if student is None:
            sizes = (observations.shape[1], *(check_whole("size of a layer", size) for size in hidden))
            student = _Student((*sizes, right.shape[1]), np.concatenate(seen), rng)
        seen, taught = (values[-_KEPT * env.task.horizon :] for values in (seen, taught))
        states, answers = np.concatenate(seen), np.concatenate(taught)
        for _ in range(_BATCHES):
            rows = rng.integers(0, len(states), _BATCH)
            student.learn(states[rows], answers[rows], _RATE * (1.0 - number / rounds))
        on_round(Round(number + 1, rounds, float(reached.mean()), student.policy(env.task.name)))
    assert student is not None
    return student.policy(env.task.name)


class _Student:
    """Network of tanh layers, the last one linear, trained by Adam.

    Args:
        sizes: Sizes of observations, layers and actions.
        seen: Observations, for their center and scale, shape (m, obs).
        rng: Generator of the initial weights.
    """

    def __init__(self, sizes: Sequence[int], seen: Floats, rng: np.random.Generator) -> None:
        self._center, self._scale = seen.mean(axis=0), np.maximum(seen.std(axis=0), _LEAST_SCALE)
        self._depth = len(sizes) - 1
        weights = [rng.normal(0.0, a**-0.5, (a, b)) for a, b in pairwise(sizes)]
        self._values = [np.asarray(x, np.float32) for x in (*weights, *(np.zeros(b) for b in sizes[1:]))]
        self._mean, self._square = ([np.zeros_like(x) for x in self._values] for _ in range(2))
        self._steps = 0

    def policy(self, task: str) -> Policy:
        """Return the network as a policy."""
        weights, biases = self._values[: self._depth], self._values[self._depth :]
        return Policy(task, self._center, self._scale, tuple(weights), tuple(biases))

    def layers(self, observations: Floats) -> list[Floats]:
        """Return the inputs of all layers and the output of the last, shape (N, .) each."""
        found = [(observations - self._center) / self._scale]
        for k in range(self._depth):
            x = found[-1] @ self._values[k] + self._values[self._depth + k]
            found.append(np.tanh(x) if k < self._depth - 1 else x)
        return found

    def learn(self, observations: Floats, right: Floats, rate: float) -> None:
        """Make a gradient step towards the right actions, shape (N, k)."""
        layers, slopes = self.layers(observations), [np.empty(0, np.float32)] * (2 * self._depth)
        error = np.float32(2.0 / len(right)) * (layers[-1] - right)
        for k in reversed(range(self._depth)):
            slopes[k], slopes[self._depth + k] = layers[k].T @ error, error.sum(axis=0)
            error = (error @ self._values[k].T) * (1.0 - layers[k] ** 2)
        self._steps += 1
        for value, slope, mean, square in zip(self._values, slopes, self._mean, self._square, strict=True):
            mean += 0.1 * (slope - mean)
            square += 0.001 * (slope**2 - square)
            size = np.sqrt(square / (1.0 - 0.999**self._steps)) + 1e-8
            value -= rate * mean / (1.0 - 0.9**self._steps) / size
