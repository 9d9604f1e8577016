"""Unmodified scripts for NAOqi, run against the twin.

They may be in Python 3, or in Python 2 with `from naoqi import ALProxy`.
"""

from __future__ import annotations

import builtins
import ctypes
import math
import signal
import sys
import threading
import time as wall
import types
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from weakref import WeakSet

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.file_access.atomic_file import as_path
from pepper_kin.kernels.threads import OWN_THREADS
from pepper_kin.naoqi.broker import Broker
from pepper_kin.naoqi.python2 import ScriptImports, begin, program
from pepper_kin.naoqi.shims import almath, motion, naoqi, qi, qi_logging, set_broker, vision_definitions
from pepper_kin.naoqi.simulated_time import SimulatedTime, TimeIsUp

MODULES = {
    "naoqi": naoqi,
    "qi": qi,
    "qi.logging": qi_logging,
    "almath": almath,
    "motion": motion,
    "vision_definitions": vision_definitions,
}
"""Name of a module that scripts import -> its replacement."""

LOOK_EVERY = 0.25
"""Time between two checks whether a script lets simulated time pass [s]."""

STUCK = 1.0
"""Wall time without simulated time after which an overdue script is interrupted [s]."""


@dataclass(frozen=True)
class ScriptResult:
    """Outcome of a script.

    Attributes:
        ended: "completed", "exited" (by `sys.exit`), "time is up", "interrupted" (by Ctrl-C) or "failed".
        code: Exit code; 130 if the script was interrupted.
        duration: Simulated time that the script took [s].
        error: The exception that ended the script, or None.
    """

    ended: str
    code: int
    duration: float
    error: BaseException | None = None

    @property
    def success(self) -> bool:
        """Whether the script ran to its end, or to the end of its time."""
        return self.ended in ("completed", "time is up") or (self.ended == "exited" and self.code == 0)


class ScriptTime(types.ModuleType):
    """The module `time` of a script, with the twin's clock.

    Args:
        broker: The simulated robot.
        longest: Simulated time at which the script is interrupted [s]; None for never.
    """

    def __init__(self, broker: Broker, longest: float | None) -> None:
        super().__init__("time")
        self.__dict__.update({name: value for name, value in vars(wall).items() if not name.startswith("__")})
        clock = broker.body.time

        def check() -> None:
            if clock.ended or (longest is not None and clock.now >= longest):
                clock.interrupted = True
                raise TimeIsUp(f"after {clock.now:g} s")

        def sleep(seconds: float) -> None:
            left = float(seconds) if longest is None else min(float(seconds), longest - clock.now)
            clock.sleep(max(left, 0.0))
            check()

        def now() -> float:
            check()
            clock.spend(1e-3)  # so that time passes in a loop that polls it
            return broker.wall_time()

        self.sleep, self.time = sleep, now
        self.monotonic = self.perf_counter = self.clock = lambda: now() - broker.wall_time() + clock.now


