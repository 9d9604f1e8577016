"""MotionBenchMaker's problems for Panda and Fetch: planning, shortest paths, and optimized motions."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import itertools
import json
import lzma
import re
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
from harness import Times, figures, peer, timed
from numba import cfunc, types

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.collision.fast import FastChecker
from pepper_kin.exceptions import PepperKinError
from pepper_kin.motion import Cost, optimize
from pepper_kin.planners import deadline, search_space

vamp = peer(importlib.import_module, "vamp")
RESOLUTION = 1.0 / 32.0
TIMEOUT = 1.0
RANGE = 1.0
FINE = 0.002


def scene_of(problem: dict[str, Any]) -> pk.Scene:
    """Return the obstacles as VAMP takes them: cylinders as capsules, in class `box` as boxes."""
    scene = pk.Scene()
    for number, item in enumerate(problem["box"] + problem["cylinder"] + problem["sphere"]):
        name, position = f"{number} {item['name']}", item["position"]
        rpy = pinocchio.rpy.matrixToRpy(np.array(item["R"])) if "R" in item else np.zeros(3)
        if "half_extents" in item:
            scene = scene.add_box(name, 2.0 * np.array(item["half_extents"]), position, rpy)
        elif "length" not in item:
            scene = scene.add_sphere(name, item["radius"], position)
        elif problem["problem"] == "box":
            radius = item["radius"]
            scene = scene.add_box(name, [2 * radius, 2 * radius, item["length"]], position, rpy)
        else:
            scene = scene.add_capsule(name, item["radius"], item["length"], position, rpy)
    return scene


class Ours:
    """Our search with the joints, resolution and longest extension that VAMP has."""

    def __init__(self, name: str, resources: Path, joints: list[str], meshes: bool) -> None:
        folder = resources / name
        urdf = folder / f"{name}{'' if meshes else '_spherized'}.urdf"
        self.robot = pk.load_robot(urdf, folder / f"{name}.srdf", [resources, folder])
        self.joints = tuple(joints)
        self.free = np.array([self.robot.joint_index(joint) for joint in joints])
        self.low, self.high = self.robot.lower_limits[self.free], self.robot.upper_limits[self.free]

    def whole(self, states: Any) -> np.ndarray:
        """Return whole configurations of states of the free joints."""
        rows = np.atleast_2d(np.clip(states, self.low, self.high))
        q = np.tile(self.robot.neutral(), (len(rows), 1))
        q[:, self.free] = rows
        return q

    def problem(self, scene: pk.Scene, start: Any, goals: Any) -> planners.Problem:
        """Return a problem of the free joints; its check is made."""
        made = FastChecker(self.robot, scene).compiled(self.robot.neutral(), self.free)
        block = made.new_memory()
        validity = planners.CompiledMotionValidator(
            made.address, len(self.free), lambda: block, keep_alive=made
        )
        ends = np.clip(start, self.low, self.high), np.clip(goals, self.low, self.high)
        return planners.Problem(self.low, self.high, *ends, validity, resolution=RESOLUTION)

    def touches(self, scene: pk.Scene, path: np.ndarray) -> bool:
        """Whether coal finds a contact along a path of whole configurations."""
        rows = [path[:1]]
        for a, b in itertools.pairwise(path):
            count = max(1, int(np.ceil(np.abs(b - a).max() / FINE)))
            rows.append(a + (b - a) * np.arange(1, count + 1)[:, None] / count)
        return bool(pk.collision.checker_for(self.robot, scene).in_collision(np.concatenate(rows)).any())


def problems_of(name: str, folder: Path) -> Any:
    """Return joints and problems, by class, of a robot."""
    return json.loads(lzma.decompress((folder / f"{name}.json.xz").read_bytes()))


def valid_problems(name, folder, resources, count, module, meshes=False) -> Iterator[tuple]:
    """Yield our search, class, number, both scenes, start and goals of what both checks call valid."""
    data = problems_of(name, folder)
    ours = Ours(name, resources, data["joints"], meshes)
    for kind, problems in data["problems"].items():
        for number, problem in enumerate(problems[:count]):
            environment, start = vamp.problem_dict_to_vamp(problem), problem["start"]
            goals = [goal for goal in problem["goals"] if module.validate(goal, environment)]
            scene = scene_of(problem)
            if not goals or not module.validate(start, environment):
                continue
            if not pk.collision.in_collision(ours.robot, ours.whole([start, *goals]), scene).any():
                yield ours, kind, number, scene, environment, start, goals


def sampled(curve: Any) -> np.ndarray:
    """Return states of a curve, close to one another."""
    chunks = []
    for k, length in enumerate(np.diff(curve.breaks)):
        ends = curve.at(np.full(20, k), np.linspace(0.0, length, 20))
        count = int(np.ceil(np.abs(np.diff(ends, axis=0)).max(axis=1).sum() / FINE)) + 2
        chunks.append(curve.at(np.full(count, k), np.linspace(0.0, length, count)))
    return np.concatenate(chunks)


@figures("benchmarks/planners.md", "VAMP, its resources and MotionBenchMaker's problems", count=1, plan=True)
def planning_vamp(
    problems: Path, resources: Path, robots=("panda", "fetch"), count=50, meshes=False, plan=False
) -> Iterator[tuple | str]:
    """Planning beside VAMP, in one process and in turn, on MotionBenchMaker's problems.

    VAMP (KavrakiLab, Apache-2.0) is built beside the project; its module must be on the path.  `problems` is
    a folder with `panda.json.xz` and `fetch.json.xz`, `resources` the folder of that name of VAMP's
    repository, where the robots' descriptions are.  Our times are processor time of whole calls from Python;
    of VAMP, the time by its own clock, which leaves out its allocation of memory, and processor time of the
    whole call are printed.  Problems with an end that VAMP's own check calls invalid are left out.  Ratios
    are medians over problems that both solve.  "Preparation" is our making of check and problem for a new
    scene, "plan" is `pk.plan` with its goals, margins, smoothing and last examination, beside VAMP's search
    and simplification, and "touch" counts paths that coal finds in contact at steps of 2 mrad.
    """
    rows = []
    for name in robots:
        module, search, settings, simplify = vamp.configure_robot_and_planner_with_kwargs(name, "rrtc")
        settings.max_samples = 100_000
        times, ratios, counts = Times(), defaultdict(list), Counter()
        for ours, kind, _, scene, environment, start, goals in valid_problems(
            name, problems, resources, count, module, meshes
        ):
            counts["valid"] += 1
            found = times("whole", search, start, goals, environment, settings, module.halton())
            task = times("prepared", ours.problem, scene, start, goals)
            result = times("search", planners.rrt_connect, task, timeout=TIMEOUT, step=RANGE)
            counts["VAMP"] += found.solved
            if found.solved and result.success:
                counts["search"] += 1
                times["VAMP"].append(1e-9 * found.nanoseconds)
                ratios[kind].append(times["search"][-1] / times["VAMP"][-1])
                ratios["whole"].append(times["search"][-1] / times["whole"][-1])
            else:
                del times["whole"][-1], times["search"][-1]
            if plan and found.solved:
                peer = module, environment, found, simplify
                beside(times, ratios, counts, ours, scene, peer, start, goals)
        kinds = [kind for kind in ratios if kind not in ("whole", "plan", "length")]
        for kind in kinds:
            solved, middle = len(ratios[kind]), np.median(ratios[kind])
            yield f"{name}, {kind}: {solved} solved by both, median ratio {middle:.2f}"
        whole = [times.at(what, unit=1e6) for what in ("VAMP", "whole", "search")]
        medians = np.median(np.concatenate([ratios[kind] for kind in kinds])), np.median(ratios["whole"])
        cells = [name, counts["valid"], counts["VAMP"], counts["search"], *whole, *medians]
        cells.append(times.at("prepared"))
        if plan:
            cells += counts["plan"], times.at("plan"), np.median(ratios["plan"]), np.median(ratios["length"])
            cells += counts["plan touches"], counts["VAMP touches"]
        rows.append(cells)
    head = (
        "robot | valid | VAMP solves | of these ours | VAMP, us {:.0f} | its whole call, us {:.0f} | "
        "ours, us {:.0f} | ratio {:.2f} | to its whole call {:.2f} | preparation, ms {:.1f}"
    )
    more = " | plan solves | plan, ms {:.2f} | ratio {:.1f} | length {:.3f} | plans touch | VAMP's touch"
    yield from ((head + more * plan, *cells) for cells in rows)


def beside(times, ratios, counts, ours: Ours, scene: pk.Scene, peer: Any, start: Any, goals: Any) -> None:
    """Time `pk.plan` and VAMP's simplification of the path that it found."""
    module, environment, found, settings = peer
    simple = module.simplify(found.path, environment, settings, module.halton())
    ends = ours.whole(start)[0], ours.whole(goals)[0]
    plan, taken = timed(pk.plan, ours.robot, *ends, scene, joints=ours.joints, timeout=2 * TIMEOUT)
    path = np.array(simple.path.numpy(), dtype=float)
    counts["VAMP touches"] += ours.touches(scene, ours.whole(path))
    if plan.success:
        counts["plan"] += 1
        times["plan"].append(taken)
        ratios["plan"].append(taken / (1e-9 * (found.nanoseconds + simple.nanoseconds)))
        lengths = [np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in (plan.path[:, ours.free], path)]
        ratios["length"].append(lengths[0] / lengths[1])
        counts["plan touches"] += ours.touches(scene, sampled(plan.curve))


