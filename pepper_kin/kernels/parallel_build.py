"""Parallel build of the machine code of compiled functions by processes on all cores.

    python -m pepper_kin.kernels.parallel_build [--only] [--nice] [--wheel TAG] MODULE...

This process schedules the units: first units that the caller waits for, whose names arrive on standard input,
then units named on the command line, then the rest.  Two units that share functions are not made at the same
time if others are left, since both processes would compile the shared functions.  The process ends when all
units are made, or when its standard input ends: when the process that has started it ends.
Progress is printed as lines of JSON, twice a second.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import json
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from pepper_kin.kernels.compiled_function import unit_of
from pepper_kin.kernels.store import is_known, make_ahead, only_maker
from pepper_kin.kernels.target import WHEELS, Target

WORKER = "PEPPER_KIN_BUILDS"
"""Environment variable of processes that build ahead: they start no further build processes."""

_POLL = 0.1
"""Interval between polls for requested names [s]."""

_LOOK = 2.0
"""Interval between checks that the process that sends work is alive [s]."""

_MOST = 8
"""Maximum number of processes: each takes some 0.4 GB, and units wait for shared functions."""

_FRONT_END = 4.0
"""Ratio of the time to compile a function by Numba, once, to its time in LLVM, in every unit that has it."""


def compiled_modules() -> list[str]:
    """Return the modules of the package that have compiled functions with signatures, by name."""
    found = set()
    for package, folder in _packages():
        for path in folder.rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            if '\n@compiled("' in text or '\n@compiled(\n    "' in text:
                parts = path.relative_to(folder).with_suffix("").parts
                found.add(".".join((package, *parts)))
    return sorted(found)


def _packages() -> list[tuple[str, Path]]:
    """Return packages and their folders; the planners' folder lies elsewhere in an editable installation."""
    folder, planners = Path(__file__).parents[1], find_spec("pepper_kin.planners")
    assert planners is not None
    assert planners.submodule_search_locations is not None
    place = Path(next(iter(planners.submodule_search_locations)))
    return [("pepper_kin", folder), ("pepper_kin.planners", place)]


class _Schedule:
    """Units that are still to be made, and units in progress.

    Args:
        target: The processor for which code is made; None for this one.
    """

    def __init__(self, target: Target | None) -> None:
        self.target = target
        self.keys: dict[str, str] = {}
        self.total = self.done = 0.0
        self._priority: dict[str, int] = {}
        self._reached: dict[str, frozenset[str]] = {}
        self._waiting: list[str] = []
        self._busy: list[str] = []
        self._planned: set[str] = set()
        self._compiled: set[str] = set()

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits to be made."""
        return not self._waiting

    def add(self, name: str, priority: int) -> None:
        """Add a module unless its machine code exists; a module of smaller priority is made earlier."""
        self._priority[name] = min(priority, self._priority.get(name, priority))
        if name in self.keys:
            return
        importlib.import_module(name)
        unit = unit_of(name)
        self.keys[name] = unit.key()
        if not is_known(self.keys[name], self.target):
            self._reached[name] = frozenset(unit.reached())
            self.total += self._cost(name, self._planned)
            self._planned |= self._reached[name]
            self._waiting.append(name)

    def next(self) -> str | None:
        """Return the next module: of the most urgent modules the longest that shares the fewest functions."""
        if not self._waiting:
            return None
        busy = frozenset().union(*(self._reached[name] for name in self._busy)) - self._compiled
        name = max(self._waiting, key=lambda name: (-self._priority[name], self._gain(name, busy)))
        self._waiting.remove(name)
        self._busy.append(name)
        return name

    def finish(self, name: str) -> None:
        """Record that a module has been made."""
        self.done += self._cost(name, self._compiled)
        self._busy.remove(name)
        self._compiled |= self._reached[name]

    def _gain(self, name: str, busy: frozenset[str]) -> float:
        return len(self._reached[name] - self._compiled) - 2.0 * len(self._reached[name] & busy)

    def _cost(self, name: str, known: set[str]) -> float:
        return _FRONT_END * len(self._reached[name] - known) + len(self._reached[name])


def _work(jobs: Connection, target: Target | None) -> None:
    """Make the units whose modules and keys arrive, until the sending process ends."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the process that started the build
    sender = multiprocessing.parent_process()
    while True:
        while not jobs.poll(_LOOK):  # the connection does not end: processes forked later hold it
            if sender is None or not sender.is_alive():
                return
        name, key = jobs.recv()
        importlib.import_module(name)
        make_ahead(key, unit_of(name).build, target)
        jobs.send(name)


