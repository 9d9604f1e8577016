"""Futures, promises, strands and asynchronous calls of libqi."""

from __future__ import annotations

import contextlib
import functools
import threading
import weakref
from collections.abc import Callable, Iterable
from typing import Any

from pepper_kin.naoqi.broker import Broker
from pepper_kin.naoqi.errors import NaoqiError

_BROKER: list[Broker] = []
_STRANDS: weakref.WeakKeyDictionary[Any, threading.RLock] = weakref.WeakKeyDictionary()
_CANCELED = "Future canceled."


def set_broker(broker: Broker | None) -> None:
    """Set the simulated robot of this process's scripts."""
    _BROKER[:] = [] if broker is None else [broker]


def current_broker() -> Broker:
    """Return the simulated robot of this process's scripts.

    Raises:
        NaoqiError: if none is set.
    """
    if not _BROKER:
        raise NaoqiError(
            "ALBroker", "createBroker", "no twin is running in this process: use `pepper-kin naoqi run`"
        )
    return _BROKER[-1]


def in_strand(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that excludes other methods of its object, if that is `singleThreaded`."""
    inner, first = function, None
    while isinstance(inner, functools.partial):
        first = inner.args[0] if inner.args else first
        inner = inner.func
    owner = getattr(inner, "__self__", first)
    if getattr(type(owner), "__qi_threading__", "") != "single":
        return function
    lock = _STRANDS.setdefault(owner, threading.RLock())

    def alone(*arguments: Any, **named: Any) -> Any:
        with lock:
            return function(*arguments, **named)

    return alone


class FutureState:
    """States of a future."""

    None_, Running, Canceled, FinishedWithError, FinishedWithValue = 0, 1, 2, 3, 4


class Future:
    """The result of an asynchronous call, or a value that is known already."""

    def __init__(self, *value: Any) -> None:
        self._changed = threading.Condition()
        self._state, self._value = FutureState.Running, None
        self._error: BaseException | None = None
        self._asked_to_cancel = False
        self._callbacks: list[Callable[[Future], Any]] = []
        self.on_cancel: Callable[[], object] | None = None
        if value:
            self.settle(value[0])

    def wait(self, timeout: int = -1) -> int:
        """Wait for the result, at most `timeout` [ms], for ever if negative; return the state."""
        clock = current_broker().body.time
        if clock.works and not clock.real_time:
            clock.wait_until(self.isFinished, None if timeout < 0 else timeout / 1000.0)
            return self._state
        end = None if timeout < 0 else clock.now + timeout / 1000.0
        while self._state == FutureState.Running and (end is None or clock.now < end):
            with self._changed:
                self._changed.wait_for(self.isFinished, 0.005)
            if not clock.real_time and threading.current_thread() is threading.main_thread():
                clock.sleep(0.02)
        return self._state

    def value(self, timeout: int = -1) -> Any:
        """Wait for the result and return it; raise the error of the call."""
        state = self.wait(timeout)
        if state == FutureState.Running:
            raise RuntimeError("Future timeout.")
        if self._error is not None:
            raise self._error if isinstance(self._error, RuntimeError) else RuntimeError(self.error())
        if state == FutureState.Canceled:
            raise RuntimeError(_CANCELED)
        return self._value

    def hasValue(self, timeout: int = -1) -> bool:
        """Return whether the call returned a value."""
        return self.wait(timeout) == FutureState.FinishedWithValue

    def hasError(self, timeout: int = -1) -> bool:
        """Return whether the call failed."""
        return self.wait(timeout) == FutureState.FinishedWithError

    def error(self, timeout: int = -1) -> str:
        """Return why the call failed."""
        self.wait(timeout)
        error = self._error
        plain = error is None or isinstance(error, NaoqiError) or getattr(error, "said", False)
        return str(error or "") if plain else f"{type(error).__name__}: {error}"

    def isFinished(self) -> bool:
        """Return whether the call has ended."""
        return self._state != FutureState.Running

    def isRunning(self) -> bool:
        """Return whether the call is running."""
        return self._state == FutureState.Running

    def isCanceled(self) -> bool:
        """Return whether the call was canceled."""
        return self._state == FutureState.Canceled

    def isCancelable(self) -> bool:
        """Return whether the call can be canceled."""
        return self.on_cancel is not None

    def isCancelRequested(self) -> bool:
        """Return whether `cancel` was called."""
        return self._asked_to_cancel

    def cancel(self) -> None:
        """Request the end of the call; its motion tasks end now."""
        if not self.isRunning():
            return
        self._asked_to_cancel = True
        if self.on_cancel is not None:
            with contextlib.suppress(Exception):  # libqi only logs the errors of this function
                self.on_cancel()

    def addCallback(self, callback: Callable[[Future], Any]) -> None:
        """Call a function with this future when it has ended; the function's errors are dropped."""
        alone = in_strand(callback)
        with self._changed:
            if self.isRunning():
                self._callbacks.append(alone)
                return
        self._tell(alone)

    connect = addCallback

    def _tell(self, callback: Callable[[Future], Any]) -> None:
        with contextlib.suppress(Exception):
            callback(self)

    def _after(self, settle: Callable[[Future, Future], None]) -> Future:
        """Return a future that a function settles when this one has ended; cancel requests go to this one."""
        after = Future()
        after.on_cancel = self.cancel

        def go_on(_: Future) -> None:
            try:
                settle(self, after)
            except Exception as error:
                after.settle(None, error)

        self.addCallback(go_on)
        return after

    def then(self, callback: Callable[[Future], Any]) -> Future:
        """Return the future of a function that is called with this future when it has ended."""
        alone = in_strand(callback)
        return self._after(lambda one, after: after.settle(alone(one)))

    def andThen(self, callback: Callable[[Any], Any]) -> Future:
        """Return the future of a function that is called with the value of this future."""
        alone = in_strand(callback)
        return self._after(lambda one, after: after.follow(one, alone))

    def unwrap(self) -> Future:
        """Return the future of the inner value, if this future's value is a future."""

        def inner(one: Future, after: Future) -> None:
            if not one.hasValue(0):
                after.follow(one)
            elif not isinstance(one._value, Future):
                raise RuntimeError("the value is no future")
            else:
                after.on_cancel = one._value.cancel
                one._value.addCallback(after.follow)
                if after.isCancelRequested():
                    after.cancel()

        return self._after(inner)

    def follow(self, other: Future, change: Callable[[Any], Any] = lambda value: value) -> None:
        """Settle this future as another one has ended, with its value mapped by `change`."""
        if other.isCanceled():
            self.settle(state=FutureState.Canceled)
        elif other._error is not None:
            self.settle(None, other._error)
        else:
            self.settle(change(other._value))

    def settle(self, value: Any = None, error: BaseException | None = None, state: int | None = None) -> None:
        """Settle the future with a value, an error or a state.

        Raises:
            RuntimeError: if it has ended before.
        """
        with self._changed:
            if not self.isRunning():
                raise RuntimeError("Future has already been set.")
            self._value, self._error = value, error
            done = FutureState.FinishedWithValue if error is None else FutureState.FinishedWithError
            self._state = done if state is None else state
            callbacks, self._callbacks = self._callbacks, []
            self._changed.notify_all()
        for callback in callbacks:
            self._tell(callback)


class Promise:
    """A future that the holder of the promise settles.

    Args:
        on_cancel: Called with this promise when its future is to be canceled.
    """

    def __init__(self, on_cancel: Callable[[Promise], Any] | None = None) -> None:
        self._future = Future()
        self._future.on_cancel = (lambda: None) if on_cancel is None else (lambda: on_cancel(self))

    def setValue(self, value: Any) -> None:
        """Settle the future with a value."""
        self._future.settle(value)

    def setError(self, error: str) -> None:
        """Settle the future with an error."""
        failure = RuntimeError(error)
        failure.said = True  # type: ignore[attr-defined]
        self._future.settle(None, failure)

    def setCanceled(self) -> None:
        """Settle the future as canceled."""
        self._future.settle(state=FutureState.Canceled)

    def isCancelRequested(self) -> bool:
        """Return whether `cancel` of the future was called."""
        return self._future.isCancelRequested()

    def future(self) -> Future:
        """Return the future."""
        return self._future


def futureBarrier(futures: Iterable[Future]) -> Future:
    """Return a future of the list of futures, settled when all have ended."""
    every = list(futures)
    left, lock, barrier = [len(every)], threading.Lock(), Future()

    def over(_: Future) -> None:
        with lock:
            left[0] -= 1
        if left[0] == 0:
            barrier.settle(every)

    def cancel() -> None:
        for future in every:
            future.cancel()

    barrier.on_cancel = cancel
    if not every:
        barrier.settle(every)
    for future in every:
        future.addCallback(over)
    return barrier


def run_async(function: Callable[..., Any], *arguments: Any, delay: float = 0.0, **named: Any) -> Future:
    """Call a function asynchronously, after a delay [us]; return its future.

    Canceled before its start, the function is not called; later its motion tasks end.
    """
    future, body, alone = Future(), current_broker().body, in_strand(function)
    order, begun = body.tasks.new_call(), threading.Event()

    def run() -> None:
        try:
            if delay:
                body.time.wait_until(future.isFinished, delay / 1e6)
            begun.set()
            if future.isFinished():
                return
            with body.tasks.within(order):
                value = alone(*arguments, **named)
            future.settle(value)
        except Exception as error:
            with contextlib.suppress(RuntimeError):
                future.settle(None, error)

    thread = threading.Thread(target=run, daemon=True)

    def cancel() -> None:
        with body.time.lock:
            order.ticket = -1
            body.tasks.kill([task for task in body.tasks if task.thread == thread.ident], body)
        if not begun.is_set():  # without the lock: callbacks may wait for a strand that waits for it
            future.settle(state=FutureState.Canceled)

    future.on_cancel = cancel
    thread.start()
    return future
