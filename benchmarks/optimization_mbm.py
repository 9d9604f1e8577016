"""Plans optimized, beside the same plans retimed within the same limits of jerk, on MotionBenchMaker's Panda.

PROBLEMS is a folder with `panda.json.xz`, RESOURCES the folder `resources` of VAMP's repository, where the
robot's spheres are.  Limits of acceleration are Franka's, which the description lacks; those of jerk are
`--jerk` times these in a second.  "certified" are motions whose certificate is green: position, velocity,
acceleration, jerk, torque and clearance.  Times are processor time of whole calls.

    python benchmarks/optimization_mbm.py PROBLEMS RESOURCES [--count 10] [--jerk 30] [--solver newton]

Prints Markdown.
"""

from __future__ import annotations

import argparse
import itertools
import json
import lzma
import re
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio

import pepper_kin as pk
from pepper_kin.exceptions import PepperKinError
from pepper_kin.motion import Cost, optimize

ACCELERATION = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
"""[rad/s^2], from https://frankaemika.github.io/docs/control_parameters.html."""
CHECKED = (
    "position",
    "velocity",
    "acceleration",
    "jerk",
    "torque",
    "velocity_continuity",
    "obstacle_clearance",
    "self_clearance",
)


def robot_of(resources: Path) -> pk.PepperModel:
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


def spent(call: Any) -> tuple[Any, float]:
    """Return what a call returns, and its processor time."""
    begin = time.process_time()
    return call(), time.process_time() - begin


class Tally:
    """What was measured of the problems of a class."""

    def __init__(self) -> None:
        self.valid = self.planned = self.certified = 0
        self.statuses: Counter[str] = Counter()
        self.rows: list[tuple[float, float, float, float, float]] = []
        self.retiming_failed = 0

    def run(self, robot: pk.PepperModel, problem: dict[str, Any], arguments: argparse.Namespace) -> None:
        """Plan, optimize and retime one problem."""
        scene, low, high = scene_of(problem), robot.lower_limits, robot.upper_limits
        start = np.clip(problem["start"], low, high)
        goals = [np.clip(goal, low, high) for goal in problem["goals"]]
        touching = pk.collision.in_collision(robot, np.array([start, *goals]), scene)
        if touching[0] or touching[1:].all():
            return
        goal = goals[int(np.argmin(touching[1:]))]
        self.valid += 1
        plan, planning = spent(lambda: pk.plan(robot, start, goal, scene, timeout=2.0))
        if not plan.success:
            return
        self.planned += 1
        cost = Cost(jerk=arguments.weight)
        found, optimizing = spent(
            lambda: optimize(robot, plan, scene, cost=cost, jerk=arguments.jerk, solver=arguments.solver)
        )
        self.statuses[found.status.value] += 1
        if not found.success:
            return
        check = found.trajectory.check(robot, scene, jerk=arguments.jerk)
        self.certified += all(getattr(check, part).success for part in CHECKED)
        try:
            retimed, retiming = spent(lambda: pk.retime(robot, plan, jerk=arguments.jerk))
        except PepperKinError:
            self.retiming_failed += 1
            return
        ratio = found.trajectory.duration / retimed.duration
        self.rows.append((planning, optimizing, planning + optimizing, retiming, ratio))

    def row(self, name: str) -> str:
        """Return a row of the table."""
        columns = np.array(self.rows).reshape(-1, 5)
        middle = np.median(columns, axis=0) if len(columns) else np.full(5, np.nan)
        late = np.quantile(columns[:, 2], 0.9) if len(columns) else np.nan
        cells = [
            name, f"{self.valid}", f"{self.planned}", f"{self.certified}",
            *(f"{1e3 * value:.1f}" for value in middle[:3]), f"{1e3 * late:.1f}",
            f"{1e3 * middle[3]:.1f}", f"{middle[4]:.3f}",
            ", ".join(f"{count} {status}" for status, count in self.statuses.items() if status != "improved"),
        ]  # fmt: skip
        return "| " + " | ".join(cells) + " |"

    def __add__(self, other: Tally) -> Tally:
        both = Tally()
        both.valid, both.planned = self.valid + other.valid, self.planned + other.planned
        both.certified, both.rows = self.certified + other.certified, self.rows + other.rows
        both.statuses = self.statuses + other.statuses
        return both


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("resources", type=Path)
    parser.add_argument("--count", type=int, default=10, help="problems of each class")
    parser.add_argument("--jerk", type=float, default=30.0, help="limits over those of acceleration [1/s]")
    parser.add_argument("--weight", type=float, default=1e-6, help="weight of the jerk in the cost [s]")
    parser.add_argument("--solver", default="newton")
    arguments = parser.parse_args()
    data = json.loads(lzma.decompress((arguments.problems / "panda.json.xz").read_bytes()))
    robot, tallies = robot_of(arguments.resources), {}
    Tally().run(robot, next(iter(data["problems"].values()))[0], arguments)  # compiles what is not compiled
    for kind, problems in data["problems"].items():
        tallies[kind] = Tally()
        for problem in itertools.islice(problems, arguments.count):
            tallies[kind].run(robot, problem, arguments)
    print(
        "| class | valid | planned | certified | plan, ms | optimize, ms | both, ms | both, 90 %, ms ", end=""
    )
    print("| retiming, ms | duration over retimed | else |\n" + "|---" * 11 + "|")
    total = Tally()
    for kind, tally in tallies.items():
        print(tally.row(kind))
        total += tally
    print(total.row("all"))


if __name__ == "__main__":
    main()
