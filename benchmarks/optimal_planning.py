"""The gap of AORRTC to the best known length on MotionBenchMaker's problems, beside VAMP's AORRTC.

VAMP (KavrakiLab, Apache-2.0) is built beside the project; see `planning_vamp.py` for what PROBLEMS and
RESOURCES are, for the scenes, and for what counts as a problem.  Our time budget is processor time; of VAMP's
own AORRTC the length after a number of iterations and its processor time are printed.  The best known length
of a problem is the least of all runs here, the longest of ours being LONG seconds, and of those that BEST, a
JSON file of earlier runs, holds; it is renewed after each problem.  VAMP's time grows with the square of its
iterations: 100,000 take up to 20 s.  A path of VAMP's counts if our check, at the same
resolution, finds it valid.

    python benchmarks/optimal_planning.py PROBLEMS RESOURCES [--robots panda fetch] [--count 5] [--budget 1]
    [--long 5] [--iterations 20000] [--best BEST]

Prints Markdown.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import lzma
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio  # noqa: F401 - before vamp, which brings libraries of its own
import vamp
from numba import cfunc, types
from planning_vamp import RANGE, RESOLUTION, Ours, scene_of

import pepper_kin as pk
from pepper_kin import planners
from pepper_kin.planners import deadline, search_space

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
    begin = time.process_time()
    found = search(start, goals, environment, settings, module.halton())
    taken = time.process_time() - begin
    if not found.solved:
        return np.inf, taken
    points = np.clip(np.array(found.path.numpy(), dtype=float), task.lower, task.upper)
    path = planners.Path(points)
    valid = bool(task.validity(path.resample(RESOLUTION).points).all())
    return (path.length if valid else np.inf), taken


def measured(name: str, arguments: argparse.Namespace, best: dict[str, float]) -> str:
    """Run the problems of a robot; return a row of the table."""
    data = json.loads(lzma.decompress((arguments.problems / f"{name}.json.xz").read_bytes()))
    module, search, settings, _ = vamp.configure_robot_and_planner_with_kwargs(name, "aorrtc")
    settings.max_iterations = settings.max_samples = arguments.iterations
    ours = Ours(name, arguments.resources, data["joints"], False)
    rows, keys = [], []
    for kind, problems in data["problems"].items():
        for number, problem in enumerate(problems[: arguments.count]):
            environment, start = vamp.problem_dict_to_vamp(problem), problem["start"]
            goals = [goal for goal in problem["goals"] if module.validate(goal, environment)]
            scene = scene_of(problem)
            if not goals or not module.validate(start, environment):
                continue
            if pk.collision.in_collision(ours.robot, ours.whole([start, *goals]), scene).any():
                continue
            task, key = ours.problem(scene, start, goals), f"{name} {kind} {number}"
            peer = (module, search, settings, environment)
            theirs, taken = length_of_vamp(peer, task, start, goals)
            found = planners.aorrtc(task, timeout=arguments.budget, step=RANGE)
            lengths = [theirs, found.cost, best.get(key, np.inf)]
            if arguments.long > 0.0:
                lengths.append(planners.aorrtc(task, timeout=arguments.long, step=RANGE, seed=1).cost)
            best[key] = float(min(lengths))
            first = found.history[0].cost if found.history else np.inf
            rows.append((first, found.cost, theirs, taken))
            keys.append(key)
            if arguments.best is not None:
                arguments.best.write_text(json.dumps(best))
            print(f"{key}: {found.cost:.4f}, VAMP's {theirs:.4f}, best {best[key]:.4f}", file=sys.stderr)
    known = np.array([best[key] for key in keys])
    first, gaps, theirs = (np.array([row[k] for row in rows]) / known - 1.0 for k in range(3))
    cells = [f"{name}", f"{len(keys)}", f"{100 * np.median(first):.0f}"]
    cells += [
        f"{100 * np.median(gaps):.2f}, {100 * np.quantile(gaps, 0.9):.2f}",
        f"{np.mean(gaps <= 0.02):.1%}",
    ]
    cells += [f"{100 * np.median(theirs):.2f}", f"{np.mean(theirs <= 0.02):.1%}"]
    cells += [f"{np.median([row[3] for row in rows]):.2f}"]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("resources", type=Path)
    parser.add_argument("--robots", nargs="+", default=["panda", "fetch"])
    parser.add_argument("--count", type=int, default=5)
    parser.add_argument("--budget", type=float, default=1.0)
    parser.add_argument("--long", type=float, default=5.0)
    parser.add_argument("--iterations", type=int, default=20_000)
    parser.add_argument("--best", type=Path)
    arguments = parser.parse_args()
    search_space.CLOCK, deadline.perf_counter = processor_clock.address, time.process_time
    known = arguments.best is not None and arguments.best.exists()
    best = json.loads(arguments.best.read_text()) if known else {}
    rows = [measured(name, arguments, best) for name in arguments.robots]
    print("| robot | problems | first path, gap % | AORRTC: gap %, median, 90 % | within 2 % ", end="")
    print("| VAMP's: gap %, median | within 2 % | its time, s |")
    print("|---" * 8 + "|\n" + "\n".join(rows))


if __name__ == "__main__":
    main()
