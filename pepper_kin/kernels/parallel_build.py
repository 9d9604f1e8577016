"""Machine code of compiled functions, made by processes on all cores.

    python -m pepper_kin.kernels.parallel_build [--only] [--nice] [--wheel TAG] MODULE...

This process decides who makes what, in which order: units that the caller waits for, whose names come by
standard input, before those that were named at the start, and these before the rest.  Two units that share
functions are not made side by side where others are left, since both processes would compile what they share.
It ends when all is made, or when its standard input ends: when the process that has started it does.
How far it has come is printed as lines of JSON, twice a second.
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
"""Environment variable of processes that make machine code ahead: they start no others."""

_POLL = 0.1
"""Interval of looking for names that are asked for [s]."""

_LOOK = 2.0
"""Interval of looking whether the process that sends work is alive [s]."""

_MOST = 8
"""Number of processes at most: each takes some 0.4 GB, and units wait for what they share."""

_FRONT_END = 4.0
"""Time to compile a function by Numba over its time in LLVM, each time that a unit holds it."""


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
    """Return packages and their folders; those of the planners lie elsewhere in an editable installation."""
    folder, planners = Path(__file__).parents[1], find_spec("pepper_kin.planners")
    assert planners is not None
    assert planners.submodule_search_locations is not None
    place = Path(next(iter(planners.submodule_search_locations)))
    return [("pepper_kin", folder), ("pepper_kin.planners", place)]


class _Schedule:
    """The units that are still to be made, and what is being made.

    Args:
        target: The processor that code is made for; None for this one.
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
        """Add a module unless its machine code is there; a smaller priority is made earlier."""
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
        """Return the module to be made next: of those most urgent the longest that shares least."""
        if not self._waiting:
            return None
        busy = frozenset().union(*(self._reached[name] for name in self._busy)) - self._compiled
        name = max(self._waiting, key=lambda name: (-self._priority[name], self._gain(name, busy)))
        self._waiting.remove(name)
        self._busy.append(name)
        return name

    def finish(self, name: str) -> None:
        """Note that a module has been made."""
        self.done += self._cost(name, self._compiled)
        self._busy.remove(name)
        self._compiled |= self._reached[name]

    def _gain(self, name: str, busy: frozenset[str]) -> float:
        return len(self._reached[name] - self._compiled) - 2.0 * len(self._reached[name] & busy)

    def _cost(self, name: str, known: set[str]) -> float:
        return _FRONT_END * len(self._reached[name] - known) + len(self._reached[name])


def _work(jobs: Connection, target: Target | None) -> None:
    """Make the units whose modules and keys arrive, until the process that sends them is gone."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that has started all this
    sender = multiprocessing.parent_process()
    while True:
        while not jobs.poll(_LOOK):  # the connection does not end: processes that were forked later hold it
            if sender is None or not sender.is_alive():
                return
        name, key = jobs.recv()
        importlib.import_module(name)
        make_ahead(key, unit_of(name).build, target)
        jobs.send(name)


def _run(schedule: _Schedule, count: int) -> None:
    """Let processes make all that is scheduled; a name from standard input is made as soon as possible."""
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
        # Whatever they do: a file is written whole or not at all.  A gentler signal is lost by a process that
        # has just been forked, and this one would wait for it for ever.
        for process in processes:
            process.kill()
            process.join()


def _hand_out(schedule: _Schedule, idle: list[Connection]) -> None:
    """Send work to processes, which are idle at first, until there is none or standard input ends."""
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
    ratio = schedule.done / max(schedule.total, 1.0)
    remaining = elapsed * (1.0 / ratio - 1.0) if ratio > 0.03 else None
    with_remaining = {"ratio": round(ratio, 3), "remaining": remaining and round(remaining, 1)}
    print(json.dumps(with_remaining), flush=True)


def _ended() -> bool:
    """Return whether standard input has ended."""
    return bool(wait([sys.stdin.fileno()], 0.0)) and not os.read(sys.stdin.fileno(), 4096)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make machine code, one such process at a time for a cache folder."""
    parser = argparse.ArgumentParser(prog="python -m pepper_kin.kernels.parallel_build", description=__doc__)
    parser.add_argument("modules", nargs="*", help="what to make first")
    parser.add_argument("--only", action="store_true", help="make nothing else")
    parser.add_argument("--wheel", choices=sorted(WHEELS), help="platform tag, for another processor")
    parser.add_argument("--nice", action="store_true", help="leave the processors to others")
    options = parser.parse_args(arguments)
    os.environ[WORKER] = "1"
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # which ends the processes that work
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