_clock = ctypes.CDLL(None).clock_gettime
_clock.argtypes, _clock.restype = [ctypes.c_int32, ctypes.c_void_p], ctypes.c_int32
_PROCESS = int(time.CLOCK_PROCESS_CPUTIME_ID)


@cfunc(types.int32(types.int32, types.voidptr))
def processor_clock(_, place):  # type: ignore[no-untyped-def]
    """Stand in for `clock_gettime`, with the processor time of this process."""
    return _clock(_PROCESS, place)


def length_of_vamp(peer: Any, task: planners.Problem, start: Any, goals: Any) -> tuple[float, float]:
    """Return the length of the path of VAMP's AORRTC, infinite where there is none, and its time [s]."""
    module, search, settings, environment = peer
    found, taken = timed(search, start, goals, environment, settings, module.halton())
    if not found.solved:
        return np.inf, taken
    points = np.clip(np.array(found.path.numpy(), dtype=float), task.lower, task.upper)
    path = planners.Path(points)
    valid = bool(task.validity(path.resample(RESOLUTION).points).all())
    return (path.length if valid else np.inf), taken


@figures("benchmarks/planners.md", "VAMP, its resources and MotionBenchMaker's problems", count=1, long=0.0)
def optimal_planning(
    problems: Path,
    resources: Path,
    robots=("panda", "fetch"),
    count=5,
    budget=1.0,
    long=5.0,
    iterations=20_000,
    best: Path | None = None,
) -> Iterator[tuple]:
    """The gap of AORRTC to the best known length on MotionBenchMaker's problems, beside VAMP's AORRTC.

    Problems, resources and scenes are those of `planning_vamp`.  Our time budget is processor time; of VAMP's
    own AORRTC the length after a number of iterations and its processor time are printed.  The best known
    length of a problem is the least of all runs here, the longest of ours being `long` seconds, and of those
    that `best`, a JSON file of earlier runs, holds; it is renewed after each problem.  VAMP's time grows with
    the square of its iterations: 100,000 take up to 20 s.  A path of VAMP's counts if our check, at the same
    resolution, finds it valid.
    """
    search_space.CLOCK, deadline.perf_counter = processor_clock.address, time.process_time
    known = json.loads(best.read_text()) if best is not None and best.exists() else {}
    for name in robots:
        module, search, settings, _ = vamp.configure_robot_and_planner_with_kwargs(name, "aorrtc")
        settings.max_iterations = settings.max_samples = iterations
        rows = {}
        for ours, kind, number, scene, environment, start, goals in valid_problems(
            name, problems, resources, count, module
        ):
            task, key = ours.problem(scene, start, goals), f"{name} {kind} {number}"
            theirs, taken = length_of_vamp((module, search, settings, environment), task, start, goals)
            found = planners.aorrtc(task, timeout=budget, step=RANGE)
            lengths = [theirs, found.cost, known.get(key, np.inf)]
            if long > 0.0:
                lengths.append(planners.aorrtc(task, timeout=long, step=RANGE, seed=1).cost)
            known[key] = float(min(lengths))
            rows[key] = found.history[0].cost if found.history else np.inf, found.cost, theirs, taken
            if best is not None:
                best.write_text(json.dumps(known))
            print(f"{key}: {found.cost:.4f}, VAMP's {theirs:.4f}, best {known[key]:.4f}", file=sys.stderr)
        *columns, taken = np.array(list(rows.values())).T
        first, gaps, theirs = (100 * (column / [known[key] for key in rows] - 1.0) for column in columns)
        median, late = np.quantile(gaps, (0.5, 0.9))
        yield (
            "robot | problems | first path, gap % {:.0f} | AORRTC: gap %, median, 90 % | within 2 % {:.1%} "
            "| VAMP's: gap %, median {:.2f} | within 2 % {:.1%} | its time, s {:.2f}",
            name, len(rows), np.median(first), f"{median:.2f}, {late:.2f}", np.mean(gaps <= 2.0),
            np.median(theirs), np.mean(theirs <= 2.0), np.median(taken),
        )  # fmt: skip


