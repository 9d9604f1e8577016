"""Collision checks of random configurations: the compiled check beside coal, in one process, as Markdown.

python benchmarks/collision.py             # a million configurations compared with coal: minutes
python benchmarks/collision.py --count 20000
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import pepper_kin as pk
from pepper_kin.collision.fast import FastChecker

ROUNDS = 7
TIMED = 50_000
TIMED_BY_COAL = 1_000


def scene(kind: str, seed: int) -> pk.Scene:
    """Ten objects of 5 to 40 cm around the robot, 0.45 m and more from its axis."""
    rng = np.random.default_rng(seed)
    made = pk.Scene()
    while len(made.objects) < 10:
        position, rpy = rng.uniform([-1, -1, 0], [1, 1, 1.6]), rng.uniform(-3, 3, 3)
        if np.hypot(*position[:2]) < 0.45:
            continue
        name = f"{kind}{len(made.objects)}"
        if kind == "box":
            made = made.add_box(name, rng.uniform(0.05, 0.4, 3), position, rpy)
        elif kind == "sphere":
            made = made.add_sphere(name, rng.uniform(0.03, 0.2), position)
        elif kind == "cylinder":
            made = made.add_cylinder(name, *rng.uniform(0.05, 0.3, 2), position, rpy)
        else:
            made = made.add_capsule(name, *rng.uniform(0.05, 0.3, 2), position, rpy)
    return made


def random_q(pepper: pk.PepperModel, count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))


def compare(fast: FastChecker, q: np.ndarray) -> tuple[int, int, int]:
    """Return how many verdicts differ from coal's, how many of these its distance confirms, and ties."""
    differ = confirmed = ties = 0
    for first in range(0, len(q), 50_000):
        part = q[first : first + 50_000]
        found = fast.in_collision(part)
        wrong = np.flatnonzero(found != fast.exact.in_collision(part))
        differ += wrong.size
        if wrong.size:
            confirmed += int(((fast.exact.clearance(part[wrong]) < 0) == found[wrong]).sum())
        ties += fast.doubts(part)[1]
    return differ, confirmed, ties


def timed(fast: FastChecker, q: np.ndarray) -> tuple[float, float]:
    """Return medians of interleaved rounds [s per configuration]: compiled, coal."""
    fast.in_collision(q)
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(ROUNDS):
        start = time.perf_counter()
        fast.in_collision(q)
        middle = time.perf_counter()
        fast.exact.in_collision(q[:TIMED_BY_COAL])
        times[0].append((middle - start) / len(q))
        times[1].append((time.perf_counter() - middle) / TIMED_BY_COAL)
    return float(np.median(times[0])), float(np.median(times[1]))


def edges(fast: FastChecker, q: np.ndarray) -> tuple[float, float, float]:
    """Return [s] per state of valid edges of 32 states, and the shares of short edges free and certified."""
    pepper = fast.pepper
    free = q[~fast.in_collision(q)][:2000].reshape(2, -1, pepper.n)
    validity = fast.compiled(pepper.posture("Stand"), np.arange(pepper.n))
    memory, states, spent = validity.new_memory(), 0, 0.0
    certified = sampled = 0
    for k, (a, b) in enumerate(zip(*free, strict=True)):
        b = a + 0.05 * (b - a)
        start = time.perf_counter()
        valid = validity.valid_steps(a, b, 32, memory)
        if valid == 32:
            spent, states = spent + time.perf_counter() - start, states + 32
        if k < 300:
            sampled += fast.edge_free(a, b, 0.002)
            certified += fast.edge_certified(a, b)
    return spent / states, sampled / 300, certified / 300


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1_000_000)
    count = parser.parse_args().count
    pepper = pk.load_pepper()
    q = random_q(pepper, count, seed=0)
    print("| scene | configurations | in collision | left in doubt by spheres | ties | differ from coal "
          "| of these, coal's distance confirms the compiled check |\n" + "|---" * 7 + "|")  # fmt: skip
    checkers = {"self only": FastChecker(pepper)}
    for kind in ("box", "sphere", "cylinder", "capsule"):
        checkers[f"10 {kind}"] = FastChecker(pepper, scene(kind, 1))
    for name, fast in checkers.items():
        part = q if name in ("self only", "10 box") else q[: min(count, 20_000)]
        doubts, _ = fast.doubts(part)
        differ, confirmed, ties = compare(fast, part)
        share = fast.in_collision(part).mean()
        rate = doubts / len(part)
        print(f"| {name} | {len(part)} | {share:.1%} | {rate:.2%} | {ties} | {differ} | {confirmed} |")
    print("\n| scene | compiled, ns | coal from Python, ns | ratio |\n|---|---|---|---|")
    for name, fast in checkers.items():
        ours, coal = timed(fast, random_q(pepper, TIMED, seed=1))
        print(f"| {name} | {ours * 1e9:.0f} | {coal * 1e9:.0f} | {coal / ours:.0f} |")
    fast = checkers["10 box"]
    decided = random_q(pepper, 400_000, seed=2)
    decided = decided[_doubtful(fast, decided)]
    in_doubt = timed(fast, decided)[0] * 1e9
    print(f"\nA configuration that spheres leave in doubt: {in_doubt:.0f} ns, exact stage included.")
    state, free, proven = edges(fast, q[:50_000])
    print(f"Edges of 32 states, called from Python: {state * 1e9:.0f} ns per state. "
          f"Of short edges {free:.0%} are free at every sample, {proven:.0%} are certified.")  # fmt: skip


def _doubtful(fast: FastChecker, q: np.ndarray) -> np.ndarray:
    """Which configurations spheres leave in doubt, found by halving."""
    doubtful = np.zeros(len(q), dtype=bool)
    pending = [(0, len(q))]
    while pending:
        first, last = pending.pop()
        if last > first and fast.doubts(q[first:last])[0]:
            if last - first == 1:
                doubtful[first] = True
            else:
                middle = (first + last) // 2
                pending += [(first, middle), (middle, last)]
    return doubtful


if __name__ == "__main__":
    main()
