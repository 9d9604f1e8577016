"""Closest postures under unequal weights, beside SciPy: benchmarks/ik_weights.py [--count 200].

Problems of several tasks of different weights that no posture meets together, eight kinds in turn: hands,
gazes, directions, orientations and centers of mass, with weights from 0.01 to 1 or of 10 and 0.1.  The
weighted cost of the answer of `pk.ik.solve` is compared with the least that SciPy's L-BFGS-B ends at from 30
random starts.  It descends on residuals and Jacobians from Pinocchio.

Self-collision off, both move the joints of the tasks.  Self-collision on, SciPy moves all joints, and its
cost has a term for each pair of bodies nearer than 5 mm, which `solve` keeps too where it can; of its ends
those count that touch nothing, which coal says.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import pepper_kin as pk
from pepper_kin.collision.checker import checker_for
from pepper_kin.ik.collisions import Collisions
from pepper_kin.ik.priorities import balanced
from pepper_kin.ik.problem import TaskProblem, flatten_tasks, make_problem

PEPPER = pk.load_pepper().with_requirements("limits")
N = PEPPER.n
STARTS, FIRM, ROWS = 30, 100.0, 32
SCALE = 1e4  # of the cost, beside which L-BFGS-B's tolerances are small


def problem_of_kind(kind: int, generator: np.random.Generator) -> list[pk.ik.Task | pk.ik.TaskGroup]:
    """Return tasks with random targets, most of which cannot be met together."""

    def point() -> np.ndarray:
        direction = generator.normal(size=3)
        return (0, 0, 0.9) + direction / np.linalg.norm(direction) * generator.uniform(0.2, 1.5)

    def weight() -> float:
        return float(10 ** generator.uniform(-2, 0))

    def hand(side: str, counts: float | None = None) -> pk.ik.Task:
        return pk.ik.HandPosition(side, point(), weight=counts or weight())

    def pose(side: str) -> pk.ik.TaskGroup:
        target = np.eye(4)
        target[:3, :3], target[:3, 3] = Rotation.random(None, generator).as_matrix(), point()
        weights = {"weight": weight(), "orientation_weight": weight()}
        return pk.ik.HandPose(side, target, **weights, position_first=False)

    kinds: tuple[Callable[[], list[pk.ik.Task | pk.ik.TaskGroup]], ...] = (
        lambda: [hand("left"), hand("right")],
        lambda: [hand("left", 10.0), pk.ik.LookAt(point(), weight=0.1)],
        lambda: [hand("left", 0.1), pk.ik.LookAt(point(), weight=10.0)],
        lambda: [pose("left")],
        lambda: [pose("left"), pose("right")],
        lambda: [hand("left"), hand("right"), pk.ik.LookAt(point(), weight=weight())],
        lambda: [hand("left"), pk.ik.Point("left", generator.normal(size=3), weight=weight())],
        lambda: [
            hand("left"),
            hand("right"),
            pk.ik.CenterOfMass(generator.uniform(-0.1, 0.1, 2), weight=weight()),
        ],
    )
    return kinds[kind % len(kinds)]()


class NearPairs:
    """Shortages of the distances of bodies nearer than 5 mm, and slopes of the distances."""

    def __init__(self) -> None:
        self._collisions = Collisions(PEPPER, pk.Scene())
        tests = self._collisions.tests(np.zeros(8, np.int64))
        self._near = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_int64] * 4)(tests.near)
        self._memory, self._rows = tests.near_memory, np.zeros((ROWS, N + 2))

    def __call__(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return shortages [m], shape (k,), and slopes, shape (k, n)."""
        q = np.ascontiguousarray(q)
        count = self._near(q.ctypes.data, self._rows.ctypes.data, ROWS, self._memory)
        return self._rows[:count, N], self._rows[:count, :N]


def least_cost(problem: TaskProblem, near: NearPairs | None, generator: np.random.Generator) -> float:
    """Return the least weighted cost that SciPy ends at."""
    index = np.arange(N) if near else np.flatnonzero(problem.movable)
    low, high = PEPPER.lower_limits[index], PEPPER.upper_limits[index]
    checker, least = checker_for(PEPPER, pk.Scene()), math.inf

    def whole(x: np.ndarray) -> np.ndarray:
        q = problem.q0.copy()
        q[index] = x
        return q

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        q = whole(x)
        residual = problem.stack(problem.residuals(q))
        value, slope = 0.5 * float(residual @ residual), problem.jacobian(q).T @ residual
        if near:
            shortages, slopes = near(q)
            value += 0.5 * FIRM**2 * float(shortages @ shortages)
            slope -= FIRM**2 * slopes.T @ shortages
        return SCALE * value, SCALE * slope[index]

    bounds = list(zip(low, high, strict=True))
    for _ in range(STARTS):
        start = generator.uniform(low, high)
        end = whole(minimize(cost, start, jac=True, bounds=bounds, options={"maxiter": 300}).x)
        value = problem.task_cost(problem.residuals(end))
        if value < least and not (near and bool(checker.in_collision(end))):
            least = value
    return least


def measure(count: int, near: NearPairs | None, seed: int) -> None:
    """Print the row of one table."""
    generator, ratios, times, number = np.random.default_rng(seed), [], [], 0
    while len(ratios) < count:
        tasks = problem_of_kind(number, generator)
        number += 1
        begin = time.process_time()
        result = pk.ik.solve(PEPPER, tasks, collisions=near is not None)
        spent = time.process_time() - begin
        if result.success:
            continue
        if near is not None and result.in_collision:
            raise SystemExit(f"an answer touches something: {result.report()}")
        parts = balanced(flatten_tasks(PEPPER, tasks))
        problem = make_problem(PEPPER, parts, PEPPER.neutral(), np.ones(N, dtype=bool), keep_idle=True)
        best = least_cost(problem, near, generator)
        ratios.append((problem.task_cost(problem.residuals(result.q)) + 1e-10) / (best + 1e-10))
        times.append(spent)
    of, milli = np.array(ratios), 1e3 * np.array(times)
    print(
        f"| {'on' if near else 'off'} | {count} | {np.sum(of > 1.02)} | {of.max():.3f} | "
        f"{np.sum(of < 0.98)} | {np.median(milli):.1f} | {np.percentile(milli, 99):.1f} |",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="problems; a quarter with self-collision")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(
        "| self-collision | problems | over 2 % above SciPy's best | highest, of it | over 2 % below | "
        "median of a call [ms] | p99 [ms] |\n|---|---|---|---|---|---|---|"
    )
    measure(arguments.count, None, arguments.seed)
    measure(max(arguments.count // 4, 1), NearPairs(), arguments.seed)


if __name__ == "__main__":
    main()
