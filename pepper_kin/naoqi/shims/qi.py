"""The module `qi` of Python scripts: sessions, applications, futures, signals and periodic tasks."""

from __future__ import annotations

import builtins
import inspect
import threading
from collections.abc import Callable
from itertools import pairwise
from typing import Any

from pepper_kin.naoqi import memory
from pepper_kin.naoqi.errors import quoted
from pepper_kin.naoqi.shims import qi_logging as logging
from pepper_kin.naoqi.shims.futures import (
    Future,
    FutureState,
    Promise,
    current_broker,
    futureBarrier,
    in_strand,
    run_async,
)
from pepper_kin.naoqi.shims.proxy import Proxy, find_module
from pepper_kin.naoqi.shims.qi_logging import Logger

__all__ = [
    "Application",
    "ApplicationSession",
    "Future",
    "FutureState",
    "Logger",
    "PeriodicTask",
    "Promise",
    "Property",
    "Session",
    "Signal",
    "Strand",
    "async_",
    "bind",
    "clockNow",
    "futureBarrier",
    "logging",
    "module",
    "multiThreaded",
    "nobind",
    "runAsync",
    "singleThreaded",
    "sleep",
]


URL = "tcp://127.0.0.1:9559"


class Type:
    """A type of libqi, by its signature; a call without arguments returns itself: `qi.Int8() == qi.Int8`."""

    def __init__(self, signature: str) -> None:
        self.signature = signature

    def __call__(self, *inner: Type) -> Type:
        """Return the type of a container of types."""
        return Type(self.signature + "".join(one.signature for one in inner)) if inner else self

    def __eq__(self, other: object) -> bool:
        if self.signature in _CONTAINERS or getattr(other, "signature", "") in _CONTAINERS:
            raise TypeError("a List, Map or Optional needs the types of what it holds")
        return builtins.isinstance(other, Type) and self.signature == other.signature

    def __hash__(self) -> int:
        return hash(self.signature)


_TYPES = {
    "Void": "v", "Bool": "b", "Int8": "c", "UInt8": "C", "Int16": "w", "UInt16": "W", "Int32": "i",
    "UInt32": "I", "Int64": "l", "UInt64": "L", "Float": "f", "Double": "d", "String": "s", "Raw": "r",
    "Object": "o", "Dynamic": "m", "AnyArguments": "*", "Unknown": "X", "List": "[", "Map": "{",
    "Struct": "(", "Optional": "+",
}  # fmt: skip
_CONTAINERS = ("[", "{", "+")
globals().update({name: Type(signature) for name, signature in _TYPES.items()})


def typeof(value: Any) -> Type:
    """Return the type of a value: Object for a proxy, Dynamic for any other."""
    return Type("o" if builtins.isinstance(value, Proxy) else "m")


def isinstance(value: Any, kind: Type) -> bool:
    """Return whether a value has a type."""
    return typeof(value) == kind


class Signal(memory.MemorySignal):
    """A signal whose functions exclude other methods of their `singleThreaded` object."""

    def connect(self, callback: Callable[..., Any], *arguments: Any, **named: Any) -> int:
        """Connect a function, which is called whenever the signal is emitted; return its number."""
        return super().connect(in_strand(callback), *arguments, **named)

    addCallback = connect


class Property(Signal):
    """A value with a signal.

    Args:
        signature: Type of the values: "i", "s", "[f]", "{si}", "(ii)", or "+s" for values that may be None.
        on_subscribers: Called with True after the first connection, False after the last.
    """

    def __init__(self, signature: str = "m", *on_subscribers: Any) -> None:
        super().__init__(signature, *on_subscribers)
        self._signature = str(signature)
        kind = _KINDS.get(self._signature[:1])
        self._value: Any = None if kind is None else kind()

    def value(self) -> Any:
        """Return the present value."""
        return self._value

    def setValue(self, value: Any) -> None:
        """Set the value and emit it.

        Raises:
            RuntimeError: for a value of another type.
        """
        kind = _KINDS.get(self._signature.removeprefix("+")[:1])
        absent = value is None and self._signature.startswith("+")
        fits = int | float if kind in (int, float, bool) else kind
        if fits is not None and not absent and not builtins.isinstance(value, fits):
            raise RuntimeError(f"cannot convert {quoted(value)} to the type {self._signature}")
        self._value = value
        self(value)


