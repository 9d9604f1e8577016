"""IK, batches and the twin on this machine in a minute, each beside the usual way to do the same."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Iterator

import numpy as np
import pinocchio
from harness import figures, in_turn

import pepper_kin as pk

FRAME = "LArm_effector"
STATES = 4000  # of a batch; a loop takes a twentieth of them
SINGLE_TARGETS = 20
BATCH_TARGETS = 500
STEPS = 400  # of the twin; the way over Pinocchio takes a tenth of them
SAME = 1e-9


def one_ik(pepper, rng):
    tasks = [pk.ik.HandPosition("left", point) for point in targets(pepper, rng, SINGLE_TARGETS)]

    def solved(solver):
        return sum(pk.ik.solve(pepper, task, solver=solver).success for task in tasks)

    assert solved("fast") == len(tasks)
    quality = f"solved {solved('fast')} and {solved('placo')} of {len(tasks)}"
    ways = (lambda: solved("fast")), (lambda: solved("placo"))
    return "IK of a hand, one call", "fast", len(tasks), "placo", len(tasks), quality, ways


def many_ik(pepper, rng):
    points = targets(pepper, rng, BATCH_TARGETS)
    few, task = points[:SINGLE_TARGETS], pk.ik.HandPosition("left", points)

    def loop():
        return [pk.ik.solve(pepper, pk.ik.HandPosition("left", point)).success for point in few]

    def batch():
        return pk.ik.solve_batch(pepper, task, collisions=False).codes == 0

    quality = f"solved {int(batch().sum())} of {len(points)} and {sum(loop())} of {len(few)}"
    return "IK of a hand, many", "batch", len(points), "calls of fast", len(few), quality, (batch, loop)


def poses(pepper, rng):
    q, _, _ = states(pepper, rng)
    few = q[:: STATES // 200]

    def batch():
        return pk.kinematics.frame_pose(pepper, q, FRAME)

    def loop():
        return np.array([pk.kinematics.frame_pose(pepper, state, FRAME) for state in few])

    quality = same(batch()[:: STATES // 200], loop())
    return "pose of a hand", "batch", len(q), "one by one", len(few), quality, (batch, loop)


def torques(pepper, rng):
    """Inverse dynamics beside a loop over Pinocchio itself, without this library's checks."""
    q, v, a = states(pepper, rng)
    few, model, data = slice(None, None, STATES // 200), pepper.inner_model, pepper.inner_model.createData()

    def batch():
        return pk.dynamics.inverse_dynamics(pepper, q, v, a)

    def loop():
        rows = zip(q[few], v[few], a[few], strict=True)
        return np.array([pinocchio.rnea(model, data, *row) for row in rows])

    quality = same(batch()[few], loop())
    return "inverse dynamics", "batch", len(q), "loop over Pinocchio", len(q[few]), quality, (batch, loop)


def twin_step(pepper, _):
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

    ways, quality = (hold, hold_over_pinocchio), same(hold(), hold_over_pinocchio())
    return "step of the twin", "compiled", STEPS, "over Pinocchio", few, quality, ways


def same(ours, peers):
    off = float(np.abs(ours - peers).max())
    assert off < SAME, off
    return f"same to {off:.0e}"


def targets(pepper, rng, count):
    """Points that the left palm takes at random joint positions, so all can be reached [m]."""
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))
    return pk.kinematics.frame_pose(pepper, q, FRAME)[:, :3, 3]


def states(pepper, rng):
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (STATES, pepper.n))
    return q, rng.normal(size=q.shape), rng.normal(size=q.shape)


@figures("benchmarks.md", repeats=1)
def quick(repeats: int = 5, seed: int = 0) -> Iterator[tuple | str]:
    """IK, batches and the twin on this machine in a minute, each beside the usual way to do the same.

    The two ways of a row take turns, so that a busy moment of the machine hits both.  What is compiled is
    compiled before the clock runs.  Results of both ways are compared.
    """
    machine = f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()}"
    yield f"On {machine}: medians of {repeats} turns, one thread."
    pepper = pk.load_pepper().with_requirements("limits")
    for measure in (one_ik, many_ik, poses, torques, twin_step):
        name, ours, count, peer, few, quality, ways = measure(pepper, np.random.default_rng(seed))
        spent = in_turn(dict(enumerate(ways)), repeats, time.perf_counter)
        own, other = 1e6 * np.median(spent[0]) / count, 1e6 * np.median(spent[1]) / few
        yield (
            "what | fast way | time [us] {:.2f} | other way | time [us] {:.2f} | ratio {:.1f} | results",
            name, ours, own, peer, other, other / own, quality,
        )  # fmt: skip
