"""Modules as services of libqi: signatures, conversion of values, and running calls."""

from __future__ import annotations

import contextlib
import inspect
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from pepper_kin.naoqi.errors import NaoqiError
from pepper_kin.naoqi.memory import MemorySignal, Subscriber
from pepper_kin.naoqi.module import Module, robot_signatures
from pepper_kin.naoqi.tables import table
from pepper_kin.naoqi.tasks import Tasks

ARRIVING = ("moveTo", "walkTo")
"""Methods that return whether the base arrived: void in the robot's list, but not in the documents."""

PICTURE = "(iiiiiiriffff)"
"""Signature of the result of methods that return an image: bytes are sent as bytes only if declared."""

RETURNS = {"getImageRemote": PICTURE, "getImageLocal": PICTURE}

MOST_ARGUMENTS = 6
"""Maximum number of arguments over the wire of a method with variable arguments."""


READING = ("get", "is", "has", "are", "ping", "version", "wait")
"""Prefixes of the names of methods that change nothing."""

NAMELESS = 0.2
"""Maximum time to wait for libqi to release unregistered objects, of which it keeps some [s]."""


def only_reads(method: str) -> bool:
    """Return whether a method changes nothing on the robot, judged by its name."""
    return method in table("wire")["reading"] or any(
        method == word or (method.startswith(word) and method[len(word)].isupper()) for word in READING
    )


class Wire:
    """All objects that libqi may call in this process, which are released before Python ends.

    A thread of libqi that enters Python while Python ends is killed inside C++, which aborts the process.
    `close` therefore refuses new calls, waits for running calls, and waits until libqi has released all
    objects.

    Args:
        qi: The module `qi`.
    """

    def __init__(self, qi: Any) -> None:
        self.qi = qi
        self._lock = threading.Condition()
        self._running = 0
        self._closing = False
        self._kinds: list[tuple[type, tuple[str, ...]]] = []
        self._services: weakref.WeakSet[Any] = weakref.WeakSet()
        self._nameless: weakref.WeakSet[Any] = weakref.WeakSet()
        self._subscribers: dict[Subscriber, tuple[Any, int]] = {}

    def service(self, module: Module, *, locked: bool = False, named: bool = True) -> Any:
        """Return an object that libqi can register, with each method for each number of its arguments.

        Args:
            module: Module of the broker.
            locked: Whether methods that change anything are refused.
            named: Whether the object will be registered; otherwise it is a call's result.
        """
        methods: dict[str, Any] = {}
        for name, signature, returns in wire_methods(module):
            call = getattr(module, name)
            if locked and not only_reads(name):
                call = _locked(module.name, name)
            tasks = module.body.tasks
            bound = self._caller(call, len(signature), returns, f"{module.name}::{name}", tasks)
            bound.__qi_name__ = name
            bound.__qi_signature__ = f"({''.join(signature)})"
            bound.__qi_return_signature__ = returns
            methods[f"{name}_{len(methods)}"] = bound
        for name, value in vars(module).items():
            if isinstance(value, MemorySignal) and not name.startswith("_"):
                methods[name] = value
        made = self._object(f"{module.name}Service", methods, inspect.getdoc(type(module)) or "")
        kept_by = self._services if named else self._nameless
        kept_by.add(made)
        kept_by.update(value for value in methods.values() if inspect.isfunction(value))
        return made

    def object_of(self, name: str, methods: dict[str, Callable[..., Any]]) -> Any:
        """Return an object as a call's result, with functions by name, each of one string."""
        bound = {}
        for method, call in methods.items():
            function = self._caller(call, 1, "o", f"{name}::{method}")
            function.__qi_name__, function.__qi_signature__ = method, "(s)"
            function.__qi_return_signature__ = "o"
            bound[method] = function
        made = self._object(name, bound, "")
        self._nameless.add(made)
        return made

    def _object(self, name: str, methods: dict[str, Any], help: str) -> Any:
        """Return an object with methods whose calls may overlap."""
        kind = self.qi.multiThreaded()(type(name, (), {**methods, "__doc__": help}))
        self._kinds.append((kind, tuple(methods)))
        return kind()

    def refuse(self) -> None:
        """Refuse further calls."""
        with self._lock:
            self._closing = True

    def close(self, seconds: float) -> bool:
        """Refuse calls, and wait until running calls and libqi's objects are gone; return whether they are.

        Args:
            seconds: Maximum time to wait [s].
        """
        end = time.monotonic() + seconds
        self.refuse()
        with self._lock:
            idle = self._lock.wait_for(lambda: self._running == 0, seconds)
        while self._subscribers:
            subscriber, kept = self._subscribers.popitem()
            subscriber.signal.disconnect(kept[1])
            del kept  # the last reference to libqi's object
        while self._kinds:
            kind, names = self._kinds.pop()
            for name in names:
                delattr(kind, name)
        self._wait_for(self._services, end)
        self._wait_for(self._nameless, min(end, time.monotonic() + NAMELESS))
        return idle and not len(self._services)

    def _wait_for(self, objects: weakref.WeakSet[Any], end: float) -> None:
        """Wait until all objects are deleted, or until a time on the monotonic clock [s]."""
        while len(objects) and time.monotonic() < end:
            time.sleep(0.005)

    def _caller(
        self, method: Callable[..., Any], count: int, returns: str, where: str, tasks: Tasks | None = None
    ) -> Any:
        """Return a function with exactly `count` arguments, which libqi can bind.

        Errors keep their text; the method's name, `where`, precedes texts without it.  Tasks of a call do not
        start if their joints were stopped in `tasks` after the call arrived.
        """

        def call(*arguments: Any) -> Any:
            within = contextlib.nullcontext() if tasks is None else tasks.within(tasks.new_call())
            with self._lock:
                if self._closing:
                    return self._failed("the server is being closed")
                self._running += 1
            try:
                with within:
                    value = method(*map(as_plain, arguments))
                if returns == PICTURE:
                    return tuple(value)
                return None if returns == "v" else self.value(value)
            except Exception as error:
                # A posted call keeps its error, whose traceback would keep the service, and `close` waiting.
                error.__traceback__ = None
                return self._failed(str(error) if isinstance(error, NaoqiError) else f"{where}\n\t{error}")
            finally:
                with self._lock:
                    self._running -= 1
                    if self._closing:
                        self._lock.notify_all()

        names = ", ".join(f"a{k}" for k in range(count))
        space: dict[str, Any] = {"call": call}
        exec(f"def bound(self{', ' if names else ''}{names}):\n    return call({names})", space)
        return space.pop("bound")  # `space` is the function's globals: `bound` in it would be a cycle

    def _failed(self, reason: str) -> Any:
        """Return a future of libqi with an error, which keeps the text unchanged."""
        promise = self.qi.Promise()
        promise.setError(reason)
        return promise.future()

    def value(self, value: Any) -> Any:
        """Convert a value to one that libqi can send."""
        if isinstance(value, Subscriber):
            return self._subscriber(value)
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, tuple | list):
            return [self.value(one) for one in value]
        return value

    def _subscriber(self, subscriber: Subscriber) -> Any:
        """Return the libqi object with the signal of an event, created once."""
        with self._lock:
            if subscriber not in self._subscribers:
                made = type("Subscriber", (), {})()
                made.signal = self.qi.Signal("(m)")
                number = subscriber.signal.connect(lambda value: made.signal(self.value(value)))
                self._subscribers[subscriber] = (made, number)
                self._nameless.add(made)
            return self._subscribers[subscriber][0]


