"""Training of policies for a task: the best policy of all rounds, and a trial against oracle and chance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.learning.imitation import Round, imitate
from pepper_kin.learning.oracle import Oracle
from pepper_kin.learning.policy import Policy, success_rate
from pepper_kin.learning.sb3 import train_by_ppo
from pepper_kin.learning.task import RobotTask
from pepper_kin.learning.tasks import task_named
from pepper_kin.learning.vector_env import PepperVectorEnv

TRAINED, CHOSEN = 0, 1
"""Seeds of the goals for training, and for the choice of the best policy."""
TRIED = 2
"""Seed of the goals for a trial."""
_TRIALS = 1024  # number of goals of a trial
_METHODS: dict[str, tuple[Callable[..., Policy], int, int]] = {
    "imitation": (imitate, 512, 12),
    "ppo": (train_by_ppo, 256, 8),
}
"""Method -> function that trains, number of robots, and number of rounds."""
_SHORT, _FEWEST = 50, 64
"""Length of episodes in steps for which `_METHODS` has the number of robots; longer ones have fewer robots,
at least the second number."""


@dataclass(frozen=True)
class Trial:
    """Fractions of new goals that are reached, from 0 to 1.

    Attributes:
        task: Name of the task.
        goals: Number of goals.
        policy: Fraction reached by the policy.
        oracle: Fraction reached by the oracle.
        chance: Fraction reached by random actions.
    """

    task: str
    goals: int
    policy: float
    oracle: float
    chance: float

    def report(self) -> str:
        """Return the fractions as a sentence."""
        return (
            f"{self.task}: of {self.goals} new goals {self.policy:.3f} are reached by the policy, "
            f"{self.oracle:.3f} by its oracle, {self.chance:.3f} by chance."
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)


def best_policy(
    task: str | RobotTask,
    method: str = "imitation",
    *,
    rounds: int | None = None,
    seed: int = 0,
    on_round: Callable[[Round], object] = lambda found: None,
) -> tuple[Policy, bool]:
    """Return the best policy of all rounds, by goals that were not trained on.

    Ctrl-C ends the training; the best so far is returned then.

    Args:
        task: A name of `TASKS`, or a task.
        method: "imitation" of the oracle, or "ppo", which needs stable-baselines3.
        rounds: Number of rounds; 12 of imitation or 8 of PPO if omitted.
        seed: Seed of goals, initial weights and draws.
        on_round: Function that is called after each round; `success` refers to goals not trained on.

    Returns:
        The policy, and whether all rounds were done.

    Raises:
        UnknownNameError: for an unknown task.
        InvalidValueError: for another method, or a number below 1.
        MissingDependencyError: for "ppo" without stable-baselines3.
        KeyboardInterrupt: Ctrl-C in the first round.
    """
    if method not in _METHODS:
        raise InvalidValueError("method", method, f"one of {', '.join(_METHODS)}")
    train, robots, usual = _METHODS[method]
    wanted = task_named(task)
    robots = max(_FEWEST, robots * _SHORT // wanted.horizon)
    env = PepperVectorEnv(robots, wanted, autoreset_mode="SameStep", goal_seed=TRAINED)
    others = PepperVectorEnv(_TRIALS, env.task, autoreset_mode="SameStep", goal_seed=CHOSEN)
    best: list[tuple[float, Policy]] = []

    def choose(found: Round) -> None:
        share = success_rate(others, found.policy)
        if not best or share >= best[0][0]:
            best[:] = [(share, found.policy)]
        on_round(found._replace(success=share))

    try:
        train(env, rounds=usual if rounds is None else rounds, seed=seed, on_round=choose)
    except KeyboardInterrupt:
        if not best:
            raise
        return best[0][1], False
    return best[0][1], True


def try_policy(policy: Policy, task: str | RobotTask | None = None) -> Trial:
    """Return the trial of a policy on goals that were used neither for its training nor for its choice.

    Args:
        policy: The policy.
        task: The task, if it is not `TASKS[policy.task]`.

    Raises:
        UnknownNameError: for an unknown task.
        InvalidValueError: for a policy of another task's observations.
    """
    env = PepperVectorEnv(_TRIALS, policy.task if task is None else task, goal_seed=TRIED)
    oracle, drawn = Oracle(env), np.random.default_rng(0)
    shape = env.action_space.shape
    shares = [
        success_rate(env, act)
        for act in (policy, lambda _: oracle(), lambda _: drawn.uniform(-1.0, 1.0, shape))
    ]
    return Trial(env.task.name, _TRIALS, *shares)
