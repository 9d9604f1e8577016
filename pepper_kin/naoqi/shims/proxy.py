"""Proxies of modules for scripts: calls, `.post` and futures."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable
from typing import Any

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.naoqi.broker import Broker
from pepper_kin.naoqi.errors import NaoqiError
from pepper_kin.naoqi.memory import Signal, Subscriber

CALL = 0.001
"""Time that a call takes [s]."""

_BROKER: list[Broker] = []


def set_broker(broker: Broker | None) -> None:
    """Say which simulated robot the scripts of this process talk to."""
    _BROKER[:] = [] if broker is None else [broker]


def current_broker() -> Broker:
    """Return the simulated robot that scripts talk to.

    Raises:
        NaoqiError: where there is none.
    """
    if not _BROKER:
        raise NaoqiError(
            "ALBroker", "createBroker", "no twin is running in this process: use `pepper-kin naoqi run`"
        )
    return _BROKER[-1]


class Future:
    """The result of a call that runs beside the caller."""

    def __init__(self) -> None:
        self._done = threading.Event()
        self._value: Any = None
        self._error: BaseException | None = None
        self._cancelled = False
        self._callbacks: list[Callable[[Future], Any]] = []
        self.on_cancel: Callable[[], object] | None = None

    def wait(self, timeout: int = -1) -> int:
        """Wait for the result [ms], for ever if negative.

        Return 3 where it is there and 1 where it is not.
        """
        clock = current_broker().body.time
        end = None if timeout < 0 else clock.now + timeout / 1000.0
        while not self._done.wait(0.005) and (end is None or clock.now < end):
            if not clock.real_time and threading.current_thread() is threading.main_thread():
                clock.sleep(0.02)
        return 3 if self._done.is_set() else 1

    def value(self, timeout: int = -1) -> Any:
        """Wait for the result and return it; raise the error of the call."""
        self.wait(timeout)
        if self._error is not None:
            raise self._error
        return self._value

    def hasValue(self, timeout: int = -1) -> bool:
        """Return whether there is a result."""
        return self.wait(timeout) == 3 and self._error is None

    def hasError(self, timeout: int = -1) -> bool:
        """Return whether the call failed."""
        self.wait(timeout)
        return self._error is not None

    def error(self, timeout: int = -1) -> str:
        """Return why the call failed."""
        self.wait(timeout)
        return "" if self._error is None else str(self._error)

    def isFinished(self) -> bool:
        """Return whether the call is over."""
        return self._done.is_set()

    def isRunning(self) -> bool:
        """Return whether the call goes on."""
        return not self._done.is_set()

    def isCanceled(self) -> bool:
        """Return whether it was cancelled."""
        return self._cancelled

    def isCancelable(self) -> bool:
        """Return whether it can be cancelled."""
        return self.on_cancel is not None

    def cancel(self) -> None:
        """End the motion tasks of the call."""
        self._cancelled = True
        if self.on_cancel is not None:
            self.on_cancel()

    def addCallback(self, callback: Callable[[Future], Any]) -> None:
        """Call a function with this future when it is over."""
        if self._done.is_set():
            callback(self)
        else:
            self._callbacks.append(callback)

    def then(self, callback: Callable[[Future], Any]) -> Future:
        """Return the future of a function that is called with this one when it is over."""
        after = Future()

        def go_on(future: Future) -> None:
            try:
                after.finish(callback(future))
            except Exception as error:
                after.fail(error)

        self.addCallback(go_on)
        return after

    def andThen(self, callback: Callable[[Any], Any]) -> Future:
        """Return the future of a function that is called with the value."""
        return self.then(lambda future: callback(future.value()))

    def finish(self, value: Any) -> None:
        """Set the value."""
        self._value = value
        self._end()

    def fail(self, error: BaseException) -> None:
        """Set the error."""
        self._error = error
        self._end()

    def _end(self) -> None:
        self._done.set()
        for callback in self._callbacks:
            callback(self)


def run_async(function: Callable[..., Any], *arguments: Any, delay: float = 0.0, **named: Any) -> Future:
    """Call a function beside the caller, after a delay [us]; return its future."""
    future = Future()

    def run() -> None:
        try:
            if delay:
                current_broker().body.time.sleep(delay / 1e6)
            future.finish(function(*arguments, **named))
        except Exception as error:
            future.fail(error)

    thread = threading.Thread(target=run, daemon=True)
    broker = current_broker()

    def cancel() -> None:
        with broker.body.time.lock:
            tasks = [task for task in broker.body.tasks if task.thread == thread.ident]
            broker.body.tasks.kill(tasks, broker.body)

    future.on_cancel = cancel
    thread.start()
    return future


class Proxy:
    """A module as a script sees it: `_async=True` returns a future; other names are calls.

    Args:
        module: A module of the broker, or one that a script registered.
    """

    def __init__(self, module: Any) -> None:
        self.__dict__["_module"] = module

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._module, name)
        if isinstance(value, Signal | Subscriber) or not callable(value):
            return value

        @functools.wraps(value)
        def call(*arguments: Any, _async: bool = False, **named: Any) -> Any:
            if _async:
                return run_async(value, *arguments, **named)
            current_broker().body.time.spend(CALL)
            return value(*arguments, **named)

        return call

    def call(self, method: str, *arguments: Any, **named: Any) -> Any:
        """Call a method by its name."""
        return getattr(self, method)(*arguments, **named)

    def metaObject(self) -> dict[str, Any]:
        """Return the methods."""
        return {"methods": {name: {"name": name} for name in self._module.getMethodList()}}


class Post:
    """`proxy.post`: calls return the number of a task at once.

    Args:
        module: A module of the broker.
    """

    def __init__(self, module: Any) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Callable[..., int]:
        method = getattr(self._module, name)

        def post(*arguments: Any) -> int:
            return current_broker().post(functools.partial(method, *arguments))

        return post


def find_module(name: str) -> Any:
    """Return a module by its name.

    Raises:
        RuntimeError: for a module that there is not, as libqi says it.
    """
    try:
        return current_broker().module(name)
    except UnknownNameError as error:
        raise RuntimeError(f"Cannot find service '{name}' in index: {error}") from error
