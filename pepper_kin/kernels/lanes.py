"""Vectors of eight floats, one value per lane, for compiled functions.

    x = load_lanes(address)  # eight float32, one after the other (`records`)
    store_lanes(address, lane_minimum(x * spread(2.0), x + x))

Sums, differences, products and quotients of lanes, and of lanes and numbers, are written as usual; products
and sums may be contracted.  Compiled, the eight floats are one vector register (two of half the width on
processors without AVX); interpreted, they are an array of eight float32.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pepper_kin.kernels.intrinsics import in_all_lanes, intrinsic
from pepper_kin.kernels.records import DOUBLES, SINGLES, WORDS, FieldKind, RecordView, single

LANES = 8
"""Number of values of a vector."""
LANE_BYTES = 4 * LANES
"""Size of a vector in memory [bytes]."""

Lanes: TypeAlias = NDArray[np.float32]

_FAST = ("contract", "nsz", "nnan", "ninf")


def _vector() -> Any:
    from llvmlite import ir

    return ir.VectorType(ir.FloatType(), LANES)


def lanes_type() -> Any:
    """Return Numba's type of vectors of lanes; made once, with its operators."""
    if not _made:
        _made.append(_register())
    return _made[0]


_made: list[Any] = []


def _register() -> Any:
    """Make Numba's type of vectors of lanes, and register its operators; return it."""
    from numba import types
    from numba.core.datamodel import models
    from numba.core.typing.templates import AbstractTemplate, infer_global, signature
    from numba.extending import lower_builtin, register_model

    class LanesType(types.Type):
        def __init__(self) -> None:
            super().__init__(name="Lanes")

        def __reduce__(self) -> Any:
            return lanes_type, ()

    kind = LanesType()

    @register_model(LanesType)
    class LanesModel(models.PrimitiveModel):
        def __init__(self, manager: Any, fe_type: Any) -> None:
            super().__init__(manager, fe_type, _vector())

    def lower(symbol: Any, name: str) -> None:
        class Typing(AbstractTemplate):
            def generic(self, arguments: Any, named: Any) -> Any:
                if len(arguments) != 2 or named or not any(isinstance(g, LanesType) for g in arguments):
                    return None
                others = [g for g in arguments if not isinstance(g, LanesType)]
                if not all(isinstance(g, (types.Float, types.Integer)) for g in others):
                    return None
                return signature(kind, *(g if isinstance(g, LanesType) else types.float32 for g in arguments))

        infer_global(symbol)(Typing)

        def generate(context: Any, builder: Any, sig: Any, values: Any) -> Any:
            wide = [
                v if isinstance(t, LanesType) else in_all_lanes(builder, v, _vector())
                for v, t in zip(values, sig.args, strict=True)
            ]
            return getattr(builder, name)(*wide, flags=_FAST)

        for types_given in ((kind, kind), (kind, types.float32), (types.float32, kind)):
            lower_builtin(symbol, *types_given)(generate)

    for symbol, name in (
        (operator.add, "fadd"),
        (operator.sub, "fsub"),
        (operator.mul, "fmul"),
        (operator.truediv, "fdiv"),
    ):
        lower(symbol, name)
        in_place = getattr(operator, "i" + symbol.__name__)
        lower(in_place, name)
    return kind


def _emit_unary(name: str) -> Callable[..., Any]:
    """Return a writer of an LLVM intrinsic of one vector."""

    def make(typing_context: Any, x: Any) -> Any:
        from llvmlite import ir

        kind = lanes_type()

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            function = builder.module.declare_intrinsic(
                f"llvm.{name}.v{LANES}f32", (), ir.FunctionType(_vector(), [_vector()])
            )
            return builder.call(function, values)

        return kind(kind), generate

    return make


def _emit_extreme(sign: str) -> Callable[..., Any]:
    """Return a writer of the minimum ("<") or maximum (">") in each lane."""

    def make(typing_context: Any, x: Any, y: Any) -> Any:
        kind = lanes_type()

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.select(builder.fcmp_ordered(sign, *values, flags=("nnan", "nsz")), *values)

        return kind(kind, kind), generate

    return make


