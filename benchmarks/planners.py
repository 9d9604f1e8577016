"""Planners on toy problems."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from harness import Times, figures, pairs, timed
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


def searches(count: int) -> Iterator[tuple]:
    for toy in toys():
        problems, times = toy.problems(), Times(time.perf_counter)
        for seed in range(count):
            for kind, problem in enumerate(problems):
                result = times(kind, planners.rrt_connect, problem, seed=seed, timeout=60.0)
                toy.require_free(result.path)
        (m, p), (mm, pp) = (times.at(kind, 50, 95) for kind in times)
        head = "problem | n | machine code: median, p95 [ms] | Python: median, p95 [ms] | ratio {:.0f}"
        yield head, toy.name, toy.start.size, f"{m:.2f}, {p:.2f}", f"{mm:.1f}, {pp:.1f}", mm / m


def short_cuts(count: int) -> Iterator[tuple]:
    for toy in toys():
        problems, times, lengths = toy.problems(), Times(time.perf_counter), defaultdict(list)
        for seed in range(count):
            path = planners.rrt_connect(problems[0], seed=seed, timeout=60.0).path
            lengths["before"].append(path.length)
            for kind, problem in enumerate(problems):
                short = times(kind, planners.shortcut, problem, path, seed=seed, timeout=60.0)
                toy.require_free(short)
                lengths[kind].append(short.length)
        yield (
            "problem | n | machine code [ms] {:.2f} | Python [ms] {:.0f} | length before {:.3f} | machine "
            "code {:.3f} | Python {:.3f}",
            toy.name, toy.start.size, *map(times.at, times), *map(np.mean, lengths.values()),
        )  # fmt: skip


def improvements(count: int) -> Iterator[tuple]:
    """Around a ball, where the shortest path is two tangents and an arc."""
    budgets = (0.01, 0.1, 1.0)
    head = "n | " + " | ".join(f"above the shortest after {b:g} s {{:.2f}} %" for b in budgets)
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
            gaps.append(100 * np.median([result.cost / shortest - 1 for result in results]))
        yield head, n, *gaps


def queries(count: int) -> Iterator[tuple]:
    for toy in toys():
        problem = toy.problems()[0]
        roadmap, rng = planners.Roadmap(problem), np.random.default_rng(0)
        states, times = rng.random((50 * count, toy.start.size)), Times(time.perf_counter)
        for start, goal in pairs(states[problem.validity(states)][: 2 * count]):
            toy.require_free(times("query", roadmap.solve, start, goal, timeout=60.0).path)
            alone = Problem(problem.lower, problem.upper, start, goal, problem.validity, None, toy.resolution)
            times("search", planners.rrt_connect, alone, timeout=60.0)
        first, *later = times["query"]
        yield (
            "problem | n | first query [ms] {:.2f} | later ones, median [ms] {:.2f} | search, median [ms] "
            "{:.2f} | nodes",
            toy.name, toy.start.size, 1e3 * first, 1e3 * np.median(later), times.at("search"), roadmap.nodes,
        )  # fmt: skip


@figures("benchmarks/planners.md", count=1)
def planners_on_toys(count: int = 3) -> Iterator[tuple | str]:
    """Planners on toy problems: 10 x `count` searches, `count` short-cuts, 17 x `count` queries each.

    Worlds are boxes and balls in the unit cube, as machine code that takes one to two tenths of a microsecond
    a state.  "Python" is the same planner with the same validity behind a Python callable, which is called
    with batches of states.  Both take each problem in turn, in one process; times are those of one whole
    call.  Paths are checked here, at a tenth of the resolution, against the world without the margin.
    """
    warm = toys()[0].problems()[0]
    _, load = timed(planners.aorrtc, warm, max_iterations=1, clock=time.perf_counter)
    _, more = timed(planners.Roadmap(warm).solve, timeout=60.0, clock=time.perf_counter)
    yield f"Loading or compiling: {load + more:.1f} s"
    yield "## rrt_connect"
    yield from searches(10 * count)
    yield "## shortcut, 200 attempts"
    yield from short_cuts(count)
    yield "## aorrtc"
    yield from improvements(count)
    yield "## Roadmap"
    yield from queries(17 * count)
