"""How times grow: with obstacles, with joints, with the rows of a batch; with obstacles that move."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from harness import Times, figures, python
from harness import pairs as pairs_of

import pepper_kin as pk

OBSTACLES = (10, 30, 100, 300, 1000, 3000, 10_000)
JOINTS = (7, 10, 15, 20, 30, 40, 50, 60)
ROWS = (1, 10, 100, 1000, 10_000, 100_000, 1_000_000)
COSTLY = 20_000
"""Most rows of jobs that take more than 10 us a row."""
Curves = dict[str, dict[int, float]]
Jobs = dict[str, tuple[Callable[[], object], int]]
"""By name: what is timed, and how many problems it solves."""


def least(function: Callable[[], object], problems: int = 1, seconds: float = 0.15) -> float:
    """Return the least processor time of a problem [us]; the function runs once before."""
    function()
    found, end = [], time.process_time() + seconds
    while time.process_time() < end or len(found) < 3:
        begin = time.process_time()
        function()
        found.append(time.process_time() - begin)
    return 1e6 * min(found) / problems


def boxes(count: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return sizes and places [m] of boxes around Pepper: as many to a cubic meter, farther out the more."""
    rng = np.random.default_rng(count)
    reach = max(1.5, 1.5 * (count / 30) ** (1 / 3))
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    while len(found) < count:
        place = rng.uniform((-reach, -reach, 0.0), (reach, reach, 2.0 * reach))
        if np.hypot(*place[:2]) > 0.65:
            found[f"box {len(found)}"] = (rng.uniform(0.03, 0.15, 3), place)
    return found


def obstacle_jobs(count: int) -> Jobs:
    """Return jobs of Pepper among so many boxes."""
    pepper, things = pk.load_pepper().with_requirements("limits"), boxes(count)
    stand, limits = pepper.posture("Stand"), (pepper.lower_limits, pepper.upper_limits)
    low, high = np.clip(limits, -0.5, 0.5)
    low[:3], high[:3] = 0.1 * low[:3], 0.1 * high[:3]
    many = np.random.default_rng(0).uniform(low, high, (2000, pepper.n))
    tasks = [
        pk.ik.HandPosition("left", pose[:3, 3])
        for pose in pk.kinematics.frame_pose(pepper, many[:30], "LArm_effector")
    ]
    scene = _scene(things)
    free = many[~pk.collision.in_collision(pepper, many, scene)]
    pairs = pairs_of(free[:20])
    return {
        "check of one posture": (lambda: pk.collision.in_collision(pepper, stand, scene), 1),
        "check, of 2,000": (lambda: pk.collision.in_collision(pepper, many, scene), len(many)),
        "clearance": (lambda: pk.collision.clearance(pepper, stand, scene), 1),
        "IK of a hand": (lambda: [pk.ik.solve(pepper, task, scene=scene) for task in tasks], len(tasks)),
        "plan": (lambda: [pk.plan(pepper, *pair, scene, timeout=30.0) for pair in pairs], len(pairs)),
        "new scene and its first check": (
            lambda: pk.collision.in_collision(pepper, stand, _scene(things)),
            1,
        ),
    }


def _scene(things: dict[str, tuple[np.ndarray, np.ndarray]]) -> pk.Scene:
    scene = pk.Scene()
    for name, (size, place) in things.items():
        scene = scene.add_box(name, size, place)
    return scene


def chain(count: int) -> pk.model.RobotModel:
    """Return a chain of links of 0.1 m about axes in turn, each a capsule, with a tip."""
    parts = []
    for k in range(count + 1):
        inertia = "".join(
            f'{name}="{0.002 if name[1] == name[2] else 0}" '
            for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        )
        body = f'<mass value="0.5"/><origin xyz="0 0 0.05"/><inertia {inertia}/>'
        shape = '<origin xyz="0 0 0.05"/><geometry><sphere radius="0.03"/></geometry>'
        parts.append(f'<link name="link{k}"><inertial>{body}</inertial><collision>{shape}</collision></link>')
    for k in range(count):
        axis = ("1 0 0", "0 1 0", "0 0 1")[k % 3]
        parts.append(
            f'<joint name="joint{k}" type="revolute"><parent link="link{k}"/><child link="link{k + 1}"/>'
            f'<origin xyz="0 0 0.1"/><axis xyz="{axis}"/>'
            f'<limit lower="-1" upper="1" velocity="3" effort="100"/></joint>'
        )
    return pk.load_robot(f"<robot name='chain'>{''.join(parts)}</robot>", acceleration_limits=10.0)


