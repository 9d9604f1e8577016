"""Motion planning beside its peers, in ten kinds of scenes, and of the base."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from harness import Times, figures, pairs, peer
from planning_peers import CompiledOmpl, Roboplan

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.collision.fast import FastChecker, fast_checker_for
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.motion.checks import Checks
from pepper_kin.motion.problem import RESOLUTION as STEP_OF_PLAN
from pepper_kin.motion.problem import path_problem
from pepper_kin.trajectory.path import as_cubic_path

PEPPER = pk.load_pepper().with_requirements("limits")
ARM = ("left_arm",)
TORSO_AND_ARM = ("torso", "left_arm")


@dataclass(frozen=True)
class Kind:
    """One kind of problem: what makes its scene, the joint groups that move, and whether the base does."""

    scene: Callable[[np.random.Generator], pk.Scene]
    groups: tuple[str, ...] = TORSO_AND_ARM
    planar: bool = False


TABLE = pk.Scene().add_box("table", (0.6, 1.0, 0.04), (0.55, 0.0, 0.70))


def _table(_: np.random.Generator) -> pk.Scene:
    return TABLE


def _shelf(_: np.random.Generator) -> pk.Scene:
    scene = pk.Scene().add_box("back", (0.02, 0.8, 1.4), (0.75, 0.2, 0.7))
    for k, z in enumerate((0.5, 0.75, 1.0)):
        scene = scene.add_box(f"board {k}", (0.3, 0.8, 0.02), (0.6, 0.2, z))
    return scene


def _bin(_: np.random.Generator) -> pk.Scene:
    scene = pk.Scene()
    for name, size, place in (
        ("front", (0.02, 0.4, 0.25), (0.30, 0.25, 0.60)), ("rear", (0.02, 0.4, 0.25), (0.60, 0.25, 0.60)),
        ("left", (0.3, 0.02, 0.25), (0.45, 0.45, 0.60)), ("right", (0.3, 0.02, 0.25), (0.45, 0.05, 0.60)),
    ):  # fmt: skip
        scene = scene.add_box(name, size, place)
    return scene


def _doorway(_: np.random.Generator) -> pk.Scene:
    return (
        pk.Scene().add_box("left post", (0.1, 0.6, 2.0), (0.35, 0.75, 1.0))
        .add_box("right post", (0.1, 0.6, 2.0), (0.35, -0.65, 1.0))
        .add_box("lintel", (0.1, 2.0, 0.3), (0.35, 0.05, 1.55))
    )  # fmt: skip


def _hole(_: np.random.Generator) -> pk.Scene:
    scene = pk.Scene()
    for name, size, place in (
        ("below", (0.03, 1.0, 0.70), (0.38, 0.2, 0.35)), ("above", (0.03, 1.0, 0.5), (0.38, 0.2, 1.35)),
        ("left", (0.03, 0.3, 0.4), (0.38, 0.60, 0.90)), ("right", (0.03, 0.3, 0.4), (0.38, -0.15, 0.90)),
    ):  # fmt: skip
        scene = scene.add_box(name, size, place)
    return scene


def _desk(generator: np.random.Generator) -> pk.Scene:
    scene = _table(generator)
    for k in range(8):
        x, y = generator.uniform(0.35, 0.75), generator.uniform(-0.4, 0.4)
        height = generator.uniform(0.05, 0.2)
        scene = scene.add_cylinder(f"thing {k}", 0.03, height, (x, y, 0.72 + height / 2))
    return scene


def _tray(generator: np.random.Generator) -> pk.Scene:
    held = np.eye(4)
    held[:3, 3] = (0.05, 0.0, 0.03)
    return _table(generator).add_box("tray", (0.20, 0.16, 0.02), (0, 0, 0)).attach("tray", "l_gripper", held)


def _pillar(_: np.random.Generator) -> pk.Scene:
    return pk.Scene().add_cylinder("pillar", 0.15, 2.0, (0.9, 0.0, 1.0))


def _cloud(generator: np.random.Generator) -> pk.Scene:
    points = generator.uniform((0.35, -0.4, 0.60), (0.75, 0.4, 0.72), (20_000, 3))
    return pk.Scene().add_point_cloud("cloud", points, 0.01, voxel=0.03)


KINDS: dict[str, Kind] = {
    "table": Kind(_table),
    "shelf": Kind(_shelf),
    "bin": Kind(_bin),
    "doorway": Kind(_doorway),
    "wall with a hole": Kind(_hole),
    "cluttered desk": Kind(_desk),
    "both arms crossing": Kind(lambda _: pk.Scene(), ("left_arm", "right_arm")),
    "carrying a tray": Kind(_tray),
    "base and arm, pillar": Kind(_pillar, ("left_arm",), planar=True),
    "point cloud": Kind(_cloud),
}


@dataclass(frozen=True, eq=False)
class Problem:
    """Start and goal of a robot in a scene; both are free and can be held."""

    pepper: pk.PepperModel
    scene: pk.Scene
    start: np.ndarray
    goal: np.ndarray
    joints: tuple[str, ...]

    @property
    def ends(self) -> tuple[pk.PepperModel, np.ndarray, np.ndarray]:
        return self.pepper, self.start, self.goal


def problems(kind: Kind, count: int, seed: int, *, blocked: bool = False) -> list[Problem]:
    """Return problems with ends drawn evenly from what is free; `blocked`, where the straight way touches."""
    generator = np.random.default_rng(seed)
    pepper = pk.load_pepper(base="planar").with_requirements("limits") if kind.planar else PEPPER
    joints = tuple(name for group in kind.groups for name in pepper.joint_group(group))
    if kind.planar:
        joints = ("BaseX", "BaseY", "BaseYaw", *joints)
    index = [pepper.joint_index(name) for name in joints]
    low, high = pepper.lower_limits[index].copy(), pepper.upper_limits[index].copy()
    if kind.planar:
        low[:3], high[:3] = (-0.2, -1.0, -1.0), (1.8, 1.0, 1.0)
    found: list[Problem] = []
    while len(found) < count:
        scene = kind.scene(generator)
        ends = np.tile(pepper.neutral(), (400, 1))
        ends[:, index] = generator.uniform(low, high, (400, len(index)))
        torque = np.abs(pk.dynamics.gravity_torque(pepper, ends))
        good = ends[(torque <= 0.9 * pepper.effort_limits).all(axis=1)]
        good = good[~pk.collision.checker_for(pepper, scene, 0.005, 0.001).in_collision(good)]
        for start, goal in pairs(good):
            way = start + np.linspace(0, 1, 60)[:, None] * (goal - start)
            if blocked and not pk.collision.in_collision(pepper, way, scene).any():
                continue
            found.append(Problem(pepper, scene, start, goal, joints))
            if len(found) == count or len(found) % 3 == 0:
                break
    return found[:count]


MARGINS = (0.005, 0.001)
STEP = 5e-4  # [m]
RESOLUTION = 0.01  # [m] of the fastest point, at most, between states that a search asks about
STATES, ROUNDS = 2000, 7


def toy(problem: Problem, *, compiled: bool) -> planners.Problem:
    """Return the planning problem of the joints that move."""
    pepper = problem.pepper
    free = np.array([pepper.joint_index(name) for name in problem.joints])
    checks = Checks(pepper, problem.scene)
    validity = checks.validity(problem.start, free, MARGINS)
    if not compiled:
        coal = pk.collision.checker_for(pepper, problem.scene, *MARGINS)

        def validity(states: np.ndarray) -> np.ndarray:
            q = np.tile(problem.start, (len(states), 1))
            q[:, free] = states
            return checks.holds(q) & ~coal.in_collision(q)

    return planners.Problem(
        lower=pepper.lower_limits[free], upper=pepper.upper_limits[free], start=problem.start[free],
        goals=problem.goal[free], validity=validity,
        weights=motion_bounds(pepper)[free], resolution=RESOLUTION,
    )  # fmt: skip


def ten_boxes() -> pk.Scene:
    """Return ten boxes within reach that leave the robot free where it stands."""
    generator, scene = np.random.default_rng(0), pk.Scene()
    while len(scene.names) < 10:
        place = generator.uniform((0.3, -0.6, 0.3), (0.9, 0.6, 1.2))
        more = scene.add_box(f"box {len(scene.names)}", generator.uniform(0.05, 0.3, 3), place)
        if not pk.collision.in_collision(PEPPER, PEPPER.posture("Stand"), more):
            scene = more
    return scene


def verdicts(roboplan: Roboplan | None) -> Iterator[tuple]:
    """Yield how long it takes to tell whether one configuration is free."""
    scene, generator = ten_boxes(), np.random.default_rng(1)
    q = generator.uniform(PEPPER.lower_limits, PEPPER.upper_limits, (STATES, PEPPER.n))
    fast, coal = fast_checker_for(PEPPER, scene), pk.collision.checker_for(PEPPER, scene)
    ours = fast.in_collision(q)
    ranges = np.any([table.violated(q) for table in dependent_ranges(PEPPER)], axis=0)

    def one_by_one(check: pk.collision.CollisionChecker | FastChecker) -> np.ndarray:
        return np.array([bool(check.in_collision(state)) for state in q])

    racers = {
        "ours, batch": lambda: fast.in_collision(q),
        "ours, one at a time": lambda: one_by_one(fast),
        "coal, one at a time": lambda: one_by_one(coal),
    }
    if roboplan is not None:
        roboplan.furnish(scene)
        racers["RoboPlan, one at a time"] = lambda: roboplan.in_collision(q)
    times, alike = Times(time.perf_counter), {}
    for _ in range(ROUNDS):
        for name, run in racers.items():
            alike[name] = 100 * (times(name, run) == ours)[~ranges].mean()
            if "RoboPlan" in name:
                times[name][-1] = roboplan.time
    head = "one configuration, ten boxes | median [us] {:.2f} | same verdict, ranges aside [%] {:.2f}"
    yield from ((head, name, times.at(name, unit=1e6) / STATES, alike[name]) for name in racers)


def race(kind: Kind, count: int, roboplan: Roboplan | None) -> Iterator[tuple | str]:
    """Yield how long one search takes."""
    cases, joints, inside = problems(kind, count, 1, blocked=True), " and ".join(kind.groups), {}

    def plan(problem: Problem, seed: int) -> bool:
        return pk.plan(*problem.ends, problem.scene, joints=problem.joints, seed=seed).success

    def other(problem: Problem, seed: int) -> bool:
        weights = motion_bounds(problem.pepper)[[PEPPER.joint_index(name) for name in problem.joints]]
        step = RESOLUTION / float(np.sqrt(np.mean(weights**2)))
        return roboplan.connect(problem.start, problem.goal, joints, step, seed, 5.0) is not None

    def over_our_check(problem: Problem, seed: int, name: str) -> bool:
        begin = time.perf_counter()
        one = CompiledOmpl(toy(problem, compiled=True), by_edge=name == "edges")
        solved = one.solve(5.0)
        inside.setdefault(name, []).append(one.inside / (time.perf_counter() - begin))
        return solved

    racers = {
        "search": lambda p, k: planners.rrt_connect(toy(p, compiled=True), seed=k, timeout=5.0).success,
        "plan": plan,
        "OMPL with coal": lambda p, _: (
            planners.ompl_plan(toy(p, compiled=False), "RRTConnect", timeout=5.0).success
        ),
    }
    for name in ("states", "edges"):
        racers[f"OMPL, {name} by our compiled check"] = partial(over_our_check, name=name)
    if roboplan is not None:
        roboplan.furnish(cases[0].scene)
        roboplan.group(joints, cases[0].joints)
        racers["RoboPlan"] = other
    for run in racers.values():
        run(cases[0], 0)
    times, solved = Times(time.perf_counter), dict.fromkeys(racers, 0)
    for seed, problem in enumerate(cases):
        for name, run in racers.items():
            solved[name] += times(name, run, problem, seed)
            if name == "RoboPlan":
                times[name][-1] = roboplan.time
    for name, found in times.items():
        yield (
            "joints | whole call | solved [%] {:.0f} | median [ms] {:.2f} | 95th percentile [ms] {:.2f} | "
            "time / search {:.1f}",
            joints, name, 100 * solved[name] / count, *times.at(name, 50, 95),
            np.median(np.divide(found, times["search"])),
        )  # fmt: skip
    for name, ratios in inside.items():
        yield f"{name}: {100 * np.median(ratios):.0f} % of the time within callbacks"


def is_clear(problem: Problem, plan: pk.motion.Plan) -> bool:
    """Whether coal finds nothing that touches along the spline through a plan's waypoints."""
    spline = as_cubic_path(problem.pepper, plan.path)
    reach, lengths = motion_bounds(problem.pepper), np.diff(spline.breaks)
    for i, length in enumerate(lengths):
        coarse = spline.at(np.full(20, i), np.linspace(0, length, 20))
        moved = np.abs(np.diff(coarse, axis=0)) @ reach
        count = int(np.ceil(moved.sum() / STEP)) + 1
        states = spline.at(np.full(count, i), np.linspace(0, length, count))
        if pk.collision.checker_for(problem.pepper, problem.scene).in_collision(states).any():
            return False
    return True


