"""Stops from any instant of a motion, new goals without one, moved scenes: `python benchmarks/live.py [N]`.

Times are processor time.  N instants of stops are examined, 1,000,000 if not given, and N / 100 splices;
torques by `newton_euler`, which no stop is computed with.  `python benchmarks/live.py runs R [SEED]` makes R
live motions among obstacles as predicted, and R among others, in simulated time, 0.2 to 0.4 s each.
"""

import sys
import time
from collections import Counter

import numpy as np

import pepper_kin as pk
from pepper_kin import dynamics
from pepper_kin.core.timing import stopping
from pepper_kin.core.timing.steering import bridge, steer
from pepper_kin.exceptions import InfeasibleError
from pepper_kin.motion import replan
from pepper_kin.trajectory import stop as stops

try:
    import ruckig
except ImportError:
    ruckig = None

MOTIONS, PER_STOP = 60, 100
TOLERANCE = 1e-9


def fastest_motions(pepper, rng):
    """Return planned motions between random postures, the legs near upright, timed at full limits."""
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
    found = []
    while len(found) < MOTIONS:
        start, goal = rng.uniform(lower, upper, (2, pepper.n))
        try:
            plan = pk.plan(pepper, start, goal, timeout=1.0)
            if plan.success:
                found.append(pk.retime(pepper, plan))
        except pk.exceptions.PepperKinError:
            continue  # a posture in collision, or too heavy to hold
    return found


def core_time(pepper, motion, at):
    """Return the time that machine code takes for velocity and acceleration [s]."""
    order, size = motion.coefficients.shape[1], 512
    path = stopping.StopPath(
        np.empty(size, np.int64), np.empty(size), np.empty(size), np.empty((size, order, pepper.n)),
        np.empty(size + 1),
    )  # fmt: skip
    none = np.empty(0)
    limits = stopping.StopLimits(pepper.acceleration_limits, np.empty((3, 3 * size, 0)), none, none)
    ahead = motion.between(at, min(at + 0.2, motion.duration))
    breaks, motion_rows = np.empty(size + 1), np.empty((size, 2 * order - 1, pepper.n))
    basis = stops._basis(order)
    begin = time.thread_time()
    count = stopping.cut_path(ahead.breaks, ahead.coefficients, 0.0, stops._STEP, path)
    used = stopping.stop_profile(count, basis, path, limits) or count
    stopping.stop_polynomials(used, path, breaks, motion_rows)
    return time.thread_time() - begin


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
    """Print how many new goals are reached without a stop, and how long that takes."""
    kinds = {
        "velocity and acceleration": ({"torque": False}, None),
        "torque and balance": ({"balance": 0.0}, None),
        "clear of itself": ({"torque": False}, "robot"),
        "ten boxes": ({"torque": False}, "boxes"),
        "ten boxes, torque and balance": ({"balance": 0.0}, "boxes"),
    }
    for name, (options, world) in kinds.items():
        ways, spent, ratio, blocked = Counter(), {}, [], 0
        for k in range(count):
            motion, goal = motions[k % MOTIONS], motions[(k + rng.integers(1, MOTIONS)) % MOTIONS].end
            at = float(rng.uniform(0.0, motion.duration - 1e-3))
            scene = ten_boxes(pepper, rng, [motion(at).position, goal]) if world == "boxes" else pk.Scene()
            begin = time.thread_time()
            try:
                if world is None:
                    spliced = motion.replaced(pepper, at, goal, **options)
                else:
                    spliced = replan(pepper, motion, at, goal, scene, **options)
                how = spliced.how
            except InfeasibleError:
                how = "refused"
            spent.setdefault(how, []).append(time.thread_time() - begin)
            ways[how] += 1
            if how == "refused":
                blocked += world == "boxes" and motion.stop(pepper, at, scene=scene).clearance.least <= 0.0
            elif how != "after a stop":
                go = stop_then_go(pepper, motion, at, goal, scene, how, options)
                ratio += [(spliced.trajectory.duration - at) / go] if go else []
        line(f"splice, {name}", [t for part in spent.values() for t in part], 1e3, f"ms, {dict(ways)}")
        if "joined" in spent:
            line("of those joined", spent["joined"], 1e3, "ms")
        line("duration over stop-then-go", ratio, 1.0, f"; {blocked} refused had a stop that touches")


