"""A policy on robots that it was not trained on: with latency, before a table, and by NAOqi's setAngles."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of small matrices threads wait for each other

import numpy as np

import pepper_kin as pk
from pepper_kin.learning import PepperVectorEnv, imitate, run_policy
from pepper_kin.naoqi import Broker

EPISODES = 30
policy = imitate(PepperVectorEnv(512, "Reach", autoreset_mode="SameStep"))

batch = PepperVectorEnv(EPISODES, "Reach", goal_seed=1)  # goals never seen
observations, _ = batch.reset(seed=list(range(EPISODES)))
for _ in range(batch.task.horizon):
    observations, *_, infos = batch.step(policy(observations))
shares = {"batch": infos["is_success"].mean()}

one = PepperVectorEnv(1, "Reach", goal_seed=1)  # the same goals, by the same seeds
pepper = one.pepper
motors = pk.twin.actuator_parameters(pepper, "motor")  # friction, encoders, 20 ms of latency
table = pk.Scene().add_box("table", size=(0.4, 0.8, 0.03), position=(0.5, 0.1, 0.78))
world = pk.twin.world.World(pepper, table)
robots = {
    "twin with latency": pk.Twin(pepper, actuators=motors),
    "the same before a table": pk.Twin(pepper, actuators=motors, world=world),
}
episodes = {
    name: [run_policy(policy, one, robot, seed=seed) for seed in range(EPISODES)]
    for name, robot in robots.items()
}
for response in ("ideal", "measured"):  # how joints follow setAngles: as they should, and as on a robot
    with Broker(real_time=False, response=response) as broker:
        episodes[f"setAngles, {response}"] = [
            run_policy(policy, one, broker.motion, seed=seed, wait=broker.body.time.sleep)
            for seed in range(EPISODES)
        ]
shares |= {name: np.mean([episode.success for episode in found]) for name, found in episodes.items()}
for name, share in shares.items():
    print(f"{share:.2f} of {EPISODES} goals reached: {name}")
failed = max(episodes["the same before a table"], key=lambda episode: episode.distances[-1])
explained = failed.explanation(pepper, table)
print(explained)

assert shares["batch"] > 0.9
assert shares["twin with latency"] > 0.9
assert shares["setAngles, measured"] > 0.7
assert not failed.success
assert "table" in explained
