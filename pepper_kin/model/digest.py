"""Digest of a robot, and caches that live as long as the robot."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar

from pepper_kin.model.pepper_model import PepperModel

Key = TypeVar("Key")
Value = TypeVar("Value")
Arguments = ParamSpec("Arguments")

_NOTHING: dict[Any, Any] = {}


def robot_digest(pepper: PepperModel) -> str:
    """Return a hash of the URDF text and of the model given to `with_pinocchio_model`, if any."""
    return pepper.dynamics_model.digest()


class RobotMemory(Generic[Key, Value]):
    """Dictionary for each robot.

    The dictionaries are attributes of the robots: a robot that is no longer used is freed with its cached
    values, even values that refer to the robot.
    """

    def of(self, pepper: PepperModel) -> OrderedDict[Key, Value]:
        """Return the dictionary of a robot."""
        found: OrderedDict[Key, Value] = pepper.kept.setdefault(self, OrderedDict())
        return found


def kept_for_robot(
    most: int = 32, most_bytes: float = float("inf"), size_of: Callable[[Any], int] = lambda value: 0
) -> Callable[
    [Callable[Concatenate[PepperModel, Arguments], Value]],
    Callable[Concatenate[PepperModel, Arguments], Value],
]:
    """Cache a function's results by robot and by its other arguments, which must be hashable.

    The least recently used result is dropped first; one result is always kept.

    Args:
        most: Maximum number of cached results of each robot.
        most_bytes: Maximum size of all cached results of each robot [bytes].
        size_of: Function that returns the size of a result [bytes].
    """

    def decorate(build: Callable[..., Value]) -> Callable[..., Value]:
        memory: RobotMemory[Hashable, tuple[Value, int]] = RobotMemory()
        lock = threading.Lock()

        @wraps(build)
        def call(pepper: PepperModel, *arguments: Hashable) -> Value:
            known = getattr(pepper, "kept", _NOTHING).get(memory)
            if known is None:  # a first call, or an argument that is not a robot, for which `of` raises
                known = memory.of(pepper)
            with lock:
                if arguments in known:
                    known.move_to_end(arguments)
                    return known[arguments][0]
            value = build(pepper, *arguments)
            with lock:
                known[arguments] = value, size_of(value)
                while len(known) > most or (
                    len(known) > 1 and sum(size for _, size in known.values()) > most_bytes
                ):
                    known.popitem(last=False)
            return value

        return call

    return decorate


def once_for_robot(build: Callable[[PepperModel], Value]) -> Callable[[PepperModel], Value]:
    """Cache the result of a function whose only argument is a robot; look-ups take no lock."""

    @wraps(build)
    def call(pepper: PepperModel) -> Value:
        try:
            value: Value = pepper.kept[build]
        except KeyError:
            value = pepper.kept[build] = build(pepper)
        return value

    return call
