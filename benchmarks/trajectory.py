"""Timing along paths beside toppra, with limited jerk, online, and what certificates cost."""

from __future__ import annotations

import dataclasses
import itertools
import logging
import tempfile
from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin
import toppra
from harness import Times, figures, python, table
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
    """Waypoints whose spline stays within the limits, and along which the robot can stand."""
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
        grid = DiscretizationType.Interpolation
        constraints = [
            JointVelocityConstraint(PEPPER.velocity_limits),
            JointAccelerationConstraint(PEPPER.acceleration_limits, discretization_scheme=grid),
        ]
        if self.torque:
            both = np.stack([-PEPPER.effort_limits, PEPPER.effort_limits], axis=1)
            limit = SecondOrderConstraint.joint_torque_constraint
            friction = np.zeros(PEPPER.n)
            constraints.append(limit(self.inverse_dynamics, both, friction, discretization_scheme=grid))
        counts = np.maximum(1, np.ceil(self.gridpoints * lengths / s[-1])).astype(int)
        parts = [
            np.linspace(a, b, k + 1)[:-1] for (a, b), k in zip(itertools.pairwise(s), counts, strict=True)
        ]
        options = {"parametrizer": "ParametrizeConstAccel", "solver_wrapper": "seidel"}
        points_on = np.append(np.concatenate(parts), s[-1])
        solver = toppra.algorithm.TOPPRA(constraints, path, gridpoints=points_on, **options)
        trajectory = solver.compute_trajectory()
        t = np.append(np.arange(0.0, trajectory.duration, 0.001), trajectory.duration)
        trajectory(t), trajectory(t, 1), trajectory(t, 2)
        return float(trajectory.duration)


def sampled(points: np.ndarray, **options: Any) -> Trajectory:
    trajectory = retime(PEPPER, points, **options)
    trajectory.sample(0.001)
    return trajectory


def timing(chosen: list[np.ndarray], repeats: int) -> Iterator[tuple]:
    for (name, (options, of_check)), gridpoints in itertools.product(CASES.items(), (100, 500)):
        both = {"gridpoints": gridpoints, **options}
        direct = Direct(options.get("torque", True), gridpoints) if "balance" not in options else None
        calls = {
            "ours": lambda p, b=both: retime(PEPPER, p, **b),
            "sampled": lambda p, b=both: sampled(p, **b),
            "behind": lambda p, b=both: sampled(p, solver="toppra", **b),
            **({"direct": direct} if direct else {}),
        }
        times, difference, green = Times(), [], 0
        for call in calls.values():
            call(chosen[0])
        for points, _ in itertools.product(chosen, range(repeats)):
            for what, call in calls.items():
                times(what, call, points)
        for points in chosen:
            trajectory = retime(PEPPER, points, **both)
            theirs = direct(points) if direct else retime(PEPPER, points, solver="toppra", **both).duration
            difference.append(100 * (trajectory.duration / theirs - 1))
            allowed = {"torque", "balance"} if not options.get("torque", True) else {"balance"}
            green += set(trajectory.check(PEPPER, collisions=False, **of_check).failures) <= allowed
        yield (
            "constraints | grid points | retime [ms] {:.2f} | and sampled [ms] {:.2f} | asked [ms] {:.1f} "
            "| retime by toppra, sampled [ms] {:.1f} | toppra used directly [ms] {:.1f} | duration beside "
            "toppra: median (most) | certified",
            name, gridpoints, times.at("ours"), times.at("sampled"), ASKED[name, gridpoints],
            times.at("behind"), times.at("direct") if direct else "-",
            f"{np.median(difference):+.3f} % ({max(difference):+.3f} %)", f"{green} of {len(chosen)}",
        )  # fmt: skip


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


def with_jerk(motions: dict[str, list[Any]]) -> Iterator[tuple]:
    for (kind, chosen), name in itertools.product(motions.items(), ("gentle", "moderate", "brisk")):
        durations, times, gaps, green = [], Times(), [], 0
        plain = [retime(PEPPER, points, gridpoints=500).duration for points in chosen]
        for points, without in zip(chosen, plain, strict=True):
            smooth = times("retime", retime, PEPPER, points, jerk=name, gridpoints=500)
            durations.append(smooth.duration / without)
            gaps.append(100 * (smooth.duration / least_duration(points, name) - 1))
            green += set(smooth.check(PEPPER, jerk=name, collisions=False).failures) <= {"balance"}
        low, half, high = (f"{100 * (x - 1):.1f}" for x in np.percentile(durations, [10, 50, 90]))
        yield (
            "motions, median without | jerk limits | processor time [ms] {:.1f} | asked [ms] {:.0f} | "
            "longer than without: median (10 to 90 %) | longer than the least: median (most) | certified",
            f"{kind}, {np.median(plain):.2f} s", name, times.at("retime"), ASKED_JERK,
            f"{half} % ({low} to {high} %)", f"{np.median(gaps):.2f} % ({max(gaps):.2f} %)",
            f"{green} of {len(chosen)}",
        )  # fmt: skip


