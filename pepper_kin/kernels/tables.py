"""Tables of machine code: a declared tuple of numbers and arrays that functions read at an address.

    class Edges(NamedTuple):
        sign: float
        x: Floats1
        places: Ints2

    edges_at = table_reader(Edges)

    memory = TableMemory(Edges, sign=1.0, x=x, places=places)  # Python keeps the arrays
    edges = edges_at(memory.address)  # a compiled function has an `Edges` over the same arrays

A function with a signature takes such tuples directly; a C function (`by_address`), whose arguments are
words, takes the address of a memory.  A memory is a row of 64-bit words: a number is one word, an array its
address and its lengths, and a tuple within the tuple its fields, in order.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import Intrinsic, intrinsic
from pepper_kin.kernels.signatures import Argument, Array, Floats1, Ints1, RecordType, ScalarType, record_of


class TableMemory:
    """The memory of a table, with the arrays that it points to.

    Args:
        kind: The NamedTuple class.
        **values: Values of its fields.

    Attributes:
        words: Words that machine code reads, shape (k,).
    """

    def __init__(self, kind: type, **values: Any) -> None:
        self._record = record_of(kind)
        self._values: dict[str, Any] = {}
        self.words: NDArray[np.int64] = np.zeros(_size(self._record), np.int64)
        if missing := set(kind._fields) - values.keys():  # type: ignore[attr-defined]
            raise TypeError(f"table {kind.__name__} lacks {', '.join(sorted(missing))}")
        self.set(**values)

    @property
    def address(self) -> int:
        """Address of the words, valid as long as this object."""
        return int(self.words.ctypes.data)

    def set(self, **values: Any) -> None:
        """Replace some numbers and arrays; contiguous arrays of the field's dtype are not copied."""
        places, place = {}, 0
        for name, argument in self._record.fields:
            places[name] = argument, place
            place += _size(argument)
        for name, value in values.items():
            own = f"{self._record.kind.__name__}.{name}"
            if name not in places:
                raise TypeError(f"no field of a table: {own}; they are {', '.join(places)}")
            argument, place = places[name]
            self._values[name] = _write(self.words[place:], argument, value, own)

    def with_values(self, **values: Any) -> TableMemory:
        """Return a memory with other values of some fields; the other arrays are shared."""
        return TableMemory(self._record.kind, **(self._values | values))


def table_reader(kind: type) -> Intrinsic:
    """Return a function by which compiled functions read the table at an address; it owns no memory."""
    record = record_of(kind)

    def make(typing_context: Any, address: Any) -> Any:
        from llvmlite import ir
        from numba import types

        from pepper_kin.kernels.numba_builder import BlockReader, numba_type

        table = numba_type(record)

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            block = builder.inttoptr(values[0], ir.IntType(64).as_pointer())
            return BlockReader(context, builder, block).read(record, table)

        return table(types.intp), generate

    def read(address: int) -> Any:
        """Return the table at an address."""
        memory = (ctypes.c_int64 * _size(record)).from_address(address)
        return _read(np.frombuffer(memoryview(memory), np.int64), record)

    read.__name__ = read.__qualname__ = repr(record)  # for the keys of machine code that uses it
    return intrinsic(make)(read)


@compiled
def take(scratch: Floats1, used: Ints1, size: int) -> Floats1:
    """Return the next `size` numbers of a workspace, and advance `used[0]` past them."""
    begin = used[0]
    used[0] = begin + size
    return scratch[begin : begin + size]


def _size(argument: Argument) -> int:
    """Return the number of words of a field."""
    if isinstance(argument, RecordType):
        return sum(_size(field) for _, field in argument.fields)
    return 1 if isinstance(argument, ScalarType) else 1 + argument.ndim


def _write(words: NDArray[np.int64], argument: Argument, value: Any, name: str) -> Any:
    """Write a field to its words; return the value that is kept."""
    if isinstance(argument, RecordType):
        kind: Any = argument.kind
        if not isinstance(value, kind):
            raise TypeError(f"{name} is a {kind.__name__}, not {value!r}")
        kept, place = [], 0
        for (own, field), part in zip(argument.fields, value, strict=True):
            kept.append(_write(words[place:], field, part, f"{name}.{own}"))
            place += _size(field)
        return kind(*kept)
    given = np.asarray(value)
    number: Any = _number(words, argument) if isinstance(argument, ScalarType) else None
    axes, dtype = (0, number.dtype) if isinstance(argument, ScalarType) else (argument.ndim, argument.dtype)
    if given.ndim != axes or not np.can_cast(given.dtype, dtype, "same_kind"):
        raise TypeError(f"{name} has {axes} axes, of {dtype}; given: shape {given.shape}, {given.dtype}")
    if number is not None:
        number[0] = given
        return value
    array = given.astype(dtype, order="C", copy=False)
    words[: 1 + array.ndim] = array.ctypes.data, *array.shape
    return array


def _read(words: NDArray[np.int64], argument: Argument) -> Any:
    """Return the field of words that begin with it, interpreted."""
    if isinstance(argument, RecordType):
        values, place = [], 0
        for _, field in argument.fields:
            values.append(_read(words[place:], field))
            place += _size(field)
        return argument.kind(*values)
    if isinstance(argument, ScalarType):
        number = _number(words, argument)[0].item()
        return bool(number) if argument.name == "boolean" else number
    return _array_at(int(words[0]), argument, words[1 : 1 + argument.ndim].tolist())


def _number(words: NDArray[np.int64], argument: ScalarType) -> Any:
    """Return the first word as an array of the number's type."""
    return words[:1].view({"float64": np.float64, "uint64": np.uint64}.get(argument.name, np.int64))


def _array_at(address: int, argument: Array, shape: list[int]) -> Any:
    size = int(np.prod(shape, dtype=np.int64)) * argument.dtype.itemsize
    memory = (ctypes.c_char * size).from_address(address)
    return np.frombuffer(memoryview(memory), argument.dtype).reshape(shape)
