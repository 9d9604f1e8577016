"""Plans to one of 18 grasps around a can: `python benchmarks/grasps.py [SEEDS]`; processor time."""

import sys
import time

import numpy as np

import pepper_kin as pk


def main():
    """Print how many of 100 seeds, or as many as are given, lead to a plan, and what it takes."""
    pepper, can = pk.load_pepper().with_requirements("limits"), np.array([0.40, 0.18, 0.95])
    scene = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.5, 0.0, 0.715))
    scene = scene.add_cylinder("can", 0.03, 0.44, can)
    angles = np.linspace(-np.pi, np.pi, 18, endpoint=False)
    tasks = [
        [pk.ik.HandPosition("left", can - 0.12 * to), pk.ik.AxisAlignment("l_gripper", to, tolerance=0.1)]
        for to in np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    ]
    times, reached = [], []
    for seed in range(int(sys.argv[1]) if len(sys.argv) > 1 else 100):
        begin = time.thread_time()
        plan = pk.plan(pepper, pepper.posture("Stand"), tasks, scene, seed=seed)
        times.append(time.thread_time() - begin)
        reached += [plan.alternative] if plan.success else []
    middle, most = np.percentile(times, (50, 90)) * 1e3
    print(f"{len(reached)} of {len(times)} seeds, {middle:.1f} / {most:.1f} ms, median / 90 %; ", end="")
    print(f"grasps reached: {sorted(set(reached))}")


if __name__ == "__main__":
    main()