def breadth(count: int) -> Iterator[tuple | str]:
    """Yield how many of each kind are solved in a second."""
    totals = np.zeros(2, int)
    for name, kind in KINDS.items():
        solved, clear, solvable, times = 0, 0, 0, Times(time.perf_counter)
        for seed, problem in enumerate(problems(kind, count, 2)):
            plan = partial(pk.plan, *problem.ends, problem.scene, joints=problem.joints, margin=0.005)
            found = times(name, plan, seed=seed, timeout=1.0)
            solved += found.success
            clear += found.success and is_clear(problem, found)
            solvable += found.success or any(plan(seed=1000 + k, timeout=5.0).success for k in range(3))
        yield (
            "scene | problems | solved in 1 s | can be solved | clear by coal | median [ms] {:.1f} | "
            "longest [ms] {:.0f}",
            name, count, solved, solvable, clear, *times.at(name, 50, 100),
        )  # fmt: skip
        totals += solved, solvable
    yield f"{totals[0]} of the {totals[1]} that can be solved were solved in a second."


@figures("benchmarks/planning.md", "OMPL; RoboPlan's interpreter", count=2, problems=1)
def planning(count: int = 100, problems: int = 30, roboplan_python: str = "") -> Iterator[tuple | str]:
    """Motion planning beside its peers.

    Three tables.  First, whether one configuration is free, of the robot and of ten boxes: ours in a batch
    and one at a time, coal's and RoboPlan's one at a time, all from Python, on the same shapes.  Second,
    RRT-Connect past a table with one arm and with torso and arm, `count` problems each: ours over the
    compiled check, OMPL's over coal's, called from Python, and RoboPlan's, on the same problems in turn.
    "Search" is `planners.rrt_connect` with the making of problem and check; "plan" is `pk.plan`, with its
    margins, shortcuts, smoothing and last examination.  RoboPlan keeps no margin, knows neither the
    tabulated ranges of neighboring links nor what the joints can hold, and measures steps in joint space: its
    step is ours over the root mean square of the joints' reaches.  Third, ten kinds of problems in a second
    each, `problems` of each, every path examined by coal at steps of half a millimeter of the fastest point;
    what is not solved is tried again for longer with other seeds, to tell whether it can be solved at all.

    RoboPlan needs an environment of its own (`pip install roboplan`), whose interpreter is named by
    `--roboplan-python PATH`, and a process of its own, where its calls are timed.
    """
    roboplan = peer(Roboplan, roboplan_python, PEPPER)
    yield from verdicts(roboplan)
    for groups in (ARM, TORSO_AND_ARM):
        yield from race(Kind(KINDS["table"].scene, groups), count, roboplan)
    if roboplan is not None:
        roboplan.close()
    if problems:
        yield from breadth(problems)