def steering(pepper, motions, rng, count):
    """Print how long states to rest and to states take, beside ruckig where it is installed."""
    n, phases = pepper.n, np.empty((pepper.n, 3, 4))
    limits = np.stack([pepper.velocity_limits, pepper.acceleration_limits])
    everywhere = np.concatenate([limits, np.full((1, n), -1e9), np.full((1, n), 1e9)])
    times, ratio = {"steer": [], "bridge": [], "ruckig to rest": [], "ruckig to a state": []}, []
    for k in range(count):
        one, other = motions[k % MOTIONS], motions[(k + rng.integers(1, MOTIONS)) % MOTIONS]
        ends = [np.stack(m(float(rng.uniform(0.0, m.duration)))[:2]) for m in (one, other)]
        begin = time.thread_time()
        steer(ends[0], other.end, limits, phases)
        middle = time.thread_time()
        duration = bridge(*ends, everywhere, 60.0, phases)
        times["bridge"].append(time.thread_time() - middle)
        times["steer"].append(middle - begin)
        if ruckig is None:
            continue
        for name, target in (("to rest", np.stack([other.end, np.zeros(n)])), ("to a state", ends[1])):
            request, planned = ruckig.InputParameter(n), ruckig.Trajectory(n)
            request.current_position, request.current_velocity = map(list, ends[0])
            request.target_position, request.target_velocity = map(list, target)
            request.max_velocity, request.max_acceleration = map(list, limits)
            request.max_jerk = [np.inf] * n
            solver, begin = ruckig.Ruckig(n), time.thread_time()
            found = solver.calculate(request, planned)
            times[f"ruckig {name}"].append(time.thread_time() - begin)
        if found == ruckig.Result.Working and duration > 0.0:
            ratio.append(duration / planned.duration)
    for name, spent in times.items():
        if spent:
            line(name, spent, 1e6, "us")
    if ratio:
        line("bridge, its duration over ruckig's", ratio, 1.0, "")


def moved_scenes(pepper, rng):
    """Print how long it takes to move ten boxes and to replace a cloud of 20,000 points, and check both."""
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
        alone, checked = [], []
        for _ in range(300):
            begin = time.thread_time()
            scene = change()
            alone.append(time.thread_time() - begin)
            pk.collision.in_collision(pepper, q, scene)
            checked.append(time.thread_time() - begin)
        line(name, alone, 1e3, "ms")
        line(f"{name}, and checked", checked, 1e3, "ms")


