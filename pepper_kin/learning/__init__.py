"""Pepper's twin as environments of Gymnasium: `pip install pepper_kin[learning]`.

    PepperVectorEnv, PepperEnv    many environments in one batch of twins, and one
    TASKS, RobotTask, ReachTask   tasks with episodes, goals and scores
    TaskState                     state of the robots between two steps, for a task
    Randomization                 ranges by which robots differ
    to_sb3, to_rsl_rl             environments for stable-baselines3 and RSL-RL
    imitate, Round                a policy from a teacher, in NumPy
    Policy, load_policy           policies as small networks, and their files
    run_policy, Episode           a policy on a twin with contacts and latency, or on NAOqi's ALMotion
    best_policy, try_policy, Trial   training and trial of a policy, as `pepper-kin learn` does
    train_by_ppo                  a policy by PPO of stable-baselines3
    success_rate                  fraction of a policy's episodes that end in success
    Oracle                        solves the tasks by the methods of this library: an upper bound on success

Importing it registers `PepperReach-v0` and the other tasks of `TASKS`, for `gymnasium.make` and for
`gymnasium.make_vec(..., vectorization_mode="vector_entry_point")`.
"""

# ruff: noqa: E402 -- a missing package is reported first

from pepper_kin.call_errors import name_options
from pepper_kin.exceptions import optional

gymnasium = optional("gymnasium", extra="learning", need="pepper_kin.learning")

from pepper_kin.learning.env import PepperEnv
from pepper_kin.learning.episode import Episode, run_policy
from pepper_kin.learning.imitation import Round, imitate
from pepper_kin.learning.oracle import Oracle
from pepper_kin.learning.policy import Policy, load_policy, success_rate
from pepper_kin.learning.randomization import Randomization
from pepper_kin.learning.reach_task import ReachTask
from pepper_kin.learning.rsl_rl import to_rsl_rl
from pepper_kin.learning.sb3 import to_sb3, train_by_ppo
from pepper_kin.learning.task import RobotTask, TaskState
from pepper_kin.learning.tasks import TASKS
from pepper_kin.learning.training import TRIED, Trial, best_policy, try_policy
from pepper_kin.learning.vector_env import PepperVectorEnv

__all__ = [
    "TASKS",
    "TRIED",
    "Episode",
    "Oracle",
    "PepperEnv",
    "PepperVectorEnv",
    "Policy",
    "Randomization",
    "ReachTask",
    "RobotTask",
    "Round",
    "TaskState",
    "Trial",
    "best_policy",
    "imitate",
    "load_policy",
    "run_policy",
    "success_rate",
    "to_rsl_rl",
    "to_sb3",
    "train_by_ppo",
    "try_policy",
]

for _name in TASKS:
    if f"Pepper{_name}-v0" not in gymnasium.registry:
        gymnasium.register(
            f"Pepper{_name}-v0",
            entry_point="pepper_kin.learning.env:PepperEnv",
            vector_entry_point="pepper_kin.learning.vector_env:PepperVectorEnv",
            kwargs={"task": _name},
        )

name_options(__name__)
