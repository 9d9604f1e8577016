"""Live motions: stops from any instant, new goals without one, moved scenes, and two robots that pass."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Iterator
from itertools import chain

import coal
import numpy as np
import pinocchio
from harness import Times, figures

import pepper_kin as pk
from pepper_kin import dynamics
from pepper_kin.core.timing import stopping
from pepper_kin.core.timing.steering import bridge, steer
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.model import Box, Capsule, Cylinder, Sphere
from pepper_kin.motion import replan
from pepper_kin.trajectory import stop as stops

try:
    import ruckig
except ImportError:
    ruckig = None

MOTIONS, PER_STOP = 60, 100
TOLERANCE = 1e-9


def near_upright(pepper):
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    return lower, upper


def fastest_motions(pepper, rng):
    """Return planned motions between random postures, the legs near upright, timed at full limits."""
    (lower, upper), found = near_upright(pepper), []
    while len(found) < MOTIONS:
        start, goal = rng.uniform(lower, upper, (2, pepper.n))
        try:
            plan = pk.plan(pepper, start, goal, timeout=1.0)
            if plan.success:
                found.append(pk.retime(pepper, plan))
        except pk.exceptions.PepperKinError:
            continue  # a posture in collision, or too heavy to hold
    return found


def core_path(pepper, motion, at):
    """Return a function that finds a stop in machine code, for velocity and acceleration."""
    order, size = motion.coefficients.shape[1], 512
    path = stopping.StopPath(
        np.empty(size, np.int64), np.empty(size), np.empty(size), np.empty((size, order, pepper.n)),
        np.empty(size + 1),
    )  # fmt: skip
    none, ahead = np.empty(0), motion.between(at, min(at + 0.2, motion.duration))
    limits = stopping.StopLimits(pepper.acceleration_limits, np.empty((3, 3 * size, 0)), none, none)
    breaks, rows = np.empty(size + 1), np.empty((size, 2 * order - 1, pepper.n))
    basis = stops._basis(order)

    def run():
        count = stopping.cut_path(ahead.breaks, ahead.coefficients, 0.0, stops._STEP, path)
        used = stopping.stop_profile(count, basis, path, limits) or count
        stopping.stop_polynomials(used, path, breaks, rows)

    return run


def limits_broken(pepper, stop, rng):
    """Return how many of random instants of a stop break a limit of the robot."""
    state = stop.trajectory(rng.uniform(0.0, stop.duration, PER_STOP))
    torque = dynamics.newton_euler(pepper, *state)
    broken = np.zeros(PER_STOP, dtype=bool)
    for value, limit in (
        (state.velocity, pepper.velocity_limits),
        (state.acceleration, pepper.acceleration_limits),
        (torque, pepper.effort_limits),
    ):
        broken |= np.any(np.abs(value) > limit * (1 + TOLERANCE), axis=1)
    broken |= np.any(state.position > pepper.upper_limits + 1e-9, axis=1)
    broken |= np.any(state.position < pepper.lower_limits - 1e-9, axis=1)
    return int(broken.sum())


def ten_boxes(pepper, rng, free):
    """Return a scene of ten boxes in front of the robot that touches none of the states, shape (T, n)."""
    scene = pk.Scene()
    while len(scene.names) < 10:
        size, place = rng.uniform(0.08, 0.24, 3), rng.uniform((0.2, -0.6, 0.5), (0.8, 0.6, 1.3))
        more = scene.add_box(f"box {len(scene.names)}", size, place)
        if not pk.collision.in_collision(pepper, np.array(free), more).any():
            scene = more
    return scene


def stop_then_go(pepper, motion, at, goal, scene, how, options):
    """Return how long a stop and the same kind of way to the goal take [s]; None where there is none."""
    stop = motion.stop(pepper, at, **options)
    try:
        if how == "straight":
            return stop.trajectory.replaced(pepper, stop.duration, goal, **options).trajectory.duration
        plan = pk.plan(pepper, stop.end, goal, scene, balance=options.get("balance"))
        return stop.duration + pk.retime(pepper, plan, **options).duration
    except InfeasibleError:
        return None


def splices(pepper, motions, rng, count):
    """Yield how many new goals are reached without a stop, and how long that takes."""
    kinds = {
        "velocity and acceleration": ({"torque": False}, None),
        "torque and balance": ({"balance": 0.0}, None),
        "clear of itself": ({"torque": False}, "robot"),
        "ten boxes": ({"torque": False}, "boxes"),
        "ten boxes, torque and balance": ({"balance": 0.0}, "boxes"),
    }
    for name, (options, world) in kinds.items():
        ways, times, ratio, blocked = Counter(), Times(time.thread_time), [], 0
        for k in range(count):
            motion, goal = motions[k % MOTIONS], motions[(k + rng.integers(1, MOTIONS)) % MOTIONS].end
            at = float(rng.uniform(0.0, motion.duration - 1e-3))
            scene = ten_boxes(pepper, rng, [motion(at).position, goal]) if world == "boxes" else pk.Scene()
            try:
                if world is None:
                    spliced = times("last", motion.replaced, pepper, at, goal, **options)
                else:
                    spliced = times("last", replan, pepper, motion, at, goal, scene, **options)
                how = spliced.how
            except InfeasibleError:
                how = "refused"
            times[how].append(times.pop("last")[0])
            ways[how] += 1
            if how == "refused":
                blocked += world == "boxes" and motion.stop(pepper, at, scene=scene).clearance.least <= 0.0
            elif how != "after a stop":
                go = stop_then_go(pepper, motion, at, goal, scene, how, options)
                ratio += [(spliced.trajectory.duration - at) / go] if go else []
        yield line(f"splice, {name}", [*itertools.chain(*times.values())], 1e3, "ms", str(dict(ways)))
        if "joined" in times:
            yield line("of those joined", times["joined"], 1e3, "ms")
        yield line("duration over stop-then-go", ratio, 1.0, "", f"{blocked} refused had a stop that touches")


def steering(pepper, motions, rng, count):
    """Yield how long states to rest and to states take, beside ruckig where it is installed."""
    n, phases = pepper.n, np.empty((pepper.n, 3, 4))
    limits = np.stack([pepper.velocity_limits, pepper.acceleration_limits])
    everywhere = np.concatenate([limits, np.full((1, n), -1e9), np.full((1, n), 1e9)])
    times, ratio = Times(time.thread_time), []
    for k in range(count):
        one, other = motions[k % MOTIONS], motions[(k + rng.integers(1, MOTIONS)) % MOTIONS]
        ends = [np.stack(m(float(rng.uniform(0.0, m.duration)))[:2]) for m in (one, other)]
        times("steer", steer, ends[0], other.end, limits, phases)
        duration = times("bridge", bridge, *ends, everywhere, 60.0, phases)
        if ruckig is None:
            continue
        for name, target in (("to rest", np.stack([other.end, np.zeros(n)])), ("to a state", ends[1])):
            request, planned = ruckig.InputParameter(n), ruckig.Trajectory(n)
            request.current_position, request.current_velocity = map(list, ends[0])
            request.target_position, request.target_velocity = map(list, target)
            request.max_velocity, request.max_acceleration = map(list, limits)
            request.max_jerk = [np.inf] * n
            found = times(f"ruckig {name}", ruckig.Ruckig(n).calculate, request, planned)
        if found == ruckig.Result.Working and duration > 0.0:
            ratio.append(duration / planned.duration)
    for name, spent in times.items():
        yield line(name, spent, 1e6, "us")
    if ratio:
        yield line("bridge, its duration over ruckig's", ratio, 1.0)


def moved_scenes(pepper, rng):
    """Yield how long it takes to move ten boxes and to replace a cloud of 20,000 points, and check both."""
    q = pepper.posture("Stand")
    boxes = ten_boxes(pepper, rng, [q])
    towards = {name: boxes.objects[name].transform_object_to_world for name in boxes.names}
    u, v = rng.uniform(-0.5, 0.5, (2, 20_000))
    depth = np.where(np.abs(u) < 0.1, 1.0, 2.0) + 0.1 * np.sin(5 * v)  # a wall and a post
    points = np.stack([depth, depth * u, depth * v + 1.0], axis=1)
    cloud = pk.Scene().add_point_cloud("cloud", points, 0.01)
    for name, change in (
        ("ten boxes moved", lambda: boxes.moved(towards)),
        ("20,000 points replaced", lambda: cloud.with_cloud("cloud", points, 0.01)),
    ):
        times = Times(time.thread_time)
        for _ in range(300):
            scene = times("alone", change)
            times("check", pk.collision.in_collision, pepper, q, scene)
        yield line(name, times["alone"], 1e3, "ms")
        yield line(f"{name}, and checked", np.add(times["alone"], times["check"]), 1e3, "ms")


def moving_boxes(pepper, motions, rng, verdicts):
    """Yield how long verdicts on a second ahead take among ten moving boxes, and compare with coal."""
    times, differ, touching = np.linspace(0.0, 1.0, 101), 0, 0
    clock = Times(time.thread_time)
    for k in range(max(verdicts // 101, 30)):
        motion, scene = motions[k % MOTIONS], pk.Scene()
        for name in map(str, range(10)):
            place, turn = rng.uniform((0.2, -0.6, 0.5), (0.8, 0.6, 1.3)), rng.normal(size=3)
            velocity = rng.uniform(-0.4, 0.4, 3)
            scene = scene.add_box(name, (0.1, 0.15, 0.2), place, turn, velocity=velocity)
        q = motion(np.minimum(times, motion.duration)).position
        pk.collision.in_collision(pepper, q, scene, times)  # shapes are prepared once
        found = clock("alone", pk.collision.in_collision, pepper, q, scene, times)
        seen = {name: scene.objects[name].transform_object_to_world for name in scene.names}
        clock(
            "anew", lambda s=scene, q=q, seen=seen: pk.collision.in_collision(pepper, q, s.moved(seen), times)
        )
        for state, at, verdict in zip(q, times, found, strict=True):
            coal = pk.collision.CollisionChecker(pepper, scene.at(at)).in_collision(state)
            differ, touching = differ + (coal != verdict), touching + coal
    yield line("101 states among ten boxes that move", clock["alone"], 1e3, "ms")
    yield line("the boxes seen anew, and 101 states", clock["anew"], 1e3, "ms")
    count = 101 * len(clock["alone"])
    yield f"verdicts that differ from coal's: {differ} of {count}, {touching} of them contacts"


def free_cycles(pepper):
    """Yield what a cycle takes whose way is free, beside ten boxes that move and are seen anew each time."""
    rng, goals = np.random.default_rng(0), [pepper.posture("Stand")]
    goals.append(pepper.joint_vector({"LShoulderPitch": 0.2, "LElbowRoll": -1.0, "HeadYaw": -0.5}))
    scene, spent = pk.Scene(), []
    for name in map(str, range(10)):
        place, size = rng.uniform((0.9, -0.7, 0.4), (1.2, 0.7, 1.3)), rng.uniform(0.08, 0.24, 3)
        scene = scene.add_box(name, size, place, velocity=rng.uniform(-0.02, 0.02, 3))
    live = pk.motion.LiveMotion(pepper, goals[0], budget=1.0)
    for k in range(600):
        if k % 40 == 0:
            live.set_goal(goals[(k // 40 + 1) % 2])
        poses = {name: scene.objects[name].transform_object_to_world for name in scene.names}
        live.set_scene(scene.moved(poses), k / 30)
        state = live.step(k / 30)
        if state.status is pk.motion.LiveStatus.MOVING and k > 100:
            spent.append(state.spent)
    yield line("live cycle, the way free", spent, 1e3, "ms")


def among_boxes(pepper, rng, count, off):
    """Yield how live motions fare among ten boxes whose velocities are up to `off` [m/s] off."""
    slower = {"velocity": 0.3 * pepper.velocity_limits, "acceleration": 0.3 * pepper.acceleration_limits}
    careful, cycle, (lower, upper) = pepper.with_limits(**slower), 1.0 / 30.0, near_upright(pepper)
    hits = reached = made = 0
    first, spent = [], []
    while made < count:
        start, goal = rng.uniform(lower, upper, (2, pepper.n))
        size = rng.uniform(0.08, 0.24, (10, 3))
        place = rng.uniform((0.25, -0.7, 0.4), (0.9, 0.7, 1.3), (10, 3))
        way, error = rng.normal(size=(2, 10, 3))
        true = way / np.linalg.norm(way, axis=1)[:, None] * rng.uniform(0.05, 0.4, (10, 1))
        believed = true + off * rng.uniform(size=(10, 1)) * error / np.linalg.norm(error, axis=1)[:, None]

        def seen(at, velocity=believed, off=off, size=size, place=place, true=true):
            scene = pk.Scene()
            for k in range(10):
                motion = {"velocity": velocity[k], "uncertainty": off}
                scene = scene.add_box(str(k), size[k], place[k] + at * true[k], **motion)
            return scene

        touching = pk.collision.in_collision(pepper, np.stack([start, goal])).any()
        if touching or pk.collision.in_collision(pepper, start, seen(0.0)):
            continue
        made, live = made + 1, pk.motion.LiveMotion(careful, start, seen(0.0))
        live.set_goal(goal)
        moving, times = [], []
        for now in np.arange(0.0, 6.0, cycle):
            live.set_scene(seen(now), now)
            state = live.step(now)
            (first if now == 0.0 else spent).append(state.spent)
            for at in now + cycle * np.arange(5) / 5:
                q, velocity, _ = state.at(at)
                if np.abs(velocity).max() > 1e-6:
                    moving.append(q)
                    times.append(at)
            if state.status is pk.motion.LiveStatus.REACHED:
                break
        truth = seen(0.0, true, 0.0)  # by the check whose verdicts `moving_boxes` compares with coal's
        hit = times and pk.collision.in_collision(pepper, np.array(moving), truth, times).any()
        hits += bool(hit)
        reached += state.status is pk.motion.LiveStatus.REACHED and not hit
    yield line(f"live cycle, up to {off:g} m/s off", spent, 1e3, "ms")
    yield line("the first of each run, with new shapes", first, 1e3, "ms")
    yield f"{hits} hits in motion, {reached} goals, {made} runs"
    assert hits == 0


def line(name, values, scale, unit="", more=""):
    middle, slow, most = np.percentile(values, (50, 99, 100)) * scale
    return (
        "what | p50 / p99 / greatest | unit | ",
        name,
        f"{middle:.4g} / {slow:.4g} / {most:.4g}",
        unit,
        more,
    )


@figures("benchmarks/live.md", runs=1)
def live_runs(runs: int = 10_000, seed: int = 0) -> Iterator[tuple | str]:
    """Live motions among obstacles as predicted, and as many among others, in simulated time."""
    pepper, rng = pk.load_pepper().with_requirements("limits"), np.random.default_rng(seed)
    for done in range(0, runs, 100):
        for off in (0.0, 0.5):
            yield f"runs {done} to {min(done + 100, runs)}"
            yield from among_boxes(pepper, rng, min(100, runs - done), off)


@figures("benchmarks/live.md", "ruckig", count=1_000)
def live(count: int = 1_000_000) -> Iterator[tuple | str]:
    """Stops from any instant of a motion, new goals without one, moved scenes.

    Times are processor time.  So many instants of stops are examined, and a hundredth as many splices;
    torques by `newton_euler`, which no stop is computed with.
    """
    pepper, rng = pk.load_pepper().with_requirements("limits"), np.random.default_rng(0)
    motions, times, rest, free, joints = fastest_motions(pepper, rng), Times(time.thread_time), [], [], []
    broken = refused = kept = 0
    for k in range(count // PER_STOP):
        motion = motions[k % MOTIONS]
        at = float(rng.uniform(0.0, motion.duration - 1e-3))
        try:
            stop = times("whole", motion.stop, pepper, at)
        except InfeasibleError:
            refused += 1
            del times["whole"][-1]
            continue
        rest.append(stop.duration)
        broken += limits_broken(pepper, stop, rng)
        if k % 7 == 0:  # shares no factor with the number of motions
            free.append(times("plain", motion.stop, pepper, at, torque=False).duration)
            times("core", core_path(pepper, motion, at))
            alone = motion.stop(pepper, at, how="joints")
            joints.append(alone.duration)
            kept += not alone.exceeded
    yield f"{len(rest)} stops, {len(rest) * PER_STOP} instants; {refused} refused"
    yield line("machine code, velocity and acceleration", times["core"], 1e6, "us")
    yield line("stop(torque=False)", times["plain"], 1e6, "us")
    yield line("stop()", times["whole"], 1e6, "us")
    yield line("time to rest along the path", rest, 1.0, "s")
    yield line("the same, torque=False", free, 1.0, "s")
    yield line('time to rest, how="joints"', joints, 1.0, "s")
    yield f"limits broken along the path: {broken}"
    yield f"of joints, within torque and position: {kept} of {len(joints)}"
    yield from splices(pepper, motions, rng, count // PER_STOP)
    yield from steering(pepper, motions, rng, count // PER_STOP)
    yield from moved_scenes(pepper, rng)
    yield from moving_boxes(pepper, motions, rng, count // 10)
    yield from free_cycles(pepper)
    for off in (0.0, 0.5):
        yield from among_boxes(pepper, rng, count // 1_000, off)
    assert broken == 0


DISTANCE = 0.8
"""Between the bases [m]."""
APART = 0.12
"""Least distance of the goals [m]."""
NEAR, FAR = (0.34, -0.18, 0.80), (0.46, 0.0, 1.00)
"""Where left hands go, each in its robot's world, beyond the middle between the hands' starts [m]."""
FACING = pk.pose((DISTANCE, 0, 0), rpy=(0, 0, np.pi))
POSTURES = 16
"""Goal postures of the first that are tried besides the nearest."""
MILLISECOND, STILL = 0.001, 0.2  # [s]


def goals(rng: np.random.Generator) -> np.ndarray:
    """Return goals of two left hands, each in its robot's world, shape (2, 3): hands cross on the way."""
    while True:
        found = rng.uniform(NEAR, FAR, (2, 3))
        if np.linalg.norm((FACING @ np.append(found[1], 1.0))[:3] - found[0]) > APART:
            return found


