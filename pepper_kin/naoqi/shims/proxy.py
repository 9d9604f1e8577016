"""Proxies of modules for scripts: calls, `.post` and futures."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any

from pepper_kin.exceptions import UnknownNameError
from pepper_kin.naoqi.memory import MemorySignal, Subscriber
from pepper_kin.naoqi.module import Module
from pepper_kin.naoqi.shims.futures import Future, current_broker, in_strand, run_async

CALL = 0.001
"""Simulated time that a call takes [s]."""


class Proxy:
    """Proxy of a module for scripts: attributes are the module's methods; `_async=True` returns a future.

    Args:
        module: A module of the broker, or one that a script registered.
    """

    def __init__(self, module: Any) -> None:
        self.__dict__["_module"] = module

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._module, name) if isinstance(self._module, Module) else self._bound(name)
        if isinstance(value, MemorySignal | Subscriber) or not callable(value):
            return value

        @functools.wraps(value)
        def call(*arguments: Any, _async: bool = False, **named: Any) -> Any:
            if not isinstance(self._module, Module):
                arguments = tuple(map(_as_sent, arguments))
            if _async:
                future = run_async(value, *arguments, **named)
                return future if isinstance(self._module, Module) else future.then(_own_value)
            current_broker().body.time.spend(CALL)
            return _own_value(in_strand(value)(*arguments, **named))

        return call

    def _bound(self, name: str) -> Any:
        """Return a script service's attribute by its name of `qi.bind`, unless `qi.nobind` hides it."""
        names = {}
        for own, value in inspect.getmembers(self._module):
            if getattr(value, "__qi_name__", own) is not None and not own.startswith("__"):
                names[getattr(value, "__qi_name__", own)] = value
        if name not in names:
            raise AttributeError(f"'{type(self._module).__name__}' object has no attribute '{name}'")
        return names[name]

    def call(self, method: str, *arguments: Any, **named: Any) -> Any:
        """Call a method by its name."""
        return getattr(self, method)(*arguments, **named)

    def metaObject(self) -> dict[str, Any]:
        """Return the methods of the module."""
        return {"methods": {name: {"name": name} for name in self._module.getMethodList()}}


def _as_sent(value: Any) -> Any:
    """Convert an argument as libqi's messages do: sets to tuples, byte arrays to strings."""
    if isinstance(value, set | frozenset):
        return tuple(map(_as_sent, value))
    if isinstance(value, memoryview):
        raise RuntimeError("a memoryview cannot be sent")
    return value.decode("latin-1") if isinstance(value, bytearray) else value


def _own_value(value: Any) -> Any:
    """Return a call's result; for a future, or a future of a future, wait for its value."""
    if isinstance(value, Future) and isinstance(value.value(), Future):
        value = value.value()
    return value.value() if isinstance(value, Future) else value


class Post:
    """`proxy.post`: asynchronous calls that return their number at once.

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
        RuntimeError: for an unknown module, with libqi's message.
    """
    try:
        return current_broker().module(name)
    except UnknownNameError as error:
        raise RuntimeError(f"Cannot find service '{name}' in index: {error}") from error
