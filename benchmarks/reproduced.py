"""Answers of an earlier commit beside those of the sources here: inverse kinematics, plans, timings, runs.

Both compute the same random problems in new processes of this interpreter.  Verdicts and statuses are counted
where they differ; numbers are compared by their largest difference.  Where an algorithm was changed on
purpose in between, answers differ, and both are right: that is told apart by the tolerance that each quantity
has, and by what both answers reach.  Prints Markdown.

    python benchmarks/reproduced.py 95bd4e3
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from edits import copy_of

PROGRAM = r"""
import sys, warnings
import numpy as np
import pepper_kin as pk

warnings.simplefilter("ignore")
counts = dict(zip(("verdicts", "ik", "plans", "timings", "runs"), map(int, sys.argv[2:])))
pepper, found = pk.load_pepper().with_requirements("limits"), {}
scene = pk.Scene().add_box("table", size=(0.40, 0.80, 0.03), position=(0.47, 0.05, 0.715))
scene = scene.add_sphere("lamp", 0.06, (0.3, -0.3, 1.0)).add_cylinder("post", 0.05, 1.0, (0.2, 0.5, 0.5))
lower, upper = np.maximum(pepper.lower_limits, -3.0), np.minimum(pepper.upper_limits, 3.0)
stand = pepper.posture("Stand")
arms = [pepper.joint_index(name) for name in pepper.joint_names if name.startswith(("L", "R", "Head"))]


def postures(seed, count):
    q = np.tile(stand, (count, 1))
    q[:, arms] = np.random.default_rng(seed).uniform(lower[arms], upper[arms], (count, len(arms)))
    return q


q = np.random.default_rng(1).uniform(lower, upper, (counts["verdicts"], pepper.n))
found["verdicts"] = np.packbits(pk.collision.in_collision(pepper, q, scene))

rng, solved, where = np.random.default_rng(2), [], []
for k in range(counts["ik"]):
    side, point = ("left", "right")[k % 2], rng.uniform((0.1, -0.5, 0.4), (0.6, 0.5, 1.3))
    tasks = [pk.ik.HandPosition(side, point)] + [pk.ik.LookAt(point)] * (k % 3 == 0)
    result = pk.ik.solve(pepper, tasks, scene=scene if k % 4 == 0 else None)
    solved.append(result.status.value)
    where.append(result.q)
found["ik_status"], found["ik_q"] = np.array(solved), np.array(where)

free = [p for p in postures(3, 8 * counts["plans"]) if not pk.collision.in_collision(pepper, p, scene)]
planned, lengths = [], []
for k in range(counts["plans"]):
    start, goal = free[2 * k % len(free)], free[(2 * k + 1) % len(free)]
    plan = pk.plan(pepper, start, goal, scene, seed=k, timeout=30.0)
    planned.append(plan.status.value)
    lengths.append(plan.length if plan.success else 0.0)
found["plan_status"], found["plan_length"] = np.array(planned), np.array(lengths)

durations, shapes, trajectories = [], [], []
paths = postures(4, 5 * counts["timings"]).reshape(counts["timings"], 5, pepper.n)
for path in paths:
    trajectory = pk.retime(pepper, path)
    durations.append(trajectory.duration)
    shapes.append(trajectory(np.linspace(0.0, trajectory.duration, 33)).position)
    trajectories.append(trajectory)
found["duration"], found["position"] = np.array(durations), np.array(shapes)

states = []
for trajectory in trajectories[: counts["runs"]]:
    run = pk.Twin(pepper, timestep=0.001).execute(trajectory)
    states.append(np.concatenate([run.position[-1], run.velocity[-1], np.abs(run.torque).max(axis=0)]))
found["run"] = np.array(states)
np.savez(sys.argv[1], **found)
"""
COUNTS = (1_000_000, 10_000, 500, 1_000, 100)


def answers(commit: str | None, counts: tuple[int, ...], folder: Path) -> dict[str, np.ndarray]:
    """Compute with a commit, or with the sources as they are."""
    package = copy_of(commit, folder / "copy")
    variables = os.environ | {"PYTHONPATH": str(package), "PEPPER_KIN_CACHE": str(folder / "cache")}
    command = [sys.executable, "-c", PROGRAM, str(folder / "answers.npz"), *map(str, counts)]
    subprocess.run(command, cwd=package, env=variables, check=True)
    with np.load(folder / "answers.npz") as file:
        return dict(file)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("commit", help="the earlier commit")
    parser.add_argument("--share", type=float, default=1.0, help="share of the problems that is computed")
    options = parser.parse_args()
    counts = tuple(max(int(options.share * count), 2) for count in COUNTS)
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        old, new = answers(options.commit, counts, Path(first)), answers(None, counts, Path(second))
    print(f"| answers | compared | other than at {options.commit} | largest difference of the others |")
    print("|---|---|---|---|")
    verdicts = int(np.unpackbits(old["verdicts"] ^ new["verdicts"]).sum())
    print(f"| verdicts of collision | {counts[0]:,} | {verdicts} | |")
    for words, status, values, tolerance, unit in (
        ("`ik.solve`", "ik_status", "ik_q", 1e-6, "rad"),
        ("`plan`, length of the path", "plan_status", "plan_length", 1e-6, "rad"),
        ("`retime`, duration", None, "duration", 1e-6, "s"),
        ("`retime`, positions", None, "position", 1e-6, "rad"),
        ("`Twin.execute`, last state and largest torques", None, "run", 1e-6, "SI"),
    ):
        a, b = old[values], new[values]
        gap = np.abs(a - b).reshape(len(a), -1).max(axis=1)
        other = gap > tolerance
        if status is not None:
            other |= old[status] != new[status]
            words += f", status of {int((old[status] != new[status]).sum())}"
        same = gap[~other].max(initial=0.0)
        print(f"| {words} | {len(a):,} | {int(other.sum())} | {same:.1e} {unit} |")


if __name__ == "__main__":
    main()