def motion_beside(pepper: pk.PepperModel, goal: object, other: object) -> pk.Trajectory | None:
    """Return a motion from Stand beside another robot that stands; None where there is no path."""
    scene = pk.Scene().add_robot("other", pepper, other, FACING)
    plan = pk.plan(pepper, pepper.posture("Stand"), goal, scene, seed=0)
    return pk.retime(pepper, plan) if plan.success else None


def other_postures(pepper: pk.PepperModel, tasks: list, scene: pk.Scene) -> Iterator[np.ndarray]:
    """Yield postures that reach a goal, each the nearest to another random one."""
    for seed in range(POSTURES):
        start = np.random.default_rng(seed).uniform(pepper.lower_limits, pepper.upper_limits)
        found = pk.ik.solve(pepper, tasks, start=start, scene=scene, seed=seed)
        if found.success:
            yield found.q


def one_after_the_other(pepper: pk.PepperModel, points: np.ndarray) -> tuple[list, float] | None:
    """Return the motions of the first and the second robot, and when the second begins [s]; None for none."""
    tasks = [[pk.ik.HandPosition("left", point)] for point in points]
    beside = pk.Scene().add_robot("other", pepper, pepper.posture("Stand"), FACING)
    for goal in chain([tasks[0]], other_postures(pepper, tasks[0], beside)):
        first = motion_beside(pepper, goal, pepper.posture("Stand"))
        second = None if first is None else motion_beside(pepper, tasks[1], first.end)
        if first is None or second is None:
            continue
        passing = pk.Scene().add_robot("other", pepper, first, FACING)
        soonest = max(0.0, first.duration - second.duration)
        for wait in np.arange(soonest, first.duration + 0.1, 0.05):
            if second.check(pepper, passing, start_time=wait).success:
                return [first, second], float(wait)
    return None


