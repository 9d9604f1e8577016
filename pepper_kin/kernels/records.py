"""Records in memory: rows of named fields, over the loads and stores that compiled functions do by address.

    BALL = RecordView("BALL", center=3 * single, outer=single, inner=single)

    x, y, z = BALL.center(balls, k)  # of row k of a table at an address; BALL.center(ball) of the one there
    BALL.set_outer(balls, 0.1, k)
    ball = BALL.at(balls, k)  # address of a row; BALL.outer_at(balls, k) of a field of it

Each call is a load or store at a constant offset.  Only the declaration defines the layout: Python code that
writes the same memory takes a row's numbers, by name, from `row` and their indices from `columns`.
An array of numbers is a table of records with one field: `SINGLES.at(address, k)`.  Lanes are a kind as well
(`lanes`), so numbers are read and written by `load_lanes`, `single_at`, ... of that module.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from pepper_kin.kernels.intrinsics import Intrinsic, intrinsic

_LLVM = {"float32": "FloatType", "float64": "DoubleType", "int64": "IntType"}


@dataclass(frozen=True)
class FieldKind:
    """Type of a field.

    Attributes:
        dtype: "float32", "float64" or "int64".
        size: Size of a value [bytes].
        count: Number of values of the field; several values are a tuple.
        lanes: Number of lanes of a value.
        side_by_side: Function that returns Numba's type of a value of several lanes; None for one lane.
    """

    dtype: str
    size: int
    count: int = 1
    lanes: int = 1
    side_by_side: Callable[[], Any] | None = field(default=None, repr=False)

    def __rmul__(self, count: int) -> FieldKind:
        """Return the kind of a field of several values."""
        return replace(self, count=count)

    def padded(self, size: int) -> FieldKind:
        """Return the kind with values of a larger size [bytes]."""
        return replace(self, size=size)

    def read(self, address: int) -> Any:
        """Return the values at an address, interpreted."""
        found = [self._memory(address + i * self.size) for i in range(self.count)]
        values = [value.copy() if self.lanes > 1 else value[0].item() for value in found]
        return values[0] if self.count == 1 else tuple(values)

    def write(self, address: int, values: Any) -> None:
        """Write values to an address, interpreted."""
        for i in range(self.count):
            self._memory(address + i * self.size)[:] = values if self.count == 1 else values[i]

    def _memory(self, address: int) -> Any:
        scalar = np.ctypeslib.as_ctypes_type(np.dtype(self.dtype))
        return np.frombuffer(memoryview((scalar * self.lanes).from_address(int(address))), self.dtype)

    def numba_type(self) -> Any:
        """Return Numba's type of the field's value or values."""
        from numba import types

        kind = self.side_by_side() if self.side_by_side else getattr(types, self.dtype)
        return kind if self.count == 1 else types.UniTuple(kind, self.count)

    def places(self, builder: Any, address: Any) -> list[Any]:
        """Return LLVM's pointers to the values at an address."""
        from llvmlite import ir

        scalar = getattr(ir, _LLVM[self.dtype])(*[64] * (self.dtype == "int64"))
        pointer = (ir.VectorType(scalar, self.lanes) if self.lanes > 1 else scalar).as_pointer()
        return [builder.inttoptr(_moved(builder, address, i * self.size), pointer) for i in range(self.count)]

    @property
    def align(self) -> int | None:
        """Alignment of a value [bytes]; None for the default."""
        return 4 if self.lanes > 1 else None


word, single, double = FieldKind("int64", 8), FieldKind("float32", 4), FieldKind("float64", 8)


def _moved(builder: Any, address: Any, offset: int, k: Any = None, stride: int = 0) -> Any:
    """Return an address, moved by some bytes and by k strides."""
    from llvmlite import ir

    if k is not None and not isinstance(k, ir.Constant):
        address = builder.add(address, builder.mul(k, ir.IntType(64)(stride)))
    elif k is not None:
        offset += k.constant * stride
    return builder.add(address, ir.IntType(64)(offset)) if offset else address


def _load(name: str, kind: FieldKind, offset: int, stride: int) -> Intrinsic:
    """Return the intrinsic that reads a field, `offset` bytes into rows of `stride` bytes."""

    def make(typing_context: Any, address: Any, k: Any = 0) -> Any:
        from numba import types

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            places = kind.places(builder, _moved(builder, values[0], offset, values[1], stride))
            found = [builder.load(place, align=kind.align) for place in places]
            return found[0] if kind.count == 1 else context.make_tuple(builder, signature.return_type, found)

        return kind.numba_type()(types.intp, types.intp), generate

    def load(address: int, k: int = 0) -> Any:
        """Return a field of the k-th record from an address on."""
        return kind.read(address + k * stride + offset)

    return _named(load, f"{name} {kind} {offset} {stride}", make)