def _emit_spread(typing_context: Any, value: Any) -> Any:
    """Return signature and writer of a vector with a number in all lanes."""
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return in_all_lanes(builder, values[0], _vector())

    return lanes_type()(types.float32), generate


def _emit_below(typing_context: Any, x: Any, y: Any) -> Any:
    """Return signature and writer of the bit mask of the lanes where x < y."""
    from llvmlite import ir
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        flags = builder.fcmp_ordered("<", *values)
        bits = builder.bitcast(flags, ir.IntType(LANES))
        return builder.zext(bits, ir.IntType(64))

    return types.int64(lanes_type(), lanes_type()), generate


def _emit_reduction(name: str) -> Callable[..., Any]:
    """Return a writer of an LLVM reduction of a vector to one number."""

    def make(typing_context: Any, x: Any) -> Any:
        from llvmlite import ir
        from numba import types

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            function = builder.module.declare_intrinsic(
                f"llvm.vector.reduce.{name}.v{LANES}f32", (), ir.FunctionType(ir.FloatType(), [_vector()])
            )
            return builder.call(function, values, fastmath=("nnan", "nsz"))

        return types.float32(lanes_type()), generate

    return make


def _emit_lowest(typing_context: Any, bits: Any) -> Any:
    """Return signature and writer of the index of the lowest set bit."""
    from llvmlite import ir
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.cttz(values[0], ir.IntType(1)(1))

    return types.int64(types.int64), generate


lanes = FieldKind("float32", LANE_BYTES, lanes=LANES, side_by_side=lanes_type)
"""Kind of a field of a record: eight float32."""
TRIPLES = RecordView("TRIPLES", xyz=3 * lanes)
"""Rows of three values in lanes: points or directions."""
ONE_LANE = RecordView("ONE_LANE", xyz=3 * single.padded(LANE_BYTES))
"""One lane of a row of `TRIPLES`, at `SINGLES.at(row, lane)`."""

load_lanes, store_lanes = (_LANES := RecordView("LANES", value=lanes)).value, _LANES.set_value
single_at, store_single = SINGLES.value, SINGLES.set_value
double_at, store_double = DOUBLES.value, DOUBLES.set_value
word_at, store_word = WORDS.value, WORDS.set_value
"""Access by address: `load(address, k=0)`, the k-th value from there, and `store(address, value, k=0)`."""


@intrinsic(_emit_spread)
def spread(value: float) -> Lanes:
    """Return a number in all lanes."""
    return np.full(LANES, value, np.float32)


@intrinsic(_emit_extreme("<"))
def lane_minimum(x: Lanes, y: Lanes) -> Lanes:
    """Return the minimum in each lane."""
    return np.minimum(x, y)


@intrinsic(_emit_extreme(">"))
def lane_maximum(x: Lanes, y: Lanes) -> Lanes:
    """Return the maximum in each lane."""
    return np.maximum(x, y)


@intrinsic(_emit_unary("fabs"))
def lane_abs(x: Lanes) -> Lanes:
    """Return |x| in each lane."""
    return np.abs(x)


@intrinsic(_emit_unary("sqrt"))
def lane_sqrt(x: Lanes) -> Lanes:
    """Return the square root in each lane."""
    return np.sqrt(x)


@intrinsic(_emit_unary("rint"))
def lane_round(x: Lanes) -> Lanes:
    """Return the nearest integer in each lane."""
    return np.rint(x)


@intrinsic(_emit_below)
def lanes_below(x: Lanes, y: Lanes) -> int:
    """Return a bit mask of the lanes where x < y; bit i belongs to lane i."""
    return int(np.packbits(np.asarray(x < y), bitorder="little")[0])


@intrinsic(_emit_reduction("fmin"))
def least_lane(x: Lanes) -> float:
    """Return the minimum of the eight numbers."""
    return float(x.min())


@intrinsic(_emit_reduction("fmax"))
def greatest_lane(x: Lanes) -> float:
    """Return the maximum of the eight numbers."""
    return float(x.max())


@intrinsic(_emit_lowest)
def lowest_bit(bits: int) -> int:
    """Return the index of the lowest set bit of a number other than 0."""
    return (int(bits) & -int(bits)).bit_length() - 1
