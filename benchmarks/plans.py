"""What `pk.plan` is good for: random problems examined, many at once, soft costs, grasps, and drives."""

from __future__ import annotations

import itertools
import os
import sys
import time
from collections import Counter, OrderedDict, defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import casadi
import numpy as np
import pinocchio
from harness import Times, example_robot, figures, in_turn, timed
from ompl import base as ompl_base

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker
from pepper_kin.collision.fast import FastChecker
from pepper_kin.collision.least_clearance import least_clearance
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.model import Wheels
from pepper_kin.motion import PathCost, manifold_of
from pepper_kin.motion.planning_process import helpers
from pepper_kin.planners.car_curves import car_curve, shortest_curve

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
BASE = ("BaseX", "BaseY", "BaseYaw")
AROUND = {"pepper": (0.25, 0.75), "planar": (0.4, 1.6), "ur5": (0.3, 0.9), "panda": (0.3, 0.85)}
HEIGHTS = {"pepper": (0.3, 1.2), "planar": (0.2, 1.2), "ur5": (-0.2, 0.9), "panda": (0.0, 1.0)}


class Asked(NamedTuple):
    """A problem: what moves, what `plan` is given, and the frame and point of a task, or None."""

    scene: pk.Scene
    joints: tuple[str, ...]
    start: np.ndarray
    goal: Any
    target: tuple[str, np.ndarray] | None


def robot_of(name: str) -> pk.PepperModel:
    """Return a robot by its name here."""
    if name in ("pepper", "planar"):
        return pk.load_pepper(base="planar" if name == "planar" else "fixed").with_requirements("limits")
    return example_robot(name)


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


def states_of(curve: Any) -> np.ndarray:
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
    states = plan.path if curve is None else states_of(curve)
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


def retimed(robot: pk.PepperModel, asked: Asked, plan: pk.Plan) -> bool | None:
    """Return whether the certificate accepts the timed plan; None where timing itself refuses it."""
    try:
        trajectory = pk.retime(robot, plan, balance=0.0)
    except pk.InfeasibleError:
        return None
    return bool(pk.trajectory.check(robot, trajectory, scene=asked.scene).success)


@figures("benchmarks/planning.md", count=5)
def planning_certificates(count=1000, first=0, robots=tuple(GROUPS)) -> Iterator[tuple]:
    """Curves of `pk.plan` on random problems, examined by code that has no part in planning.

    Scenes hold up to ten boxes, spheres, cylinders, capsules, convex hulls and clouds around the robot.
    Start and goal are drawn evenly from the free configurations of one or several joint groups of Pepper (its
    base fixed or driving), a UR5 or a Panda (the files of example-robot-data).  A goal is a configuration,
    several of them, or a task: a point that a hand can reach.  The certificate of a curve is computed here
    with NumPy, coal and the independent Newton-Euler alone: states no farther apart than 2 mrad (or
    millimeters, all joints added), continuity, joint limits, both ends, torque against gravity at rest, the
    least distance to the scene and between parts of the robot, and the error of the task.  Every tenth of
    Pepper's plans (base fixed) is timed as well, in balance, and `trajectory.check` asked.  A curve that any
    of these refuses is a bug; its seed, after `first`, is printed.
    """
    for name in robots:
        robot, seed, done, least, times, endings = robot_of(name), first, Counter(), [], Times(), Counter()
        while done["problems"] < count:
            seed += 1
            asked = problem(name, robot, seed)
            if asked is None:
                continue
            done["problems"] += 1
            options = {"joints": asked.joints, "seed": seed, "margin": (0.01, 0.0, 0.03)[seed % 3]}
            plan = times(
                "plan", pk.plan, robot, asked.start, asked.goal, asked.scene, timeout=TIMEOUT, **options
            )
            endings[plan.status.value] += 1
            if not plan.success:
                continue
            done["solved"] += 1
            wrong, distance = faults(robot, asked, plan)
            least.append(distance)
            if name == "pepper" and plan.curve is not None and done["solved"] % TIMED == 0:
                accepted = retimed(robot, asked, plan)
                done["timed"] += accepted is not None
                if accepted is False:
                    wrong.append("timing refused by the certificate")
            if wrong:
                done["refused"] += 1
                print(f"REFUSED: {name}, seed {seed}: {', '.join(wrong)}", file=sys.stderr)
        others = ", ".join(f"{key} {value}" for key, value in endings.most_common() if key != "solved")
        counts = (done[key] for key in ("problems", "solved", "refused", "timed"))
        yield (
            "robot | problems | solved | refused | timed too | least distance, mm {:.3f} | `plan`, mean ms "
            "{:.1f} | not solved",
            name, *counts, 1e3 * min(least), 1e3 * np.mean(times["plan"]), others,
        )  # fmt: skip


PEPPER = pk.load_pepper().with_requirements("limits")