@contextmanager
def stand_ins(
    broker: Broker, folder: Path, longest: float | None, reads: Callable[..., str]
) -> Iterator[Callable[[], None]]:
    """Replace modules that scripts import, and `time` in modules of the script's folder.

    Yields a function that waits for the script's non-daemon threads, as Python does at its end.
    """
    before = {name: sys.modules.get(name) for name in MODULES}
    clock, finder = ScriptTime(broker, longest), ScriptImports(folder, reads)
    imported = builtins.__import__
    own = str(folder.resolve())

    def import_(
        name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0
    ) -> Any:
        if name == "time" and level == 0 and str((globals or {}).get("__file__", "")).startswith(own):
            return clock
        return imported(name, globals, locals, fromlist, level)

    threads, begins = list[threading.Thread](), threading.Thread.start
    pools, creates = WeakSet[ThreadPoolExecutor](), ThreadPoolExecutor.__init__
    twin, workers, over = broker.body.time, list[object](), threading.Event()

    def start(self: threading.Thread) -> None:
        """Start a thread of a script as a worker of the simulated time."""
        if self.ident is not None or self.name.startswith(OWN_THREADS):
            begins(self)  # which refuses a thread that has been started
            return
        if not self.daemon:
            self.daemon = True  # waited for here, with a limit; the process would wait for ever
            threads.append(self)
        does, worker = self.run, twin.new_worker()
        self.__dict__["worker"] = worker
        if not getattr(self, "of_robot", False):
            workers.append(worker)

        def run() -> None:
            try:
                with twin.working(worker):
                    does()
            except TimeIsUp:
                pass
            except Exception:
                if not over.is_set():  # else the error is an effect of the script's end
                    raise

        self.run = run  # type: ignore[method-assign]
        try:
            begins(self)
        except BaseException:
            twin.dismiss([worker])
            raise

    def create(self: ThreadPoolExecutor, *arguments: Any, **named: Any) -> None:
        creates(self, *arguments, **named)
        if not str(self._thread_name_prefix).startswith(OWN_THREADS):
            pools.add(self)

    def wait() -> None:
        """Wait for threads, and threads that they start, until the time is up; pools end when idle."""
        for pool in pools:
            pool.shutdown(wait=False)
        for thread in threads:
            while thread.is_alive() and (longest is None or twin.now < longest):
                thread.join(0.02)
            if thread.is_alive():
                raise TimeIsUp(f"at {longest:g} s")

    sys.modules.update(MODULES)
    set_broker(broker)
    builtins.__import__ = import_
    ThreadPoolExecutor.__init__ = create  # type: ignore[method-assign]
    threading.Thread.start = start  # type: ignore[method-assign]
    sys.path.insert(0, own)
    sys.meta_path.insert(0, finder)
    try:
        yield wait
    finally:
        over.set()
        twin.dismiss(workers)
        builtins.__import__ = imported
        threading.Thread.start = begins  # type: ignore[method-assign]
        ThreadPoolExecutor.__init__ = creates  # type: ignore[method-assign]
        sys.path.remove(own)
        sys.meta_path.remove(finder)
        for name in finder.loaded:
            sys.modules.pop(name, None)
        set_broker(None)
        for name, module in before.items():
            if module is None:
                sys.modules.pop(name, None)
            else:
                sys.modules[name] = module


def run_script(
    path: str | Path, arguments: Sequence[str] = (), *, broker: Broker, longest: float | None = None
) -> ScriptResult:
    """Run a script against the twin of this process.

    Args:
        path: The script, in Python 3 or 2.
        arguments: Arguments of the command line, after the script's name.
        broker: The simulated robot.
        longest: Simulated time after which it is interrupted, as by Ctrl-C [s]: in its sleeps, in calls
            that block, and when it reads the time.

    Returns:
        Outcome of the script.

    Raises:
        FileFormatError: for a file that is no script.
        InvalidValueError: for a time that is not above 0.
    """
    check_longest(longest)
    script = as_path(path)
    return run_program(main_program(script, arguments), script.parent, broker, longest)


def check_longest(longest: float | None) -> None:
    """Refuse a time that is not above 0 [s].

    Raises:
        InvalidValueError: for a time that is not above 0.
    """
    if longest is not None and not longest > 0:
        raise InvalidValueError("longest", longest, "a time above 0 [s]")


def main_program(script: Path, arguments: Sequence[str]) -> Callable[[Callable[..., str]], None]:
    """Return a function that runs a script as `__main__`; its argument reads a typed line.

    Raises:
        FileFormatError: for a file that is no script.
    """
    code, old = program(script)
    module = types.ModuleType("__main__")
    module.__file__ = str(script.resolve())

    def runs(reads: Callable[..., str]) -> None:
        sys.modules["__main__"], sys.argv = module, [str(script), *arguments]
        begin(code, old, module.__dict__, reads)

    return runs


