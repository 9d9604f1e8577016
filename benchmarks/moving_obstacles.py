"""How memory and time grow with the number of obstacles that move: `python benchmarks/moving_obstacles.py`.

Each number has a process of its own.  Balls and boxes of 4 to 12 cm are drawn 1 to 3 m around Pepper, each
with a velocity of up to 0.3 m/s.  Examined are a motion (`check`), and cycles of live motion along it that
see all obstacles at new places; times are of one thread, the least of `check` and the median of cycles.
"""

import os
import resource
import subprocess
import sys
import time

import numpy as np

import pepper_kin as pk

COUNTS = (30, 60, 120, 240)
CYCLES, PERIOD = 20, 0.02
REPEATS = 3


def scene_of(count):
    """Return a scene of so many obstacles that move."""
    rng, scene = np.random.default_rng(count), pk.Scene()
    for k in range(count):
        angle, away, height = rng.uniform((-np.pi, 1.0, 0.1), (np.pi, 3.0, 1.8))
        place, size = (away * np.cos(angle), away * np.sin(angle), height), rng.uniform(0.04, 0.12, 3)
        motion = {"velocity": rng.uniform(-0.17, 0.17, 3), "uncertainty": 0.05}
        if k % 2:
            scene = scene.add_box(f"mover {k}", size, place, **motion)
        else:
            scene = scene.add_sphere(f"mover {k}", size[0] / 2, place, **motion)
    return scene


def measure(count):
    """Print memory that was taken [MB] and times of a check and a live cycle [ms]."""
    pepper, scene = pk.load_pepper(), scene_of(count)
    stand, goal = pepper.posture("Stand"), pepper.joint_vector({"LShoulderPitch": 0.3, "HeadYaw": 0.4})
    motion = pk.retime(pepper, [stand, goal])
    motion.check(pepper)
    alone, spent = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, []
    for _ in range(REPEATS):
        begin = time.thread_time()
        found = motion.check(pepper, scene)
        spent.append(time.thread_time() - begin)
    live, cycles = pk.motion.LiveMotion(pepper, stand, scene), []
    live.set_goal(goal)
    for k in range(CYCLES):
        moved = {item.name: item.poses(np.array([k * PERIOD]))[0] for item in scene.movers}
        seen = scene.moved(moved)
        begin = time.thread_time()
        live.set_scene(seen, k * PERIOD)
        live.step(k * PERIOD)
        cycles.append(time.thread_time() - begin)
    taken = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - alone) / 1e3
    first, next_, cycle = 1e3 * spent[0], 1e3 * min(spent[1:]), 1e3 * float(np.median(cycles[1:]))
    least = found.obstacle_clearance.value
    print(f"| {count} | {taken:.0f} | {first:.0f} | {next_:.1f} | {cycle:.2f} | {least:.4f} |")


def main():
    """Print the table."""
    if len(sys.argv) > 1:
        measure(int(sys.argv[1]))
        return
    print("| obstacles | memory [MB] | first check [ms] | next [ms] | live cycle [ms] | least distance [m] |")
    print("|---|---|---|---|---|---|", flush=True)
    alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    for count in COUNTS:
        subprocess.run([sys.executable, __file__, str(count)], check=True, env=alone)


if __name__ == "__main__":
    main()
