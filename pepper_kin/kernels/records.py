"""Records in memory: rows of named fields, over the loads and stores that compiled functions do by address.

    BALL = RecordView("BALL", center=3 * single, outer=single, inner=single)

    x, y, z = BALL.center(balls, k)  # of row k of a table at an address; BALL.center(ball) of the one there
    BALL.set_outer(balls, 0.1, k)
    ball = BALL.at(balls, k)  # address of a row; BALL.outer_at(balls, k) of a field of it

Such a call is a load or store at a constant offset.  The layout stands in the declaration only: Python code
that writes the same memory takes a row's numbers, by name, from `row` and their places from `columns`.
An array of numbers is a table of records with one field: `SINGLES.at(address, k)`.  Lanes are a kind as well
(`lanes`), which is why numbers are read and written by `load_lanes`, `single_at`, ... of that module.
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
    """What a field holds.

    Attributes:
        dtype: "float32", "float64" or "int64".
        size: Of a value [bytes].
        count: Values of the field; several are a tuple.
        lanes: Numbers of a value, side by side.
        side_by_side: Returns Numba's type of such a value.
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
        """Return the same in more bytes."""
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
        """Of a value [bytes]; None for what is usual."""
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
    def make(typing_context: Any, address: Any, k: Any = 0) -> Any:
        from numba import types

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            places = kind.places(builder, _moved(builder, values[0], offset, values[1], stride))
            found = [builder.load(place, align=kind.align) for place in places]
            return found[0] if kind.count == 1 else context.make_tuple(builder, signature.return_type, found)

        return kind.numba_type()(types.intp, types.intp), generate

    def load(address: int, k: int = 0) -> Any:
        """Return a field of the record at an address, or of the k-th from there on."""
        return kind.read(address + k * stride + offset)

    return _named(load, f"{name} {kind} {offset} {stride}", make)


def _store(name: str, kind: FieldKind, offset: int, stride: int) -> Intrinsic:
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
        """Write a field of the record at an address, or of the k-th from there on."""
        kind.write(address + k * stride + offset, value)

    return _named(store, f"{name} {kind} {offset} {stride}", make)


def _address(name: str, offset: int, stride: int) -> Intrinsic:
    def make(typing_context: Any, address: Any, k: Any = 0) -> Any:
        from numba import types

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return _moved(builder, values[0], offset, values[1], stride)

        return types.int64(types.intp, types.intp), generate

    def address(address: int, k: int = 0) -> int:
        """Return the address of a field, or of the record, of the k-th from an address on."""
        return int(address) + k * stride + offset

    return _named(address, f"{name} {offset} {stride}", make)


def _named(python: Callable[..., Any], name: str, make: Callable[..., Any]) -> Intrinsic:
    python.__name__ = python.__qualname__ = name
    return intrinsic(make)(python)


class RecordView:
    """Fields of a row, one after the other.

    For each field there are, for compiled functions, `<field>(address, k=0)`, `set_<field>(address, value,
    k=0)` and `<field>_at(address, k=0)`, of the k-th row from an address on, and `at(address, k=0)` of a row.

    Args:
        name: What it is called, in keys and messages.
        **fields: Kinds by names.

    Attributes:
        size: Of a row [bytes].
        columns: For each field its place among the numbers of a row, or the slice of its places.
        width: How many numbers a row has.
        described: Name and layout, for the keys of machine code that uses it.
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
        """Return the numbers of a row, of all fields by names."""
        if values.keys() != self.fields.keys():
            raise TypeError(f"record {self.name} has the fields {', '.join(self.fields)}; given: {[*values]}")
        return [number for own in self.fields for number in np.ravel(values[own]).tolist()]

    def __repr__(self) -> str:
        """Name."""
        return f"<record {self.name}>"

    @property
    def _numba_type_(self) -> Any:
        """What Numba takes for a module: its attributes are constants and functions."""
        from numba import types

        return types.Module(self)


SINGLES = RecordView("SINGLES", value=single)
DOUBLES = RecordView("DOUBLES", value=double)
WORDS = RecordView("WORDS", value=word)
