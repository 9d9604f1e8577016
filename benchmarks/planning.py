"""Motion planning beside its peers: python benchmarks/planning.py [--count N] [--problems N].

Three tables.  First, whether one configuration is free, of the robot and of ten boxes: ours in a batch and
one at a time, coal's and RoboPlan's one at a time, all from Python, on the same shapes.  Second, RRT-Connect
past a table with one arm and with torso and arm: ours over the compiled check, OMPL's over coal's, called
from Python, and RoboPlan's, on the same problems in turn.  "Search" is `planners.rrt_connect` with the making
of problem and check; "plan" is `pk.plan`, with its margins, short-cuts, smoothing and last examination.
RoboPlan keeps no margin, knows neither the tabulated ranges of neighboring links nor what the joints can
hold, and measures steps in joint space: its step is ours over the root mean square of the joints' reaches.
Third, ten kinds of problems in a second each, every path examined by coal at steps of half a millimeter of
the fastest point; what is not solved is tried again for longer with other seeds, to tell whether it can be
solved at all.

RoboPlan needs an environment of its own (`pip install roboplan`), whose interpreter is named by
`--roboplan-python PATH`, and a process of its own, where its calls are timed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from planning_ompl import CompiledOmpl
from planning_peers import Roboplan, roboplan
from planning_scenes import ARM, KINDS, PEPPER, TORSO_AND_ARM, Kind, Problem, problems

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.collision.dependent_ranges import dependent_ranges
from pepper_kin.collision.fast import FastChecker, fast_checker_for
from pepper_kin.collision.motion_tree import motion_bounds
from pepper_kin.motion.checks import Checks
from pepper_kin.trajectory.path import as_cubic_path

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


def validity(peer: Roboplan | None) -> None:
    """Print how long it takes to tell whether one configuration is free."""
    scene, generator = ten_boxes(), np.random.default_rng(1)
    q = generator.uniform(PEPPER.lower_limits, PEPPER.upper_limits, (STATES, PEPPER.n))
    fast, coal = fast_checker_for(PEPPER, scene), pk.collision.checker_for(PEPPER, scene)
    ours = fast.in_collision(q)
    ranges = np.any([table.violated(q) for table in dependent_ranges(PEPPER)], axis=0)

    def batch() -> tuple[np.ndarray, float]:
        begin = time.perf_counter()
        return fast.in_collision(q), time.perf_counter() - begin

    def one_by_one(check: pk.collision.CollisionChecker | FastChecker) -> tuple[np.ndarray, float]:
        begin = time.perf_counter()
        found = [bool(check.in_collision(state)) for state in q]
        return np.array(found), time.perf_counter() - begin

    racers = {
        "ours, batch": batch,
        "ours, one at a time": lambda: one_by_one(fast),
        "coal, one at a time": lambda: one_by_one(coal),
    }
    if peer is not None:
        peer.furnish(scene)
        racers["RoboPlan, one at a time"] = lambda: (peer.in_collision(q), peer.time)
    times: dict[str, list[float]] = {name: [] for name in racers}
    alike: dict[str, float] = {}
    for _ in range(ROUNDS):
        for name, run in racers.items():
            found, spent = run()
            times[name].append(1e6 * spent / STATES)
            alike[name] = float((found == ours)[~ranges].mean())
    print("| one configuration, ten boxes | median [us] | same verdict, ranges aside [%] |")
    print("|---|---|---|")
    for name, spent in times.items():
        print(f"| {name} | {np.median(spent):.2f} | {100 * alike[name]:.2f} |", flush=True)


def race(kind: Kind, count: int, peer: Roboplan | None) -> None:
    """Print how long one search takes."""
    cases = problems(kind, count, 1, blocked=True)

    def search(problem: Problem, seed: int) -> bool:
        return planners.rrt_connect(toy(problem, compiled=True), seed=seed, timeout=5.0).success

    def whole(problem: Problem, seed: int) -> bool:
        plan = pk.plan(
            problem.pepper, problem.start, problem.goal, problem.scene, joints=problem.joints, seed=seed
        )
        return plan.success

    def ompl(problem: Problem, seed: int) -> bool:
        return planners.ompl_plan(toy(problem, compiled=False), "RRTConnect", timeout=5.0).success

    def other(problem: Problem, seed: int) -> bool:
        assert peer is not None
        weights = motion_bounds(problem.pepper)[[PEPPER.joint_index(name) for name in problem.joints]]
        step = RESOLUTION / float(np.sqrt(np.mean(weights**2)))
        return (
            peer.connect(problem.start, problem.goal, " and ".join(kind.groups), step, seed, 5.0) is not None
        )

    inside: dict[str, list[float]] = {}

    def compiled_ompl(name: str, by_edge: bool) -> Callable[[Problem, int], bool]:
        def run(problem: Problem, seed: int) -> bool:
            begin = time.perf_counter()
            one = CompiledOmpl(toy(problem, compiled=True), by_edge=by_edge)
            solved = one.solve(5.0)
            inside.setdefault(name, []).append(one.inside / (time.perf_counter() - begin))
            return solved

        return run

    racers = {"search": search, "plan": whole, "OMPL with coal": ompl}
    for name in ("states", "edges"):
        racers[f"OMPL, {name} by our compiled check"] = compiled_ompl(name, name == "edges")
    if peer is not None:
        peer.furnish(cases[0].scene)
        peer.group(" and ".join(kind.groups), cases[0].joints)
        racers["RoboPlan"] = other
    for run in racers.values():
        run(cases[0], 0)
    times: dict[str, list[float]] = {name: [] for name in racers}
    solved = dict.fromkeys(racers, 0)
    for seed, problem in enumerate(cases):
        for name, run in racers.items():
            begin = time.perf_counter()
            solved[name] += run(problem, seed)
            spent = time.perf_counter() - begin
            times[name].append(peer.time if peer is not None and name == "RoboPlan" else spent)
    base = np.array(times["search"])
    for name, found in times.items():
        milli = 1e3 * np.array(found)
        print(
            f"| {' and '.join(kind.groups)} | {name} | {100 * solved[name] / count:.0f} | "
            f"{np.median(milli):.2f} | {np.percentile(milli, 95):.2f} | {np.median(found / base):.1f} |",
            flush=True,
        )
    for name, ratios in inside.items():
        print(f"{name}: {100 * np.median(ratios):.0f} % of the time within callbacks", flush=True)


def is_clear(problem: Problem, plan: pk.motion.Plan) -> bool:
    """Whether coal finds nothing that touches along the spline through a plan's way-points."""
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


