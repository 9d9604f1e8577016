"""IK that touches nothing: python benchmarks/ik_clear.py [--full].

Places of the left hand, clear of the robot's own body, and of the body and ten boxes.  Targets are where the
hand is in random postures that touch nothing: they can be solved.  A tenth as many more are random points
around the robot; whether they can be solved is told by a long search of another kind: descents without
collisions from random postures of the whole body, each end judged by coal.  What is solved is judged by coal
and by the hand's place.  Times are processor time of one call from Python; `--long 0` leaves the long search
out.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from ik_targets import HIGH, LEFT, LOW, PEPPER
from planning import ten_boxes

import pepper_kin as pk
from pepper_kin.collision.checker import checker_for
from pepper_kin.ik.fast import solutions_from

TOLERANCE = 1e-3


def reachable(scene: pk.Scene, count: int, seed: int) -> np.ndarray:
    """Return places of the hand in postures that touch nothing, shape (count, 3) [m]."""
    generator, found = np.random.default_rng(seed), np.empty((0, 3))
    while len(found) < count:
        q = generator.uniform(LOW, HIGH, (count, PEPPER.n))
        q = q[~pk.collision.in_collision(PEPPER, q, scene)]
        found = np.concatenate([found, pk.kinematics.frame_pose(PEPPER, q, LEFT)[:, :3, 3]])
    return found[:count]


def anywhere(count: int, seed: int) -> np.ndarray:
    """Return points around the robot, shape (count, 3) [m]."""
    return np.random.default_rng(seed).uniform((-0.7, -0.8, 0.1), (0.9, 1.0, 1.6), (count, 3))


def is_clear(scene: pk.Scene, q: np.ndarray, point: np.ndarray) -> bool:
    """Whether q puts the hand there, within the limits, and touches nothing, which coal says."""
    place = pk.kinematics.frame_pose(PEPPER, q, LEFT)[:3, 3]
    within = bool(((q >= LOW) & (q <= HIGH)).all())
    return (
        within
        and float(np.linalg.norm(place - point)) <= TOLERANCE
        and not bool(checker_for(PEPPER, scene).in_collision(q))
    )


def long_search(scene: pk.Scene, point: np.ndarray, starts: int, seed: int) -> bool:
    """Whether descents from random postures find one that is clear."""
    task, generator = pk.ik.HandPosition("left", point), np.random.default_rng(seed)
    q0 = PEPPER.neutral()
    for _ in range(0, starts, 500):
        drawn = generator.uniform(LOW, HIGH, (500, PEPPER.n))
        found = solutions_from(PEPPER, [task], q0, None, drawn, 150)
        free = np.array(found)[~pk.collision.in_collision(PEPPER, found, scene)] if found else []
        if any(is_clear(scene, q, point) for q in free):
            return True
    return False


def measure(name: str, scene: pk.Scene, count: int, starts: int) -> None:
    """Print the rows of one scene."""
    for what, points in (
        ("reachable", reachable(scene, count, seed=1)),
        ("anywhere", anywhere(count // 10, seed=2)),
    ):
        times, solved, missed, touching = [], [], 0, 0
        pk.ik.solve(PEPPER, pk.ik.HandPosition("left", points[0]), scene=scene)
        for number, point in enumerate(points):
            task = pk.ik.HandPosition("left", point)
            begin = time.process_time()
            result = pk.ik.solve(PEPPER, task, scene=scene)
            times.append(time.process_time() - begin)
            solved.append(result.success)
            if result.success:
                touching += not is_clear(scene, result.q, point)
            elif what == "reachable":
                missed += 1
            elif starts and result.status is pk.ik.IKStatus.CLOSEST_COLLISION:
                missed += long_search(scene, point, starts, number)
        can = sum(solved) + missed
        milli = 1e3 * np.array(times)[np.array(solved)]
        rest = 1e3 * np.array(times)[~np.array(solved)]
        print(
            f"| {name}, {what} | {len(points)} | {can} | {100 * sum(solved) / can:.2f} | {touching} | "
            f"{np.median(milli):.3f} | {np.percentile(milli, 99):.2f} | {milli.max():.1f} | "
            f"{f'{np.median(rest):.1f}' if len(rest) else '–'} |",
            flush=True,
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="10,000 targets instead of 1,000")
    parser.add_argument("--count", type=int, help="another number of targets")
    parser.add_argument("--long", type=int, default=10_000, help="starts of the long search")
    arguments = parser.parse_args()
    count = arguments.count or (10_000 if arguments.full else 1_000)
    print(
        "| clear of | targets | can be solved | of these solved [%] | of these touching | median [ms] | "
        "p99 [ms] | longest [ms] | not solved: median [ms] |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    measure("the body", pk.Scene(), count, arguments.long)
    measure("the body and ten boxes", ten_boxes(), count, arguments.long)


if __name__ == "__main__":
    main()