def joint_jobs(count: int) -> Jobs:
    """Return jobs of a chain of so many joints."""
    robot, rng, tip = chain(count), np.random.default_rng(count), f"link{count}"
    q, v, a = rng.uniform(-3.0 / count, 3.0 / count, (100, count)), *rng.normal(size=(2, 100, count))
    free = q[~pk.collision.in_collision(robot, q)]
    pairs, rows = pairs_of(free[:20]), list(zip(q, v, a, strict=True))
    bent = rng.uniform(-0.5, 0.5, (100, count))
    tasks = [pk.ik.FramePosition(tip, pose[:3, 3]) for pose in pk.kinematics.frame_pose(robot, bent, tip)]
    of = pk.dynamics
    return {
        "inverse dynamics": (lambda: [of.inverse_dynamics(robot, *row) for row in rows], 100),
        "forward dynamics": (lambda: [of.forward_dynamics(robot, *row) for row in rows], 100),
        "mass matrix": (lambda: [of.mass_matrix(robot, one) for one in q], 100),
        "derivatives": (lambda: [of.inverse_dynamics_derivatives(robot, *row) for row in rows], 100),
        "IK of the tip": (lambda: [pk.ik.solve(robot, task, collisions=False) for task in tasks], 100),
        "check, of 100": (lambda: pk.collision.in_collision(robot, q), 100),
        "plan": (lambda: [pk.plan(robot, *pair, timeout=30.0) for pair in pairs], len(pairs)),
        "timing": (lambda: [pk.retime(robot, np.array(pair), torque=False) for pair in pairs], len(pairs)),
    }


def row_jobs(count: int) -> Jobs:
    """Return jobs of batches of so many rows."""
    pepper, rng = pk.load_pepper().with_requirements("limits"), np.random.default_rng(0)
    q = rng.uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))
    v = rng.normal(size=q.shape)
    jobs: dict[str, Callable[[], object]] = {
        "inverse dynamics": lambda: pk.dynamics.inverse_dynamics(pepper, q, v, v),
        "forward dynamics": lambda: pk.dynamics.forward_dynamics(pepper, q, v, v),
        "frame pose": lambda: pk.kinematics.frame_pose(pepper, q, "LArm_effector"),
        "collision check": lambda: pk.collision.in_collision(pepper, q),
    }
    if count <= COSTLY:
        points = pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:, :3, 3]
        task, twins = pk.ik.HandPosition("left", points), pk.TwinBatch(pepper, count)
        jobs["IK of a hand"] = lambda: pk.ik.solve_batch(pepper, task, collisions=False, threads=1)
        jobs["10 steps of the twin"] = lambda: twins.step(q, 10)
    return {name: (job, count) for name, job in jobs.items()}


def curves_of(jobs: Callable[[int], Jobs], numbers: Iterable[int]) -> Curves:
    """Return the time of a problem [us] by job and number."""
    curves: Curves = {}
    for number in numbers:
        for name, job in jobs(number).items():
            curves.setdefault(name, {})[number] = least(*job)
    return curves


