"""What the twin says of motions into obstacles, and of motions planned around them.

    python benchmarks/blocked_runs.py [--count 50] [--seed 0] [--margin 0.02 --least-margin 0.005]

Each scene has a box somewhere before the robot.  A motion into it is timed along the straight line from
Stand to a posture in which a hand is at the box's center.  A motion around it is planned from Stand to a
point beside or behind the box, where the straight line to a posture that has the hand there passes through
the box.  Coal measures how deep a reference goes into the box, and how near the twin comes to it.  Both run
on `Twin(pepper, scene=scene)`, with the defaults of `retime` and the twin.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

import pepper_kin as pk
from pepper_kin.collision import in_collision, least_clearance


def main() -> None:
    """Print how many of the runs ended in which way."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--margin", type=float, default=0.0, help="of the plans, where it can be kept [m]")
    parser.add_argument("--least-margin", type=float, default=0.0, help="of all plans [m]")
    options = parser.parse_args()
    pepper, rng = pk.load_pepper(), np.random.default_rng(options.seed)
    into, around, refused = Counter[str](), Counter[str](), Counter[str]()
    margins = {"margin": options.margin, "least_margin": options.least_margin}
    depths, errors, nearest = [], [], []
    while into.total() < options.count or around.total() < options.count:
        scene, blocked, free = draw(pepper, rng)
        if blocked is not None and into.total() < options.count:
            motion = pk.retime(pepper, [pepper.posture("Stand"), blocked])
            run = pk.Twin(pepper, scene=scene).execute(motion)
            into[run.status.value] += 1
            depths.append(-distance(pepper, motion.sample(0.002).position, scene))
            errors.append(float(np.abs(run.tracking_error[-1]).max()))
        if free is not None and around.total() < options.count:
            plan = pk.plan(pepper, pepper.posture("Stand"), [free], scene, seed=options.seed, **margins)
            if not plan.success:
                refused[plan.status.value] += 1
                continue
            run = pk.Twin(pepper, scene=scene).execute(pk.retime(pepper, plan))
            around[run.status.value] += 1
            nearest.append(distance(pepper, run.position[::2], scene))
    print(f"into obstacles ({min(depths):.3f} to {max(depths):.3f} m deep): {dict(into)}")
    print(f"  off the reference at the end: {min(errors):.2f} to {max(errors):.2f} rad")
    print(f"around them: {dict(around)}; the twin's least distance {1000 * min(nearest):.1f} mm")
    print(f"  drawn besides, without a plan: {dict(refused)}")


def draw(
    pepper: pk.PepperModel, rng: np.random.Generator
) -> tuple[pk.Scene, np.ndarray | None, pk.ik.HandPosition | None]:
    """Return a scene, a posture with a hand in its box, and where a hand is free; None for none found."""
    stand, hand = pepper.posture("Stand"), str(rng.choice(["left", "right"]))
    side = 1.0 if hand == "left" else -1.0
    center = np.array([rng.uniform(0.3, 0.5), side * rng.uniform(0.0, 0.35), rng.uniform(0.7, 1.1)])
    scene = pk.Scene().add_box("box", size=rng.uniform(0.08, 0.2, 3), position=center)
    if in_collision(pepper, stand, scene):
        return scene, None, None
    inside = pk.ik.solve(pepper, [pk.ik.HandPosition(hand, center)], seed=0)
    shift = rng.uniform(-0.05, 0.1), side * rng.choice([-1.0, 1.0]) * 0.25, rng.uniform(-0.15, 0.15)
    goal = center + np.array(shift)
    task = pk.ik.HandPosition(hand, goal)
    beside = pk.ik.solve(pepper, [task], scene=scene, seed=0)
    straight = stand + np.linspace(0.0, 1.0, 100)[:, None] * (beside.q - stand)
    passes = beside.success and distance(pepper, straight, scene) <= 0.0
    return scene, inside.q if inside.success else None, task if passes else None


def distance(pepper: pk.PepperModel, q: np.ndarray, scene: pk.Scene) -> float:
    """Return the least distance to the obstacles over configurations q, shape (T, n) [m]."""
    return least_clearance(pepper, q, scene, to="obstacles").distance


if __name__ == "__main__":
    main()