def driven(points: np.ndarray) -> float:
    """Return how far the base moves along waypoints whose first two coordinates are its own [m]."""
    return float(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1).sum())


def among_boxes(base: str, count: int) -> Iterator[tuple]:
    """Yield how long planning and timing among three boxes takes, with the base "planar" or "fixed"."""
    pepper, generator = pk.load_pepper(base=base).with_requirements("limits"), np.random.default_rng(1)
    groups = pepper.joint_group("torso"), pepper.joint_group("left_arm")
    driving = ("BaseX", "BaseY", "BaseYaw") if base == "planar" else ()
    joints = (*driving, *groups[0], *groups[1])
    index = [pepper.joint_index(name) for name in joints]
    low, high = pepper.lower_limits[index].copy(), pepper.upper_limits[index].copy()
    if driving:
        low[:3], high[:3] = (-1.5, -1.5, -3.1), (1.5, 1.5, 3.1)
    legs = slice(len(driving), len(driving) + len(groups[0]))
    low[legs], high[legs] = 0.1 * low[legs], 0.1 * high[legs]
    scene = pk.Scene()
    for name, x, y in (("a", 0.0, 0.6), ("b", 0.6, -0.6), ("c", -0.7, -0.3)):
        scene = scene.add_box(name, (0.5, 0.5, 1.0), (x, y, 0.5))
    free: list[np.ndarray] = []
    while len(free) < 2 * count:
        q = np.array(pepper.posture("Stand"))
        q[index] = generator.uniform(low, high)
        if not pk.collision.in_collision(pepper, q, scene):
            free.append(q)
    times, both = Times(time.thread_time), []
    for start, goal in pairs(free):
        plan = times("plan", pk.plan, pepper, start, goal, scene, joints=joints)
        if plan.success:
            times("retime", pk.retime, pepper, plan)
            both.append(times["plan"][-1] + times["retime"][-1])
    solved, times["both"] = len(both), both
    heads = "".join(f" | {what}: median, 90 %, 99 %, ms" for what in times)
    cells = [" ".join(f"{x:.2f}" for x in times.at(what, 50, 90, 99)) for what in times]
    yield f"base | problems | solved{heads}", base, count, solved, *cells