def random_worlds(count: int) -> list[pk.PlanProblem]:
    """Return problems with scenes of their own."""
    rng, made = np.random.default_rng(0), []
    for number in range(count):
        scene = pk.Scene()
        for box in range(6):
            place = rng.uniform([0.3, -0.6, 0.4], [0.7, 0.6, 1.2])
            scene = scene.add_box(f"box {box}", size=rng.uniform(0.05, 0.15, 3), position=place)
        target = pk.ik.HandPosition("left", rng.uniform([0.2, 0.05, 0.6], [0.4, 0.4, 1.1]))
        stand = PEPPER.posture("Stand")
        made.append(pk.PlanProblem(PEPPER, stand, [target], scene, seed=number, timeout=3.0))
    return made


def helpers_seconds(count: int) -> float:
    """Return the processor time of the helpers so far [s]."""
    ticks = 0
    for one in helpers(count):
        with open(f"/proc/{one._process.pid}/stat", encoding="ascii") as file:
            fields = file.read().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def forget_checkers() -> None:
    """Let checkers of scenes be made anew, which are kept for the robot."""
    for known in PEPPER.kept.values():
        if isinstance(known, OrderedDict) and known:
            value = next(iter(known.values()))
            if isinstance(value, tuple) and isinstance(value[0], CollisionChecker | FastChecker):
                known.clear()


def clocks(count: int) -> np.ndarray:
    """Return the wall clock, and processor times here and of the helpers [s]."""
    return np.array([time.perf_counter(), time.process_time(), helpers_seconds(count)])


@figures("benchmarks/planning.md", count=4)
def plan_batch(count: int = 60, processes: int = os.cpu_count() or 1) -> Iterator[tuple | str]:
    """Many planning problems: one after the other, by threads, and by `pk.plan_batch`.

    Each problem has a scene of its own, as in randomized worlds: six boxes, and a target for the left hand.
    Processor time of this process and of its helpers is counted; on an idle machine with as many cores as
    processes, the larger of the two is the wall time.
    """
    asked, others = random_worlds(count), processes - 1
    asked[0].solve()
    for one in helpers(others):
        one.ready.wait()
    pk.plan_batch(asked[:16], processes=processes)

    def threaded() -> list:
        with ThreadPoolExecutor(processes) as pool:
            return list(pool.map(lambda problem: problem.solve(), asked))

    runs = {
        "one after the other": lambda: [problem.solve() for problem in asked],
        f"{processes} threads": threaded,
        f"`plan_batch`, {processes} processes": lambda: list(pk.plan_batch(asked, processes=processes).plans),
    }
    times, paths = defaultdict(list), []
    for _, (name, run) in itertools.product(range(5), runs.items()):
        forget_checkers()
        before = clocks(others)
        found = run()
        times[name].append(clocks(others) - before)
        paths.append([plan.path for plan in found])
    for path in paths[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(paths[0], path, strict=True))
    solved = sum(path is not None for path in paths[0])
    yield f"{count} problems, {solved} solved; medians of 5 [s]; load {os.getloadavg()[0]:.1f}"
    head = " | wall time {:.2f} | processor time here {:.2f} | of helpers {:.2f}"
    yield from ((head, name, *np.median(rows, axis=0)) for name, rows in times.items())


WIDTH = 0.1  # of a hot spot [m]


def compile_times(pepper):
    """Yield what the first manifold of expressions that nobody has used takes, and the second."""
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
            first.append(timed(manifold_of, pepper, [task], q, free)[1])
        again = 1e3 * np.median([timed(manifold_of, pepper, [task], q, free)[1] for _ in range(50)])
        yield f"{name}: compiled in {1e3 * np.median(first):.0f} ms, afterwards {again:.2f} ms"


def among_four_boxes(generator):
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


@figures("benchmarks/planning.md", problems=2)
def soft_costs(problems: int = 40) -> Iterator[str]:
    """Formulas of users: what an expression takes to compile, and what plans with soft costs save and take.

    Processor times.  Every curve is looked at by coal and its costs are integrated again by NumPy.
    """
    pepper, generator = pk.load_pepper().with_requirements("limits"), np.random.default_rng(5)
    yield from compile_times(pepper)
    hand, start = pk.symbolic.frame_pose(pepper, "LArm_effector"), pepper.posture("Stand")
    times, shares = Times(), []
    for seed in range(problems):
        scene, spot, goal = among_four_boxes(generator)
        cost = PathCost(
            pepper, lambda q, p=spot: 10 * casadi.exp(-casadi.sumsqr(hand(q)[:3, 3] - p) / (2 * WIDTH**2))
        )
        solve = partial(pk.plan, pepper, start, goal, scene, joints="whole_body", seed=seed)
        solve(), solve(costs=[cost])  # makes tables and code
        free, plain = timed(solve)
        plan, costed = timed(solve, costs=[cost])
        assert plan.success == free.success
        if not plan.success:
            continue
        q, found = integral(pepper, plan.curve, spot)
        assert not pk.collision.in_collision(pepper, q, scene).any()
        (priced,) = plan.costs
        assert abs(found - priced.integral) <= 0.005 * found + 1e-6
        times["without costs"].append(plain)
        times["with costs"].append(costed)
        shares.append(priced.integral / priced.before)
    yield f"{len(shares)} of {problems} problems solved, with costs and without; no curve touches"
    middle, most = np.median(shares), max(shares)
    yield f"integral beside that of the plan without costs: median {middle:.2f}, most {most:.2f}"
    for name in times:
        middle, late = times.at(name, 50, 90)
        yield f"{name}: median {middle:.0f} ms, 90 % {late:.0f} ms"