def online(chosen: list[np.ndarray]) -> Iterator[tuple]:
    times = Times()
    for points in chosen:
        motion = OnlineMotion(PEPPER, points[0])
        for target in points[1:]:
            try:
                times("set_target", motion.set_target, target)
            except InfeasibleError:
                del times["set_target"][-1]
                continue
            for _ in range(20):
                times("step", motion.step, 0.004)
    for name in times:
        yield "online | processor time [us] {:.0f}", name, times.at(name, unit=1e6)


def worlds() -> dict[str, pk.Scene]:
    """Nothing, a table, the table with a cup in the hand, and the table with a cloud of points on a floor."""
    held = table().add_cylinder("cup", 0.03, 0.12, (0, 0, 0)).attach("cup", "l_gripper", np.eye(4))
    points = np.random.default_rng(0).uniform((0.35, -0.5, 0.75), (0.65, 0.5, 1.2), (2000, 3))
    cloud = table().add_half_space("floor", (0, 0, 1)).allow("floor", "Tibia", *WHEELS)
    return {
        "the body alone": pk.Scene(),
        "table": table(),
        "table, cup in hand": held,
        "table, floor, cloud": cloud.add_point_cloud("cloud", points, radius=0.01),
    }


def certificates(count: int) -> Iterator[tuple]:
    rng, stand, motions = np.random.default_rng(0), PEPPER.posture("Stand"), []
    while len(motions) < count:
        goal = stand + 0.3 * rng.normal(size=PEPPER.n)
        points = [stand, np.clip(goal, PEPPER.lower_limits, PEPPER.upper_limits)]
        motions.append(retime(PEPPER, points, torque=False))
    milliseconds = np.median([1e3 * motion.duration for motion in motions])
    for name, scene in worlds().items():
        times, measured, off = Times(), [], 0.0
        motions[0].check(PEPPER, scene)
        for motion in motions:
            q = motion.sample(0.001).position
            every = times("every", pk.collision.clearance, PEPPER, q, scene)
            found = times("bounds", pk.collision.least_clearance, PEPPER, q, scene)
            times("whole", motion.check, PEPPER, scene)
            times("without", motion.check, PEPPER, collisions=False)
            off = max(off, abs(found.distance - float(every.min())))
            measured.append(100 * found.measured / len(q))
        yield (
            f"certificate of {milliseconds:.0f} ms (median) | clearance at every one [ms] {{:.0f}} | "
            "by bounds [ms] {:.0f} | whole certificate [ms] {:.0f} | without a scene [ms] {:.0f} | "
            "measured {:.0f} % | least distance differs by at most [um] {:.2f}",
            name, *map(times.at, times), np.median(measured), 1e6 * off,
        )  # fmt: skip


FIRST_CALL = """
import sys, time, pepper_kin as pk; p = pk.load_pepper(); q = p.posture('Stand'); begin = time.perf_counter()
pk.retime(p, [q, 0.9 * q], solver=sys.argv[1]); print(time.perf_counter() - begin)
"""


@figures("benchmarks/timing.md", "toppra", count=2, repeats=1)
def trajectory(count=15, repeats=7, certificate=False, jerk=False) -> Iterator[tuple]:
    """Timing along paths beside toppra.

    Random paths of five waypoints for all 15 joints.  Each case is timed in turn with toppra used directly
    (its own spline, constraints and pass, the torques by Pinocchio one state at a time, as its users write
    it) and with toppra behind `retime(solver="toppra")`; times are medians of processor time, from waypoints
    to a trajectory sampled every millisecond.  Every trajectory is certified before it counts.

    With `--certificate` only the cost of certificates is printed: without a scene, with one, and the
    clearance in it found by bounds beside distances at every millisecond, in turn on the same motions.  With
    `--jerk` only what limits of jerk cost, with 500 grid points: on the random paths, and on plans from Stand
    to random points of a hand.
    """
    toppra.setup_logging("ERROR")
    logging.getLogger("toppra").setLevel(logging.ERROR)
    if certificate:
        yield from certificates(max(count - 3, 2))
        return
    chosen = paths(count)
    if not jerk:
        yield from timing(chosen, repeats)
    yield from with_jerk({"random paths": chosen, "plans from Stand": plans(count * 8 // 3)})
    if jerk:
        return
    yield from online(chosen)
    with tempfile.TemporaryDirectory() as folder:
        for name in ("fast, empty cache", "fast, from the cache", "toppra"):
            spent = float(python(FIRST_CALL, name.split(",")[0], PEPPER_KIN_CACHE=folder))
            yield "first call in a process | time [s] {:.1f}", name, spent
