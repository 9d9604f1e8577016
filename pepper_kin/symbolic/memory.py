"""Functions are built once for each robot as it is."""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, TypeVar

from pepper_kin.exceptions import InvalidValueError
from pepper_kin.model import PepperModel, RobotMemory

Result = TypeVar("Result")

# One lock for all: CasADi counts references to expressions without locking.
_lock = threading.RLock()
_memory: RobotMemory[Hashable, Any] = RobotMemory()


def remembered(build: Callable[..., Result]) -> Callable[..., Result]:
    """Make a builder return what it built before for the same robot and arguments.

    A robot that is no longer used takes what was built for it along; so does a change of its masses.

    Args:
        build: Takes a robot and hashable arguments.
    """
    signature = inspect.signature(build)

    @wraps(build)
    def call(pepper: PepperModel, *args: Hashable, **keywords: Hashable) -> Result:
        if not isinstance(pepper, PepperModel):
            raise InvalidValueError("pepper", repr(pepper), "a PepperModel, as load_pepper gives")
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
