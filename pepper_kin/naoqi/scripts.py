"""Scripts for NAOqi, run as they are against the twin.

Python 3, and Python 2 that says `from naoqi import ALProxy`.
"""

from __future__ import annotations

import builtins
import math
import re
import sys
import time as wall
import types
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pepper_kin.exceptions import FileFormatError, InvalidValueError
from pepper_kin.file_access.atomic_file import as_path
from pepper_kin.file_access.reading import read_bytes
from pepper_kin.naoqi.broker import Broker
from pepper_kin.naoqi.shims import almath, motion, naoqi, qi, qi_logging, set_broker, vision_definitions
from pepper_kin.naoqi.simulated_time import TimeIsUp

MODULES = {
    "naoqi": naoqi,
    "qi": qi,
    "qi.logging": qi_logging,
    "almath": almath,
    "motion": motion,
    "vision_definitions": vision_definitions,
}
"""Modules that scripts import -> what stands in for them."""

_RESERVED = re.compile(r"\.async\b")
_ASYNC_ARGUMENT = re.compile(r"\basync\s*=")


@dataclass(frozen=True)
class ScriptResult:
    """What came of a script.

    Attributes:
        ended: "completed", "exited" (by `sys.exit`), "time is up", "interrupted" (by Ctrl-C) or "failed".
        code: What it exited with; 130 where it was interrupted.
        duration: Time of the twin [s].
        error: The exception that ended it.
    """

    ended: str
    code: int
    duration: float
    error: BaseException | None = None

    @property
    def success(self) -> bool:
        """Whether it ran to its end, or to that of its time."""
        return self.ended in ("completed", "time is up") or (self.ended == "exited" and self.code == 0)


def python3_source(path: Path) -> str:
    """Return the source of a script as Python 3; scripts in Python 2 are translated.

    Raises:
        FileFormatError: naming the line, for a script that is neither.
    """
    text = read_bytes(path).decode("utf-8", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    source = _RESERVED.sub(".async_", _ASYNC_ARGUMENT.sub("_async=", text))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            compile(source, str(path), "exec")
        return source
    except SyntaxError as first:
        return _translated(path, source, first)
    except (ValueError, RecursionError, MemoryError) as error:
        raise FileFormatError(path, f"cannot be compiled by Python: {error}") from error


def _translated(path: Path, source: str, first: SyntaxError) -> str:
    """Return a script in Python 2 as Python 3, by the translator that comes with Python (or `fissix`)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        package = next((name for name in ("lib2to3", "fissix") if find_spec(name) is not None), None)
        if package is None:
            reason = "is written in Python 2; translating it needs: pip install fissix"
            raise FileFormatError(path, reason, first.lineno) from first
        refactor = import_module(f"{package}.refactor")
        fixers = refactor.get_fixers_from_package(f"{package}.fixes")
        tool = refactor.RefactoringTool(fixers)
        try:
            text = str(tool.refactor_string(source.expandtabs(8).rstrip() + "\n", str(path)))
            compile(text, str(path), "exec")
        except Exception as error:
            raise FileFormatError(
                path, f"is neither Python 3 nor Python 2: {first.msg}", first.lineno
            ) from error
    return text


class ScriptTime(types.ModuleType):
    """The module `time` of a script: its clock is that of the twin.

    Args:
        broker: The twin.
        longest: Time after which the script is interrupted [s]; None for never.
    """

    def __init__(self, broker: Broker, longest: float | None) -> None:
        super().__init__("time")
        self.__dict__.update({name: value for name, value in vars(wall).items() if not name.startswith("__")})
        clock = broker.body.time

        def check() -> None:
            if longest is not None and clock.now >= longest:
                raise TimeIsUp(f"after {longest:g} s")

        def sleep(seconds: float) -> None:
            left = float(seconds) if longest is None else min(float(seconds), longest - clock.now)
            clock.sleep(max(left, 0.0))
            check()

        def now() -> float:
            check()
            clock.spend(1e-3)  # whoever asks for the time in a loop lets it pass
            return broker.wall_time()

        self.sleep, self.time = sleep, now
        self.monotonic = self.perf_counter = self.clock = lambda: now() - broker.wall_time() + clock.now


@contextmanager
def stand_ins(broker: Broker, folder: Path, longest: float | None) -> Iterator[None]:
    """Let imports find the stand-ins, and those of the script's folder the twin's clock."""
    before = {name: sys.modules.get(name) for name in MODULES}
    clock = ScriptTime(broker, longest)
    imported = builtins.__import__
    own = str(folder.resolve())

    def import_(
        name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0
    ) -> Any:
        if name == "time" and level == 0 and str((globals or {}).get("__file__", "")).startswith(own):
            return clock
        return imported(name, globals, locals, fromlist, level)

    sys.modules.update(MODULES)
    set_broker(broker)
    builtins.__import__ = import_
    sys.path.insert(0, own)
    try:
        yield
    finally:
        builtins.__import__ = imported
        sys.path.remove(own)
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
        arguments: What stands behind its name on the command line.
        broker: The simulated robot.
        longest: Time of the twin after which it is interrupted, as by Ctrl-C [s]: in its sleeps, in calls
            that block, and when it asks for the time.

    Returns:
        How it ended.

    Raises:
        FileFormatError: for a file that is no script.
        InvalidValueError: for a time that is not above 0.
    """
    if longest is not None and not longest > 0:
        raise InvalidValueError("longest", longest, "a time above 0 [s]")
    script = as_path(path)
    code = compile(python3_source(script), str(script), "exec")
    module = types.ModuleType("__main__")
    module.__file__ = str(script.resolve())
    names = {
        "raw_input": _no_input,
        "input": _no_input,
        "unicode": str,
        "xrange": range,
        "long": int,
        "basestring": str,
    }
    for name, value in names.items():
        if not (name == "input" and sys.stdin is not None and sys.stdin.isatty()):
            module.__dict__[name] = value
    main, argv = sys.modules["__main__"], sys.argv
    begun = broker.body.time.now
    ended, status = "completed", 0
    error: BaseException | None = None
    with stand_ins(broker, script.parent, None if longest is None else begun + longest):
        broker.body.time.limit(math.inf if longest is None else begun + longest)
        sys.modules["__main__"], sys.argv = module, [str(script), *arguments]
        try:
            exec(code, module.__dict__)
        except TimeIsUp:
            ended = "time is up"
        except SystemExit as exit_:
            ended = "exited"
            status = exit_.code if isinstance(exit_.code, int) else int(exit_.code is not None)
            if exit_.code is not None and not isinstance(exit_.code, int):
                print(exit_.code, file=sys.stderr)  # as Python does
        except KeyboardInterrupt as interrupt:
            ended, status, error = "interrupted", 130, interrupt
        except Exception as failure:
            ended, status, error = "failed", 1, failure
        finally:
            broker.body.time.limit(math.inf)
            sys.modules["__main__"], sys.argv = main, argv
    return ScriptResult(ended, status, broker.body.time.now - begun, error)


def _no_input(prompt: object = "") -> str:
    """Return an empty line: nobody is there to type one."""
    print(prompt)
    return ""
