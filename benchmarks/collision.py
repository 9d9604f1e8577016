"""Collision checks beside coal, what scenes cost, and ticks of the servo."""

from __future__ import annotations

import itertools
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio
from harness import ROBOTS, Times, example_robot, figures, in_turn, table

import pepper_kin as pk
from pepper_kin.collision import CollisionChecker, PointCloud
from pepper_kin.collision.fast import FastChecker

ROUNDS = 7
TIMED = 50_000
TIMED_BY_COAL = 1_000


def scene(kind: str, seed: int) -> pk.Scene:
    """Ten objects of 5 to 40 cm around the robot, 0.45 m and more from its axis."""
    rng = np.random.default_rng(seed)
    made = pk.Scene()
    while len(made.objects) < 10:
        position, rpy = rng.uniform([-1, -1, 0], [1, 1, 1.6]), rng.uniform(-3, 3, 3)
        if np.hypot(*position[:2]) < 0.45:
            continue
        name = f"{kind}{len(made.objects)}"
        if kind == "box":
            made = made.add_box(name, rng.uniform(0.05, 0.4, 3), position, rpy)
        elif kind == "sphere":
            made = made.add_sphere(name, rng.uniform(0.03, 0.2), position)
        elif kind == "cylinder":
            made = made.add_cylinder(name, *rng.uniform(0.05, 0.3, 2), position, rpy)
        else:
            made = made.add_capsule(name, *rng.uniform(0.05, 0.3, 2), position, rpy)
    return made