class Judge:
    """Finds contacts of two robots by coal."""

    def __init__(self, pepper: pk.PepperModel) -> None:
        self.model, self.data = pepper.inner_model, pepper.inner_model.createData()
        self.frames = [self.model.getFrameId(shape.link) for shape in pepper.collision_shapes]
        self.local = [pinocchio.SE3(shape.transform_shape_to_link) for shape in pepper.collision_shapes]
        self.sides = [
            [coal.CollisionObject(shape_of(s.geometry)) for s in pepper.collision_shapes] for _ in "ab"
        ]
        self.managers = [coal.DynamicAABBTreeCollisionManager() for _ in self.sides]
        for manager, side in zip(self.managers, self.sides, strict=True):
            manager.registerObjects(side)
            manager.setup()

    def touch(self, states: tuple[np.ndarray, np.ndarray]) -> bool:
        places = np.eye(4), FACING
        for q, side, manager, place in zip(states, self.sides, self.managers, places, strict=True):
            pinocchio.framesForwardKinematics(self.model, self.data, q)
            for item, frame, local in zip(side, self.frames, self.local, strict=True):
                pose = pinocchio.SE3(place) * self.data.oMf[frame] * local
                item.setTransform(coal.Transform3s(pose.rotation, pose.translation))
                item.computeAABB()
            manager.update()
        found = coal.CollisionCallBackDefault()
        self.managers[0].collide(self.managers[1], found)
        return bool(found.data.result.isCollision())


