"""Curves of `pk.plan` on random problems, examined by code that has no part in planning.

Scenes hold up to ten boxes, spheres, cylinders, capsules, convex hulls and clouds around the robot.  Start
and goal are drawn evenly from the free configurations of one or several joint groups of Pepper (its base
fixed or driving), a UR5 or a Panda (the files of example-robot-data).  A goal is a configuration, several of
them, or a task: a point that a hand can reach.  The certificate of a curve is computed here with NumPy,
coal and the independent Newton-Euler alone: states no farther apart than 2 mrad (or millimeters, all joints
added), continuity, joint limits, both ends, torque against gravity at rest, the least distance to the scene
and between parts of the robot, and the error of the task.  Every tenth of Pepper's plans (base fixed) is
timed as well, in balance, and `trajectory.check` asked.  A curve that any of these refuses is a bug; its
seed is printed.

    python benchmarks/planning_certificates.py [--count 1000] [--first 0] [--robots pepper planar ur5 panda]

Prints Markdown.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio

import pepper_kin as pk
from pepper_kin.collision.least_clearance import least_clearance

STEP = 2e-3  # [rad or m] between states, all joints added
TOUCH = -2e-6  # [m] coal's own accuracy
CONTINUOUS = 1e-9  # [rad or m]
REACHED = 1e-3  # [m]
TIMED = 10
TIMEOUT = 2.0  # [s]
GROUPS = {
    "pepper": (
        ("left_arm",), ("right_arm",), ("torso", "left_arm"), ("left_arm", "right_arm"), ("whole_body",),
        ("head", "torso"),
    ),
    "planar": (("left_arm",), ("torso", "right_arm")),
    "ur5": ((),),
    "panda": ((),),
}  # fmt: skip
FILES = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "ur_description/srdf/ur5.srdf"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_description/srdf/panda.srdf"),
}
BASE = ("BaseX", "BaseY", "BaseYaw")
AROUND = {"pepper": (0.25, 0.75), "planar": (0.4, 1.6), "ur5": (0.3, 0.9), "panda": (0.3, 0.85)}
HEIGHTS = {"pepper": (0.3, 1.2), "planar": (0.2, 1.2), "ur5": (-0.2, 0.9), "panda": (0.0, 1.0)}


class Asked(NamedTuple):
    """A problem.

    Attributes:
        scene: The world.
        joints: Names of those that move.
        start: Shape (n,).
        goal: What `plan` is given.
        target: The point of a task and its frame, or None.
    """

    scene: pk.Scene
    joints: tuple[str, ...]
    start: np.ndarray
    goal: Any
    target: tuple[str, np.ndarray] | None


def robot_of(name: str) -> pk.PepperModel:
    """Return a robot by its name here."""
    if name in ("pepper", "planar"):
        return pk.load_pepper(base="planar" if name == "planar" else "fixed").with_requirements("limits")
    share = Path(str(metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share")))
    urdf, srdf = (share / "example-robot-data" / "robots" / file for file in FILES[name])
    return pk.load_robot(urdf, srdf, [share])


def random_scene(name: str, rng: np.random.Generator) -> pk.Scene:
    """Return a scene with up to ten things around a robot."""
    scene = pk.Scene()
    for number in range(int(rng.integers(0, 11))):
        angle, radius = rng.uniform(-np.pi, np.pi), rng.uniform(*AROUND[name])
        place = np.array([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(*HEIGHTS[name])])
        turned, label, kind = rng.uniform(-np.pi, np.pi, 3), f"thing {number}", int(rng.integers(6))
        if kind == 0:
            scene = scene.add_box(label, rng.uniform(0.03, 0.35, 3), place, turned)
        elif kind == 1:
            scene = scene.add_sphere(label, rng.uniform(0.02, 0.15), place)
        elif kind == 2:
            scene = scene.add_cylinder(label, rng.uniform(0.02, 0.1), rng.uniform(0.05, 0.5), place, turned)
        elif kind == 3:
            scene = scene.add_capsule(label, rng.uniform(0.02, 0.08), rng.uniform(0.05, 0.5), place, turned)
        elif kind == 4:
            scene = scene.add_convex_mesh(label, rng.normal(0.0, 0.07, (12, 3)), place, turned)
        else:
            points = rng.uniform(-0.12, 0.12, (int(rng.integers(20, 400)), 3))
            scene = scene.add_point_cloud(label, points, 0.01, place, turned)
    return scene


def free_states(robot: pk.PepperModel, scene: pk.Scene, joints: tuple[str, ...], rng: Any) -> np.ndarray:
    """Return configurations that are free and can be held, most of them, shape (k, n)."""
    index = [robot.joint_index(joint) for joint in joints]
    low = np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -np.pi)[index]
    high = np.where(np.isfinite(robot.upper_limits), robot.upper_limits, np.pi)[index]
    for k, joint in enumerate(joints):
        if joint in BASE[:2]:
            low[k], high[k] = -1.5, 1.5
    states = np.tile(robot.neutral(), (64, 1))
    states[:, index] = rng.uniform(low, high, (64, len(index)))
    torque = np.abs(pk.dynamics.gravity_torque(robot, states))
    states = states[(torque <= 0.9 * robot.effort_limits).all(axis=1)]
    return states[~pk.collision.in_collision(robot, states, scene)]


def problem(name: str, robot: pk.PepperModel, seed: int) -> Asked | None:
    """Return the problem of a seed; None where fewer than four free states were drawn."""
    rng = np.random.default_rng((seed, len(name)))
    scene = random_scene(name, rng)
    groups = GROUPS[name][int(rng.integers(len(GROUPS[name])))]
    joints = tuple(dict.fromkeys(joint for group in groups for joint in robot.joint_group(group)))
    joints = joints or tuple(robot.joint_names)
    if name == "planar":
        joints = (*BASE, *joints)
    free = free_states(robot, scene, joints, rng)
    if len(free) < 4:
        return None
    kind = rng.random()
    hand = next((side for side in ("left", "right") if f"{side}_arm" in groups), None)
    if name == "pepper" and hand is not None and kind < 0.3:
        frame = "LArm_effector" if hand == "left" else "RArm_effector"
        point = pk.kinematics.frame_pose(robot, free[1], frame)[:3, 3]
        return Asked(scene, joints, free[0], [pk.ik.HandPosition(hand, point)], (frame, point))
    goal = free[1:4] if kind > 0.85 else free[1]
    return Asked(scene, joints, free[0], goal, None)


def sampled(curve: Any) -> np.ndarray:
    """Return states of a piecewise cubic curve, both ends of every piece included, shape (N, n)."""
    rows = []
    for begin, end, constant in zip(curve.breaks[:-1], curve.breaks[1:], curve.coefficients, strict=True):

        def at(h: np.ndarray, c: np.ndarray = constant) -> np.ndarray:
            return c[0] + h[:, None] * (c[1] + h[:, None] * (c[2] + h[:, None] * c[3]))

        rough = at(np.linspace(0.0, end - begin, 33))
        fastest = 32 * np.abs(np.diff(rough, axis=0)).sum(axis=1).max()
        rows.append(at(np.linspace(0.0, end - begin, int(np.ceil(1.1 * fastest / STEP)) + 2)))
    return np.concatenate(rows)


def faults(robot: pk.PepperModel, asked: Asked, plan: pk.Plan) -> tuple[list[str], float]:
    """Return what is wrong with a plan's curve, and the least distance along it [m]."""
    wrong, curve = [], plan.curve
    states = plan.path if curve is None else sampled(curve)
    if curve is not None:
        c, h = curve.coefficients, np.diff(curve.breaks)[:, None]
        ends = c[:, 0] + h * (c[:, 1] + h * (c[:, 2] + h * c[:, 3]))
        if len(c) > 1 and np.abs(ends[:-1] - c[1:, 0]).max() > CONTINUOUS:
            wrong.append("jumps")
    if (states < robot.lower_limits - 1e-9).any() or (states > robot.upper_limits + 1e-9).any():
        wrong.append("limits")
    if np.abs(states[[0, -1]] - [asked.start, plan.goal]).max() > CONTINUOUS:
        wrong.append("ends")
    if asked.target is None and np.abs(np.atleast_2d(asked.goal) - plan.goal).max(axis=1).min() > CONTINUOUS:
        wrong.append("another goal")
    if asked.target is not None:
        frame, point = asked.target
        if np.linalg.norm(position_of(robot, states[-1], frame) - point) > REACHED:
            wrong.append("task not met")
    still = [k for k, name in enumerate(robot.joint_names) if name not in asked.joints]
    if np.ptp(states[:, still], axis=0).max(initial=0.0) > CONTINUOUS:
        wrong.append("moves another joint")
    at_rest = np.zeros_like(states)
    torque = np.abs(pk.dynamics.newton_euler(robot, states, at_rest, at_rest))
    if (torque > robot.effort_limits + 1e-9).any():
        wrong.append("torque")
    least = least_clearance(robot, states, asked.scene)
    if least.distance < TOUCH or least.forbidden is not None:
        pair = least.pair
        wrong.append(f"touches, {1e3 * least.distance:.4f} mm, {pair and pair.names}")
    return wrong, least.distance


