"""Services of libqi made of modules: signatures, conversion of values, and the calls that are under way."""

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
"""Methods that say whether they arrived, which the list calls void and the documents do not."""

PICTURE = "(iiiiiiriffff)"
"""What the methods that return a picture return: only declared bytes cross the wire as bytes."""

RETURNS = {"getImageRemote": PICTURE, "getImageLocal": PICTURE}

MOST_ARGUMENTS = 6
"""Arguments that a method with any number of them takes over the wire."""


READING = ("get", "is", "has", "are", "ping", "version", "wait")
"""Beginnings of the names of methods that change nothing."""

NAMELESS = 0.2
"""Time that is left to libqi to let go of objects without a name, of which it keeps some [s]."""


def only_reads(method: str) -> bool:
    """Return whether a method, by its name, changes nothing on the robot."""
    return method in table("wire")["reading"] or any(
        method == word or (method.startswith(word) and method[len(word)].isupper()) for word in READING
    )


class Wire:
    """Everything that libqi may call in this process, so that it can be ended before Python is.

    A thread of libqi that enters Python while Python ends is ended in the middle of C++, which aborts the
    process.  `close` therefore refuses new calls, and waits for those under way and for libqi to let go of
    all objects.

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
        """Return an object that libqi can register: each method with each number of arguments it takes.

        Args:
            module: A module.
            locked: Whether methods that change something are refused.
            named: Whether it will be registered; otherwise a call returns it.
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
        """Return an object that a call can return: functions by name, which take one text each."""
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
        """Refuse calls from now on."""
        with self._lock:
            self._closing = True

    def close(self, seconds: float) -> bool:
        """Refuse calls, wait for those under way and until libqi holds no object; return whether so.

        Args:
            seconds: The longest time to wait.
        """
        end = time.monotonic() + seconds
        self.refuse()
        with self._lock:
            idle = self._lock.wait_for(lambda: self._running == 0, seconds)
        while self._subscribers:
            subscriber, kept = self._subscribers.popitem()
            subscriber.signal.disconnect(kept[1])
            del kept  # the last reference to what libqi was given
        while self._kinds:
            kind, names = self._kinds.pop()
            for name in names:
                delattr(kind, name)
        self._wait_for(self._services, end)
        self._wait_for(self._nameless, min(end, time.monotonic() + NAMELESS))
        return idle and not len(self._services)

    def _wait_for(self, objects: weakref.WeakSet[Any], end: float) -> None:
        """Wait until there is none of these objects any more, or a time is over [s]."""
        while len(objects) and time.monotonic() < end:
            time.sleep(0.005)

    def _caller(
        self, method: Callable[..., Any], count: int, returns: str, where: str, tasks: Tasks | None = None
    ) -> Any:
        """Return a function with exactly so many arguments, which libqi can bind.

        Errors keep their text; those that do not name the method get its name, `where`, before it.  What is
        stopped among `tasks` while a call is on its way to them does not begin.
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
        return space.pop("bound")  # `space` is all that the function sees: together they would be a cycle

    def _failed(self, reason: str) -> Any:
        """Return a future of libqi with an error, which keeps the text as it is."""
        promise = self.qi.Promise()
        promise.setError(reason)
        return promise.future()

    def value(self, value: Any) -> Any:
        """Return a value as libqi sends it."""
        if isinstance(value, Subscriber):
            return self._subscriber(value)
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, tuple | list):
            return [self.value(one) for one in value]
        return value

    def _subscriber(self, subscriber: Subscriber) -> Any:
        """Return the object of libqi with the signal of an event, made once."""
        with self._lock:
            if subscriber not in self._subscribers:
                made = type("Subscriber", (), {})()
                made.signal = self.qi.Signal("(m)")
                number = subscriber.signal.connect(lambda value: made.signal(self.value(value)))
                self._subscribers[subscriber] = (made, number)
                self._nameless.add(made)
            return self._subscribers[subscriber][0]


def _locked(module: str, name: str) -> Callable[..., Any]:
    """Return a function that says how a locked method is reached."""

    def refuse(*_: Any) -> None:
        raise NaoqiError(
            module, name, f'needs the token: session.service("Access").unlock(token).service("{module}")'
        )

    return refuse


def wire_methods(module: Module) -> Iterator[tuple[str, tuple[str, ...], str]]:
    """Yield name, types of the arguments and type of the result, as libqi writes them, of all methods."""
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
    """Return the numbers of arguments that a method takes."""
    least, most = 0, 0
    for parameter in inspect.signature(method).parameters.values():
        if parameter.kind is parameter.VAR_POSITIONAL:
            most = MOST_ARGUMENTS
        elif parameter.kind is not parameter.KEYWORD_ONLY:
            most += 1
            least += parameter.default is parameter.empty
    return list(range(least, most + 1))


def as_plain(value: Any) -> Any:
    """Return a value from the wire as lists, numbers, strings and dictionaries."""
    if isinstance(value, tuple | list):
        return [as_plain(one) for one in value]
    return value
