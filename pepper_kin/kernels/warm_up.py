"""Build of missing machine code by processes on all cores while this process waits."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence

from pepper_kin.kernels.compiled_function import INTERPRETER, Unit, units
from pepper_kin.kernels.parallel_build import WORKER
from pepper_kin.kernels.progress import PATIENCE, BuildProgress, announce, show
from pepper_kin.kernels.store import can_write, is_collecting, is_kept, is_known
from pepper_kin.kernels.working_time import not_counted

_POLL = 0.02
"""Interval between checks for the code that is waited for [s]."""

_FEW = 2
"""Minimum number of units for which processes are started: fewer are made sooner without."""


class Build:
    """A process that makes machine code in parallel (`parallel_build`); it ends when this process ends.

    Args:
        modules: Names of the modules whose code is made first.
        only: Whether only the code of `modules` is made.
        nice: Whether the build runs at low priority.
        wheel: Platform tag of the wheel for which code is made; for this processor if omitted.

    Attributes:
        progress: Progress of the build.
    """

    def __init__(
        self, modules: Sequence[str], *, only: bool = False, nice: bool = False, wheel: str | None = None
    ) -> None:
        options = ["--only"] * only + ["--nice"] * nice + (["--wheel", wheel] if wheel else [])
        self.progress = BuildProgress(0.0, None)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "pepper_kin.kernels.parallel_build", *options, *modules],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # Numba emits reference counting in the order of a set of names, which depends on their hashes.
            env={name: value for name, value in os.environ.items() if name != INTERPRETER}
            | {"PYTHONHASHSEED": "0"},
        )
        self._errors: list[str] = []
        for read in (self._read_progress, self._read_errors):
            threading.Thread(target=read, daemon=True).start()

    def ask(self, module: str) -> None:
        """Request that the code of a module is made as soon as possible."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.write(f"{module}\n")
            self._process.stdin.flush()

    def end(self) -> None:
        """End the process; code that has been made is kept."""
        self._process.terminate()
        self._process.wait()

    @property
    def is_running(self) -> bool:
        """Whether the process still runs."""
        return self._process.poll() is None

    def finish(self, report: Callable[[BuildProgress], None]) -> None:
        """Wait until all code is made.

        Args:
            report: Function that is called with the progress repeatedly.

        Raises:
            RuntimeError: A process failed; the message has the last line that it printed.
        """
        while self.is_running:
            report(self.progress)
            time.sleep(_POLL)
        if self._process.returncode:
            raise RuntimeError((self._errors or ["machine code could not be made"])[-1])
        report(BuildProgress(1.0, 0.0))

    def _read_progress(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.progress = BuildProgress(**json.loads(line))

    def _read_errors(self) -> None:
        assert self._process.stderr is not None
        self._errors += [line.strip() for line in self._process.stderr if line.strip()]


def wait_for(unit: Unit) -> None:
    """Make missing code by processes, and wait for the code of a unit.

    If nothing is compiled yet, the processes make all code, and continue while this process uses the code it
    has; if some sources have changed, they make the changed units of imported modules.  If a process fails,
    or the unit is the only missing one, its code is still missing on return.
    """
    if (
        is_collecting()
        or os.environ.get(WORKER)
        or (os.cpu_count() or 1) < 2
        or not unit.module.startswith("pepper_kin.")
        or not can_write()
    ):
        return
    build, key = _started(), unit.key()
    if build is None:
        return
    build.ask(unit.module)
    begin = time.monotonic()
    with not_counted():
        while not is_kept(key) and build.is_running:
            if time.monotonic() - begin > PATIENCE:
                announce(f"machine code {build.progress.bar()}")
            time.sleep(_POLL)
    show("")


def _started() -> Build | None:
    """Return the build of this process, started at the first call; None if little code is missing."""
    global _build
    if _build is None:
        missing, of = missing_modules()
        if len(missing) >= _FEW:
            _build = Build(missing, only=2 * len(missing) < of)
    return _build


_build: Build | None = None


def missing_modules() -> tuple[list[str], int]:
    """Return the imported modules of the package whose code is missing, and the number of all imported."""
    own = [unit for unit in units() if unit.module.startswith("pepper_kin.")]
    return [unit.module for unit in own if not is_known(unit.key())], len(own)