def _locked(module: str, name: str) -> Callable[..., Any]:
    """Return a function that raises, and says how to unlock the method."""

    def refuse(*_: Any) -> None:
        raise NaoqiError(
            module, name, f'needs the token: session.service("Access").unlock(token).service("{module}")'
        )

    return refuse


def wire_methods(module: Module) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield name, argument types and result type of every method, in libqi's signatures."""
    listed = [s for s in robot_signatures() if s.module == module.name]
    known_arities: set[tuple[str, int]] = set()
    for s in listed:
        types = tuple(table("wire")["types"][kind] for _, kind in s.parameters)
        known_arities.add((s.name, len(types)))
        yield s.name, types, "b" if s.name in ARRIVING else table("wire")["types"][s.returns]
    known = {s.name for s in listed}
    for name in module.getMethodList():
        if name in known:
            continue
        for count in _counts(getattr(module, name)):
            if (name, count) not in known_arities:
                known_arities.add((name, count))
                yield name, ("m",) * count, RETURNS.get(name, "m")


def _counts(method: Callable[..., Any]) -> list[int]:
    """Return all possible numbers of arguments of a method."""
    least, most = 0, 0
    for parameter in inspect.signature(method).parameters.values():
        if parameter.kind is parameter.VAR_POSITIONAL:
            most = MOST_ARGUMENTS
        elif parameter.kind is not parameter.KEYWORD_ONLY:
            most += 1
            least += parameter.default is parameter.empty
    return list(range(least, most + 1))


def as_plain(value: Any) -> Any:
    """Convert tuples of a received value to lists."""
    if isinstance(value, tuple | list):
        return [as_plain(one) for one in value]
    return value
