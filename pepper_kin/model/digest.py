"""One digest of a robot, and memories of what belongs to it."""

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
    """Return a hash of the URDF text, and of the model that `with_pinocchio_model` has put in its place."""
    return pepper.dynamics_model.digest()


class RobotMemory(Generic[Key, Value]):
    """A dictionary for each robot.

    The dictionaries are attributes of the robots: one that is no longer used takes what was kept for it
    along, also where that refers to the robot.
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
    """Keep what a function returns for a robot as it is, and other arguments, which can be hashed.

    What was asked for longest ago is forgotten first; one result is always kept.

    Args:
        most: Number of results that are kept for each robot.
        most_bytes: Size of all results that are kept for each robot [bytes].
        size_of: Returns the size of a result [bytes].
    """

    def decorate(build: Callable[..., Value]) -> Callable[..., Value]:
        memory: RobotMemory[Hashable, tuple[Value, int]] = RobotMemory()
        lock = threading.Lock()

        @wraps(build)
        def call(pepper: PepperModel, *arguments: Hashable) -> Value:
            known = getattr(pepper, "kept", _NOTHING).get(memory)
            if known is None:  # a first call, or no robot, which `of` refuses
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
    """Keep what a function returns for a robot, which is its only argument; looked up without a lock."""

    @wraps(build)
    def call(pepper: PepperModel) -> Value:
        try:
            value: Value = pepper.kept[build]
        except KeyError:
            value = pepper.kept[build] = build(pepper)
        return value

    return call