_KINDS: dict[str, Any] = dict.fromkeys("cCwWiIlL", int) | {
    "b": bool, "f": float, "d": float, "s": str, "[": list, "{": dict, "(": tuple,
}  # fmt: skip


class Strand:
    """A queue that executes its calls one at a time."""

    def __init__(self) -> None:
        self._lock = threading.RLock()

    def async_(self, function: Callable[..., Any], *arguments: Any, delay: float = 0.0) -> Future:
        """Call a function asynchronously, after a delay [us], when no other call of this strand runs."""

        def alone() -> Any:
            with self._lock:
                return function(*arguments)

        return run_async(alone, delay=delay)


class Session:
    """A session with the twin; addresses are ignored."""

    def __init__(self, *_: Any) -> None:
        self._connected, self._own = False, dict[int, str]()
        self.connected, self.disconnected = Signal(), Signal()
        self.serviceRegistered, self.serviceUnregistered = _REGISTERED, _UNREGISTERED

    def connect(self, *_: Any, _async: bool = False, **__: Any) -> Any:
        """Connect to the twin."""
        current_broker()
        self._connected = True
        self.connected()
        return Future(None) if _async else None

    def close(self, *_: Any, _async: bool = False, **__: Any) -> Any:
        """Disconnect, and unregister the session's services."""
        if self._connected:
            self._connected = False
            self.disconnected("closed")
        for number in tuple(self._own):
            self.unregisterService(number)
        return Future(None) if _async else None

    def isConnected(self) -> bool:
        """Return whether the session is connected."""
        return self._connected

    def url(self) -> str:
        """Return the address."""
        return URL

    def endpoints(self) -> list[str]:
        """Return the addresses."""
        return [URL]

    def service(self, name: str, *_: Any, _async: bool = False) -> Any:
        """Return a proxy of a module."""

        def find() -> Proxy:
            return Proxy(self if name == "ServiceDirectory" else find_module(name))

        return run_async(find) if _async else find()

    def waitForService(self, name: str, timeout: int = 300_000, *_: Any, _async: bool = False) -> Any:
        """Wait until a module is registered, at most a timeout [ms].

        Raises:
            RuntimeError: if it is not registered by then.
        """
        futures: list[Future] = []

        def known() -> bool:
            return name in current_broker().module_names or any(one.isCancelRequested() for one in futures)

        def wait() -> None:
            if not current_broker().body.time.wait_until(known, timeout / 1000.0):
                raise RuntimeError(f"no service '{name}' came in {timeout} ms")

        futures += [run_async(wait)] if _async else []
        return futures[0] if futures else wait()

    def services(self, *_: Any) -> list[dict[str, Any]]:
        """Return name and number of every module."""
        return [{"name": name, "serviceId": k + 1} for k, name in enumerate(current_broker().module_names)]

    def registerService(self, name: str, service: Any, *_: Any) -> int:
        """Register a module of the script; return its number.

        Raises:
            RuntimeError: for a method without `self`, or invalid types.
        """
        for method_name, method in inspect.getmembers(type(service), inspect.isfunction):
            static = builtins.isinstance(inspect.getattr_static(type(service), method_name), staticmethod)
            returns, parameters = getattr(method, "__qi_types__", (None, None))
            listed = parameters if builtins.isinstance(parameters, list | tuple) else [parameters]
            if not (static or inspect.signature(method).parameters):
                raise RuntimeError(f"{name}::{method_name} has no self")
            if any(not (one is None or builtins.isinstance(one, Type)) for one in (returns, *listed)):
                raise RuntimeError(f"{name}::{method_name} has types that are none of qi's")
        current_broker().add_module(name, service)
        number = len(current_broker().module_names)
        self._own[number] = name
        _REGISTERED(number, name)
        return number

    def unregisterService(self, number: int) -> None:
        """Unregister a service that the session registered."""
        name = self._own.pop(number, None)
        if name is None:
            raise RuntimeError(f"no service of this session has the number {number}")
        current_broker().remove_module(name)
        _UNREGISTERED(number, name)

    def listenStandalone(self, *_: Any, **__: Any) -> None:
        """Connect to the twin; other processes connect to `pepper-kin naoqi`."""
        self.connect()

    def loadServiceRename(self, name: str, *_: Any) -> None:
        """Raise RuntimeError: libqi's modules are compiled for the robot."""
        module(name)


_REGISTERED, _UNREGISTERED = Signal(), Signal()


