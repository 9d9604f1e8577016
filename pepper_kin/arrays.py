"""Array types for annotations, read-only arrays, and short representations of values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from enum import Enum
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, DTypeLike

Array: TypeAlias = NDArray[np.float64]
"""An array of float64; docstrings give the shape."""


@runtime_checkable
class PiecewiseCubic(Protocol):
    """Piecewise cubic curve, such as `pepper_kin.planners.SmoothPath`.

    On segment i, where breaks[i] <= s <= breaks[i + 1],
        q(s) = sum_p coefficients[i, p] (s - breaks[i])^p,   p = 0 ... 3: constant term first.
    """

    @property
    def breaks(self) -> Array:
        """Ends of the segments in ascending order, shape (m + 1,)."""

    @property
    def coefficients(self) -> Array:
        """Coefficients, constant term first, shape (m, 4, n)."""


def read_only(array: ArrayLike, dtype: DTypeLike = float) -> NDArray[Any]:
    """Copy an array of numbers, of any shape, to read-only memory.

    The memory belongs to a `bytes` object, so `setflags(write=True)` raises an error.
    """
    values = np.asarray(array, dtype=dtype)
    return np.ndarray(values.shape, values.dtype, buffer=values.tobytes())


def kept_read_only(array: ArrayLike) -> Array:
    """Return an array of any shape as a read-only array of float64.

    The result is the array itself if it is a read-only array of float64 with its own memory or a `bytes`
    object's; else a copy.
    """
    if (
        type(array) is np.ndarray
        and array.dtype == np.float64
        and (array.base is None or isinstance(array.base, bytes))
        and not array.flags.writeable
    ):
        return array
    return read_only(array)


LINE = 110
"""Maximum number of characters of a line."""
_FIRST = ("status", "success", "duration", "max_error", "errors", "failures", "message")
_FEW = 3  # maximum number of items that are written out


class BriefRepr:
    """A dataclass whose `repr` has at most two lines: the most important values first, arrays by shape.

    It begins with status, success, duration, errors and message, as far as the class has them as fields or
    properties; other fields follow while there is room.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        """Set `__repr__` before `dataclass` adds its own."""
        super().__init_subclass__(**options)
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = brief  # type: ignore[method-assign]


def brief(value: Any) -> str:
    """Return a dataclass in at most two lines of `LINE` characters."""
    lines, parts = [f"{type(value).__name__}:"], list(_parts(value))
    for k, part in enumerate(parts):
        end = "" if k == len(parts) - 1 else ";"
        if len(lines[-1]) + len(part) + 6 <= LINE:
            lines[-1] += f" {part}{end}"
        elif len(lines) == 1 and len(part) + 8 <= LINE:
            lines.append(f"  {part}{end}")
        else:
            room = LINE - 5 - len(lines[-1])
            lines[-1] += f" {part[:room]} ..." if room > LINE // 2 else " ..."
            break
    return "\n".join(lines)


def _parts(value: Any) -> Iterator[str]:
    """Yield the texts of a dataclass's values, the most important first."""
    shown = {field.name for field in fields(value) if field.repr}
    names = [
        name for name in _FIRST if name in shown or isinstance(getattr(type(value), name, None), property)
    ]
    if "status" in names and "success" in names:
        names.remove("success")
    for name in (*names, *(field.name for field in fields(value) if field.repr and field.name not in names)):
        try:
            text = _words(name, getattr(value, name))
        except Exception:  # a property that cannot be computed is left out, since a repr must not raise
            text = ""
        if text:
            yield text


def _words(name: str, item: Any) -> str:
    """Return a field as text; "" for a value without information."""
    label = name.replace("_", " ")
    match item:
        case None:
            return ""
        case Enum():
            return str(item.value) if name == "status" else f"{label} {item.value}"
        case str():
            words = " ".join(item.split())
            return words.rstrip(".") if name == "message" or not words else f"{label} {words!r}"
        case bool() | np.bool_():
            return label if item else f"not {label}"
        case int() | float() | np.number():
            unit = " s" if name in ("duration", "time") else ""
            return f"{label} {item:.4g}{unit}" if np.isfinite(item) or name != "length" else ""
        case np.ndarray():
            if name == "max_error":
                return f"off by at most {np.abs(item).max(initial=0.0):.3g}"
            few = item.ndim <= 1 and item.size <= _FEW
            return f"{label} {np.array2string(item, precision=4)}" if few else f"{label} {item.shape}"
        case Mapping() | Sequence():
            return _many(name, label, item)
    named = getattr(item, "status", None)
    return f"{label} {named.value}" if isinstance(named, Enum) else f"{label} {type(item).__name__}"


def _many(name: str, label: str, items: Mapping[Any, Any] | Sequence[Any]) -> str:
    """Return several items as text: joint names as a count, a few short items in full."""
    if name == "joint_names":
        return f"{len(items)} joints"
    if name in ("joint_units", "units") or not len(items):
        return ""
    values = [getattr(item, "value", item) for item in items]
    if len(values) <= _FEW and all(isinstance(each, str | int | float) for each in values):
        return f"{label} " + ", ".join(each if isinstance(each, str) else f"{each:.3g}" for each in values)
    return f"{len(items)} {label}"


class FrozenArrays(BriefRepr):
    """A frozen value whose arrays are read-only in copies, too.

    NumPy drops the read-only flag of an array that is pickled or copied deeply.
    """

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, _frozen(value))


def _frozen(value: Any) -> Any:
    """Return a value with its arrays, also in tuples and dictionaries, made read-only."""
    if type(value) is tuple:
        return tuple(map(_frozen, value))
    if type(value) is dict:
        return {key: _frozen(item) for key, item in value.items()}
    if type(value) is np.ndarray and value.flags.writeable:
        if value.dtype.hasobject:
            value.setflags(write=False)
            return value
        return read_only(value, value.dtype)
    return value
