"""The code that comes with the package: what is in its files, and the command that makes them.

    python -m pepper_kin.jobs.shipping            # make the files beside the sources, of what has changed
    python -m pepper_kin.jobs.shipping --check    # fail where they do not fit the sources

The portable code has all compiled functions.  The machine code has them too, made of the portable code, and
the kernels that the everyday calls below ask for on the default Peppers, for each baseline processor.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pepper_kin import collision, dynamics, ik, kinematics
from pepper_kin.batch import kernel
from pepper_kin.collision import Scene
from pepper_kin.jobs.demo import run_demo
from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.portable import PortableCode, portable_keys, portable_path, used, write_portable
from pepper_kin.kernels.shipping import shipped_before, shipped_keys, shipped_path, write_shipped
from pepper_kin.kernels.sources import sources_path, write_sources
from pepper_kin.kernels.store import MissingPartError, recorded, watched
from pepper_kin.kernels.target import BASELINES
from pepper_kin.kernels.warm_up import compiled_modules
from pepper_kin.model import load_pepper
from pepper_kin.motion import plan
from pepper_kin.plugins import plugins
from pepper_kin.trajectory import retime
from pepper_kin.twin import Twin

LARGEST = 4_500_000
"""Size that no file must exceed [bytes]; the wheel is compressed."""

PATIENCE = 900.0
"""Time budget of a plan whose code is being made meanwhile [s]."""

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
    for calls in _everyday():
        calls()


def _ik_calls() -> None:
    pepper = load_pepper()
    left, right, pose = (0.35, 0.2, 0.85), (0.35, -0.2, 0.85), np.eye(4)
    pose[:3, 3] = left
    for tasks in (
        [ik.HandPosition("left", left), ik.LookAt(left)],
        [ik.HandPosition("left", left)],
        [ik.HandPosition("right", right)],
        [ik.HandPosition("right", right), ik.LookAt(right)],
        [ik.HandPosition("left", left), ik.HandPosition("right", right)],
        [ik.HandPosition("left", left), ik.HandPosition("right", right), ik.LookAt(left)],
        [ik.HandPose("left", pose)],
        [ik.HandPose("right", pose)],
        [ik.LookAt(left)],
    ):
        ik.solve(pepper, tasks)


def _motion_calls() -> None:
    pepper = load_pepper()
    tasks = [ik.HandPosition("left", _POINT), ik.LookAt(_POINT)]
    found = plan(pepper, pepper.posture("Stand"), tasks, _scene(), seed=0, timeout=PATIENCE)
    trajectory = retime(pepper, found, balance=0.01)
    trajectory.check(pepper, scene=_scene())
    trajectory.replaced(pepper, 0.5 * trajectory.duration, trajectory.start, balance=0.01)
    Twin(pepper, timestep=0.001).execute(trajectory)
    run_demo(pepper)


def _payload_calls() -> None:
    pepper = load_pepper()
    for payload in (None, {"left": 0.3}, {"right": 0.3}, {"left": 0.3, "right": 0.3}):
        for balance in (None, 0.005):
            held = plan(
                pepper, pepper.posture("Stand"), [ik.HandPosition("left", _POINT)], _scene(),
                balance=balance, payload=payload, timeout=PATIENCE,
            )  # fmt: skip
            retime(pepper, held, balance=balance, payload=payload)


def _batch_calls() -> None:
    pepper = load_pepper()
    q = np.tile(pepper.neutral(), (64, 1))
    for frame in ("LArm_effector", "RArm_effector"):
        kinematics.frame_pose(pepper, q, frame)
        kinematics.frame_jacobian(pepper, q, frame)
    kinematics.frame_poses(pepper, q, tuple(dict.fromkeys(shape.link for shape in pepper.visual_shapes)))
    for quantity in BATCHES:
        kernel(pepper, quantity)
    collision.in_collision(pepper, q, _scene())


def _calls_of_other_robots() -> None:
    planar = load_pepper(base="planar")
    collision.in_collision(planar, np.tile(planar.neutral(), (64, 1)), _scene())
    for other in (planar, load_pepper(hands="mimic")):
        state = np.tile(other.neutral(), (64, 1))
        dynamics.inverse_dynamics(other, state, state, state)
        ik.solve(other, [ik.HandPosition("left", _POINT), ik.LookAt(_POINT)])


def _everyday() -> tuple[Callable[[], None], ...]:
    own = (_motion_calls, _ik_calls, _payload_calls, _batch_calls, _calls_of_other_robots)
    return (*own, *(entry.load() for entry in plugins("everyday_calls").values()))


_POINT = (0.38, 0.22, 0.82)


def _scene() -> Scene:
    return Scene().add_box("table", (0.4, 0.8, 0.03), (0.47, 0.05, 0.715))


def portable_code() -> PortableCode:
    """Return all units and their parts; Numba compiles functions that have changed."""
    from pepper_kin.kernels.numba_builder import portable_parts

    units = unit_keys()
    functions = [function for name in units.values() for function in unit_of(name).functions]
    return PortableCode(units, portable_parts(functions))


def unit_keys() -> dict[str, str]:
    """Return key -> name of all modules with compiled functions, by name."""
    names = sorted(compiled_modules())
    return {unit_of(name).key(): name for name in names if importlib.import_module(name) is not None}


def shipped_parts(
    portable: PortableCode, tell: Callable[[str], None] = lambda line: None, *, rebuild: bool = False
) -> dict[str, dict[str, tuple[str, bytes]]]:
    """Return all parts of the machine code: baseline -> key -> name and content.

    Args:
        portable: The portable code, of which it is made.
        tell: Called with the name of what is made next.
        rebuild: Whether to make what the package's files have already, for the first of the processors.
    """
    with used(portable), recorded(rebuild) as recording:
        tell("the everyday calls")
        everyday_calls()
        for name in sorted(compiled_modules()):  # the core first, of which more is used elsewhere
            tell(name)
            importlib.import_module(name)
            unit_of(name).load()
        return recording.parts


def stale_names() -> list[str]:
    """Return the compiled modules whose code in one of the package's files was made from other sources."""
    files = [portable_keys(), *map(shipped_keys, BASELINES)]
    return [name for key, name in unit_keys().items() if not all(key in made for made in files)]


