"""Cache of functions, built once for each robot and arguments."""

from __future__ import annotations

import inspect
import os
import threading
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, TypeVar

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel, RobotMemory
from pepper_kin.model.at_frames import carrying

Result = TypeVar("Result")

# One lock for all threads: CasADi counts references to expressions without locking.
_lock = threading.RLock()
_memory: RobotMemory[Hashable, Any] = RobotMemory()


def _free_lock() -> None:
    """Replace the lock in a forked child, where the thread that held it does not exist."""
    global _lock
    _lock = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_free_lock)


def remembered(build: Callable[..., Result]) -> Callable[..., Result]:
    """Cache the results of a builder by robot and arguments.

    Results are dropped with their robot.

    Args:
        build: Function of a robot and hashable arguments. If it has an argument `payload`, it is called with
            the robot that carries the payload, and without payload.
    """
    signature = inspect.signature(build)
    loadable = "payload" in signature.parameters

    @wraps(build)
    def call(pepper: PepperModel, *args: Hashable, **keywords: Hashable) -> Result:
        if not isinstance(pepper, PepperModel):
            raise InvalidValueError("pepper", repr(pepper), "a PepperModel, as load_pepper gives")
        if loadable and keywords.get("payload") is not None:
            loaded = carrying(pepper, keywords["payload"])  # type: ignore[arg-type]
            return call(loaded, *args, **{**keywords, "payload": None})
        bound = signature.bind(pepper, *args, **keywords)
        bound.apply_defaults()
        key = (build.__module__, build.__qualname__, bound.args[1:], tuple(bound.kwargs.items()))
        with _lock:
            known = _memory.of(pepper)
            try:
                found = known.get(key)
            except TypeError:
                raise InvalidValueError("arguments", repr(args), "names, which can be hashed") from None
            if found is None:
                found = known[key] = build(pepper, *args, **keywords)
            return found

    return call