ACCELERATION = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
"""[rad/s^2], from https://frankaemika.github.io/docs/control_parameters.html."""
CHECKED_WITH_JERK = (
    "position", "velocity", "acceleration", "jerk", "torque", "velocity_continuity", "obstacle_clearance",
    "self_clearance",
)  # fmt: skip


def panda_with_limits(resources: Path) -> pk.PepperModel:
    """Return the Panda with limits of acceleration."""
    folder, limits = resources / "panda", iter(ACCELERATION)
    text = re.sub(
        r"<joint name=\"panda_joint[1-7]\".*?</joint>",
        lambda joint: joint[0].replace("<limit ", f'<limit acceleration="{next(limits)}" '),
        (folder / "panda_spherized.urdf").read_text(),
        flags=re.DOTALL,
    )
    with tempfile.TemporaryDirectory() as here:
        urdf = Path(here) / "panda.urdf"
        urdf.write_text(text)
        return pk.load_robot(urdf, folder / "panda.srdf", [resources, folder])


@figures("benchmarks/optimization.md", "VAMP's resources and MotionBenchMaker's problems", count=1)
def optimization_mbm(
    problems: Path, resources: Path, count=10, jerk=30.0, weight=1e-6, solver="newton"
) -> Iterator[tuple]:
    """Plans optimized, beside the same plans retimed within the same limits of jerk, on the Panda.

    MotionBenchMaker's problems and the resources are those of `planning_vamp`, `count` of each class.  Limits
    of acceleration are Franka's, which the description lacks; those of jerk are `jerk` times these in a
    second; `weight` is that of the jerk in the cost [s].  "certified" are motions whose certificate is green:
    position, velocity, acceleration, jerk, torque and clearance.  Times are processor time of whole calls.
    """
    data, robot, total = problems_of("panda", problems), panda_with_limits(resources), Counter()
    cost, whole = Cost(jerk=weight), defaultdict(list)
    low, high = robot.lower_limits, robot.upper_limits

    def run(problem: dict[str, Any], counts: Counter[str], rows: dict[str, list[float]]) -> None:
        scene, start = scene_of(problem), np.clip(problem["start"], low, high)
        goals = np.clip(problem["goals"], low, high)
        touching = pk.collision.in_collision(robot, np.array([start, *goals]), scene)
        if touching[0] or touching[1:].all():
            return
        counts["valid"] += 1
        goal = goals[int(np.argmin(touching[1:]))]
        plan, planning = timed(pk.plan, robot, start, goal, scene, timeout=2.0)
        if not plan.success:
            return
        counts["planned"] += 1
        found, optimizing = timed(optimize, robot, plan, scene, cost=cost, jerk=jerk, solver=solver)
        if found.status.value != "improved":
            counts[f"status {found.status.value}"] += 1
        if not found.success:
            return
        check = found.trajectory.check(robot, scene, jerk=jerk)
        counts["certified"] += all(getattr(check, part).success for part in CHECKED_WITH_JERK)
        with contextlib.suppress(PepperKinError):
            retimed, retiming = timed(pk.retime, robot, plan, jerk=jerk)
            for name, value in (
                ("plan", planning), ("optimize", optimizing), ("both", planning + optimizing),
                ("retime", retiming), ("ratio", found.trajectory.duration / retimed.duration),
            ):  # fmt: skip
                rows[name].append(value)

    def row(kind: str, counts: Counter[str], rows: dict[str, list[float]]) -> tuple:
        middle = {name: np.median(rows[name] or np.nan) for name in ("plan", "optimize", "both", "retime")}
        others = (f"{n} {what.removeprefix('status ')}" for what, n in counts.items() if "status" in what)
        return (
            "class | valid | planned | certified | plan, ms {:.1f} | optimize, ms {:.1f} | both, ms {:.1f} | "
            "both, 90 %, ms {:.1f} | retiming, ms {:.1f} | duration over retimed {:.3f} | else",
            kind, counts["valid"], counts["planned"], counts["certified"],
            *(1e3 * middle[name] for name in ("plan", "optimize", "both")),
            1e3 * np.quantile(rows["both"] or np.nan, 0.9), 1e3 * middle["retime"],
            np.median(rows["ratio"] or np.nan), ", ".join(others),
        )  # fmt: skip

    run(
        next(iter(data["problems"].values()))[0], Counter(), defaultdict(list)
    )  # compiles what is not compiled
    for kind, cases in data["problems"].items():
        counts, rows = Counter(), defaultdict(list)
        for problem in cases[:count]:
            run(problem, counts, rows)
        yield row(kind, counts, rows)
        total += counts
        for name, values in rows.items():
            whole[name] += values
    yield row("all", total, whole)
