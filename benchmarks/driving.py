"""Drives of a differential base in rooms with random boxes, and the curves they are made of beside OMPL's.

    python benchmarks/driving.py [ROOMS]

Prints Markdown.
"""

from __future__ import annotations

import itertools
import sys
import time

import numpy as np
from ompl import base as ompl_base

import pepper_kin as pk
from pepper_kin.model import Wheels
from pepper_kin.planners.car_curves import car_curve, shortest_curve

CART = """<robot name="cart"><link name="base"><inertial><origin xyz="0 0 0.2"/><mass value="20"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<collision><origin xyz="0 0 0.25"/><geometry><box size="0.5 0.4 0.4"/></geometry></collision></link>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>
<collision><origin xyz="0 0 0.2"/><geometry><box size="0.06 0.06 0.4"/></geometry></collision></link>
<joint name="lift" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/>
<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="30" velocity="2" acceleration="5"/>
</joint></robot>"""
WHEELS = Wheels(speed=0.6, acceleration=0.8, track=0.4, turning_radius=0.4, reach=3.0)


def office(seed: int) -> tuple[pk.Scene, np.ndarray, np.ndarray]:
    """Return twelve boxes, and places of the base on either side of them."""
    rng, scene = np.random.default_rng(seed), pk.Scene()
    for number in range(12):
        size, place = rng.uniform(0.1, 0.6, 2), rng.uniform(-1.8, 1.8, 2)
        scene = scene.add_box(f"box {number}", size=(*size, 1.0), position=(*place, 0.5))
    return scene, np.array([-2.5, -2.5, *rng.uniform(-3, 3, 1)]), np.array([2.5, 2.5, *rng.uniform(-3, 3, 1)])


def drives(count: int) -> None:
    """Print how rooms are driven through."""
    robot = pk.load_robot(CART, base="differential", wheels=WHEELS)
    rows, solved, tried = [], 0, 0
    for seed in range(count):
        scene, start, goal = office(seed)
        ends = [
            robot.joint_vector(dict(zip(("BaseX", "BaseY", "BaseYaw"), end, strict=True)))
            for end in (start, goal)
        ]
        if pk.collision.in_collision(robot, np.array(ends), scene).any():
            continue
        tried += 1
        begin = time.process_time()
        plan = pk.plan(robot, *ends, scene, seed=seed)
        planned = time.process_time()
        if not plan.success:
            continue
        solved += 1
        trajectory = pk.retime(robot, plan)
        timed = time.process_time()
        assert trajectory.check(robot, scene=scene).success
        state = trajectory.sample(0.005)
        yaw, (vx, vy, _) = state.position[:, 2], state.velocity[:, :3].T
        drift = np.abs(vy * np.cos(yaw) - vx * np.sin(yaw)).max()
        length = np.linalg.norm(np.diff(plan.path[:, :2], axis=0), axis=1).sum()
        bound = car_curve(start, goal, WHEELS.turning_radius).length
        rows.append((1e3 * (planned - begin), 1e3 * (timed - planned), length / bound, 1e3 * drift))
    (plan_ms, retime_ms, ratio, drift_mm), worst = np.median(rows[1:], axis=0), np.max(rows[1:], axis=0)
    print(f"{solved} of {tried} rooms, all certified; median (worst)\n")
    print("| `plan` [ms] | `retime` [ms] | length over the curve without boxes | sideways [mm/s] |")
    print("|---|---|---|---|")
    print(
        f"| {plan_ms:.0f} ({worst[0]:.0f}) | {retime_ms:.1f} ({worst[1]:.1f}) "
        f"| {ratio:.2f} ({worst[2]:.2f}) | {drift_mm:.1f} ({worst[3]:.1f}) |"
    )


def curves() -> None:
    """Print the time of a curve's length, called from Python."""
    poses = np.random.default_rng(0).uniform([-3, -3, -3.1], [3, 3, 3.1], (4000, 3))
    segments = np.zeros((2, 5))
    print("\n| length of a curve [us] | ours | OMPL |\n|---|---|---|")
    for name, backward in (("Reeds and Shepp", True), ("Dubins", False)):
        space = (ompl_base.ReedsSheppStateSpace if backward else ompl_base.DubinsStateSpace)(0.5)
        bounds = ompl_base.RealVectorBounds(2)
        bounds.setLow(-5.0)
        bounds.setHigh(5.0)
        space.setBounds(bounds)
        states = []
        for x, y, yaw in poses:
            state = space.allocState()
            state.setX(x)
            state.setY(y)
            state.setYaw(yaw)
            states.append(state)
        times = []
        for _ in range(7):
            begin = time.process_time()
            for a, b in itertools.pairwise(poses):
                shortest_curve(a, b, 0.5, backward, segments)
            middle = time.process_time()
            for one, other in itertools.pairwise(states):
                space.distance(one, other)
            times.append((middle - begin, time.process_time() - middle))
        ours, theirs = 1e6 * np.median(times, axis=0) / (len(poses) - 1)
        print(f"| {name} | {ours:.1f} | {theirs:.1f} |")


if __name__ == "__main__":
    drives(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
    curves()