@figures("planning.md", seeds=3)
def grasps(seeds: int = 100) -> Iterator[str]:
    """Plans to one of 18 grasps around a can: how many seeds lead to a plan, and its processor time."""
    pepper, can = pk.load_pepper().with_requirements("limits"), np.array([0.40, 0.18, 0.95])
    scene = pk.Scene().add_box("table", (0.4, 0.8, 0.03), (0.5, 0.0, 0.715))
    scene = scene.add_cylinder("can", 0.03, 0.44, can)
    angles = np.linspace(-np.pi, np.pi, 18, endpoint=False)
    tasks = [
        [pk.ik.HandPosition("left", can - 0.12 * to), pk.ik.AxisAlignment("l_gripper", to, tolerance=0.1)]
        for to in np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    ]
    times, reached, stand = Times(time.thread_time), [], pepper.posture("Stand")
    for seed in range(seeds):
        plan = times("plan", pk.plan, pepper, stand, tasks, scene, seed=seed)
        reached += [plan.alternative] if plan.success else []
    middle, most = times.at("plan", 50, 90)
    yield (
        f"{len(reached)} of {seeds} seeds, {middle:.1f} / {most:.1f} ms, median / 90 %; "
        f"grasps reached: {sorted(set(reached))}"
    )


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


@figures("benchmarks/planning.md", "OMPL", rooms=4)
def driving(rooms: int = 40) -> Iterator[tuple | str]:
    """Drives of a differential base in rooms with random boxes, and its curves beside OMPL's."""
    robot, names = pk.load_robot(CART, base="differential", wheels=WHEELS), ("BaseX", "BaseY", "BaseYaw")
    rows, solved, tried = [], 0, 0
    for seed in range(rooms):
        scene, start, goal = office(seed)
        ends = [robot.joint_vector(dict(zip(names, end, strict=True))) for end in (start, goal)]
        if pk.collision.in_collision(robot, np.array(ends), scene).any():
            continue
        tried += 1
        plan, planned = timed(pk.plan, robot, *ends, scene, seed=seed)
        if not plan.success:
            continue
        solved += 1
        trajectory, spent = timed(pk.retime, robot, plan)
        assert trajectory.check(robot, scene=scene).success
        state = trajectory.sample(0.005)
        yaw, (vx, vy, _) = state.position[:, 2], state.velocity[:, :3].T
        drift = np.abs(vy * np.cos(yaw) - vx * np.sin(yaw)).max()
        length = np.linalg.norm(np.diff(plan.path[:, :2], axis=0), axis=1).sum()
        bound = car_curve(start, goal, WHEELS.turning_radius).length
        rows.append((1e3 * planned, 1e3 * spent, length / bound, 1e3 * drift))
    yield f"{solved} of {tried} rooms, all certified; median (worst)"
    both = zip(np.median(rows[1:], axis=0), np.max(rows[1:], axis=0), (0, 1, 2, 1), strict=True)
    cells = (f"{middle:.{digits}f} ({worst:.{digits}f})" for middle, worst, digits in both)
    yield "`plan` [ms] | `retime` [ms] | length over the curve without boxes | sideways [mm/s]", *cells
    poses = np.random.default_rng(0).uniform([-3, -3, -3.1], [3, 3, 3.1], (4000, 3))
    segments = np.zeros((2, 5))
    for name, backward in (("Reeds and Shepp", True), ("Dubins", False)):
        space = (ompl_base.ReedsSheppStateSpace if backward else ompl_base.DubinsStateSpace)(0.5)
        bounds = ompl_base.RealVectorBounds(2)
        bounds.setLow(-5.0)
        bounds.setHigh(5.0)
        space.setBounds(bounds)
        states = [space.allocState() for _ in poses]
        for state, (x, y, yaw) in zip(states, poses, strict=True):
            state.setX(x)
            state.setY(y)
            state.setYaw(yaw)
        jobs = {
            "ours": lambda back=backward: [
                shortest_curve(a, b, 0.5, back, segments) for a, b in itertools.pairwise(poses)
            ],
            "OMPL": lambda s=space, z=states: [s.distance(a, b) for a, b in itertools.pairwise(z)],
        }
        times = in_turn(jobs, 7).values()
        each = (1e6 * np.median(spent) / (len(poses) - 1) for spent in times)
        yield "length of a curve [us] | ours {:.1f} | OMPL {:.1f}", name, *each