def moving_boxes(pepper, motions, rng, verdicts):
    """Print how long verdicts on a second ahead take among ten moving boxes, and compare with coal."""
    times, differ, touching = np.linspace(0.0, 1.0, 101), 0, 0
    alone, anew = [], []
    for k in range(max(verdicts // 101, 30)):
        motion, scene = motions[k % MOTIONS], pk.Scene()
        for name in map(str, range(10)):
            place, turn = rng.uniform((0.2, -0.6, 0.5), (0.8, 0.6, 1.3)), rng.normal(size=3)
            velocity = rng.uniform(-0.4, 0.4, 3)
            scene = scene.add_box(name, (0.1, 0.15, 0.2), place, turn, velocity=velocity)
        q = motion(np.minimum(times, motion.duration)).position
        pk.collision.in_collision(pepper, q, scene, times)  # shapes are prepared once
        begin = time.thread_time()
        found = pk.collision.in_collision(pepper, q, scene, times)
        alone.append(time.thread_time() - begin)
        seen = {name: scene.objects[name].transform_object_to_world for name in scene.names}
        begin = time.thread_time()
        pk.collision.in_collision(pepper, q, scene.moved(seen), times)
        anew.append(time.thread_time() - begin)
        for state, at, verdict in zip(q, times, found, strict=True):
            coal = pk.collision.CollisionChecker(pepper, scene.at(at)).in_collision(state)
            differ, touching = differ + (coal != verdict), touching + coal
    line("101 states among ten boxes that move", alone, 1e3, "ms")
    line("the boxes seen anew, and 101 states", anew, 1e3, "ms")
    print(f"verdicts that differ from coal's: {differ} of {101 * len(alone)}, {touching} of them contacts")


def free_cycles(pepper):
    """Print what a cycle takes whose way is free, beside ten boxes that move and are seen anew each time."""
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
    line("live cycle, the way free", spent, 1e3, "ms")


def among_boxes(pepper, rng, count, off):
    """Print how live motions fare among ten boxes whose velocities are up to `off` [m/s] off."""
    slower = {"velocity": 0.3 * pepper.velocity_limits, "acceleration": 0.3 * pepper.acceleration_limits}
    careful, cycle = pepper.with_limits(**slower), 1.0 / 30.0
    lower, upper = pepper.lower_limits.copy(), pepper.upper_limits.copy()
    lower[:3], upper[:3] = 0.06 * lower[:3], 0.06 * upper[:3]
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
    line(f"live cycle, up to {off:g} m/s off", spent, 1e3, "ms")
    line("the first of each run, with new shapes", first, 1e3, "ms")
    print(f"{'':44}{hits} hits in motion, {reached} goals, {made} runs")
    return hits


def line(name, values, scale, unit):
    middle, slow, most = np.percentile(values, (50, 99, 100)) * scale
    print(f"{name:44}{middle:9.4g} / {slow:.4g} / {most:.4g} {unit}")


def runs(count, seed):
    """Make many live motions, a hundred at a time."""
    pepper, rng, hits = pk.load_pepper().with_requirements("limits"), np.random.default_rng(seed), 0
    for done in range(0, count, 100):
        for off in (0.0, 0.5):
            print(f"runs {done} to {min(done + 100, count)}", flush=True)
            hits += among_boxes(pepper, rng, min(100, count - done), off)
    assert hits == 0


def main():
    if len(sys.argv) > 2 and sys.argv[1] == "runs":
        return runs(int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 0)
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    pepper, rng = pk.load_pepper().with_requirements("limits"), np.random.default_rng(0)
    motions = fastest_motions(pepper, rng)
    core, plain, free, whole, rest, joints = [], [], [], [], [], []
    broken = refused = kept = 0
    for k in range(count // PER_STOP):
        motion = motions[k % MOTIONS]
        at = float(rng.uniform(0.0, motion.duration - 1e-3))
        try:
            begin = time.thread_time()
            stop = motion.stop(pepper, at)
            whole.append(time.thread_time() - begin)
        except InfeasibleError:
            refused += 1
            continue
        rest.append(stop.duration)
        broken += limits_broken(pepper, stop, rng)
        if k % 7 == 0:  # shares no factor with the number of motions
            begin = time.thread_time()
            light = motion.stop(pepper, at, torque=False)
            plain.append(time.thread_time() - begin)
            free.append(light.duration)
            core.append(core_time(pepper, motion, at))
            alone = motion.stop(pepper, at, how="joints")
            joints.append(alone.duration)
            kept += not alone.exceeded
    print(f"{len(rest)} stops, {len(rest) * PER_STOP} instants; {refused} refused; p50 / p99 / greatest")
    line("machine code, velocity and acceleration", core, 1e6, "us")
    line("stop(torque=False)", plain, 1e6, "us")
    line("stop()", whole, 1e6, "us")
    line("time to rest along the path", rest, 1.0, "s")
    line("the same, torque=False", free, 1.0, "s")
    line('time to rest, how="joints"', joints, 1.0, "s")
    print(f"{'limits broken along the path':44}{broken:9}")
    print(f"{'of joints, within torque and position':44}{kept:9} of {len(joints)}")
    splices(pepper, motions, rng, count // PER_STOP)
    steering(pepper, motions, rng, count // PER_STOP)
    moved_scenes(pepper, rng)
    moving_boxes(pepper, motions, rng, count // 10)
    free_cycles(pepper)
    for off in (0.0, 0.5):
        among_boxes(pepper, rng, count // 1_000, off)
    assert broken == 0


if __name__ == "__main__":
    main()
