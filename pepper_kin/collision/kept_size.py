"""Results that are kept within bounds of bytes, and the size of what is kept for a scene."""

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
"""Size of all checkers of one kind that are kept for a robot [bytes]."""

_ROBOT, _OBJECT, _PER_BYTE = 4_000_000, 4_000, 20
"""Bytes kept for a robot (2 to 4 MB for Pepper, measured), for an object, and for each byte of its arrays."""


def scene_size(scene: Scene | None) -> int:
    """Return about how many bytes a checker of a robot in a scene keeps."""
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
    """Return about how many bytes something with a `scene` keeps."""
    return scene_size(checker.scene)


def kept_within(
    most_bytes: float, size_of: Callable[..., int]
) -> Callable[[Callable[..., Value]], Callable[..., Value]]:
    """Keep what a function of shapes returns, as `functools.lru_cache` does, but within bounds of bytes.

    What was asked for longest ago is forgotten first; one result is always kept.

    Args:
        most_bytes: Size of all results that are kept, with their arguments [bytes].
        size_of: Returns the size of a result with its arguments [bytes], from the result and the arguments.
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


_PER_RESULT = 1_000  # bytes, of the entry itself


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
    """Return the attributes of an object, none for one without."""
    return getattr(value, "__dict__", {})
