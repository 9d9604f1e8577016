"""Caches limited by size in bytes, and the size of the cached data of a scene."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

if TYPE_CHECKING:
    from pepper_kin.collision.scene import Scene

Value = TypeVar("Value")

MOST_BYTES = 256e6
"""Maximum size of all checkers of one kind that are cached for a robot [bytes]."""

_ROBOT, _OBJECT, _PER_BYTE = 4_000_000, 4_000, 20
"""Cached bytes of a robot (2 to 4 MB for Pepper, measured), of an object, and per byte of its arrays."""


def scene_size(scene: Scene | None) -> int:
    """Return the approximate cached size of a checker of a robot in a scene [bytes]."""
    if scene is None:
        return _ROBOT
    size = _ROBOT
    shapes = [item.geometry for item in scene.objects.values()]
    shapes += [item.geometry for item in scene.attached.values()]
    for shape in shapes:
        arrays = (getattr(shape, name, None) for name in ("vertices", "faces", "points"))
        size += _OBJECT + _PER_BYTE * sum(array.nbytes for array in arrays if array is not None)
    return size


def checker_size(checker: Any) -> int:
    """Return the approximate cached size of an object with a `scene` [bytes]."""
    return scene_size(checker.scene)


def kept_within(
    most_bytes: float, size_of: Callable[..., int]
) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Cache the results of a function of shapes, like `functools.lru_cache`, but limited by size.

    The least recently used result is dropped first; one result is always kept.

    Args:
        most_bytes: Maximum size of all cached results with their arguments [bytes].
        size_of: Function from a result and its arguments to their size [bytes].
    """

    def decorate(build: Callable[..., Value]) -> Callable[..., Value]:
        known: OrderedDict[tuple[Hashable, ...], tuple[Value, int]] = OrderedDict()
        lock, total = threading.Lock(), 0

        @wraps(build)
        def call(*arguments: Hashable) -> Value:
            nonlocal total
            with lock:
                if arguments in known:
                    known.move_to_end(arguments)
                    return known[arguments][0]
            value = build(*arguments)
            size = _PER_RESULT + size_of(value, *arguments)
            with lock:
                total += size - known.pop(arguments, (value, 0))[1]
                known[arguments] = value, size
                while len(known) > 1 and total > most_bytes:
                    total -= known.popitem(last=False)[1][1]
            return value

        def kept_bytes() -> int:
            return total

        call.kept_bytes = kept_bytes  # type: ignore[attr-defined]
        return call

    return decorate


_PER_RESULT = 1_000  # bytes of a cache entry


def bytes_of(*values: Any) -> int:
    """Return the size of arrays, bytes, and the arrays in objects, tuples and lists of them [bytes]."""
    size = 0
    for value in values:
        if isinstance(value, np.ndarray):
            size += value.nbytes
        elif isinstance(value, bytes):
            size += len(value)
        elif isinstance(value, tuple | list):
            size += bytes_of(*value)
        else:
            size += sum(part.nbytes for part in vars_of(value).values() if isinstance(part, np.ndarray))
    return size


def vars_of(value: Any) -> dict[str, Any]:
    """Return the attributes of an object; an empty dictionary if it has none."""
    return getattr(value, "__dict__", {})
