"""100,000 solutions of the inverse kinematics as a dataset, in one compressed file."""

import argparse
import io
import os

import numpy as np

import pepper_kin as pk
from pepper_kin.file_access.atomic_file import write_bytes

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--count", type=int, default=100_000, help="number of targets")
parser.add_argument("--seed", type=int, default=0, help="draws the targets and the restarts")
parser.add_argument("-o", "--output", default="ik_data_set.npz", help="file to write")
options = parser.parse_args()

pepper = pk.load_pepper()
frame = "LArm_effector"

# Targets that some posture reaches: where random postures put the hand.
rng = np.random.default_rng(options.seed)
postures = rng.uniform(pepper.lower_limits, pepper.upper_limits, (options.count, pepper.n))
targets = pk.kinematics.frame_pose(pepper, postures, frame)[:, :3, 3]


def report(done: int, count: int) -> None:
    if done * 10 // count > max(0, done - 512) * 10 // count:
        print(f"{done} of {count} targets")


found = pk.ik.solve_batch(
    pepper,
    pk.ik.HandPosition("left", targets),
    seed=options.seed,
    threads=os.cpu_count() or 1,
    collisions=False,  # kinematics alone: some of the targets were drawn where the robot touches itself
    progress=report,
)
print(found.report())

content = io.BytesIO()
np.savez_compressed(
    content,
    targets=targets,
    q=found.q,
    solved=found.success,
    errors=found.errors[:, 0],
    joint_names=np.array(pepper.joint_names),
    frame=np.array(frame),
    units=np.array("targets and errors [m], q [rad], in the world of base_footprint"),
    seed=np.array(options.seed),
)
path = write_bytes(options.output, content.getvalue())
print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")

# Check the written file by forward kinematics, one posture at a time through Pinocchio.
with np.load(path, allow_pickle=False) as data:
    rows = rng.choice(np.flatnonzero(data["solved"]), min(500, int(data["solved"].sum())), replace=False)
    hands = np.array([pk.kinematics.frame_pose(pepper, q, frame)[:3, 3] for q in data["q"][rows]])
    worst = np.linalg.norm(hands - data["targets"][rows], axis=1).max()
    share = data["solved"].mean()
print(f"{100 * share:.2f} % solved; of {len(rows)} rows the worst is {1000 * worst:.3f} mm off its target")

assert share > 0.99
assert worst < 1e-3