def _store(name: str, kind: FieldKind, offset: int, stride: int) -> Intrinsic:
    """Return the intrinsic that writes a field, `offset` bytes into rows of `stride` bytes."""

    def make(typing_context: Any, address: Any, value: Any, k: Any = 0) -> Any:
        from numba import types

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            places = kind.places(builder, _moved(builder, values[0], offset, values[2], stride))
            for i, place in enumerate(places):
                own = values[1] if kind.count == 1 else builder.extract_value(values[1], i)
                builder.store(own, place, align=kind.align)
            return context.get_dummy_value()

        return types.void(types.intp, kind.numba_type(), types.intp), generate

    def store(address: int, value: Any, k: int = 0) -> None:
        """Write a field of the k-th record from an address on."""
        kind.write(address + k * stride + offset, value)

    return _named(store, f"{name} {kind} {offset} {stride}", make)


def _address(name: str, offset: int, stride: int) -> Intrinsic:
    """Return the intrinsic that computes an address, `offset` bytes into rows of `stride` bytes."""

    def make(typing_context: Any, address: Any, k: Any = 0) -> Any:
        from numba import types

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return _moved(builder, values[0], offset, values[1], stride)

        return types.int64(types.intp, types.intp), generate

    def address(address: int, k: int = 0) -> int:
        """Return the address of the k-th record from an address on, or of a field of it."""
        return int(address) + k * stride + offset

    return _named(address, f"{name} {offset} {stride}", make)


def _named(python: Callable[..., Any], name: str, make: Callable[..., Any]) -> Intrinsic:
    python.__name__ = python.__qualname__ = name
    return intrinsic(make)(python)


class RecordView:
    """Layout of a row: fields, one after the other.

    Compiled functions access the k-th row from an address on: `<field>(address, k=0)` reads a field,
    `set_<field>(address, value, k=0)` writes it, `<field>_at(address, k=0)` returns its address, and
    `at(address, k=0)` the row's address.

    Args:
        name: Name of the record in keys and messages.
        **fields: Kinds of the fields by name.

    Attributes:
        size: Size of a row [bytes].
        columns: Index of each field among the numbers of a row, or the slice of its indices.
        width: Number of numbers in a row.
        described: Name and layout, for the keys of machine code that uses the record.
    """

    def __init__(self, name: str, **fields: FieldKind) -> None:
        self.name, self.fields = name, fields
        self.size = sum(kind.size * kind.count for kind in fields.values())
        self.described = f"record {name} {fields}"
        self.columns, self.width, offset = SimpleNamespace(), 0, 0
        made: dict[str, Intrinsic] = {"at": _address(f"{name}.at", 0, self.size)}
        if taken := fields.keys() & {*dir(self), *made}:
            raise TypeError(f"record {name}: {', '.join(taken)} cannot be names of fields")
        for own, kind in fields.items():
            first, count = self.width, kind.count * kind.lanes
            setattr(self.columns, own, slice(first, first + count) if count > 1 else first)
            made[own] = _load(f"{name}.{own}", kind, offset, self.size)
            made[f"set_{own}"] = _store(f"{name}.set_{own}", kind, offset, self.size)
            made[f"{own}_at"] = _address(f"{name}.{own}_at", offset, self.size)
            self.width, offset = self.width + count, offset + kind.size * kind.count
        self.__dict__.update(made)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"record {self.name} has no {name!r}; its fields: {', '.join(self.fields)}")

    def row(self, **values: Any) -> list[Any]:
        """Return the numbers of a row, given the values of all fields by name."""
        if values.keys() != self.fields.keys():
            raise TypeError(f"record {self.name} has the fields {', '.join(self.fields)}; given: {[*values]}")
        return [number for own in self.fields for number in np.ravel(values[own]).tolist()]

    def __repr__(self) -> str:
        """Name."""
        return f"<record {self.name}>"

    @property
    def _numba_type_(self) -> Any:
        """Return a Numba module type: attributes of the record are constants and functions."""
        from numba import types

        return types.Module(self)


SINGLES = RecordView("SINGLES", value=single)
DOUBLES = RecordView("DOUBLES", value=double)
WORDS = RecordView("WORDS", value=word)