def position_of(robot: pk.PepperModel, q: np.ndarray, frame: str) -> np.ndarray:
    """Return the position of a frame by Pinocchio itself [m], shape (3,)."""
    model = robot.pinocchio_model
    data = model.createData()
    full = robot.full_map @ q + robot.full_offset
    pinocchio.framesForwardKinematics(model, data, full)
    return data.oMf[model.getFrameId(frame)].translation.copy()


def measured(name: str, arguments: argparse.Namespace) -> str:
    """Run the problems of a robot; return a row of the table."""
    robot, seed, count = robot_of(name), arguments.first, Counter()
    least, taken, endings = [], 0.0, Counter()
    while count["problems"] < arguments.count:
        seed += 1
        asked = problem(name, robot, seed)
        if asked is None:
            continue
        count["problems"] += 1
        begin = time.process_time()
        plan = pk.plan(
            robot, asked.start, asked.goal, asked.scene, joints=asked.joints, seed=seed, timeout=TIMEOUT,
            margin=(0.01, 0.0, 0.03)[seed % 3],
        )  # fmt: skip
        taken += time.process_time() - begin
        endings[plan.status.value] += 1
        if not plan.success:
            continue
        count["solved"] += 1
        wrong, distance = faults(robot, asked, plan)
        least.append(distance)
        if name == "pepper" and plan.curve is not None and count["solved"] % TIMED == 0:
            timed = retimed(robot, asked, plan)
            count["timed"] += timed is not None
            if timed is False:
                wrong.append("timing refused by the certificate")
        if wrong:
            count["refused"] += 1
            print(f"REFUSED: {name}, seed {seed}: {', '.join(wrong)}", file=sys.stderr)
    others = ", ".join(f"{key} {value}" for key, value in endings.most_common() if key != "solved")
    cells = [name, f"{count['problems']}", f"{count['solved']}", f"{count['refused']}", f"{count['timed']}"]
    cells += [f"{1e3 * min(least):.3f}", f"{1e3 * taken / count['problems']:.1f}", others]
    return "| " + " | ".join(cells) + " |"


def retimed(robot: pk.PepperModel, asked: Asked, plan: pk.Plan) -> bool | None:
    """Return whether the certificate accepts the timed plan; None where timing itself refuses it."""
    try:
        trajectory = pk.retime(robot, plan, balance=0.0)
    except pk.InfeasibleError:
        return None
    return bool(pk.trajectory.check(robot, trajectory, scene=asked.scene).success)


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--robots", nargs="+", default=list(GROUPS))
    arguments = parser.parse_args()
    print("| robot | problems | solved | refused | timed too | least distance, mm ", end="")
    print("| `plan`, mean ms | not solved |\n" + "|---" * 8 + "|", flush=True)
    for name in arguments.robots:
        print(measured(name, arguments), flush=True)


if __name__ == "__main__":
    main()
