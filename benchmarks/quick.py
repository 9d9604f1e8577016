"""IK, batches and the twin on this machine in a minute, each beside the usual way to do the same.

The two ways of a row take turns, so that a busy moment of the machine hits both.  What is compiled is
compiled before the clock runs.  Results of both ways are compared.  Prints Markdown, or JSON.

python benchmarks/quick.py [--repeats N] [--seed N] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import time

import numpy as np
import pinocchio

import pepper_kin as pk

FRAME = "LArm_effector"
STATES = 4000  # of a batch; a loop takes a twentieth of them
SINGLE_TARGETS = 20
BATCH_TARGETS = 500
STEPS = 400  # of the twin; the way over Pinocchio takes a tenth of them
SAME = 1e-9


def one_ik(pepper, rng, repeats):
    points, solved = targets(pepper, rng, SINGLE_TARGETS), {}

    def solve_all(solver):
        tasks = [pk.ik.HandPosition("left", point) for point in points]
        solved[solver] = sum(pk.ik.solve(pepper, task, solver=solver).success for task in tasks)

    ours, peer = medians(repeats, lambda: solve_all("fast"), lambda: solve_all("placo"))
    assert solved["fast"] == len(points)
    quality = f"solved {solved['fast']} and {solved['placo']} of {len(points)}"
    return "IK of a hand, one call", "fast", ours / len(points), "placo", peer / len(points), quality


def many_ik(pepper, rng, repeats):
    points = targets(pepper, rng, BATCH_TARGETS)
    few = points[:SINGLE_TARGETS]

    def loop():
        return [pk.ik.solve(pepper, pk.ik.HandPosition("left", point)).success for point in few]

    def batch():
        return pk.ik.solve_batch(pepper, pk.ik.HandPosition("left", points), collisions=False).codes == 0

    quality = f"solved {int(batch().sum())} of {len(points)} and {sum(loop())} of {len(few)}"
    ours, peer = medians(repeats, batch, loop)
    return "IK of a hand, many", "batch", ours / len(points), "calls of fast", peer / len(few), quality


def poses(pepper, rng, repeats):
    q, _, _ = states(pepper, rng)
    few = q[:: STATES // 200]

    def batch():
        return pk.kinematics.frame_pose(pepper, q, FRAME)

    def loop():
        return np.array([pk.kinematics.frame_pose(pepper, state, FRAME) for state in few])

    quality = same(batch()[:: STATES // 200], loop())
    ours, peer = medians(repeats, batch, loop)
    return "pose of a hand", "batch", ours / len(q), "one by one", peer / len(few), quality


def torques(pepper, rng, repeats):
    """Inverse dynamics beside a loop over Pinocchio itself, without this library's checks."""
    q, v, a = states(pepper, rng)
    few = slice(None, None, STATES // 200)
    model = pepper.inner_model
    data = model.createData()

    def batch():
        return pk.dynamics.inverse_dynamics(pepper, q, v, a)

    def loop():
        rows = zip(q[few], v[few], a[few], strict=True)
        return np.array([pinocchio.rnea(model, data, *row) for row in rows])

    quality = same(batch()[few], loop())
    ours, peer = medians(repeats, batch, loop)
    return "inverse dynamics", "batch", ours / len(q), "loop over Pinocchio", peer / len(q[few]), quality


def twin_step(pepper, rng, repeats):
    goal = np.clip(pepper.neutral() + 0.001, pepper.lower_limits, pepper.upper_limits)
    few, twin, reference = STEPS // 10, pk.Twin(pepper, 0.001), np.tile(goal, (STEPS, 1))

    def hold():
        twin.reset(pepper.neutral())
        return twin.follow(reference, np.zeros_like(reference)).position[few]

    def hold_over_pinocchio():
        """Servos far from their limits: the twin's scheme, called from Python."""
        servo, h = twin.actuators, twin.timestep
        model = pinocchio.Model(pepper.pinocchio_model)
        data = model.createData()
        model.armature = np.array(model.armature) + h * h * servo.stiffness + h * servo.damping
        q, v = pepper.neutral(), np.zeros(pepper.n)
        for _ in range(few):
            torque = servo.stiffness * (goal - q - h * v) - servo.damping * v
            torque += pinocchio.computeGeneralizedGravity(model, data, q)
            v = v + h * pinocchio.aba(model, data, q, v, torque)
            q = q + h * v
        return q

    quality = same(hold(), hold_over_pinocchio())
    ours, peer = medians(repeats, hold, hold_over_pinocchio)
    return "step of the twin", "compiled", ours / STEPS, "over Pinocchio", peer / few, quality


def same(ours, peers):
    off = float(np.abs(ours - peers).max())
    assert off < SAME, off
    return f"same to {off:.0e}"


def targets(pepper, rng, count):
    """Points that the left palm takes at random joint positions, so all can be reached [m]."""
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))
    return pk.kinematics.frame_pose(pepper, q, FRAME)[:, :3, 3]


def states(pepper, rng):
    shape = (STATES, pepper.n)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, shape)
    return q, rng.normal(size=shape), rng.normal(size=shape)


def medians(repeats, *functions):
    """Median times of functions that take turns [s]; each runs once before, to compile."""
    for function in functions:
        function()
    turns = [[seconds(function) for function in functions] for _ in range(repeats)]
    return [statistics.median(column) for column in zip(*turns, strict=True)]


def seconds(function):
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    pepper, names = (
        pk.load_pepper().with_requirements("limits"),
        ("name", "ours", "seconds", "peer", "peer_seconds", "quality"),
    )
    measures = (one_ik, many_ik, poses, torques, twin_step)
    rows = [measure(pepper, np.random.default_rng(options.seed), options.repeats) for measure in measures]
    machine = f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()}"
    if options.json:
        print(json.dumps({"machine": machine, "rows": [dict(zip(names, row, strict=True)) for row in rows]}))
        return
    print(f"On {machine}: medians of {options.repeats} turns, one thread.\n")
    print("| what | fast way | time [us] | other way | time [us] | ratio | results |")
    print("|---|---|---|---|---|---|---|")
    for name, ours, own, peer, other, quality in rows:
        own, other = own * 1e6, other * 1e6
        print(f"| {name} | {ours} | {own:.2f} | {peer} | {other:.2f} | {other / own:.1f} | {quality} |")


if __name__ == "__main__":
    main()
