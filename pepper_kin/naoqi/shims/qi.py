"""The module `qi` of Python scripts: sessions, applications, futures, signals and periodic tasks."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from pepper_kin.naoqi.memory import Signal
from pepper_kin.naoqi.shims.proxy import Future, Proxy, current_broker, find_module, run_async

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
    "async_",
    "bind",
    "clockNow",
    "multiThreaded",
    "nobind",
    "runAsync",
    "singleThreaded",
    "sleep",
]

AnyArguments = Dynamic = Void = Bool = Float = Double = Int32 = UInt32 = Int64 = String = object
List = Map = Struct = Object = lambda *_: object


class FutureState:
    """States of a future."""

    None_, Running, Canceled, FinishedWithError, FinishedWithValue = 0, 1, 2, 3, 4


class Promise:
    """A future that somebody else fulfils."""

    def __init__(self, *_: Any) -> None:
        self._future = Future()

    def setValue(self, value: Any) -> None:
        """Fulfil it."""
        self._future.finish(value)

    def setError(self, error: str) -> None:
        """Let it fail."""
        self._future.fail(RuntimeError(error))

    def setCanceled(self) -> None:
        """Cancel it."""
        self._future.fail(RuntimeError("Future canceled"))

    def future(self) -> Future:
        """Return the future."""
        return self._future


class Session:
    """A session with the twin, whatever address is named."""

    def __init__(self, *_: Any) -> None:
        self._connected = False
        self.connected, self.disconnected = Signal(), Signal()
        self.serviceRegistered, self.serviceUnregistered = Signal(), Signal()

    def connect(self, *_: Any, _async: bool = False, **__: Any) -> Any:
        """Connect."""
        current_broker()
        self._connected = True
        return run_async(lambda: None) if _async else None

    def close(self, *_: Any, **__: Any) -> None:
        """Disconnect."""
        self._connected = False

    def isConnected(self) -> bool:
        """Return whether it is connected."""
        return self._connected

    def url(self) -> str:
        """Return the address."""
        return "tcp://127.0.0.1:9559"

    def service(self, name: str, *_: Any, _async: bool = False) -> Any:
        """Return a module."""
        return run_async(lambda: Proxy(find_module(name))) if _async else Proxy(find_module(name))

    def waitForService(self, name: str, *_: Any, **__: Any) -> None:
        """Return once there is a module, which is at once."""
        find_module(name)

    def services(self, *_: Any) -> list[dict[str, Any]]:
        """Return the modules."""
        return [{"name": name, "serviceId": k + 1} for k, name in enumerate(current_broker().module_names)]

    def registerService(self, name: str, service: Any, *_: Any) -> int:
        """Register a module of the script; return its number."""
        current_broker().add_module(name, service)
        return len(current_broker().module_names)

    def unregisterService(self, *_: Any) -> None:
        """Accept: modules of scripts end with them."""

    def listenStandalone(self, *_: Any) -> None:
        """Accept: others connect to `pepper-kin naoqi`."""

    def loadServiceRename(self, *_: Any) -> None:
        """Accept."""


class Application:
    """An application with a session."""

    def __init__(self, args: Any = None, *_: Any, url: str = "", **__: Any) -> None:
        self.session = Session()
        self.session.connect()
        self._ended = threading.Event()
        self.url = url or "tcp://127.0.0.1:9559"

    def start(self) -> None:
        """Connect, which is done."""

    def run(self) -> None:
        """Let time pass until `stop`."""
        clock = current_broker().body.time
        while not self._ended.is_set():
            clock.sleep(0.1)

    def stop(self) -> None:
        """End `run`."""
        self._ended.set()

    def atRun(self, callback: Callable[[], Any]) -> None:
        """Call a function when it runs, which is now."""
        callback()

    def atStop(self, callback: Callable[[], Any]) -> None:
        """Accept."""


ApplicationSession = Application


class PeriodicTask:
    """A function that is called again and again."""

    def __init__(self) -> None:
        self._period, self._callback = 1.0, lambda: None
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()

    def setCallback(self, callback: Callable[[], Any]) -> None:
        """Set the function."""
        self._callback = callback

    def setUsPeriod(self, period: float) -> None:
        """Set the time between two calls [us]."""
        self._period = period / 1e6

    def setName(self, name: str) -> None:
        """Accept a name."""

    def compensateCallbackTime(self, compensate: bool) -> None:
        """Accept."""

    def start(self, immediate: bool = True) -> None:
        """Begin."""
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
        """End."""
        self._ended.set()

    def asyncStop(self) -> None:
        """End."""
        self._ended.set()

    def isRunning(self) -> bool:
        """Return whether it goes on."""
        return self._thread is not None and self._thread.is_alive() and not self._ended.is_set()


class Property(Signal):
    """A value with a signal."""

    def __init__(self, *_: Any) -> None:
        super().__init__()
        self._value: Any = None

    def value(self) -> Any:
        """Return the value."""
        return self._value

    def setValue(self, value: Any) -> None:
        """Set the value and emit it."""
        self._value = value
        self(value)


class Logger:
    """Messages of a category, kept in the twin's log."""

    def __init__(self, category: str = "") -> None:
        self._category = category

    def _log(self, text: Any, *_: Any) -> None:
        current_broker().log(f"{self._category}: {text}")

    verbose = info = warning = error = fatal = debug = _log


def runAsync(function: Callable[..., Any], *arguments: Any, **named: Any) -> Future:
    """Call a function beside the caller."""
    return run_async(function, *arguments, **named)


async_ = runAsync


def bind(*_: Any, **__: Any) -> Callable[[Any], Any]:
    """Return a decorator that changes nothing: types need no binding in one process."""
    return lambda method: method


def nobind(method: Any) -> Any:
    """Return the method."""
    return method


def multiThreaded(*_: Any) -> Callable[[Any], Any]:
    """Return a decorator that changes nothing."""
    return lambda kind: kind


singleThreaded = multiThreaded


def clockNow() -> int:
    """Return the time of the twin [ns]."""
    return int(current_broker().body.time.now * 1e9)


systemClockNow = steadyClockNow = clockNow


def sleep(seconds: float) -> None:
    """Let time pass [s]."""
    current_broker().body.time.sleep(seconds)


def listen(*_: Any) -> None:
    """Accept."""


def logging(category: str = "") -> Logger:
    """Return a logger."""
    return Logger(category)
