"""All machine code of compiled functions, made at once on all cores.

Run as `python -m pepper_kin.kernels.warm_up MODULE...` it makes the code of these modules, one after the
other, and leaves out what another process is making.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from pepper_kin.kernels.compiled_function import Unit, unit_of, units
from pepper_kin.kernels.progress import expect, making
from pepper_kin.kernels.shipping import is_usable, shipped_keys
from pepper_kin.kernels.store import can_write, is_kept, is_known, is_recording, make_ahead

_WORKER = "PEPPER_KIN_WARM_UP"
"""Environment variable of the processes that make machine code ahead."""

_POLL = 0.05  # [s]


def compiled_modules() -> list[str]:
    """Return the modules of the package that have compiled functions with signatures.

    Those that come with the package are first, in the order in which they are needed.
    """
    found = set()
    for package, folder in _packages():
        for path in folder.rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            if '\n@compiled("' in text or '\n@compiled(\n    "' in text:
                parts = path.relative_to(folder).with_suffix("").parts
                found.add(".".join((package, *parts)))
    first = [name for name in shipped_keys().values() if name in found]
    return list(dict.fromkeys([*first, *sorted(found)]))


def _packages() -> list[tuple[str, Path]]:
    """Packages and their folders; those of the planners lie elsewhere where it is installed for editing."""
    folder, planners = Path(__file__).parents[1], find_spec("pepper_kin.planners")
    assert planners is not None
    assert planners.submodule_search_locations is not None
    place = Path(next(iter(planners.submodule_search_locations)))
    return [("pepper_kin", folder), ("pepper_kin.planners", place)]


def make_all(modules: Sequence[str], report: Callable[[int], None] | None = None) -> None:
    """Make the code of modules for this processor on all cores, where it is not kept already.

    Args:
        modules: Their names.
        report: Called with the number of modules done, again and again.

    Raises:
        RuntimeError: A process failed; with the last line that it printed.
    """
    keys = {name: unit_of(name).key() for name in modules if importlib.import_module(name) is not None}
    workers = _start_workers([name for name, key in keys.items() if not is_kept(key)], silent=False)
    while workers:
        if report:
            report(sum(map(is_kept, keys.values())))
        time.sleep(_POLL)
        for worker in [one for one in workers if one.poll() is not None]:
            workers.remove(worker)
            if worker.returncode and worker.stderr is not None:
                raise RuntimeError(worker.stderr.read().strip().rpartition("\n")[2])
    if report:
        report(len(keys))


def wait_for(unit: Unit) -> None:
    """Have other processes make the code that is missing, and wait for that of a unit where all is.

    Where none comes with the package they make all of it.  Where sources have changed they make the other
    units of imported modules that have, while this process makes its own.  Where they fail, the unit is still
    missing when this returns.
    """
    if (
        is_recording()
        or os.environ.get(_WORKER)
        or (os.cpu_count() or 1) < 2
        or not can_write()
        or not unit.module.startswith("pepper_kin.")
    ):
        return
    if is_usable():
        _help_with_changes(unit.module)
        return
    workers, key = _helpers(), unit.key()
    if not workers:
        return
    with making(unit.module):
        while not is_kept(key) and any(worker.poll() is None for worker in workers):
            time.sleep(_POLL)


def _help_with_changes(mine: str) -> None:
    """Start processes, once, for the other units whose sources have changed."""
    global _helped
    if _helped:
        return
    _helped = True
    changed = [
        unit.module
        for unit in units()
        if unit.module != mine and unit.module.startswith("pepper_kin.") and not is_known(unit.key())
    ]
    if changed:
        workers = _start_workers(changed, silent=True, spared=1)
        atexit.register(_end, workers)


_helped = False


@cache
def _helpers() -> list[subprocess.Popen[str]]:
    """The processes that work ahead of this one; they end with it."""
    modules = compiled_modules()
    expect(len(modules))
    workers = _start_workers(modules, silent=True)
    atexit.register(_end, workers)
    return workers


def _end(workers: Sequence[subprocess.Popen[str]]) -> None:
    for worker in workers:
        with contextlib.suppress(OSError):
            worker.terminate()


def _start_workers(modules: Sequence[str], *, silent: bool, spared: int = 0) -> list[subprocess.Popen[str]]:
    """Start one process for each core, but those that are spared; they share the work among themselves."""
    count = min((os.cpu_count() or 1) - spared, len(modules))
    return [
        subprocess.Popen(
            [sys.executable, "-m", "pepper_kin.kernels.warm_up", *modules],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL if silent else subprocess.PIPE,
            env={**os.environ, _WORKER: "1"},
            text=True,
        )
        for _ in range(count)
    ]


def _make_in_turn(modules: Sequence[str]) -> None:
    for name in modules:
        importlib.import_module(name)
        unit = unit_of(name)
        make_ahead(name, unit.key(), unit.build)


if __name__ == "__main__":
    _make_in_turn(sys.argv[1:])
