"""Planners on toy problems: python benchmarks/planners.py [--full].

Worlds are boxes and balls in the unit cube, as machine code that takes one to two tenths of a microsecond a
state.  "Python" is the same planner with the same validity behind a Python callable, which is called with
batches of states.  Both take each problem in turn, in one process; times are those of one whole call.  Paths
are checked here, at a tenth of the resolution, against the world without the margin.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numba import cfunc, types

from pepper_kin import planners
from pepper_kin.planners import CompiledMotionValidator, Path, Problem

NUMBERS = types.CPointer(types.float64)


@cfunc(types.int64(NUMBERS, NUMBERS, types.int64, NUMBERS), error_model="numpy", cache=True)
def last_valid_step(a, b, steps, memory):  # type: ignore[no-untyped-def]
    """Boxes and balls, which are in the memory behind n and their numbers."""
    n = int(memory[0])
    for j in range(1, steps + 1):
        place = 3
        for _ in range(int(memory[1])):
            inside = True
            for i in range(n):
                x = b[i] if j == steps else a[i] + (b[i] - a[i]) * j / steps
                if not memory[place + i] < x < memory[place + n + i]:
                    inside = False
                    break
            if inside:
                return j - 1
            place += 2 * n
        for _ in range(int(memory[2])):
            square = 0.0
            for i in range(n):
                x = b[i] if j == steps else a[i] + (b[i] - a[i]) * j / steps
                square += (x - memory[place + i]) ** 2
            if square <= memory[place + n] ** 2:
                return j - 1
            place += n + 1
    return steps


@dataclass(frozen=True)
class Toy:
    """A world with a start and a goal; boxes as (lower, upper), balls as (center, radius)."""

    name: str
    start: np.ndarray
    goal: np.ndarray
    boxes: tuple = ()
    balls: tuple = ()
    resolution: float = 0.01

    def code(self, margin: float) -> CompiledMotionValidator:
        n = self.start.size
        rows = [n, len(self.boxes), len(self.balls)]
        rows += [x for low, high in self.boxes for x in (*(low - margin), *(high + margin))]
        rows += [x for center, radius in self.balls for x in (*center, radius + margin)]
        return CompiledMotionValidator(
            last_valid_step.address, n, np.array(rows, dtype=float).copy, last_valid_step
        )

    def problems(self) -> tuple[Problem, Problem]:
        n, code = self.start.size, self.code(self.resolution / 2)
        return tuple(
            Problem(np.zeros(n), np.ones(n), self.start, self.goal, validity, resolution=self.resolution)
            for validity in (code, lambda states: code(states))
        )  # type: ignore[return-value]

    def require_free(self, path: Path) -> None:
        assert self.code(0.0)(path.resample(self.resolution / 10).points).all(), self.name


def toys() -> list[Toy]:
    walls = []
    for k, x in enumerate((0.2, 0.4, 0.6, 0.8)):
        low, high = (-1.0, 0.8) if k % 2 == 0 else (0.2, 2.0)
        walls.append((np.array([x - 0.02, low]), np.array([x + 0.02, high])))
    found = [Toy("maze of four walls", np.full(2, 0.05), np.full(2, 0.95), boxes=tuple(walls))]
    slab = [
        (np.array([0.45, -1.0, -1.0]), np.array([0.55, 2.0, 0.45])),
        (np.array([0.45, -1.0, 0.55]), np.array([0.55, 2.0, 2.0])),
        (np.array([0.45, -1.0, 0.4]), np.array([0.55, 0.45, 0.6])),
        (np.array([0.45, 0.55, 0.4]), np.array([0.55, 2.0, 0.6])),
    ]
    found.append(Toy("window in a wall", np.full(3, 0.1), np.full(3, 0.9), boxes=tuple(slab)))
    for n in (5, 7, 15):
        rng = np.random.default_rng(n)
        centers = rng.uniform(0.1, 0.9, (20, n))
        far = np.min([np.linalg.norm(centers - p, axis=1) for p in (0.1, 0.9)], axis=0) > 0.35
        balls = [(c, 0.3) for c in centers[far]] + [(np.full(n, 0.5), 0.2 * np.sqrt(n))]
        found.append(Toy("balls", np.full(n, 0.1), np.full(n, 0.9), balls=tuple(balls), resolution=0.02))
    return found


def timed(call: Callable[[], object]) -> tuple[float, object]:
    begun = time.perf_counter()
    answer = call()
    return (time.perf_counter() - begun) * 1e3, answer


def searches(count: int) -> None:
    print("| problem | n | machine code: median, p95 [ms] | Python: median, p95 [ms] | ratio |")
    print("|---|---|---|---|---|")
    for toy in toys():
        problems, times = toy.problems(), ([], [])
        for seed in range(count):
            for problem, spent in zip(problems, times, strict=True):
                taken, result = timed(lambda p=problem, s=seed: planners.rrt_connect(p, seed=s, timeout=60.0))
                toy.require_free(result.path)
                spent.append(taken)
        (m, p), (mm, pp) = (np.percentile(spent, [50, 95]) for spent in times)
        print(f"| {toy.name} | {toy.start.size} | {m:.2f}, {p:.2f} | {mm:.1f}, {pp:.1f} | {mm / m:.0f} |")


def short_cuts(count: int) -> None:
    print("| problem | n | machine code [ms] | Python [ms] | length before | machine code | Python |")
    print("|---|---|---|---|---|---|---|")
    for toy in toys():
        problems, times, lengths, before = toy.problems(), ([], []), ([], []), []
        for seed in range(count):
            path = planners.rrt_connect(problems[0], seed=seed, timeout=60.0).path
            before.append(path.length)
            for k, problem in enumerate(problems):
                taken, short = timed(
                    lambda p=problem, s=seed, q=path: planners.shortcut(p, q, seed=s, timeout=60.0)
                )
                toy.require_free(short)
                times[k].append(taken)
                lengths[k].append(short.length)
        fast, slow = (np.median(spent) for spent in times)
        numbers = " | ".join(f"{np.mean(some):.3f}" for some in (before, *lengths))
        print(f"| {toy.name} | {toy.start.size} | {fast:.2f} | {slow:.0f} | {numbers} |")


def improvements(count: int) -> None:
    """Around a ball, where the shortest path is two tangents and an arc."""
    budgets = (0.01, 0.1, 1.0)
    print("| n | " + " | ".join(f"above the shortest after {b:g} s" for b in budgets) + " |")
    print("|---|" + "---|" * len(budgets))
    for n in (2, 3, 5, 10):
        ends = np.full((2, n), 0.5)
        ends[:, 0] = 0.1, 0.9
        toy = Toy("ball", *ends, balls=((np.full(n, 0.5), 0.3),))
        radius, far = 0.3 + toy.resolution / 2, 0.4
        shortest = 2 * np.sqrt(far**2 - radius**2) + radius * (np.pi - 2 * np.arccos(radius / far))
        gaps = []
        for budget in budgets:
            results = [planners.aorrtc(toy.problems()[0], seed=s, timeout=budget) for s in range(count)]
            for result in results:
                toy.require_free(result.path)
            gaps.append(np.median([result.cost / shortest - 1 for result in results]))
        print(f"| {n} | " + " | ".join(f"{100 * gap:.2f} %" for gap in gaps) + " |")


def queries(count: int) -> None:
    print("| problem | n | first query [ms] | later ones, median [ms] | search, median [ms] | nodes |")
    print("|---|---|---|---|---|---|")
    for toy in toys():
        problem = toy.problems()[0]
        roadmap, rng = planners.Roadmap(problem), np.random.default_rng(0)
        states = rng.random((50 * count, toy.start.size))
        pairs = states[problem.validity(states)][: 2 * count].reshape(-1, 2, toy.start.size)
        times, searched = [], []
        for start, goal in pairs:
            taken, result = timed(lambda a=start, b=goal, r=roadmap: r.solve(a, b, timeout=60.0))
            toy.require_free(result.path)
            times.append(taken)
            alone = Problem(problem.lower, problem.upper, start, goal, problem.validity, None, toy.resolution)
            searched.append(timed(lambda p=alone: planners.rrt_connect(p, timeout=60.0))[0])
        first, later, search = times[0], np.median(times[1:]), np.median(searched)
        print(
            f"| {toy.name} | {toy.start.size} | {first:.2f} | {later:.2f} | {search:.2f} | {roadmap.nodes} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="ten times as many problems")
    factor = 10 if parser.parse_args().full else 1
    warm = toys()[0].problems()[0]
    load, _ = timed(lambda: planners.aorrtc(warm, max_iterations=1))
    more, _ = timed(lambda: planners.Roadmap(warm).solve(timeout=60.0))
    print(f"Loading or compiling: {(load + more) / 1e3:.1f} s\n\n## rrt_connect\n")
    searches(30 * factor)
    print("\n## shortcut, 200 attempts\n")
    short_cuts(3 * factor)
    print("\n## aorrtc\n")
    improvements(3 * factor)
    print("\n## Roadmap\n")
    queries(50 * factor)


if __name__ == "__main__":
    main()