def stale_kernels() -> tuple[list[str], list[str]]:
    """Make the everyday calls and compare the code that they ask for with the package's file.

    Returns:
        Names of the parts that are asked for and not in the file, which would be made again at first use,
        and of the kernels in the file that nothing asks for.  Calls end at the first part that is missing,
        so some kernels may be in the second list because of one in the first.
    """
    made = shipped_keys()
    missing: dict[str, None] = {}
    with watched(made) as asked:
        for calls in _everyday():
            try:
                calls()
            except MissingPartError as error:
                missing[error.name] = None
    kernels = {key: name for key, name in made.items() if not name.startswith("pepper_kin.")}
    return list(missing), [name for key, name in kernels.items() if key not in asked]


def main(arguments: list[str] | None = None) -> int:
    """Run the command; the result is its exit code."""
    parser = argparse.ArgumentParser(prog="python -m pepper_kin.jobs.shipping", description=__doc__)
    parser.add_argument(
        "--check", action="store_true", help="compare the files with the sources, write nothing"
    )
    parser.add_argument(
        "--rebuild", action="store_true", help="with --check: make all parts, compare their list"
    )
    parser.add_argument(
        "-o", "--output", type=Path, help="folder to write the files to; beside the sources by default"
    )
    options = parser.parse_args(arguments)
    if options.check:
        return _check(options.rebuild)
    print("  the portable code", flush=True)
    portable = portable_code()
    parts = shipped_parts(portable, lambda name: print(f"  {name}", flush=True))
    folder = options.output or sources_path().parent
    sizes = [write_portable(portable, folder / portable_path().name)]
    for baseline, made in parts.items():
        sizes.append(write_shipped(made, baseline, folder / shipped_path(baseline).name))
    write_sources(folder / sources_path().name)
    print(f"{len(portable.units)} units, {len(portable.parts)} portable parts; files of {sizes} bytes")
    return _report_sizes(sizes)


def _report_sizes(sizes: Sequence[int]) -> int:
    large = [size for size in sizes if size > LARGEST]
    for size in large:
        print(f"a file has {size} bytes, more than {LARGEST}", file=sys.stderr)
    return int(bool(large))


def _check(rebuild: bool) -> int:
    if rebuild:  # in a process that has not loaded anything yet: what is loaded is not made
        return int(_differs())
    missing, unused = stale_kernels()
    for what, names in (("stale", stale_names()), ("missing", missing), ("not needed", unused)):
        for name in names:
            print(f"{what}: {name}; run python -m pepper_kin.jobs.shipping", file=sys.stderr)
    return int(bool(stale_names() or missing or unused))


def _differs() -> bool:
    """Rebuild everything and compare it with the files, byte by byte where the same versions made them."""
    portable = portable_code()
    missing: list[str] = []
    extra: list[str] = []
    other: list[str] = []
    compared = [(dict(portable.units), portable_keys())]
    for baseline, parts in shipped_parts(portable, rebuild=True).items():
        compared.append(({key: name for key, (name, _) in parts.items()}, shipped_keys(baseline)))
        for key, (name, content) in parts.items():
            kept = shipped_before(key, baseline)
            if kept is not None and kept != content:
                other.append(f"{name} for {baseline}")
    for made, kept_names in compared:
        missing += [name for key, name in made.items() if key not in kept_names]
        extra += [name for key, name in kept_names.items() if key not in made]
    for word, names in (("missing", missing), ("not needed", extra), ("other bytes", other)):
        for name in names:
            print(f"{word}: {name}; run python -m pepper_kin.jobs.shipping", file=sys.stderr)
    return bool(missing or extra or other)


if __name__ == "__main__":
    sys.exit(main())