def exponent(curve: dict[int, float]) -> float:
    """Return the slope in logarithms over the upper half of a curve."""
    number, value = np.log(np.array(list(curve.items())).T)
    upper = slice(len(number) // 2, None)
    return float(np.polyfit(number[upper], value[upper], 1)[0])


def rows_of(words: str, curves: Curves) -> Iterator[tuple]:
    """Yield a table of curves."""
    numbers = sorted({number for curve in curves.values() for number in curve})
    head = f"{words} | {' | '.join(f'{number:,} {{:.3g}}' for number in numbers)} | exponent {{:.2f}}"
    for name, curve in curves.items():
        yield head, name, *(curve.get(number, "-") for number in numbers), exponent(curve)


def draw(path: Path, pictures: dict[str, Curves]) -> None:
    """Draw the curves of all tables."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(pictures), figsize=(15, 5), layout="constrained")
    for axis, (words, curves) in zip(axes, pictures.items(), strict=True):
        for name, curve in curves.items():
            label = f"{name} ({exponent(curve):.2f})"
            axis.loglog(list(curve), list(curve.values()), marker="o", markersize=3, label=label)
        axis.set_xlabel(words)
        axis.set_ylabel("processor time [us]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize="x-small")
    figure.savefig(path, dpi=90)


@figures("benchmarks/growth.md", most=30)
def growth(picture: Path | None = None, most: int = ROWS[-1]) -> Iterator[tuple]:
    """How times grow: with obstacles, with joints, with the rows of a batch, up to a number; draws curves.

    Each time is the least processor time of several runs, one thread.  The exponent is the slope of a
    straight line through the upper half of a curve in logarithms: 0 is a time that does not grow, 1 one that
    doubles with the number.
    """
    pictures = {}
    for words, jobs, numbers in (
        ("boxes", obstacle_jobs, OBSTACLES), ("joints", joint_jobs, JOINTS),
        ("rows, time of one", row_jobs, ROWS),
    ):  # fmt: skip
        pictures[words] = curves_of(jobs, [number for number in numbers if number <= most])
        yield from rows_of(words, pictures[words])
    if picture:
        draw(picture, pictures)


COUNTS = (30, 60, 120, 240)
CYCLES, PERIOD = 20, 0.02
REPEATS = 3


def scene_of(count):
    """Return a scene of so many obstacles that move."""
    rng, scene = np.random.default_rng(count), pk.Scene()
    for k in range(count):
        angle, away, height = rng.uniform((-np.pi, 1.0, 0.1), (np.pi, 3.0, 1.8))
        place, size = (away * np.cos(angle), away * np.sin(angle), height), rng.uniform(0.04, 0.12, 3)
        motion = {"velocity": rng.uniform(-0.17, 0.17, 3), "uncertainty": 0.05}
        if k % 2:
            scene = scene.add_box(f"mover {k}", size, place, **motion)
        else:
            scene = scene.add_sphere(f"mover {k}", size[0] / 2, place, **motion)
    return scene


def measured(count: int) -> None:
    """Print memory that was taken [MB] and times of a check and a live cycle [ms]."""
    pepper, scene = pk.load_pepper(), scene_of(count)
    stand, goal = pepper.posture("Stand"), pepper.joint_vector({"LShoulderPitch": 0.3, "HeadYaw": 0.4})
    motion = pk.retime(pepper, [stand, goal])
    motion.check(pepper)
    alone, times = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, Times(time.thread_time)
    for _ in range(REPEATS):
        found = times("check", motion.check, pepper, scene)
    live = pk.motion.LiveMotion(pepper, stand, scene)
    live.set_goal(goal)
    for k in range(CYCLES):
        moved = {item.name: item.poses(np.array([k * PERIOD]))[0] for item in scene.movers}
        seen = scene.moved(moved)
        times("cycle", lambda k=k, seen=seen: (live.set_scene(seen, k * PERIOD), live.step(k * PERIOD)))
    taken = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - alone) / 1e3
    first, *later = times["check"]
    cycle, least = np.median(times["cycle"][1:]), found.obstacle_clearance.value
    print(json.dumps([taken, 1e3 * first, 1e3 * min(later), 1e3 * cycle, least]))


@figures("benchmarks/growth.md", most=30)
def moving_obstacles(most: int = COUNTS[-1]) -> Iterator[tuple]:
    """How memory and time grow with the number of obstacles that move.

    Each number has a process of its own.  Balls and boxes of 4 to 12 cm are drawn 1 to 3 m around Pepper,
    each with a velocity of up to 0.3 m/s.  Examined are a motion (`check`), and cycles of live motion along
    it that see all obstacles at new places; times are of one thread, the least of `check` and the median of
    cycles.
    """
    here = {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(Path(__file__).parent)}
    for count in (count for count in COUNTS if count <= most):
        row = json.loads(python(f"import growth; growth.measured({count})", **here))
        yield (
            "obstacles | memory [MB] {:.0f} | first check [ms] {:.0f} | next [ms] {:.1f} | live cycle [ms] "
            "{:.2f} | least distance [m] {:.4f}",
            count, *row,
        )  # fmt: skip
