"""Types of the arguments of compiled functions, without Numba.

    "int64(float64[:, ::1], Tables, float64)"

A signature is text: result, then arguments.  Scalars are `int64`, `uint64`, `float64`, `boolean`; arrays
are C-contiguous, `dtype[::1]`, `dtype[:, ::1]`, ..., of a scalar type, `float32`, `int32` or `uint8`; any
other name is a `NamedTuple` class of the function's module whose fields are annotated with `float`, `int`,
`bool` or an alias of this module.
A result is `void`, a scalar or `Tuple(scalar, scalar, ...)`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats1: TypeAlias = Annotated[NDArray[np.float64], "float64[::1]"]
Floats2: TypeAlias = Annotated[NDArray[np.float64], "float64[:, ::1]"]
Floats3: TypeAlias = Annotated[NDArray[np.float64], "float64[:, :, ::1]"]
Floats4: TypeAlias = Annotated[NDArray[np.float64], "float64[:, :, :, ::1]"]
Singles1: TypeAlias = Annotated[NDArray[np.float32], "float32[::1]"]
Singles2: TypeAlias = Annotated[NDArray[np.float32], "float32[:, ::1]"]
Singles3: TypeAlias = Annotated[NDArray[np.float32], "float32[:, :, ::1]"]
Singles4: TypeAlias = Annotated[NDArray[np.float32], "float32[:, :, :, ::1]"]
Ints1: TypeAlias = Annotated[NDArray[np.int64], "int64[::1]"]
Ints2: TypeAlias = Annotated[NDArray[np.int64], "int64[:, ::1]"]
Ints3: TypeAlias = Annotated[NDArray[np.int64], "int64[:, :, ::1]"]
Words1: TypeAlias = Annotated[NDArray[np.int32], "int32[::1]"]
Bytes1: TypeAlias = Annotated[NDArray[np.uint8], "uint8[::1]"]
Bytes2: TypeAlias = Annotated[NDArray[np.uint8], "uint8[:, ::1]"]
Flags1: TypeAlias = Annotated[NDArray[np.bool_], "boolean[::1]"]
Flags2: TypeAlias = Annotated[NDArray[np.bool_], "boolean[:, ::1]"]

_DTYPES: dict[str, np.dtype] = {
    "float64": np.dtype(np.float64),
    "float32": np.dtype(np.float32),
    "int64": np.dtype(np.int64),
    "int32": np.dtype(np.int32),
    "uint64": np.dtype(np.uint64),
    "uint8": np.dtype(np.uint8),
    "boolean": np.dtype(np.bool_),
}
_SCALARS = ("int64", "uint64", "float64", "boolean")
_PYTHON = {"float": "float64", "int": "int64", "bool": "boolean"}
_ARRAY = re.compile(r"(\w+)\[((?::,)*)::1\]")


@dataclass(frozen=True)
class ScalarType:
    """One number: "int64", "uint64", "float64" or "boolean"."""

    name: str


@dataclass(frozen=True)
class Array:
    """A C-contiguous array of a dtype with a number of axes."""

    dtype: np.dtype
    ndim: int


@dataclass(frozen=True)
class RecordType:
    """A NamedTuple of scalars, arrays and nested NamedTuples."""

    kind: type
    fields: tuple[tuple[str, ScalarType | Array | RecordType], ...]


Argument: TypeAlias = ScalarType | Array | RecordType


@dataclass(frozen=True)
class FunctionSignature:
    """Result and arguments of a compiled function; the result is empty for `void`."""

    result: tuple[ScalarType, ...]
    is_tuple: bool
    arguments: tuple[Argument, ...]


def parse_signature(text: str, names: Mapping[str, Any]) -> FunctionSignature:
    """Return a signature.

    Args:
        text: The signature.
        names: Record classes by name: the globals of the function.

    Raises:
        TypeError: The text is not a signature; the message quotes it.
    """
    plain = re.sub(r"\s+", "", text)
    end = plain.index(")(") + 1 if plain.startswith("Tuple(") else plain.index("(")
    result, arguments = plain[:end], plain[end:]
    if not (arguments.startswith("(") and arguments.endswith(")")):
        raise TypeError(f"not a signature: {text!r}")
    parts = _split(arguments[1:-1])
    is_tuple = result.startswith("Tuple(")
    results = _split(result[6:-1]) if is_tuple else [] if result == "void" else [result]
    for name in results:
        if name not in _SCALARS:
            raise TypeError(f"result {name!r} in {text!r}: void or one of {', '.join(_SCALARS)}")
    return FunctionSignature(
        tuple(map(ScalarType, results)), is_tuple, tuple(_argument(part, names) for part in parts)
    )


def _argument(text: str, names: Mapping[str, Any]) -> Argument:
    """Return the type of an argument from its text; raise TypeError for another text."""
    if text in _SCALARS:
        return ScalarType(text)
    match = _ARRAY.fullmatch(text)
    if match and match[1] in _DTYPES:
        return Array(_DTYPES[match[1]], match[2].count(":") + 1)
    kind = names.get(text)
    if isinstance(kind, type) and issubclass(kind, tuple):
        return record_of(kind)
    raise TypeError(f"argument {text!r}: a scalar, a C-contiguous array or a NamedTuple class")


def record_of(kind: type) -> RecordType:
    """Return a NamedTuple class as a type.

    Raises:
        TypeError: A field's annotation is not a type of this module.
    """
    names = vars(sys.modules.get(kind.__module__, object))
    fields: list[tuple[str, Argument]] = []
    for name in kind._fields:  # type: ignore[attr-defined]
        annotation: Any = kind.__annotations__[name]
        annotation = getattr(annotation, "__forward_arg__", annotation)
        alias: Any = globals().get(annotation) if isinstance(annotation, str) else annotation
        if hasattr(alias, "__metadata__"):
            text = alias.__metadata__[0]
        else:
            text = annotation if isinstance(annotation, str) else annotation.__name__
            text = _PYTHON.get(text, text)
        try:
            fields.append((name, _argument(text.replace(" ", ""), names)))
        except TypeError as error:
            raise TypeError(f"field {name!r} of {kind.__name__}: {error}") from error
    return RecordType(kind, tuple(fields))


def _split(text: str) -> list[str]:
    """Split a text at the commas outside brackets."""
    parts, depth, begin = [], 0, 0
    for place, letter in enumerate(text):
        depth += (letter in "([") - (letter in ")]")
        if letter == "," and depth == 0:
            parts.append(text[begin:place])
            begin = place + 1
    parts.append(text[begin:])
    return [part for part in parts if part]
