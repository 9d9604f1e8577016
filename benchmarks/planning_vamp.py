"""Planning beside VAMP, in one process and in turn, on MotionBenchMaker's problems.

VAMP (KavrakiLab, Apache-2.0) is built beside the project; its module must be on the path.  PROBLEMS is a
folder with `panda.json.xz` and `fetch.json.xz`, RESOURCES the folder `resources` of VAMP's repository, where
the robots' descriptions are.  Our times are processor time of whole calls from Python; of VAMP, the time by
its own clock, which leaves out its allocation of memory, and processor time of the whole call are printed.
Problems with an end that VAMP's own check calls invalid are left out.  Ratios are medians over problems that
both solve.  "Preparation" is our making of check and problem for a new scene, "plan" is `pk.plan` with its
goals, margins, smoothing and last examination, beside VAMP's search and simplification, and "touch" counts
paths that coal finds in contact at steps of 2 mrad.

    python benchmarks/planning_vamp.py PROBLEMS RESOURCES [--robots panda fetch] [--count 50] [--meshes]
    [--plan]

Prints Markdown.
"""

from __future__ import annotations

import argparse
import itertools
import json
import lzma
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import vamp

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.collision.fast import FastChecker

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


def sampled(curve: Any) -> np.ndarray:
    """Return states of a curve, close to one another."""
    chunks = []
    for k, length in enumerate(np.diff(curve.breaks)):
        ends = curve.at(np.full(20, k), np.linspace(0.0, length, 20))
        count = int(np.ceil(np.abs(np.diff(ends, axis=0)).max(axis=1).sum() / FINE)) + 2
        chunks.append(curve.at(np.full(count, k), np.linspace(0.0, length, count)))
    return np.concatenate(chunks)


class Tally:
    """What was measured of one robot."""

    def __init__(self) -> None:
        self.valid = self.vamp = self.search = self.plan = self.plan_touches = self.vamp_touches = 0
        self.ratios: dict[str, list[float]] = defaultdict(list)
        self.prepared: list[float] = []
        self.times: dict[str, list[float]] = defaultdict(list)
        self.lengths: list[float] = []

    def row(self, name: str) -> str:
        """Return a row of the table."""
        every = [ratio for ratios in self.ratios.values() for ratio in ratios]
        planned = self.times["plan ratio"]
        cells = [
            name, f"{self.valid}", f"{self.vamp}", f"{self.search}",
            f"{1e6 * np.median(self.times['VAMP']):.0f}", f"{1e6 * np.median(self.times['whole']):.0f}",
            f"{1e6 * np.median(self.times['search']):.0f}", f"{np.median(every):.2f}",
            f"{np.median(self.times['whole ratio']):.2f}", f"{1e3 * np.median(self.prepared):.1f}",
        ]  # fmt: skip
        if planned:
            cells += [
                f"{self.plan}", f"{1e3 * np.median(self.times['plan']):.2f}", f"{np.median(planned):.1f}",
                f"{np.median(self.lengths):.3f}", f"{self.plan_touches}", f"{self.vamp_touches}",
            ]  # fmt: skip
        return "| " + " | ".join(cells) + " |"


def measured(name: str, arguments: argparse.Namespace) -> Tally:
    """Run all problems of a robot."""
    data = json.loads(lzma.decompress((arguments.problems / f"{name}.json.xz").read_bytes()))
    module, search, settings, simplify = vamp.configure_robot_and_planner_with_kwargs(name, "rrtc")
    settings.max_samples = 100_000
    ours, tally = Ours(name, arguments.resources, data["joints"], arguments.meshes), Tally()
    for kind, problems in data["problems"].items():
        for problem in problems[: arguments.count]:
            environment, start = vamp.problem_dict_to_vamp(problem), problem["start"]
            goals = [goal for goal in problem["goals"] if module.validate(goal, environment)]
            scene = scene_of(problem)
            if not goals or not module.validate(start, environment):
                continue
            if pk.collision.in_collision(ours.robot, ours.whole([start, *goals]), scene).any():
                continue  # with meshes
            tally.valid += 1
            begin = time.process_time()
            found = search(start, goals, environment, settings, module.halton())
            whole = time.process_time() - begin
            begin = time.process_time()
            task = ours.problem(scene, start, goals)
            middle = time.process_time()
            result = planners.rrt_connect(task, timeout=TIMEOUT, step=RANGE)
            taken = time.process_time() - middle
            tally.prepared.append(middle - begin)
            tally.vamp += found.solved
            tally.search += found.solved and result.success
            if found.solved and result.success:
                tally.ratios[kind].append(taken / (1e-9 * found.nanoseconds))
                tally.times["VAMP"].append(1e-9 * found.nanoseconds)
                tally.times["whole"].append(whole)
                tally.times["whole ratio"].append(taken / whole)
                tally.times["search"].append(taken)
            if arguments.plan and found.solved:
                beside(tally, ours, scene, (module, environment, found, simplify), start, goals)
    for kind, ratios in tally.ratios.items():
        print(f"{name}, {kind}: {len(ratios)} solved by both, median ratio {np.median(ratios):.2f}")
    return tally


def beside(tally: Tally, ours: Ours, scene: pk.Scene, peer: Any, start: Any, goals: Any) -> None:
    """Time `pk.plan` and VAMP's simplification of the path that it found."""
    module, environment, found, settings = peer
    simple = module.simplify(found.path, environment, settings, module.halton())
    goal = ours.whole(goals)
    begin = time.process_time()
    plan = pk.plan(ours.robot, ours.whole(start)[0], goal[0], scene, joints=ours.joints, timeout=2 * TIMEOUT)
    taken = time.process_time() - begin
    tally.plan += plan.success
    path = np.array(simple.path.numpy(), dtype=float)
    tally.vamp_touches += ours.touches(scene, ours.whole(path))
    if plan.success:
        spent = 1e-9 * (found.nanoseconds + simple.nanoseconds)
        tally.times["plan"].append(taken)
        tally.times["plan ratio"].append(taken / spent)
        lengths = [np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in (plan.path[:, ours.free], path)]
        tally.lengths.append(lengths[0] / lengths[1])
        tally.plan_touches += ours.touches(scene, sampled(plan.curve))


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("resources", type=Path)
    parser.add_argument("--robots", nargs="+", default=["panda", "fetch"])
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--meshes", action="store_true")
    parser.add_argument("--plan", action="store_true")
    arguments = parser.parse_args()
    rows = [measured(name, arguments).row(name) for name in arguments.robots]
    head = "| robot | valid | VAMP solves | of these ours | VAMP, us | its whole call, us | ours, us | ratio "
    head += "| to its whole call | preparation, ms |"
    more = " plan solves | plan, ms | ratio | length | plans touch | VAMP's touch |"
    print("\n" + head + (more if arguments.plan else ""))
    print("|---" * (16 if arguments.plan else 10) + "|\n" + "\n".join(rows))


if __name__ == "__main__":
    main()
