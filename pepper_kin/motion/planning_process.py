"""Helper processes for planning, and the transfer of problems and plans.

Threads do not suffice: half of a plan's time is Python code, which runs in one thread at a time.  The
processes are started anew, not forked, and do not run the main script; they read problems from a pipe until
it is closed.  Robot and scene are sent once for all problems of a chunk, and plans are returned without them.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import io
import os
import pickle
import struct
import subprocess
import sys
import threading
from collections import OrderedDict
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING, Any

from pepper_kin.collision import Scene, checker_for
from pepper_kin.ik import IKResult
from pepper_kin.model import PepperModel
from pepper_kin.motion.plan_result import Plan

if TYPE_CHECKING:
    from pepper_kin.motion.batch_planning import Outcome, PlanProblem

_LENGTH = struct.Struct("<Q")
_MOST_KEPT = 64
"""Maximum number of robots, and of scenes, that a process caches with their tables."""


_NOTHING = Scene()


class UnansweredError(Exception):
    """Error if a process cannot read its message, or has ended."""


class Helper:
    """A process that plans.

    Attributes:
        ready: Event that is set once the process has started.
    """

    def __init__(self) -> None:
        path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": path},
        )
        self.ready = threading.Event()
        self._busy = threading.Lock()
        threading.Thread(target=self._wait, daemon=True).start()

    @property
    def ended(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    def end(self) -> None:
        """Kill the process."""
        with contextlib.suppress(OSError):
            self._process.kill()

    def solve(
        self, pepper: PepperModel, scene: Scene | None, problems: Sequence[PlanProblem]
    ) -> Sequence[Outcome]:
        """Return plans and errors of problems of one robot and one scene.

        Raises:
            UnansweredError: if the problems cannot be sent or read, or the process has ended.
        """
        try:
            message = pickle.dumps(
                (pickle.dumps(pepper), pickle.dumps(scene), _packed(problems, pepper, scene))
            )
        except Exception as error:  # pickling a user's own task may raise anything
            raise UnansweredError from error
        with self._busy:
            try:
                _write(self._pipe("stdin"), message)
                answer = _read(self._pipe("stdout"))
            except (OSError, EOFError) as error:
                self.end()
                raise UnansweredError from error
        found: Sequence[Outcome] | None = _Unpickler(answer, pepper, scene).load() if answer else None
        if found is None:
            raise UnansweredError
        return found

    def _pipe(self, name: str) -> IO[bytes]:
        pipe: IO[bytes] | None = getattr(self._process, name)
        if pipe is None:
            raise EOFError
        return pipe

    def _wait(self) -> None:
        with self._busy, contextlib.suppress(OSError, EOFError):
            _read(self._pipe("stdout"))
            self.ready.set()


_lock = threading.Lock()
_helpers: list[Helper] = []


def helpers(count: int) -> list[Helper]:
    """Return a number of helper processes, starting missing ones; they end with this process."""
    with _lock:
        _helpers[:] = [one for one in _helpers if not one.ended]
        while len(_helpers) < count:
            _helpers.append(Helper())
        return _helpers[: max(count, 0)]


@atexit.register
def _end_all() -> None:
    for one in _helpers:
        one.end()


if hasattr(os, "register_at_fork"):  # a child has no helpers
    os.register_at_fork(after_in_child=_helpers.clear)


def _write(pipe: IO[bytes], message: bytes) -> None:
    pipe.write(_LENGTH.pack(len(message)))
    pipe.write(message)
    pipe.flush()


def _read(pipe: IO[bytes]) -> bytes:
    """Return the next message.

    Raises:
        EOFError: if the pipe has ended.
    """
    head = pipe.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    size = _LENGTH.unpack(head)[0]
    message = pipe.read(size)
    if len(message) < size:
        raise EOFError
    return message


class _Pickler(pickle.Pickler):
    """Pickler that leaves out robot and scene, which both sides have, and certificates not yet computed."""

    def __init__(self, file: IO[bytes], pepper: PepperModel, *scenes: Scene | None) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self.shared = {id(scene): "scene" for scene in scenes if scene is not None} | {id(pepper): "robot"}

    def persistent_id(self, obj: object) -> str | None:
        """Return the name of a shared object, or None."""
        return self.shared.get(id(obj))

    def reducer_override(self, obj: Any) -> Any:
        """Pickle results with the means to compute their certificates, which are rarely needed."""
        if type(obj) in (Plan, IKResult):
            return _restored, (type(obj), dict(obj.__dict__))
        return NotImplemented


def _restored(kind: type, fields: dict[str, Any]) -> Any:
    made: Any = object.__new__(kind)
    made.__dict__.update(fields)
    return made


class _Unpickler(pickle.Unpickler):
    """Unpickler that inserts the robot and the scene of this process."""

    def __init__(self, message: bytes, pepper: PepperModel, scene: Scene | None) -> None:
        super().__init__(io.BytesIO(message))
        self.pepper, self.scene = pepper, scene

    def persistent_load(self, pid: str) -> object:
        """Return a shared object by its name."""
        return self.pepper if pid == "robot" else _NOTHING if self.scene is None else self.scene


def _packed(value: object, pepper: PepperModel, *scenes: Scene | None) -> bytes:
    file = io.BytesIO()
    _Pickler(file, pepper, *scenes).dump(value)
    return file.getvalue()


class _Kept:
    """Cache of recently read values, so that their tables are reused."""

    def __init__(self) -> None:
        self._values: OrderedDict[bytes, Any] = OrderedDict()

    def read(self, message: bytes) -> Any:
        """Return the value of a message; the same object for the same message."""
        key = hashlib.sha256(message).digest()
        if key not in self._values:
            self._values[key] = pickle.loads(message)
        self._values.move_to_end(key)
        while len(self._values) > _MOST_KEPT:
            self._values.popitem(last=False)
        return self._values[key]


def _answer(message: bytes, robots: _Kept, scenes: _Kept) -> bytes:
    """Return the answer to a message; an empty one if the message cannot be read."""
    try:
        robot, world, body = pickle.loads(message)
        pepper, scene = robots.read(robot), scenes.read(world)
        problems: Sequence[PlanProblem] = _Unpickler(body, pepper, scene).load()
    except Exception:  # a class of a script that is not run here, a file that is gone, ...
        return b""
    found = [problem.outcome() for problem in problems]
    try:
        return _packed(found, pepper, scene, checker_for(pepper, scene).scene)
    except Exception:  # an error or result of a user's own class
        return b""


def serve() -> None:
    """Answer messages until the pipe is closed; printed text is redirected to standard error."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent process
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    import pepper_kin.motion.planning  # noqa: F401, so that a helper is ready when it says so

    robots, scenes = _Kept(), _Kept()
    with contextlib.suppress(EOFError, OSError):
        _write(answers, b"ready")
        while True:
            _write(answers, _answer(_read(sys.stdin.buffer), robots, scenes))
