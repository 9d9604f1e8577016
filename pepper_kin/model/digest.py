"""One digest of a robot, and memories that forget what belongs to a robot as it was."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Generic, TypeVar
from weakref import WeakKeyDictionary

from pepper_kin.model.pepper_model import PepperModel

Key = TypeVar("Key")
Value = TypeVar("Value")


def robot_digest(pepper: PepperModel) -> str:
    """Return a hash of the URDF text and of what has been changed in `pepper.inner_model`.

    A payload, another mass, rotor inertias, limits, placements or gravity change it; looking at a model, or
    building it, does not.  It costs a comparison of two models in C++, and nothing where nobody has asked for
    `pepper.inner_model`.
    """
    return pepper.dynamics_model.digest()


class RobotMemory(Generic[Key, Value]):
    """A dictionary for each robot, emptied once `pepper.inner_model` has been changed.

    A robot that is no longer used takes what was kept for it along.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: WeakKeyDictionary[PepperModel, tuple[str, dict[Key, Value]]] = WeakKeyDictionary()

    def of(self, pepper: PepperModel) -> dict[Key, Value]:
        """Return the dictionary of a robot as it is now."""
        digest = robot_digest(pepper)
        found = self._kept.get(pepper)
        if found is None or found[0] != digest:
            with self._lock:
                found = self._kept.get(pepper)
                if found is None or found[0] != digest:
                    found = self._kept[pepper] = digest, {}
        return found[1]


def kept_while_private(build: Callable[[PepperModel], Value]) -> Callable[[PepperModel], Value]:
    """Keep what a function returns for a robot whose `pinocchio_model` has not been handed out.

    For what takes less time to compute than a comparison of two models does.
    """
    kept = lru_cache(maxsize=32)(build)

    @wraps(build)
    def call(pepper: PepperModel) -> Value:
        return build(pepper) if pepper.dynamics_model.handed_out else kept(pepper)

    return call
