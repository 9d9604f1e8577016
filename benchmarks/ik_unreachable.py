"""Closest points of targets out of reach, beside a long search: benchmarks/ik_unreachable.py --count N.

Random targets up to 3 m from a point between the shoulders; most are beyond reach, some behind the robot or
inside it.  The answer of one call (`pk.ik.solve`, collisions left out) is compared with a search of another
kind that shares only the kinematics: projected Gauss-Newton from 200 random starts at once in NumPy, the
best ten then each brought to their end by SciPy's L-BFGS-B.  An answer counts where its hand is at most 5
mm farther from the target.  The long search takes about 0.3 s a target.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import pepper_kin as pk

Array = NDArray[np.float64]

PEPPER = pk.load_pepper().with_requirements("limits")
FRAME = "LArm_effector"
CENTER = np.array([0.0, 0.0, 0.9])
FARTHEST = 3.0
ALLOWED = 5e-3  # [m]
STARTS, STEPS, POLISHED = 200, 60, 10


@dataclass(frozen=True)
class Comparison:
    """One target.

    Attributes:
        ours: Distance of our answer [m].
        other: Distance that the long search finds [m].
        time: Of our call [s].
        solved: Whether our answer meets the target.
    """

    ours: float
    other: float
    time: float
    solved: bool


def used_joints() -> NDArray[np.int64]:
    """Return the places of the joints that move the hand."""
    middle = 0.5 * (PEPPER.lower_limits + PEPPER.upper_limits)
    jacobian = pk.kinematics.frame_jacobian(PEPPER, middle + 0.1, FRAME)[:3]
    return np.flatnonzero(np.abs(jacobian).max(axis=0) > 1e-9)


MOVING = used_joints()
LOW, HIGH = PEPPER.lower_limits[MOVING], PEPPER.upper_limits[MOVING]


def whole(x: Array) -> Array:
    """Return joint vectors (..., n) of the joints that move the hand, shape (..., k)."""
    q = np.zeros((*x.shape[:-1], PEPPER.n))
    q[..., MOVING] = x
    return q


def hand(x: Array) -> Array:
    return pk.kinematics.frame_pose(PEPPER, whole(x), FRAME)[..., :3, 3]


def slope(x: Array) -> Array:
    return pk.kinematics.frame_jacobian(PEPPER, whole(x), FRAME)[..., :3, MOVING]


def projected_descents(target: Array, x: Array) -> Array:
    """Return where damped Gauss-Newton steps, cut off at the limits, lead from each start, shape (s, k).

    Joints at a limit that the gradient pushes against rest (Bertsekas, Projected Newton methods for
    optimization problems with simple constraints, 1982).
    """
    damping = np.full(len(x), 1e-2)
    residual = hand(x) - target
    cost = np.sum(residual**2, axis=1)
    eye = np.eye(x.shape[1])
    for _ in range(STEPS):
        jacobian = slope(x)
        gradient = np.einsum("sik,si->sk", jacobian, residual)
        rests = ((x <= LOW + 1e-9) & (gradient > 0)) | ((x >= HIGH - 1e-9) & (gradient < 0))
        jacobian = np.where(rests[:, None, :], 0.0, jacobian)
        matrix = np.einsum("sik,sij->skj", jacobian, jacobian) + damping[:, None, None] * eye
        step = np.linalg.solve(matrix, np.where(rests, 0.0, -gradient)[..., None])[..., 0]
        trial = np.clip(x + step, LOW, HIGH)
        trial_residual = hand(trial) - target
        trial_cost = np.sum(trial_residual**2, axis=1)
        better = trial_cost < cost
        x, residual = np.where(better[:, None], trial, x), np.where(better[:, None], trial_residual, residual)
        cost = np.where(better, trial_cost, cost)
        damping = np.clip(np.where(better, damping / 3, damping * 4), 1e-7, 1e4)
    return x


def long_search(target: Array, generator: np.random.Generator) -> float:
    """Return the least distance of the hand to a target that many starts lead to [m]."""
    ends = projected_descents(target, generator.uniform(LOW, HIGH, (STARTS, MOVING.size)))
    order = np.argsort(np.sum((hand(ends) - target) ** 2, axis=1))

    def cost(x: Array) -> tuple[float, Array]:
        residual = hand(x) - target
        return 0.5 * float(residual @ residual), slope(x).T @ residual

    bounds = list(zip(LOW, HIGH, strict=True))
    least = math.inf
    for k in order[:POLISHED]:
        found = minimize(cost, ends[k], jac=True, bounds=bounds, method="L-BFGS-B", options={"maxiter": 50})
        least = min(least, math.sqrt(2 * found.fun), math.dist(hand(ends[k]), target))
    return least


def targets(count: int, generator: np.random.Generator) -> Array:
    """Return points whose directions and distances from `CENTER` are even, shape (count, 3)."""
    direction = generator.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return CENTER + direction * generator.uniform(0.0, FARTHEST, (count, 1))


def compare(target: Array, generator: np.random.Generator) -> Comparison:
    begin = time.perf_counter()
    result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", target), collisions=False)
    duration = time.perf_counter() - begin
    within = np.all((result.q >= PEPPER.lower_limits) & (result.q <= PEPPER.upper_limits))
    if not within:
        raise SystemExit(f"an answer left the limits: target {target}")
    ours = math.dist(hand(result.q[MOVING]), target)
    other = 0.0 if result.success and ours < 1e-3 else long_search(target, generator)
    return Comparison(ours, other, duration, result.success)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1_000, help="number of targets; the goal names 10,000")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    generator = np.random.default_rng(arguments.seed)
    pk.ik.solve(PEPPER, pk.ik.HandPosition("left", CENTER), collisions=False)
    found = []
    begin = time.perf_counter()
    for k, target in enumerate(targets(arguments.count, generator)):
        found.append(compare(target, generator))
        if (k + 1) % 500 == 0:
            print(f"{k + 1} of {arguments.count} targets, {time.perf_counter() - begin:.0f} s", flush=True)
    difference = np.array([c.ours - c.other for c in found if not c.solved])
    micro = 1e6 * np.array([c.time for c in found if not c.solved])
    print("\n| targets | reached | others within 5 mm of the long search [%] | worst [mm] | ", end="")
    print("closer than the long search by over 1 mm | median of a call [us] | 99th percentile [us] |")
    print("|---|---|---|---|---|---|---|")
    print(
        f"| {len(found)} | {len(found) - difference.size} | {100 * np.mean(difference <= ALLOWED):.2f} | "
        f"{1e3 * difference.max():.1f} | {np.sum(difference < -1e-3)} | {np.median(micro):.0f} | "
        f"{np.percentile(micro, 99):.0f} |"
    )


if __name__ == "__main__":
    main()
