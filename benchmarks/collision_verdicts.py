"""Verdicts of the compiled check beside coal's on five robots among ten objects, as Markdown.

python benchmarks/collision_verdicts.py                          # a million for each robot: hours
python benchmarks/collision_verdicts.py --count 20000 ur5 talos  # some robots only
python benchmarks/collision_verdicts.py --fetch vamp/resources/fetch  # the folder of Fetch's URDF and SRDF

Configurations are uniform within the joints' ranges, those without limits within a turn either way.
Scenes hold ten boxes, cylinders, spheres or capsules; there are eight, each without margins and with 13 mm to
the scene and 5 mm between parts of the robot.  What differs is looked at by coal's distance.  Files are
those of example-robot-data, which has no Fetch.
"""

from __future__ import annotations

import argparse
import time
from importlib import metadata
from pathlib import Path

import numpy as np
from collision import scene

import pepper_kin as pk
from pepper_kin.collision.fast import FastChecker

FILES = {
    "panda": ("panda_description/urdf/panda.urdf", "panda_description/srdf/panda.srdf"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "ur_description/srdf/ur5.srdf"),
    "talos": ("talos_data/robots/talos_reduced.urdf", "talos_data/srdf/talos.srdf"),
}
KINDS = ("box", "cylinder", "sphere", "capsule")
MARGINS = ((0.0, 0.0), (0.013, 0.005))
STATES = 2_000
"""Configurations checked together."""


def robot_of(name: str, fetch: Path | None) -> pk.PepperModel:
    if name == "pepper":
        return pk.load_pepper()
    if name == "fetch" and fetch is not None:
        return pk.load_robot(fetch / "fetch.urdf", fetch / "fetch.srdf", [fetch])
    share = Path(str(metadata.distribution("example-robot-data").locate_file("cmeel.prefix/share")))
    urdf, srdf = (share / "example-robot-data" / "robots" / file for file in FILES[name])
    return pk.load_robot(urdf, srdf, [share])


def compare(name: str, robot: pk.PepperModel, count: int) -> str:
    """Return a line of the table for a robot."""
    rng = np.random.default_rng(0)
    low = np.where(np.isfinite(robot.lower_limits), robot.lower_limits, -np.pi)
    high = np.where(np.isfinite(robot.upper_limits), robot.upper_limits, np.pi)
    done = touching = doubts = ties = differ = confirmed = 0
    spent = [0.0, 0.0]
    checkers = [
        FastChecker(robot, scene(kind, seed), *margins)
        for seed in (1, 2)
        for kind in KINDS
        for margins in MARGINS
    ]
    while done < count:
        fast = checkers[(done // STATES) % len(checkers)]
        q = rng.uniform(low, high, (min(STATES, count - done), robot.n))
        start = time.process_time()
        found = fast.in_collision(q)
        middle = time.process_time()
        wrong = np.flatnonzero(found != fast.exact.in_collision(q))
        spent[0] += middle - start
        spent[1] += time.process_time() - middle
        doubtful, tied = fast.doubts(q)
        done, touching = done + len(q), touching + int(found.sum())
        doubts, ties, differ = doubts + doubtful, ties + tied, differ + wrong.size
        for k in wrong:
            pairs = fast.exact.contact_points(q[k], within=1.0)
            margin = {True: fast.exact.self_margin, False: fast.exact.margin}
            near = any(
                pair.distance is None or pair.distance < margin[None not in pair.links] for pair in pairs
            )
            confirmed += near == found[k]
    share, unsure, ns, us = touching / done, doubts / done, spent[0] / done * 1e9, spent[1] / done * 1e6
    return (
        f"| {name} | {done:,} | {share:.1%} | {unsure:.2%} | {ties} | {differ} | {confirmed} "
        f"| {ns:.0f} | {us:.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", default=[], help=f"of pepper, {', '.join(FILES)}, fetch")
    parser.add_argument("--fetch", type=Path, help="folder of fetch.urdf, fetch.srdf and its meshes")
    parser.add_argument("--count", type=int, default=1_000_000)
    arguments = parser.parse_args()
    print("| robot | verdicts | in contact | left in doubt by balls | ties, asked of coal | differ from coal "
          "| of these, coal's distance confirms | compiled [ns] | coal [us] |")  # fmt: skip
    print("|---" * 9 + "|")
    for name in arguments.robots or ["pepper", *FILES, *(["fetch"] if arguments.fetch else [])]:
        print(compare(name, robot_of(name, arguments.fetch), arguments.count), flush=True)


if __name__ == "__main__":
    main()