def shape_of(geometry: Box | Capsule | Cylinder | Sphere) -> coal.CollisionGeometry:
    match geometry:
        case Box():
            return coal.Box(*geometry.size)
        case Capsule():
            return coal.Capsule(geometry.radius, geometry.length)
        case Cylinder():
            return coal.Cylinder(geometry.radius, geometry.length)
        case Sphere():
            return coal.Sphere(geometry.radius)


def at(motion: pk.Trajectory, times: np.ndarray) -> np.ndarray:
    return motion(np.clip(times, 0.0, motion.duration)).position


@figures("benchmarks/live.md", runs=2)
def two_robots(runs: int = 100, seed: int = 0) -> Iterator[tuple]:
    """Two Peppers face each other and reach with hands that cross: contacts and arrivals in many runs.

    The way of the recipe "Let two robots pass each other": one is planned beside the other where it stands,
    the other with the first at its goal; it begins as soon as its certificate among the first's motion is
    green.  Where there is no path, the first goes to another posture, or the other one goes first.  The judge
    is coal on every millisecond, with poses of Pinocchio: it shares neither scenes nor checkers with the
    library.
    """
    pepper, rng = pk.load_pepper(), np.random.default_rng(seed)
    judge, arrived, contacts, waits, swapped, straight = Judge(pepper), 0, 0, [], 0, 0
    for _ in range(runs):
        points = goals(rng)
        tried = ((one_after_the_other(pepper, points[::order]), order) for order in (1, -1))
        found, order = next((way for way in tried if way[0]), (None, 0))
        if found is None:
            continue
        (first, second), wait = found
        times = np.arange(0.0, max(first.duration, wait + second.duration) + STILL, MILLISECOND)
        rows = list(zip(at(first, times), at(second, times - wait), strict=True))
        contacts += any(judge.touch(row) for row in rows)
        straight += any(judge.touch(row) for row in zip(at(first, times), at(second, times), strict=True))
        hands = [pk.kinematics.frame_pose(pepper, q, "LArm_effector")[:3, 3] for q in rows[-1]]
        arrived += all(np.linalg.norm(h - p) < 0.005 for h, p in zip(hands, points[::order], strict=True))
        waits.append(wait)
        swapped += order < 0
    for row in (
        ("contacts, by coal", contacts, 0),
        ("both arrive", arrived, f"{0.95 * runs:g}"),
        ("the second waits, median / greatest", f"{np.median(waits):.2f} / {max(waits):.2f} s", ""),
        ("the other one goes first", swapped, ""),
        ("contacts if it did not wait", straight, ""),
    ):
        yield f"{runs} runs | found | asked", *row
