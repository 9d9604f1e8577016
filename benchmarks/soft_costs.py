"""Formulas of users: what an expression takes to compile, and what plans with soft costs save and take.

    python benchmarks/soft_costs.py [--problems 40]

Processor times.  Every curve is looked at by coal and its costs are integrated again by NumPy.
"""

import argparse
import time
from functools import partial

import casadi
import numpy as np

import pepper_kin as pk
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.motion import PathCost, manifold_of

WIDTH = 0.1  # of a hot spot [m]


def timed(call):
    """Return the processor time of a call [ms] and its answer."""
    begin = time.process_time()
    answer = call()
    return 1000 * (time.process_time() - begin), answer


def compile_times(pepper):
    """Print what the first manifold of expressions that nobody has used takes, and the second."""
    hand, torque = pk.symbolic.frame_pose(pepper, "LArm_effector"), pk.symbolic.gravity_torque(pepper)
    q, free = pepper.posture("Stand"), np.arange(pepper.n)
    for name, function in (
        ("height of a hand", lambda x: hand(x)[2, 3]),
        ("five torques", lambda x: torque(x)[5:10]),
    ):
        first = []
        for _ in range(5):
            salt = np.random.default_rng().normal() * 1e-9  # new to every cache
            task = pk.ik.Expression(pepper, lambda x, f=function, s=salt: f(x) + s * x[0], -5.0, 5.0)
            first.append(timed(lambda t=task: manifold_of(pepper, [t], q, free))[0])
        again = [timed(lambda t=task: manifold_of(pepper, [t], q, free))[0] for _ in range(50)]
        print(f"{name}: compiled in {np.median(first):.0f} ms, afterwards {np.median(again):.2f} ms")


def problem(generator):
    """Return a scene of four boxes, a hot spot and a goal, drawn at random."""
    scene = pk.Scene()
    for k in range(4):
        place = generator.uniform([0.3, -0.6, 0.5], [0.7, 0.6, 1.3])
        scene = scene.add_box(f"box {k}", size=generator.uniform(0.04, 0.2, 3), position=place)
    spot = generator.uniform([0.25, -0.1, 0.6], [0.5, 0.4, 1.1])
    target = generator.uniform([0.25, 0.0, 0.6], [0.45, 0.4, 1.1])
    return scene, spot, [pk.ik.HandPosition("left", target)]


def integral(pepper, curve, spot):
    """Return states of a curve, and the integral of the price of a hot spot along it [m]."""
    segments = np.repeat(np.arange(len(curve.breaks) - 1), 100)
    spans = np.diff(curve.breaks)[segments]
    local = (np.tile(np.arange(100), len(curve.breaks) - 1) + 0.5) / 100 * spans
    q, slopes = curve.at(segments, local), curve.at(segments, local, 1)
    places = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:, :3, 3]
    price = 10 * np.exp(-np.sum((places - spot) ** 2, axis=1) / (2 * WIDTH**2))
    return q, float(price @ (np.linalg.norm(slopes * motion_bounds(pepper), axis=1) * spans / 100))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=40)
    count = parser.parse_args().problems
    pepper, generator = pk.load_pepper().with_requirements("limits"), np.random.default_rng(5)
    compile_times(pepper)
    hand, start = pk.symbolic.frame_pose(pepper, "LArm_effector"), pepper.posture("Stand")
    plain, costed, shares, solved = [], [], [], 0
    for seed in range(count):
        scene, spot, goal = problem(generator)
        cost = PathCost(
            pepper, lambda q, p=spot: 10 * casadi.exp(-casadi.sumsqr(hand(q)[:3, 3] - p) / (2 * WIDTH**2))
        )
        solve = partial(pk.plan, pepper, start, goal, scene, joints="whole_body", seed=seed)
        solve(), solve(costs=[cost])  # makes tables and code
        time_plain, free = timed(solve)
        time_costed, plan = timed(partial(solve, costs=[cost]))
        assert plan.success == free.success
        if not plan.success:
            continue
        solved += 1
        q, found = integral(pepper, plan.curve, spot)
        assert not pk.collision.in_collision(pepper, q, scene).any()
        (priced,) = plan.costs
        assert abs(found - priced.integral) <= 0.005 * found + 1e-6
        plain.append(time_plain)
        costed.append(time_costed)
        shares.append(priced.integral / priced.before)
    print(f"{solved} of {count} problems solved, with costs and without; no curve touches")
    middle, most = np.median(shares), max(shares)
    print(f"integral beside that of the plan without costs: median {middle:.2f}, most {most:.2f}")
    for name, times in (("without costs", plain), ("with costs", costed)):
        print(f"{name}: median {np.median(times):.0f} ms, 90 % {np.quantile(times, 0.9):.0f} ms")


if __name__ == "__main__":
    main()