def breadth(name: str, kind: Kind, count: int) -> tuple[int, int]:
    """Print how many of one kind are solved in a second; returns how many were and how many can be."""
    solved = clear = solvable = 0
    times = []
    for seed, problem in enumerate(problems(kind, count, 2)):

        def plan(seed: int, timeout: float, problem: Problem = problem) -> pk.motion.Plan:
            return pk.plan(
                problem.pepper, problem.start, problem.goal, problem.scene, joints=problem.joints,
                margin=0.005, seed=seed, timeout=timeout,
            )  # fmt: skip

        begin = time.perf_counter()
        found = plan(seed, 1.0)
        times.append(time.perf_counter() - begin)
        solved += found.success
        clear += found.success and is_clear(problem, found)
        solvable += found.success or any(plan(1000 + k, 5.0).success for k in range(3))
    milli = 1e3 * np.array(times)
    print(
        f"| {name} | {count} | {solved} | {solvable} | {clear} | {np.median(milli):.1f} | "
        f"{milli.max():.0f} |",
        flush=True,
    )
    return solved, solvable


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--count", type=int, default=100, help="problems of each race")
    parser.add_argument("--problems", type=int, default=30, help="problems of each kind; 0 for none")
    parser.add_argument("--roboplan-python", help="interpreter of an environment with RoboPlan")
    options = parser.parse_args()
    peer = roboplan(options.roboplan_python, PEPPER)
    validity(peer)
    print("\n| joints | whole call | solved [%] | median [ms] | 95th percentile [ms] | time / search |")
    print("|---|---|---|---|---|---|")
    for groups in (ARM, TORSO_AND_ARM):
        race(Kind(KINDS["table"].scene, groups), options.count, peer)
    if peer is not None:
        peer.close()
    if not options.problems:
        return
    print(
        "\n| scene | problems | solved in 1 s | can be solved | clear by coal | median [ms] | longest [ms] |"
    )
    print("|---|---|---|---|---|---|---|")
    totals = np.array([breadth(name, kind, options.problems) for name, kind in KINDS.items()]).sum(axis=0)
    print(f"\n{totals[0]} of the {totals[1]} that can be solved were solved in a second.")


if __name__ == "__main__":
    main()