def random_q(pepper: pk.PepperModel, count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(pepper.lower_limits, pepper.upper_limits, (count, pepper.n))


def beside_coal(fast: FastChecker, q: np.ndarray) -> tuple[int, int, int]:
    """Return how many verdicts differ from coal's, how many of these its distance confirms, and ties."""
    differ = confirmed = ties = 0
    for first in range(0, len(q), 50_000):
        part = q[first : first + 50_000]
        found = fast.in_collision(part)
        wrong = np.flatnonzero(found != fast.exact.in_collision(part))
        differ += wrong.size
        if wrong.size:
            confirmed += int(((fast.exact.clearance(part[wrong]) < 0) == found[wrong]).sum())
        ties += fast.doubts(part)[1]
    return differ, confirmed, ties


@figures("benchmarks/collision.md", count=20_000)
def collision(count: int = 1_000_000) -> Iterator[tuple | str]:
    """Collision checks of random configurations: the compiled check beside coal, in one process."""
    pepper = pk.load_pepper()
    q, timed_q = random_q(pepper, count, seed=0), random_q(pepper, TIMED, seed=1)
    checkers = {"self only": FastChecker(pepper)}
    for kind in ("box", "sphere", "cylinder", "capsule"):
        checkers[f"10 {kind}"] = FastChecker(pepper, scene(kind, 1))
    for name, fast in checkers.items():
        part = q if name in ("self only", "10 box") else q[: min(count, 20_000)]
        doubts, _ = fast.doubts(part)
        differ, confirmed, ties = beside_coal(fast, part)
        yield (
            "scene | configurations | in collision {:.1%} | left in doubt by spheres {:.2%} | ties | "
            "differ from coal | of these, coal's distance confirms the compiled check",
            name, len(part), fast.in_collision(part).mean(), doubts / len(part), ties, differ, confirmed,
        )  # fmt: skip

    def nanoseconds(fast: FastChecker, q: np.ndarray) -> Iterator[float]:
        few = q[:TIMED_BY_COAL]
        jobs = {"ours": lambda: fast.in_collision(q), "coal": lambda: fast.exact.in_collision(few)}
        times = in_turn(jobs, ROUNDS, time.perf_counter)
        yield from (
            1e9 * np.median(times[who]) / rows for who, rows in (("ours", len(q)), ("coal", len(few)))
        )

    for name, fast in checkers.items():
        ours, coal = nanoseconds(fast, timed_q)
        yield (
            "scene | compiled, ns {:.0f} | coal from Python, ns {:.0f} | ratio {:.0f}",
            name, ours, coal, coal / ours,
        )  # fmt: skip


KINDS = ("box", "cylinder", "sphere", "capsule")
MARGINS = ((0.0, 0.0), (0.013, 0.005))
STATES = 2_000
"""Configurations checked together."""


@figures("benchmarks/collision.md", "Fetch's description for its row", count=2_000)
def collision_verdicts(
    robots=("pepper", *ROBOTS), fetch: Path | None = None, count=1_000_000
) -> Iterator[tuple]:
    """Verdicts of the compiled check beside coal's on five robots among ten objects; a million take hours.

    Configurations are uniform within the joints' ranges, those without limits within a turn either way.
    Scenes hold ten boxes, cylinders, spheres or capsules; there are eight, each without margins and with 13
    mm to the scene and 5 mm between parts of the robot.  What differs is looked at by coal's distance.  Files
    are those of example-robot-data, which has no Fetch: `fetch` is the folder of `fetch.urdf`, `fetch.srdf`
    and its meshes.
    """
    for name in (*robots, *(["fetch"] if fetch else [])):
        if name == "fetch":
            robot = pk.load_robot(fetch / "fetch.urdf", fetch / "fetch.srdf", [fetch])
        else:
            robot = example_robot(name)
        rng, times = np.random.default_rng(0), Times()
        low = np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -np.pi)
        high = np.where(np.isfinite(robot.upper_limits), robot.upper_limits, np.pi)
        done = touching = doubts = ties = differ = confirmed = 0
        worlds = itertools.product((1, 2), KINDS, MARGINS)
        checkers = [FastChecker(robot, scene(kind, seed), *margins) for seed, kind, margins in worlds]
        while done < count:
            fast = checkers[(done // STATES) % len(checkers)]
            q = rng.uniform(low, high, (min(STATES, count - done), robot.n))
            found = times("ours", fast.in_collision, q)
            wrong = np.flatnonzero(found != times("coal", fast.exact.in_collision, q))
            doubtful, tied = fast.doubts(q)
            done, touching = done + len(q), touching + int(found.sum())
            doubts, ties, differ = doubts + doubtful, ties + tied, differ + wrong.size
            for k in wrong:
                margin = {True: fast.exact.self_margin, False: fast.exact.margin}
                near = any(
                    pair.distance is None or pair.distance < margin[None not in pair.links]
                    for pair in fast.exact.contact_points(q[k], within=1.0)
                )
                confirmed += near == found[k]
        ours, coal = (sum(times[who]) / done for who in ("ours", "coal"))
        yield (
            "robot | verdicts {:,} | in contact {:.1%} | left in doubt by balls {:.2%} | ties, asked of "
            "coal | differ from coal | of these, coal's distance confirms | compiled [ns] {:.0f} | coal "
            "[us] {:.0f}",
            name, done, touching / done, doubts / done, ties, differ, confirmed, 1e9 * ours, 1e6 * coal,
        )  # fmt: skip


def clear_boxes(pepper, count):
    """Boxes around the robot, none of which touches it in Stand."""
    rng = np.random.default_rng(1)
    scene, q = pk.Scene(), pepper.posture("Stand")
    while len(scene.objects) < count:
        name = f"box {len(scene.objects)}"
        more = scene.add_box(
            name,
            rng.uniform(0.05, 0.3, 3),
            rng.uniform([-1.5, -1.5, 0], [1.5, 1.5, 1.5]),
            rng.uniform(-3, 3, 3),
        )
        alone = pk.Scene({name: more.objects[name]})
        if not any(name in pair for pair in CollisionChecker(pepper, alone).contacts(q)):
            scene = more
    return scene


def office(count):
    """A million points of a table, a wall and a floor."""
    rng = np.random.default_rng(0)
    points = rng.uniform([-2, -2, 0], [2, 2, 0.005], (count, 3))
    points[: count // 3, 2] += 0.7
    points[: count // 3, 0] = rng.uniform(0.5, 1.5, count // 3)
    points[-count // 3 :, 0] = 1.5
    points[-count // 3 :, 2] = rng.uniform(0, 2, len(points[-count // 3 :]))
    return points


def checks(name, pepper, scene, states):
    """Return a row of median times per configuration, the two ways in turn."""
    checker, times = CollisionChecker(pepper, scene), Times(time.perf_counter)
    model, data, geometry = pepper.inner_model, checker._data[0], checker._data[1]._kept
    check, shapes = pinocchio.computeCollisions, checker._shapes.model
    for q in states:
        fast = times("broad", checker._touches, q)
        assert fast == times("all", check, model, data, shapes, geometry, q, True)
        times("clearance", checker.clearance, q)
    head = "scene | pairs | `in_collision` [us] {:.0f} | over all pairs [us] {:.0f} | `clearance` [us] {:.0f}"
    return head, name, checker.pair_count, *(times.at(which, unit=1e6) for which in times)


@figures("benchmarks/collision.md", points=10_000, boxes=5)
def scenes(points: int = 1_000_000, boxes: int = 100) -> Iterator[tuple | str]:
    """What scenes cost: in_collision with and without the broad phase, clearance, and clouds.

    Both ways of checking run in turn on the same configurations and must agree.
    """
    pepper, rng = pk.load_pepper().with_requirements("limits"), np.random.default_rng(0)
    states = rng.uniform(pepper.lower_limits, pepper.upper_limits, (300, pepper.n))
    for count in (0, 1, 5, 20, 100):
        if count <= boxes:
            yield checks(f"{count} boxes", pepper, clear_boxes(pepper, count), states)
    cloud, times = office(points), Times(time.perf_counter)
    for _ in range(3):
        scene = times("thin", pk.Scene().add_point_cloud, "office", cloud, 0.005).allow("office", "Tibia")
        checker = times("tree", CollisionChecker, pepper, scene)
    kept = scene.objects["office"].geometry
    assert checker.pair_count > 0
    assert isinstance(kept, PointCloud)
    yield checks(
        f"cloud of {points:_} points, {len(kept.points)} kept".replace("_", " "), pepper, scene, states
    )
    thin, tree = min(times["thin"]), min(times["tree"])
    yield f"The cloud, best of three: {thin:.2f} s to thin, {tree:.2f} s for its tree."


SETTLED = 300


def ten_boxes():
    rng, scene = np.random.default_rng(3), table()
    for k in range(10):
        place = rng.uniform((0.35, -0.6, 0.75), (0.9, 0.6, 1.4))
        scene = scene.add_box(f"box {k}", rng.uniform(0.04, 0.15, 3), place, rng.uniform(-3, 3, 3))
    return scene


def cloud():
    points = np.random.default_rng(1).uniform((0.3, -0.5, 0.70), (0.8, 0.5, 0.72), (3000, 3))
    return pk.Scene().add_point_cloud("cloud", points, radius=0.01)


CASES = {
    "left hand, gaze": {"collisions": False},
    "both hands, gaze": {"both": True, "collisions": False},
    "both hands, gaze, balance": {"both": True, "balance": 0.02, "collisions": False},
    "left hand, gaze, self-collision": {},
    "both hands, gaze, self-collision": {"both": True},
    "both hands, gaze, self and table": {"both": True, "scene": table()},
}


REACH = np.array([[-0.1, -0.6, 0.4], [0.7, 0.6, 1.5]])
HARD_CASES = {
    "no scene": {},
    "no scene, balance": {"balance": 0.01},
    "table": {"scene": table()},
    "ten boxes": {"scene": ten_boxes()},
    "ten boxes, balance": {"scene": ten_boxes(), "balance": 0.01},
    "cloud of 3,000 points, balance": {"scene": cloud(), "balance": 0.01},
    "ten boxes, asleep between ticks": {"scene": ten_boxes()},
}


def point_on_circle(seconds):
    angle = 2 * np.pi * seconds / 4.0
    return np.array([0.30, 0.20, 0.95]) + 0.06 * np.array([0.0, np.cos(angle), np.sin(angle)])


def tasks_at(seconds, both):
    point = point_on_circle(seconds)
    tasks = [pk.ik.HandPosition("left", point), pk.ik.LookAt(point)]
    return [*tasks, pk.ik.HandPosition("right", point * (1, -1, 1))] if both else tasks


@figures("benchmarks/collision.md", ticks=301)
def servo(ticks: int = 600) -> Iterator[tuple]:
    """Time of one servo tick, and how closely it follows.

    Times are of the thread's processor time, taken in turn over all cases, so that other load disturbs
    little.  Targets at random, some of them within the body or an obstacle, are hard; each moves to another
    in 0.6 s, and `set_target` and `step` are timed together.
    """
    pepper, stepping = pk.load_pepper().with_requirements("limits"), Times(time.thread_time)
    setting, missing = Times(time.thread_time), defaultdict(list)
    stand, both = (
        pepper.posture("Stand"),
        {name: options.get("both", False) for name, options in CASES.items()},
    )
    cases = {name: {k: v for k, v in options.items() if k != "both"} for name, options in CASES.items()}
    servos = {name: pk.servo.Servo(pepper, stand, **options) for name, options in cases.items()}
    for _ in range(ticks):
        for name, loop in servos.items():
            setting(name, loop.set_target, tasks_at(loop.time, both[name]))
            state = stepping(name, loop.step)
            hand = pk.kinematics.frame_pose(pepper, state.q, "LArm_effector")[:3, 3]
            missing[name].append(1e3 * np.linalg.norm(hand - point_on_circle(state.time)))
    for name in CASES:
        miss = max(missing[name][SETTLED:])
        yield (
            "circle of 0.12 m in 4 s at 100 Hz | step {:.2f} ms | p99 {:.2f} ms | target {:.2f} ms | miss "
            "{:.3f} mm",
            name, *stepping.at(name, 50, 99), setting.at(name), miss,
        )  # fmt: skip
        assert miss < 0.5
    servos = {name: pk.servo.Servo(pepper, stand, **options) for name, options in HARD_CASES.items()}
    spent, statuses, rng = Times(time.thread_time), defaultdict(Counter), np.random.default_rng(7)
    for tick in range(ticks):
        if tick % 60 == 0:
            begin, end = rng.uniform(*REACH, (2, 3, 3))
        left, right, gaze = begin + (end - begin) * (tick % 60) / 60
        tasks = [pk.ik.HandPosition("left", left), pk.ik.HandPosition("right", right), pk.ik.LookAt(gaze)]
        for name, loop in servos.items():
            if "asleep" in name:
                time.sleep(0.5 / loop.rate)  # other programs have the caches meanwhile
            state = spent(name, lambda loop=loop, tasks=tasks: (loop.set_target(tasks), loop.step())[1])
            statuses[name][state.status.value] += 1
    for name in spent:
        yield (
            "both hands and gaze to random targets | p50 {:.2f} ms | p99 {:.2f} ms | greatest {:.2f} ms | "
            "statuses",
            name, *spent.at(name, 50, 99, 100), dict(statuses[name]),
        )  # fmt: skip
