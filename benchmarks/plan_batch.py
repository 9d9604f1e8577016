"""Many planning problems: one after the other, by threads, and by `pk.plan_batch`.

Each problem has a scene of its own, as in randomized worlds: six boxes, and a target for the left hand.
Processor time of this process and of its helpers is counted; on an idle machine with as many cores as
processes, the larger of the two is the wall time.

    python benchmarks/plan_batch.py [COUNT] [PROCESSES]

Prints Markdown.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import pepper_kin as pk
from pepper_kin.collision import checker
from pepper_kin.collision.fast import checker as fast_checker
from pepper_kin.motion.planning_process import helpers

PEPPER = pk.load_pepper().with_requirements("limits")


def problems(count: int) -> list[pk.PlanProblem]:
    """Return problems with scenes of their own."""
    rng, made = np.random.default_rng(0), []
    for number in range(count):
        scene = pk.Scene()
        for box in range(6):
            place = rng.uniform([0.3, -0.6, 0.4], [0.7, 0.6, 1.2])
            scene = scene.add_box(f"box {box}", size=rng.uniform(0.05, 0.15, 3), position=place)
        target = pk.ik.HandPosition("left", rng.uniform([0.2, 0.05, 0.6], [0.4, 0.4, 1.1]))
        stand = PEPPER.posture("Stand")
        made.append(pk.PlanProblem(PEPPER, stand, [target], scene, seed=number, timeout=3.0))
    return made


def helpers_seconds(count: int) -> float:
    """Return the processor time of the helpers so far [s]."""
    ticks = 0
    for one in helpers(count):
        with open(f"/proc/{one._process.pid}/stat", encoding="ascii") as file:
            fields = file.read().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def measured(run: Callable[[], list], count: int) -> tuple[list, float, float, float]:
    """Return what a run returns, its wall time, and processor time here and of the helpers [s]."""
    fast_checker._fast_checker_for.cache_clear()
    checker._checker_for.cache_clear()
    before = time.perf_counter(), time.process_time(), helpers_seconds(count)
    found = run()
    after = time.perf_counter(), time.process_time(), helpers_seconds(count)
    return found, *(b - a for a, b in zip(before, after, strict=True))


def main(count: int, processes: int) -> None:
    """Print a table."""
    asked, others = problems(count), processes - 1
    asked[0].solve()
    for one in helpers(others):
        one.ready.wait()
    pk.plan_batch(asked[:16], processes=processes)

    def threaded() -> list:
        with ThreadPoolExecutor(processes) as pool:
            return list(pool.map(lambda problem: problem.solve(), asked))

    runs = {
        "one after the other": lambda: [problem.solve() for problem in asked],
        f"{processes} threads": threaded,
        f"`plan_batch`, {processes} processes": lambda: list(pk.plan_batch(asked, processes=processes).plans),
    }
    times: dict[str, list[tuple[float, ...]]] = {name: [] for name in runs}
    paths = []
    for _ in range(5):
        for name, run in runs.items():
            found, *seconds = measured(run, others)
            times[name].append(tuple(seconds))
            paths.append([plan.path for plan in found])
    for path in paths[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(paths[0], path, strict=True))
    solved = sum(path is not None for path in paths[0])
    print(f"{count} problems, {solved} solved; medians of 5 [s]; load {os.getloadavg()[0]:.1f}\n")
    print("| | wall time | processor time here | of helpers |\n|---|---|---|---|")
    for name, rows in times.items():
        wall, own, theirs = np.median(rows, axis=0)
        print(f"| {name} | {wall:.2f} | {own:.2f} | {theirs:.2f} |")


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:]]
    main(*(numbers + [60, os.cpu_count() or 1][len(numbers) :]))