def _run(schedule: _Schedule, count: int) -> None:
    """Make all scheduled modules by processes; a name from standard input is made as soon as possible."""
    context: Any = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    gc.freeze()
    idle: list[Connection] = []
    processes = []
    try:
        for _ in range(count):
            ours, theirs = context.Pipe()
            process = context.Process(target=_work, args=(theirs, schedule.target), daemon=True)
            process.start()
            processes.append(process)
            theirs.close()
            idle.append(ours)
        _hand_out(schedule, idle)
    finally:
        # Processes may be killed at any time: a file is written whole or not at all.  A process that has just
        # been forked may lose a gentler signal, and this process would wait for it forever.
        for process in processes:
            process.kill()
            process.join()


def _hand_out(schedule: _Schedule, idle: list[Connection]) -> None:
    """Send work to processes, which are idle at first, until none is left or standard input ends."""
    begin = printed = time.monotonic()
    busy: set[Connection] = set()
    while True:
        while idle and (name := schedule.next()):
            idle[-1].send((name, schedule.keys[name]))
            busy.add(idle.pop())
        if not busy:
            return
        for ready in wait([*busy, sys.stdin.fileno()], _POLL):
            if isinstance(ready, int):
                asked = os.read(ready, 4096).decode().split()
                if not asked:
                    return
                for name in asked:
                    schedule.add(name, 0)
            else:
                assert isinstance(ready, Connection)
                schedule.finish(ready.recv())
                busy.remove(ready)
                idle.append(ready)
        if time.monotonic() - printed > 0.5:
            printed = time.monotonic()
            _print(schedule, printed - begin)


def _print(schedule: _Schedule, elapsed: float) -> None:
    """Print the progress as a line of JSON."""
    ratio = schedule.done / max(schedule.total, 1.0)
    remaining = elapsed * (1.0 / ratio - 1.0) if ratio > 0.03 else None
    with_remaining = {"ratio": round(ratio, 3), "remaining": remaining and round(remaining, 1)}
    print(json.dumps(with_remaining), flush=True)


def _ended() -> bool:
    """Return whether standard input has ended."""
    return bool(wait([sys.stdin.fileno()], 0.0)) and not os.read(sys.stdin.fileno(), 4096)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make machine code, with one build process at a time per cache folder."""
    parser = argparse.ArgumentParser(prog="python -m pepper_kin.kernels.parallel_build", description=__doc__)
    parser.add_argument("modules", nargs="*", help="what to make first")
    parser.add_argument("--only", action="store_true", help="make nothing else")
    parser.add_argument("--wheel", choices=sorted(WHEELS), help="platform tag, for another processor")
    parser.add_argument("--nice", action="store_true", help="leave the processors to others")
    options = parser.parse_args(arguments)
    os.environ[WORKER] = "1"
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # the exit ends the worker processes
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if options.nice and hasattr(os, "nice"):
        os.nice(10)
    while True:
        with only_maker("all machine code", wait=False) as mine:
            if mine:
                from pepper_kin.kernels import numba_builder  # noqa: F401  # once, for all processes

                schedule = _Schedule(WHEELS[options.wheel]() if options.wheel else None)
                for name in options.modules:
                    schedule.add(name, 1)
                for name in () if options.only else compiled_modules():
                    schedule.add(name, 2)
                if not schedule.is_empty:
                    _run(schedule, min(os.cpu_count() or 1, _MOST))
                return
        if _ended():
            return
        time.sleep(_POLL)


if __name__ == "__main__":
    main()