@figures("benchmarks/planning.md", count=2, seconds=0.5)
def planar_base(count: int = 30, seconds: float = 5.0) -> Iterator[tuple]:
    """Detours of the base: `pk.plan` of base and arm around a pillar, beside a long search; and its time.

    The second table is of base, torso and arm among three boxes of a meter's height, and the third of torso
    and arm beside them, the base standing, ten times as many problems, `plan` and `retime`, in processor
    time.  The long search is `planners.aorrtc` without smoothing, on the same problem with the same margins.
    Lengths are those of the polylines through the waypoints, in the metric of the search and as distance
    driven.
    """
    lengths, drives, times, difference = [], [], Times(time.thread_time), []
    for case in problems(KINDS["base and arm, pillar"], count, 0, blocked=True):
        free = np.array([case.pepper.joint_index(joint) for joint in case.joints])
        checks = Checks(case.pepper, case.scene)
        search = path_problem(checks, case.start, case.goal[None], free, 0.01, STEP_OF_PLAN).search_problem
        long = planners.aorrtc(search, timeout=seconds, seed=1)
        plan = times("plan", pk.plan, *case.ends, case.scene, joints=case.joints)
        if not plan.success or not long.success:
            lengths.append(np.inf)
            continue
        path = planners.Path(plan.path[:, free], search.metric.weights)
        lengths.append(path.length / long.cost)
        drives.append(driven(path.points) / driven(long.path.points))
        difference.append(driven(path.points) - driven(long.path.points))
    cells = [" ".join(f"{x:.3f}" for x in np.quantile(some, (0.5, 0.9, 1.0))) for some in (lengths, drives)]
    yield (
        "problems | at most 1.1 times as long | length: median, 90 %, worst | driven: median, 90 %, worst "
        "| most driven beyond, m {:.2f} | plan, ms {:.0f}",
        len(lengths), np.sum(np.array(lengths) <= 1.1), *cells, max(difference), times.at("plan"),
    )  # fmt: skip
    for base in ("planar", "fixed"):
        yield from among_boxes(base, 10 * count)
