"""The machine code that comes with the package: which parts it has, and the command that makes the file.

    python -m pepper_kin.jobs.shipping            # make the file beside the sources
    python -m pepper_kin.jobs.shipping --check    # fail where it does not fit the sources

All compiled functions are in it, and the kernels that the everyday calls below ask for on the default
Peppers.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from pepper_kin import collision, dynamics, ik, kinematics
from pepper_kin.batch import kernel
from pepper_kin.collision import Scene
from pepper_kin.jobs.demo import run_demo
from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.shipping import shipped_keys, write_shipped
from pepper_kin.kernels.store import recorded
from pepper_kin.kernels.warm_up import compiled_modules
from pepper_kin.model import load_pepper
from pepper_kin.motion import plan
from pepper_kin.trajectory import retime
from pepper_kin.twin import Twin

LARGEST = 1_000_000
"""Size that the file must not exceed [bytes]."""

BATCHES = (
    "center_of_mass",
    "forward_dynamics",
    "gravity_torque",
    "inverse_dynamics",
    "mass_matrix",
    "zero_moment_point",
)
"""Quantities whose kernels come with the package."""


def everyday_calls() -> None:
    """Make the calls whose kernels come with the package, in the order in which a newcomer makes them."""
    pepper = load_pepper()
    point, scene = (0.38, 0.22, 0.82), Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))
    tasks = [ik.HandPosition("left", point), ik.LookAt(point)]
    found = plan(pepper, pepper.posture("Stand"), tasks, scene, seed=0)
    trajectory = retime(pepper, found, balance=0.01)
    trajectory.check(pepper, scene=scene)
    Twin(pepper, timestep=0.001).execute(trajectory)
    run_demo(pepper)
    _ik_calls(pepper)
    q = np.tile(pepper.neutral(), (64, 1))
    for frame in ("LArm_effector", "RArm_effector"):
        kinematics.frame_pose(pepper, q, frame)
        kinematics.frame_jacobian(pepper, q, frame)
    kinematics.frame_poses(pepper, q, tuple(dict.fromkeys(shape.link for shape in pepper.visual_shapes)))
    for quantity in BATCHES:
        kernel(pepper, quantity)
    collision.in_collision(pepper, q, scene)
    planar = load_pepper(base="planar")
    collision.in_collision(planar, np.tile(planar.neutral(), (64, 1)), scene)
    for other in (planar, load_pepper(hands="mimic")):
        state = np.tile(other.neutral(), (64, 1))
        dynamics.inverse_dynamics(other, state, state, state)
        ik.solve(other, tasks)


def _ik_calls(pepper: object) -> None:
    left, right, pose = (0.35, 0.2, 0.85), (0.35, -0.2, 0.85), np.eye(4)
    pose[:3, 3] = left
    for tasks in (
        [ik.HandPosition("left", left)],
        [ik.HandPosition("right", right)],
        [ik.HandPosition("right", right), ik.LookAt(right)],
        [ik.HandPosition("left", left), ik.HandPosition("right", right)],
        [ik.HandPosition("left", left), ik.HandPosition("right", right), ik.LookAt(left)],
        [ik.HandPose("left", pose)],
        [ik.HandPose("right", pose)],
        [ik.LookAt(left)],
    ):
        ik.solve(pepper, tasks)  # type: ignore[arg-type]


def shipped_parts(tell: Callable[[str], None] = lambda line: None) -> dict[str, tuple[str, bytes]]:
    """Return all parts that belong into the file, for the baseline processor: key -> name and content."""
    with recorded() as parts:
        tell("the everyday calls")
        everyday_calls()
        for name in compiled_modules():
            tell(name)
            importlib.import_module(name)
            unit_of(name).load()
        return dict(parts)


def stale_names() -> list[str]:
    """Return the compiled modules whose code in the package's file was made from other sources."""
    kept = shipped_keys()
    names = compiled_modules()
    return [name for name in names if importlib.import_module(name) and unit_of(name).key() not in kept]


def main(arguments: list[str] | None = None) -> int:
    """Run the command; the result is its exit code."""
    parser = argparse.ArgumentParser(prog="python -m pepper_kin.jobs.shipping", description=__doc__)
    parser.add_argument(
        "--check", action="store_true", help="compare the file with the sources, write nothing"
    )
    parser.add_argument(
        "--rebuild", action="store_true", help="with --check: make all parts, compare their list"
    )
    parser.add_argument(
        "-o", "--output", type=Path, help="where to write the file; beside the sources by default"
    )
    options = parser.parse_args(arguments)
    if options.check:
        return _check(options.rebuild)
    parts = shipped_parts(lambda name: print(f"  {name}", flush=True))
    size = write_shipped(parts, options.output)
    print(f"{len(parts)} parts, {size} bytes")
    return _report_size(size)


def _report_size(size: int) -> int:
    if size > LARGEST:
        print(f"the file has {size} bytes, more than {LARGEST}", file=sys.stderr)
    return int(size > LARGEST)


def _check(rebuild: bool) -> int:
    stale = stale_names()
    for name in stale:
        print(f"stale: {name}; run python -m pepper_kin.jobs.shipping", file=sys.stderr)
    differs = rebuild and _differs(shipped_parts())
    return int(bool(stale) or differs)


def _differs(parts: Mapping[str, tuple[str, bytes]]) -> bool:
    kept = shipped_keys()
    missing = [name for key, (name, _) in parts.items() if key not in kept]
    extra = [kept[key] for key in kept if key not in parts]
    for word, names in (("missing", missing), ("not needed", extra)):
        for name in names:
            print(f"{word}: {name}; run python -m pepper_kin.jobs.shipping", file=sys.stderr)
    return bool(missing or extra)


if __name__ == "__main__":
    sys.exit(main())
