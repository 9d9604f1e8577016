"""Timing along paths beside toppra: python benchmarks/trajectory.py [--quick] [--certificate | --jerk].

Random paths of five way-points for all 15 joints.  Each case is timed in turn with toppra used directly (its
own spline, constraints and pass, the torques by Pinocchio one state at a time, as its users write it) and
with toppra behind `retime(solver="toppra")`; times are medians of processor
time, from way-points to a trajectory sampled every millisecond.  Every trajectory is certified before it
counts.  Prints Markdown.

With `--certificate` only the cost of certificates is printed: without a scene, with one, and the clearance
in it found by bounds beside distances at every millisecond, in turn on the same motions.  With `--jerk` only
what limits of jerk cost, with 500 grid points: on the random paths, and on plans from Stand to random points
of a hand.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import logging
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import toppra
from toppra.constraint import (
    DiscretizationType,
    JointAccelerationConstraint,
    JointVelocityConstraint,
    SecondOrderConstraint,
)

import pepper_kin as pk
from pepper_kin.core.timing.rate_program import fastest_rate
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.trajectory import OnlineMotion, Trajectory, retime
from pepper_kin.trajectory.limits import jerk_limits, motion_limits
from pepper_kin.trajectory.path import as_cubic_path
from pepper_kin.trajectory.retiming import grid_parameters
from pepper_kin.trajectory.smooth_time import PIECES, rate_program, smooth_time

PEPPER = pk.load_pepper().with_requirements("limits")
WHEELS = ("WheelB_link", "WheelFL_link", "WheelFR_link")
HANDS = {"left": 0.6, "right": 0.6}
CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "velocity, acceleration": ({"torque": False}, {}),
    "with torque": ({}, {}),
    "with torque, balance, hand speed": ({"balance": 0.005, "hand_speed": HANDS}, {"hand_speed": HANDS}),
}
ASKED = {
    ("velocity, acceleration", 100): 0.3,
    ("velocity, acceleration", 500): 0.6,
    ("with torque", 100): 0.4,
    ("with torque", 500): 1.0,
    ("with torque, balance, hand speed", 100): 0.6,
    ("with torque, balance, hand speed", 500): 1.5,
}
ASKED_JERK = 10.0


def paths(count: int, seed: int = 0) -> list[np.ndarray]:
    """Way-points whose spline stays within the limits, and along which the robot can stand."""
    rng = np.random.default_rng(seed)
    lower, upper = PEPPER.lower_limits.copy(), PEPPER.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    middle = (lower + upper) / 2
    found: list[np.ndarray] = []
    while len(found) < count:
        points = middle + 0.7 * (rng.uniform(lower, upper, (5, PEPPER.n)) - middle)
        try:
            retime(PEPPER, points, balance=0.005)
        except InfeasibleError:
            continue
        found.append(points)
    return found


class Direct:
    """toppra as its documentation has it."""

    def __init__(self, torque: bool, gridpoints: int) -> None:
        self.torque, self.gridpoints = torque, gridpoints
        self.data = PEPPER.inner_model.createData()

    def inverse_dynamics(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        return pin.rnea(PEPPER.inner_model, self.data, q, v, a)

    def __call__(self, points: np.ndarray) -> float:
        chords = np.diff(points, axis=0)
        lengths = np.linalg.norm(chords, axis=1)
        s = np.concatenate([[0.0], np.cumsum(lengths)])
        ends = ((1, chords[0] / lengths[0]), (1, chords[-1] / lengths[-1]))
        path = toppra.SplineInterpolator(s, points, bc_type=ends)
        constraints = [
            JointVelocityConstraint(PEPPER.velocity_limits),
            JointAccelerationConstraint(
                PEPPER.acceleration_limits, discretization_scheme=DiscretizationType.Interpolation
            ),
        ]
        if self.torque:
            both = np.stack([-PEPPER.effort_limits, PEPPER.effort_limits], axis=1)
            constraints.append(
                SecondOrderConstraint.joint_torque_constraint(
                    self.inverse_dynamics,
                    both,
                    np.zeros(PEPPER.n),
                    discretization_scheme=DiscretizationType.Interpolation,
                )
            )
        counts = np.maximum(1, np.ceil(self.gridpoints * lengths / s[-1])).astype(int)
        parts = [
            np.linspace(a, b, k + 1)[:-1] for (a, b), k in zip(itertools.pairwise(s), counts, strict=True)
        ]
        solver = toppra.algorithm.TOPPRA(
            constraints,
            path,
            gridpoints=np.append(np.concatenate(parts), s[-1]),
            parametrizer="ParametrizeConstAccel",
            solver_wrapper="seidel",
        )
        trajectory = solver.compute_trajectory()
        t = np.append(np.arange(0.0, trajectory.duration, 0.001), trajectory.duration)
        trajectory(t), trajectory(t, 1), trajectory(t, 2)
        return float(trajectory.duration)


def sampled(points: np.ndarray, **options: Any) -> Trajectory:
    trajectory = retime(PEPPER, points, **options)
    trajectory.sample(0.001)
    return trajectory


def seconds(function: Callable[[], object]) -> float:
    """Processor time [s], which other programs disturb least."""
    begin = time.process_time()
    function()
    return time.process_time() - begin


def medians(
    chosen: list[np.ndarray], repeats: int, *functions: Callable[[np.ndarray], object]
) -> list[float]:
    """Median times [ms], the functions taken in turn on each path."""
    for function in functions:
        function(chosen[0])
    rounds = [
        [seconds(lambda f=f, p=points: f(p)) for f in functions]  # type: ignore[misc]
        for points in chosen
        for _ in range(repeats)
    ]
    return [1e3 * statistics.median(column) for column in zip(*rounds, strict=True)]


def table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    print(f"\n| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")
    sys.stdout.flush()


def timing(chosen: list[np.ndarray], repeats: int) -> None:
    rows = []
    for (name, (options, of_check)), gridpoints in itertools.product(CASES.items(), (100, 500)):
        both = {"gridpoints": gridpoints, **options}
        direct = Direct(options.get("torque", True), gridpoints) if "balance" not in options else None
        functions: list[Callable[[np.ndarray], Any]] = [
            lambda p, b=both: retime(PEPPER, p, **b),  # type: ignore[misc]
            lambda p, b=both: sampled(p, **b),  # type: ignore[misc]
            lambda p, b=both: sampled(p, solver="toppra", **b),  # type: ignore[misc]
            *([direct] if direct else []),
        ]
        ours, whole, behind, *rest = medians(chosen, repeats, *functions)
        difference, green = [], 0
        for points in chosen:
            trajectory = retime(PEPPER, points, **both)
            theirs = direct(points) if direct else retime(PEPPER, points, solver="toppra", **both).duration
            difference.append(trajectory.duration / theirs - 1)
            allowed = {"torque", "balance"} if not options.get("torque", True) else {"balance"}
            green += set(trajectory.check(PEPPER, collisions=False, **of_check).failures) <= allowed
        rows.append(
            (
                name,
                str(gridpoints),
                f"{ours:.2f}",
                f"{whole:.2f}",
                f"{ASKED[name, gridpoints]:.1f}",
                f"{behind:.1f}",
                f"{rest[0]:.1f}" if rest else "-",
                f"{100 * statistics.median(difference):+.3f} % ({100 * max(difference):+.3f} %)",
                f"{green} of {len(chosen)}",
            )
        )
    table(
        (
            "constraints",
            "grid points",
            "retime [ms]",
            "and sampled [ms]",
            "asked [ms]",
            "retime by toppra, sampled [ms]",
            "toppra used directly [ms]",
            "duration beside toppra: median (most)",
            "certified",
        ),
        rows,
    )


def plans(count: int) -> list[Any]:
    """Plans from Stand to where a hand, left and right in turn, is in postures drawn within the limits."""
    rng, found = np.random.default_rng(0), []
    while len(found) < count:
        side = ("left", "right")[len(found) % 2]
        q = rng.uniform(PEPPER.lower_limits, PEPPER.upper_limits)
        point = pk.kinematics.frame_pose(PEPPER, q, f"{side[0].upper()}Arm_effector")[:3, 3]
        plan = pk.plan(PEPPER, PEPPER.posture("Stand"), [pk.ik.HandPosition(side, point)], seed=len(found))
        if plan.success:
            found.append(plan)
    return found


def least_duration(points: Any, name: str) -> float:
    """The least duration of several programs with three times as many pieces, which search longer."""
    curve = as_cubic_path(PEPPER, points)
    fastest, s = retime(PEPPER, curve, gridpoints=500), grid_parameters(curve, 500)
    limits = motion_limits(PEPPER).of(PEPPER, PEPPER.acceleration_limits, drives=False)
    limits, found = dataclasses.replace(limits, jerk=jerk_limits(PEPPER, name)), []
    for share in (0.1, 0.2, 0.4, 0.8):
        base = smooth_time(curve, fastest.breaks, s, share * fastest.duration, 3 * PIECES)
        program = rate_program(PEPPER, curve, base, limits)
        found.append(fastest_rate(program, np.empty(base.knots.size + 1), 1e-5, 200))
    return min(found)


def jerk(motions: dict[str, list[Any]]) -> None:
    rows = []
    for (kind, chosen), name in itertools.product(motions.items(), ("gentle", "moderate", "brisk")):
        durations, times, gaps, green = [], [], [], 0
        plain = [retime(PEPPER, points, gridpoints=500).duration for points in chosen]
        for points, without in zip(chosen, plain, strict=True):
            begin = time.process_time()
            smooth = retime(PEPPER, points, jerk=name, gridpoints=500)
            times.append(1e3 * (time.process_time() - begin))
            durations.append(smooth.duration / without)
            gaps.append(100 * (smooth.duration / least_duration(points, name) - 1))
            green += set(smooth.check(PEPPER, jerk=name, collisions=False).failures) <= {"balance"}
        low, half, high = (f"{100 * (x - 1):.1f}" for x in np.percentile(durations, [10, 50, 90]))
        ms = statistics.median(times)
        rows.append(
            (
                f"{kind}, {statistics.median(plain):.2f} s",
                name,
                f"{ms:.1f}",
                f"{ASKED_JERK:.0f}",
                f"{half} % ({low} to {high} %)",
                f"{statistics.median(gaps):.2f} % ({max(gaps):.2f} %)",
                f"{green} of {len(chosen)}",
            )
        )
    heads = ("motions, median without", "jerk limits", "processor time [ms]", "asked [ms]")
    gap = "longer than the least: median (most)"
    table((*heads, "longer than without: median (10 to 90 %)", gap, "certified"), rows)


def online(chosen: list[np.ndarray]) -> None:
    times, steps = [], []
    for points in chosen:
        motion = OnlineMotion(PEPPER, points[0])
        for target in points[1:]:
            try:
                times.append(1e6 * seconds(lambda m=motion, t=target: m.set_target(t)))  # type: ignore[misc]
            except InfeasibleError:
                continue
            steps += [1e6 * seconds(lambda m=motion: m.step(0.004)) for _ in range(20)]  # type: ignore[misc]
    rows = [("set_target", f"{statistics.median(times):.0f}"), ("step", f"{statistics.median(steps):.0f}")]
    table(("online", "processor time [us]"), rows)


def worlds() -> dict[str, pk.Scene]:
    """Nothing, a table, the table with a cup in the hand, and the table with a cloud of points on a floor."""
    table = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))
    held = table.add_cylinder("cup", 0.03, 0.12, (0, 0, 0)).attach("cup", "l_gripper", np.eye(4))
    points = np.random.default_rng(0).uniform((0.35, -0.5, 0.75), (0.65, 0.5, 1.2), (2000, 3))
    cloud = table.add_half_space("floor", (0, 0, 1)).allow("floor", "Tibia", *WHEELS)
    return {
        "the body alone": pk.Scene(),
        "table": table,
        "table, cup in hand": held,
        "table, floor, cloud": cloud.add_point_cloud("cloud", points, radius=0.01),
    }


def certificate(count: int) -> None:
    rng = np.random.default_rng(0)
    stand, motions = PEPPER.posture("Stand"), []
    while len(motions) < count:
        goal = stand + 0.3 * rng.normal(size=PEPPER.n)
        points = [stand, np.clip(goal, PEPPER.lower_limits, PEPPER.upper_limits)]
        motions.append(retime(PEPPER, points, torque=False))
    rows = []
    for name, scene in worlds().items():
        times, measured, off = [], [], 0.0
        motions[0].check(PEPPER, scene)
        for motion in motions:
            q = motion.sample(0.001).position
            found = pk.collision.least_clearance(PEPPER, q, scene)
            every = pk.collision.clearance(PEPPER, q, scene)
            off = max(off, abs(found.distance - float(every.min())))
            measured.append(found.measured / len(q))
            functions: list[Callable[[], object]] = [
                lambda q=q, s=scene: pk.collision.clearance(PEPPER, q, s),  # type: ignore[misc]
                lambda q=q, s=scene: pk.collision.least_clearance(PEPPER, q, s),  # type: ignore[misc]
                lambda m=motion, s=scene: m.check(PEPPER, s),  # type: ignore[misc]
                lambda m=motion: m.check(PEPPER, collisions=False),  # type: ignore[misc]
            ]
            times.append([1e3 * seconds(function) for function in functions])
        medians_ms = [f"{statistics.median(column):.0f}" for column in zip(*times, strict=True)]
        share = f"{100 * statistics.median(measured):.0f} %"
        rows.append((name, *medians_ms, share, f"{1e6 * off:.2f}"))
    milliseconds = statistics.median(1e3 * motion.duration for motion in motions)
    table(
        (
            f"certificate of {milliseconds:.0f} ms (median)",
            "clearance at every one [ms]",
            "by bounds [ms]",
            "whole certificate [ms]",
            "without a scene [ms]",
            "measured",
            "least distance differs by at most [um]",
        ),
        rows,
    )


def cold() -> None:
    """Time of the first call in a process of its own, with an empty cache and with what that left there."""
    code = (
        "import time, pepper_kin as pk; p = pk.load_pepper(); q = p.posture('Stand');"
        "begin = time.perf_counter();"
        "pk.retime(p, [q, 0.9 * q], solver={!r}); print(time.perf_counter() - begin)"
    )
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, solver in (
            ("fast, empty cache", "fast"),
            ("fast, from the cache", "fast"),
            ("toppra", "toppra"),
        ):
            done = subprocess.run(
                [sys.executable, "-c", code.format(solver)],
                capture_output=True,
                text=True,
                check=True,
                env={**os.environ, "PEPPER_KIN_CACHE": folder},
            )
            rows.append((name, f"{float(done.stdout):.1f}"))
    table(("first call in a process", "time [s]"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--certificate", action="store_true", help="only what certificates cost")
    only.add_argument("--jerk", action="store_true", help="only what limits of jerk cost")
    options = parser.parse_args()
    quick = options.quick
    toppra.setup_logging("ERROR")
    logging.getLogger("toppra").setLevel(logging.ERROR)
    if options.certificate:
        certificate(4 if quick else 12)
        return
    chosen = paths(4 if quick else 15)
    if not options.jerk:
        timing(chosen, 3 if quick else 7)
    jerk({"random paths": chosen, "plans from Stand": plans(4 if quick else 40)})
    if options.jerk:
        return
    online(chosen)
    cold()


if __name__ == "__main__":
    main()
