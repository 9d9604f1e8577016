"""Unmodified programs for qiBullet, run with replacements of `qibullet`, `pybullet`, `pybullet_data`."""

from __future__ import annotations

import importlib
import sys
import time
import types
from collections.abc import Sequence
from pathlib import Path

from pepper_kin import qibullet
from pepper_kin.file_access.atomic_file import as_path
from pepper_kin.naoqi.python2 import ScriptImports
from pepper_kin.naoqi.scripts import (
    ScriptResult,
    check_longest,
    ending,
    main_program,
    reads_of_stdin,
    standstill,
)
from pepper_kin.naoqi.simulated_time import SimulatedTime
from pepper_kin.qibullet import simulation


def stand_ins() -> dict[str, types.ModuleType]:
    """Return the replacements of qiBullet's and Bullet's modules, by name."""
    modules = {"qibullet": qibullet}
    for path in Path(qibullet.__path__[0]).glob("*.py"):
        if path.stem not in ("__init__", "commands", "programs"):
            modules[f"qibullet.{path.stem}"] = importlib.import_module(f"{qibullet.__name__}.{path.stem}")
    return modules | {name: modules.pop(f"qibullet.{name}") for name in ("pybullet", "pybullet_data")}


def run_program(
    path: str | Path, arguments: Sequence[str] = (), *, longest: float | None = None
) -> ScriptResult:
    """Run a program, in Python 3 or 2, in this process; end the simulations that it leaves.

    Args:
        path: The program.
        arguments: Arguments of the command line, after the program's name.
        longest: Time after which the program is interrupted, as by Ctrl-C [s].

    Raises:
        FileFormatError: for a file that is no program.
        InvalidValueError: for a time that is not above 0.
    """
    check_longest(longest)
    script = as_path(path)
    runs, reads, modules = main_program(script, arguments), reads_of_stdin(), stand_ins()
    finder, others = ScriptImports(script.parent, reads), simulation.all_running()
    before = {name: sys.modules.get(name) for name in modules}
    sys.modules.update(modules)
    sys.path.insert(0, str(script.parent.resolve()))
    sys.meta_path.insert(0, finder)
    begun = time.monotonic()
    try:
        with standstill(SimulatedTime(lambda: None, False), longest) as stuck:  # stopped: wall time counts
            ended, status, error = ending(lambda: runs(reads), stuck)
    finally:
        for client in set(simulation.all_running()).difference(others):
            simulation.end(client)
        modules["pybullet"]._forget()
        sys.meta_path.remove(finder)
        sys.path.remove(str(script.parent.resolve()))
        for name in finder.loaded:
            sys.modules.pop(name, None)
        for name, own in before.items():
            if own is None:
                del sys.modules[name]
            else:
                sys.modules[name] = own
    return ScriptResult(ended, status, time.monotonic() - begun, error)
