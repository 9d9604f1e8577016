"""Detours of Pepper's base: `pk.plan` of base and arm around a pillar, beside a long search; and its time.

    python benchmarks/planar_base.py [--count 30] [--seconds 5]

The second table is of base, torso and arm among three boxes of a meter's height, and the third of torso and
arm beside them, the base standing, ten times as many problems, `plan` and `retime`, in processor time.

The long search is `planners.aorrtc` without smoothing, on the same problem with the same margins.
Lengths are those of the polylines through the way-points, in the metric of the search and as distance
driven.

Prints Markdown.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from planning_scenes import KINDS, problems

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.problem import RESOLUTION, path_problem

WHAT = "plan", "retime", "both"


def driven(points: np.ndarray) -> float:
    """Return how far the base moves along way-points whose first two coordinates are its own [m]."""
    return float(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).sum())


def among_boxes(base: str, count: int) -> None:
    """Print how long planning and timing among three boxes takes, with the base "planar" or "fixed"."""
    pepper, generator = pk.load_pepper(base=base).with_requirements("limits"), np.random.default_rng(1)
    groups = pepper.joint_group("torso"), pepper.joint_group("left_arm")
    driving = ("BaseX", "BaseY", "BaseYaw") if base == "planar" else ()
    joints = (*driving, *groups[0], *groups[1])
    index = [pepper.joint_index(name) for name in joints]
    low, high = pepper.lower_limits[index].copy(), pepper.upper_limits[index].copy()
    if driving:
        low[:3], high[:3] = (-1.5, -1.5, -3.1), (1.5, 1.5, 3.1)
    legs = slice(len(driving), len(driving) + len(groups[0]))
    low[legs], high[legs] = 0.1 * low[legs], 0.1 * high[legs]
    scene = pk.Scene()
    for name, x, y in (("a", 0.0, 0.6), ("b", 0.6, -0.6), ("c", -0.7, -0.3)):
        scene = scene.add_box(name, (0.5, 0.5, 1.0), (x, y, 0.5))
    free: list[np.ndarray] = []
    while len(free) < 2 * count:
        q = np.array(pepper.posture("Stand"))
        q[index] = generator.uniform(low, high)
        if not pk.collision.in_collision(pepper, q, scene):
            free.append(q)
    planned, timed, both = [], [], []
    for start, goal in zip(free[::2], free[1::2], strict=True):
        begin = time.thread_time()
        plan = pk.plan(pepper, start, goal, scene, joints=joints)
        planned.append(time.thread_time() - begin)
        if plan.success:
            begin = time.thread_time()
            pk.retime(pepper, plan)
            timed.append(time.thread_time() - begin)
            both.append(planned[-1] + timed[-1])
    print(f"\n| base | problems | solved{''.join(f' | {x}: median, 90 %, 99 %, ms' for x in WHAT)} |")
    print("|---|---|---" + len(WHAT) * "|---" + "|")
    rows = planned, timed, both
    cells = [" ".join(f"{1e3 * x:.2f}" for x in np.quantile(some, (0.5, 0.9, 0.99))) for some in rows]
    print(f"| {base} | {len(planned)} | {len(timed)} | {' | '.join(cells)} |")


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=5.0)
    arguments = parser.parse_args()
    lengths, drives, times, difference = [], [], [], []
    for case in problems(KINDS["base and arm, pillar"], arguments.count, 0, blocked=True):
        free = np.array([case.pepper.joint_index(joint) for joint in case.joints])
        problem_data = path_problem(
            Checks(case.pepper, case.scene), case.start, case.goal[None], free, 0.01, RESOLUTION
        )
        long = planners.aorrtc(problem_data.search_problem, timeout=arguments.seconds, seed=1)
        begin = time.thread_time()
        plan = pk.plan(case.pepper, case.start, case.goal, case.scene, joints=case.joints)
        times.append(time.thread_time() - begin)
        if not plan.success or not long.success:
            lengths.append(np.inf)
            continue
        path = planners.Path(plan.path[:, free], problem_data.search_problem.metric.weights)
        lengths.append(path.length / long.cost)
        drives.append(driven(path.points) / driven(long.path.points))
        difference.append(driven(path.points) - driven(long.path.points))
    print(
        "| problems | at most 1.1 times as long | length: median, 90 %, worst | driven: median, 90 %, worst ",
        end="",
    )
    print("| most driven beyond, m | plan, ms |\n|---|---|---|---|---|---|")
    cells = [" ".join(f"{x:.3f}" for x in np.quantile(some, (0.5, 0.9, 1.0))) for some in (lengths, drives)]
    short = int(np.sum(np.array(lengths) <= 1.1))
    print(f"| {len(lengths)} | {short} | {cells[0]} | {cells[1]} ", end="")
    print(f"| {max(difference):.2f} | {1e3 * np.median(times):.0f} |")
    for base in ("planar", "fixed"):
        among_boxes(base, 10 * arguments.count)


if __name__ == "__main__":
    main()
