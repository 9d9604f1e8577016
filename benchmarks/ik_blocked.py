"""IK of blocked targets: python benchmarks/ik_blocked.py [--targets 50] [--seeds 20] [--known FILE].

Each target is where the left hand is in a random posture, with an obstacle put around it: it is reached only
in collision.  Asked with many seeds, `solve` should come equally close each time.  Printed are the spread of
the distance over the seeds, and the gap to the closest that any seed came, or that a file of earlier runs
knows, which is written anew.  Every answer is checked by coal.  Times are processor time of one call.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from ik_targets import HIGH, LEFT, LOW, PEPPER

import pepper_kin as pk
from pepper_kin.ik import IKStatus


def blocked_targets(count: int, seed: int = 3) -> list[tuple[np.ndarray, pk.Scene]]:
    """Return points of the left hand [m], shape (3,), each with a scene that it cannot be reached in."""
    generator, found = np.random.default_rng(seed), []
    while len(found) < count:
        q = generator.uniform(LOW, HIGH, (64, PEPPER.n))
        q = q[~pk.collision.in_collision(PEPPER, q, pk.Scene())]
        for point in pk.kinematics.frame_pose(PEPPER, q, LEFT)[:, :3, 3]:
            size = generator.uniform(0.1, 0.5, 3)
            middle = point + generator.uniform(-0.3, 0.3, 3) * size
            scene = pk.Scene().add_box("obstacle", size=size, position=middle)
            if generator.random() < 0.5:
                low = point + generator.uniform((-0.3, -0.3, -0.5), (0.3, 0.3, -0.2))
                scene = scene.add_box("shelf", size=(0.5, 0.6, 0.04), position=low)
            if pk.collision.in_collision(PEPPER, PEPPER.neutral(), scene):
                continue
            result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point), scene=scene)
            if result.status is IKStatus.CLOSEST_COLLISION:
                found.append((point, scene))
    return found[:count]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--targets", type=int, default=50)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--known", type=Path)
    arguments = parser.parse_args()
    problems = blocked_targets(arguments.targets)
    shape = len(problems), arguments.seeds
    distances, times, touching = np.empty(shape), np.empty(shape), 0
    for row, (point, scene) in enumerate(problems):
        for seed in range(arguments.seeds):
            begin = time.process_time()
            result = pk.ik.solve(PEPPER, pk.ik.HandPosition("left", point), scene=scene, seed=seed)
            times[row, seed] = time.process_time() - begin
            touching += bool(pk.collision.in_collision(PEPPER, result.q, scene))
            place = pk.kinematics.frame_pose(PEPPER, result.q, LEFT)[:3, 3]
            distances[row, seed] = np.linalg.norm(place - point)
    best = distances.min(axis=1)
    if arguments.known is not None and arguments.known.exists():
        best = np.minimum(best, json.loads(arguments.known.read_text())[: len(best)])
    if arguments.known is not None:
        arguments.known.write_text(json.dumps(best.tolist()))
    gaps, spread = 100 * (distances - best[:, None]), 100 * np.ptp(distances, axis=1)
    print(f"{shape[0]} targets, {shape[1]} seeds; {touching} answers touch")
    print(f"spread over seeds: median {np.median(spread):.2f} cm, largest {spread.max():.2f} cm")
    print(
        f"gap to the best known: mean {gaps.mean():.2f} cm, median {np.median(gaps):.2f}, "
        f"90 % {np.quantile(gaps, 0.9):.2f}, largest {gaps.max():.2f} cm; "
        f"within 5 mm: {100 * np.mean(gaps <= 0.5):.1f} %"
    )
    print(
        f"time: median {1000 * np.median(times):.1f} ms, mean {1000 * times.mean():.1f}, "
        f"largest {1000 * times.max():.1f} ms"
    )


if __name__ == "__main__":
    main()
