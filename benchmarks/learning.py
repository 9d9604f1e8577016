"""Environments a second of processor time, beside MuJoCo's rollout: `python benchmarks/learning.py`.

One environment step is 20 ms of the twin, with commands shaped, observations, rewards and new episodes.  The
peers do the same task, with the same commands, by `mujoco.rollout` in batches, and as an environment of
Gymnasium's `SyncVectorEnv` that calls `mj_step`.  Rates are measured in turn; ratios are medians.
"""

import time

import gymnasium
import mujoco
import numpy as np
from gymnasium.vector import AutoresetMode
from mujoco import rollout
from twin import MujocoRobot

import pepper_kin as pk
from pepper_kin.learning import TASKS, Oracle, PepperVectorEnv
from pepper_kin.learning.vector_env import REACH, STEPS

H, ROUNDS = 0.001, 5
SAME = AutoresetMode.SAME_STEP


class Commands:
    """The cubics to targets as arrays of positions and velocities, for the peers."""

    def __init__(self, pepper, count, speed):
        self.command, self.speed = np.tile(pepper.neutral(), (count, 1)), np.zeros((count, pepper.n))
        self.fastest, self.strongest = speed * pepper.velocity_limits, pepper.acceleration_limits

    def to(self, target):
        way, u = target - self.command, self.speed
        steady = np.maximum(1.5 * np.abs(way) / self.fastest, np.sqrt(3.0 * np.abs(way) / self.strongest))
        duration = np.maximum(np.maximum(steady, np.abs(u) / self.strongest), H)
        t = np.minimum((np.arange(STEPS) + 1)[:, None] * H, duration[:, None])
        second = ((3 * way - 2 * u * duration) / duration**2)[:, None]
        third = ((u * duration - 2 * way) / duration**3)[:, None]
        position = self.command[:, None] + t * (u[:, None] + t * (second + t * third))
        velocity = u[:, None] + t * (2 * second + t * 3 * third)
        self.command, self.speed = position[:, -1].copy(), velocity[:, -1].copy()
        return position, velocity


class RolloutEnv(PepperVectorEnv):
    """The same environment on MuJoCo's rollout."""

    def __init__(self, count):
        super().__init__(count, autoreset_mode=SAME)
        self.mujoco, self.q = MujocoRobot(self.pepper), self.twins.position
        self.v, self.commands = np.zeros_like(self.q), Commands(self.pepper, count, self.speed)

    def step(self, actions):
        target = self.q.copy()
        target[:, self.joints] += REACH * np.clip(actions, -1.0, 1.0)
        target = np.clip(target, self.pepper.lower_limits, self.pepper.upper_limits)
        controls = self.mujoco.controls(*self.commands.to(target))
        state = np.concatenate([np.zeros((self.num_envs, 1)), self.q, self.v], axis=1)
        states, _ = rollout.rollout(self.mujoco.model, [self.mujoco.data], state, controls)
        n = self.pepper.n
        self.q, self.v = states[:, -1, 1 : 1 + n].copy(), states[:, -1, 1 + n : 1 + 2 * n].copy()
        places = self.task.places(self.pepper, self.q)
        score = self.task.score(self.pepper, self.q, places, self.goals)
        self._elapsed += 1
        ended = self._elapsed >= self.task.horizon
        if ended.any():
            self._begin(ended)
            self.q[ended], self.v[ended] = self.pepper.neutral(), 0.0
            self.commands.command[ended], self.commands.speed[ended] = self.pepper.neutral(), 0.0
        return self._observations(places), self._rewards(score), ended & False, ended, {}