class Application:
    """An application with a session."""

    def __init__(self, args: Any = None, *_: Any, url: str = "", autoExit: bool = True, **__: Any) -> None:
        self.session = Session()
        self._ended, self._runs = threading.Event(), False
        self._at_run: list[Callable[[], Any]] = []
        self._at_stop: list[Callable[[], Any]] = []
        words = [str(word) for word in args or ()]
        named = [b for a, b in pairwise(words) if a == "--qi-url"]
        named += [word.partition("=")[2] for word in words if word.startswith("--qi-url=")]
        self.url = named[-1] if named else url or URL

    def start(self) -> None:
        """Connect the session."""
        if not self.session.isConnected():
            self.session.connect(self.url)

    def run(self) -> None:
        """Run until `stop` is called."""
        self.start()
        clock, self._runs = current_broker().body.time, True
        while self._at_run:
            self._at_run.pop(0)()
        while not self._ended.is_set():
            clock.sleep(0.1)
        while self._at_stop:
            self._at_stop.pop(0)()

    def stop(self) -> None:
        """End `run`."""
        self._ended.set()

    def atRun(self, callback: Callable[[], Any]) -> None:
        """Call a function when `run` starts, or at once if it runs."""
        if self._runs:
            callback()
        else:
            self._at_run.append(callback)

    def atStop(self, callback: Callable[[], Any]) -> None:
        """Call a function when `run` ends."""
        self._at_stop.append(callback)


ApplicationSession = Application


class PeriodicTask:
    """A function that is called periodically."""

    def __init__(self) -> None:
        self._period, self._callback = 1.0, lambda: None
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()

    def setCallback(self, callback: Callable[[], Any]) -> None:
        """Set the function to call."""
        self._callback = in_strand(callback)

    def setUsPeriod(self, period: float) -> None:
        """Set the pause between two calls [us]."""
        self._period = period / 1e6

    def setName(self, name: str) -> None:
        """Accept a name, without effect."""

    def compensateCallbackTime(self, compensate: bool) -> None:
        """Accept the setting, without effect."""

    def start(self, immediate: bool = True) -> None:
        """Start the calls."""
        self._ended.clear()

        def run() -> None:
            clock = current_broker().body.time
            if not immediate:
                clock.sleep(self._period)
            while not self._ended.is_set():
                self._callback()
                clock.sleep(self._period)

        self._thread = threading.Thread(target=run, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop the calls."""
        self._ended.set()

    def asyncStop(self) -> None:
        """Stop the calls."""
        self._ended.set()

    def isRunning(self) -> bool:
        """Return whether the calls go on."""
        return self._thread is not None and self._thread.is_alive() and not self._ended.is_set()


def runAsync(function: Callable[..., Any], *arguments: Any, **named: Any) -> Future:
    """Call a function asynchronously; return its future."""
    return run_async(function, *arguments, **named)


async_ = runAsync
fatal, error, warning = logging.fatal, logging.error, logging.warning
info, verbose, debug = logging.info, logging.verbose, logging.debug


def bind(returns: Any = None, parameters: Any = None, name: str | None = None) -> Callable[[Any], Any]:
    """Return a decorator that renames a method; its types are checked when its service is registered."""

    def named(method: Any) -> Any:
        if name is not None:
            method.__qi_name__ = name
        method.__qi_types__ = (returns, parameters)
        return method

    return named


def nobind(method: Any) -> Any:
    """Hide a method from the clients of its service."""
    method.__qi_name__ = None
    return method


def _threading(kind: str) -> Callable[[], Callable[[Any], Any]]:
    def decorator() -> Callable[[Any], Any]:
        def mark(marked: Any) -> Any:
            marked.__qi_threading__ = kind
            return marked

        return mark

    return decorator


multiThreaded, singleThreaded = _threading("multi"), _threading("single")


def module(name: str) -> Any:
    """Raise RuntimeError: libqi's modules are compiled for the robot.

    Raises:
        RuntimeError: always.
    """
    raise RuntimeError(f"qi.module: the module {quoted(name)} is compiled code that the twin does not have")


def clockNow() -> int:
    """Return the simulated time [ns]."""
    return int(current_broker().body.time.now * 1e9)


systemClockNow = steadyClockNow = clockNow


def sleep(seconds: float) -> None:
    """Wait for a simulated time [s]."""
    current_broker().body.time.sleep(seconds)


def listen(*_: Any) -> None:
    """Accept the call, without effect."""