def run_program(
    does: Callable[[Callable[..., str]], None], folder: Path, broker: Broker, longest: float | None
) -> ScriptResult:
    """Run a function of scripts, and wait for the threads that it starts.

    Args:
        does: Function to run; its argument reads a typed line.
        folder: Folder that scripts import from; its modules get the twin's clock.
        broker: The simulated robot.
        longest: Simulated time after which it is interrupted [s]; None for never.
    """
    clock = broker.body.time
    begun = clock.now
    end = math.inf if longest is None else begun + longest
    with (
        standstill(clock, longest) as stuck,
        stand_ins(broker, folder, None if longest is None else begun + longest, reads_of_stdin()) as wait,
    ):
        clock.limit(end)

        def waits() -> None:
            try:
                with clock.working(clock.new_worker()):
                    does(reads_of_stdin())
            except (Exception, SystemExit):
                with suppress(KeyboardInterrupt):  # the script's own error is the result
                    wait()
                raise
            wait()

        ended, status, error = ending(waits, stuck)
        clock.limit(math.inf)
    return ScriptResult(ended, status, clock.now - begun, error)


def reads_of_stdin() -> Callable[..., str]:
    """Return a function that reads a typed line: `input` on a terminal, else one that returns ""."""
    return input if sys.stdin is not None and sys.stdin.isatty() else _no_input


def ending(does: Callable[[], None], stuck: threading.Event) -> tuple[str, int, BaseException | None]:
    """Run a function; return `ended`, `code` and `error` of its `ScriptResult`.

    Args:
        does: Function to run; `sys.argv` and `__main__` are restored afterwards.
        stuck: Set if the interrupt meant that the time is up; see `standstill`.
    """
    main, argv = sys.modules["__main__"], sys.argv
    try:
        does()
    except TimeIsUp:
        return "time is up", 0, None
    except SystemExit as exit_:
        if exit_.code is not None and not isinstance(exit_.code, int):
            print(exit_.code, file=sys.stderr)  # as Python does
        return "exited", exit_.code if isinstance(exit_.code, int) else int(exit_.code is not None), None
    except KeyboardInterrupt as interrupt:
        return ("time is up", 0, None) if stuck.is_set() else ("interrupted", 130, interrupt)
    except Exception as failure:
        return "failed", 1, failure
    finally:
        sys.modules["__main__"], sys.argv = main, argv
    return "completed", 0, None


@contextmanager
def standstill(clock: SimulatedTime, longest: float | None) -> Iterator[threading.Event]:
    """Interrupt a script that computes or waits outside the twin's clock while no simulated time passes.

    While the twin's clock stands still, wall time counts.  An interrupted script may clean up as long as
    simulated time passes, and is interrupted again when the clock stands still for `STUCK`.
    """
    stuck, over, thread = threading.Event(), threading.Event(), threading.get_ident()
    before = signal.getsignal(signal.SIGINT)
    ignored = thread == threading.main_thread().ident and longest is not None and before is signal.SIG_IGN
    if ignored:  # as in background jobs of a shell
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def watch() -> None:
        """Interrupt the script when its time is up, repeatedly if it does not end."""
        begun = seen = clock.now
        stood, since, looked = 0.0, 0.0, wall.monotonic()
        while longest is not None and not over.wait(LOOK_EVERY):
            now, at = clock.now, wall.monotonic()
            passed, stands = at - looked, now == seen
            seen, looked = now, at
            stood, since = stood + passed * stands, (since + passed) * stands
            up = now - begun + stood >= longest + STUCK
            if up and (since >= STUCK or not (clock.interrupted or stuck.is_set())):
                since = 0.0
                stuck.set()
                if thread == threading.main_thread().ident:
                    signal.siginterrupt(signal.SIGINT, True)  # polars lets system calls resume after a signal
                    signal.pthread_kill(thread, signal.SIGINT)
                else:
                    interrupt = ctypes.py_object(KeyboardInterrupt)
                    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), interrupt)

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield stuck
    finally:
        over.set()
        watcher.join()
        if ignored:
            signal.signal(signal.SIGINT, before)


def _no_input(prompt: object = "") -> str:
    """Return an empty line, without a terminal to read one from."""
    print(prompt)
    return ""