class SingleEnv(gymnasium.Env):
    """The same environment with calls of `mj_step`, as most are written."""

    def __init__(self):
        self.batch = RolloutEnv(1)
        self.action_space = self.batch.single_action_space
        self.observation_space = self.batch.single_observation_space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.batch.reset(seed=seed)[0][0], {}

    def step(self, action):
        env, robot = self.batch, self.batch.mujoco
        target = env.q.copy()
        target[:, env.joints] += REACH * np.clip(action, -1.0, 1.0)
        controls = robot.controls(*env.commands.to(target))[0]
        for row in controls:
            robot.data.ctrl[:] = row
            mujoco.mj_step(robot.model, robot.data)
        env.q[0], env.v[0] = robot.data.qpos, robot.data.qvel
        places = env.task.places(env.pepper, env.q)
        score = env.task.score(env.pepper, env.q, places, env.goals)
        return env._observations(places)[0], float(env._rewards(score)[0]), False, False, {}


def rate(env, steps, rng):
    """Return environment steps a second of processor time, with random actions."""
    env.reset(seed=0)
    shape = env.action_space.shape
    actions = rng.uniform(-1.0, 1.0, (8, *shape)).astype(np.float32)
    env.step(actions[0])
    begin = time.process_time()
    for k in range(steps):
        env.step(actions[k % 8])
    return steps * shape[0] / (time.process_time() - begin)


def wall_rate(env, steps, rng):
    env.reset(seed=0)
    actions = rng.uniform(-1.0, 1.0, (8, *env.action_space.shape)).astype(np.float32)
    env.step(actions[0])
    begin = time.perf_counter()
    for k in range(steps):
        env.step(actions[k % 8])
    return steps * env.num_envs / (time.perf_counter() - begin)


def held_targets(pepper, count=1024):
    """Return the time of a step of raw commands, which jump by up to 0.1 rad and saturate the motors [us]."""
    twins, rng = pk.TwinBatch(pepper, count), np.random.default_rng(0)
    spent = []
    for _ in range(5):
        target = twins.position + rng.uniform(-0.1, 0.1, (count, pepper.n))
        target = np.repeat(np.clip(target, pepper.lower_limits, pepper.upper_limits)[:, None], STEPS, axis=1)
        begin = time.process_time()
        twins.follow(target)
        spent.append((time.process_time() - begin) / count)
    return 1e6 * np.median(spent)


def main():
    rng = np.random.default_rng(0)
    for name in TASKS:
        env = PepperVectorEnv(1024, name, autoreset_mode=SAME)
        scores = {}
        shape = env.action_space.shape
        policies = {"oracle": Oracle(env), "random": lambda shape=shape: rng.uniform(-1.0, 1.0, shape)}
        for policy, act in policies.items():
            env.reset(seed=1)
            ends = []
            while len(ends) < 2:
                *_, truncated, infos = env.step(act())
                if truncated.any():
                    ends.append(infos["final_info"]["is_success"].mean())
            scores[policy] = np.mean(ends)
        print(f"{name:10} oracle {scores['oracle']:.3f}, random {scores['random']:.3f}")
    ours = {name: PepperVectorEnv(1024, name, autoreset_mode=SAME) for name in TASKS}
    single = gymnasium.vector.SyncVectorEnv([SingleEnv] * 8)
    peers = {"mujoco.rollout": RolloutEnv(256), "SyncVectorEnv": single}
    found = {name: [] for name in (*ours, *peers)}
    for _ in range(ROUNDS):
        for name, env in ours.items():
            found[name].append(rate(env, 60, rng))
        for name, env in peers.items():
            found[name].append(rate(env, 12, rng))
    for name, rates in found.items():
        times = np.median(np.array(found["Reach"]) / np.array(rates))
        print(
            f"{name:15} {np.median(rates):9.0f} environment steps/s and core; Reach is {times:.2f} times that"
        )
    threads = [PepperVectorEnv(4096, autoreset_mode=SAME, threads=count) for count in (1, 2)]
    ratios = [wall_rate(threads[1], 20, rng) / wall_rate(threads[0], 20, rng) for _ in range(ROUNDS)]
    print(f"two threads over one: {np.median(ratios):.2f}")
    spent = held_targets(ours["Reach"].pepper)
    print(f"held random targets of 0.1 rad: {spent:.0f} us, {1e6 / spent:.0f} environment steps/s and core")


if __name__ == "__main__":
    main()
