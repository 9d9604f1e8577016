"""Sine and cosine of a vector, in IR.

Cody and Waite: with n the integer next to x * 2 / pi, the remainder is r = ((x - n P1) - n P2) - n P3, where
P1 + P2 + P3 = pi / 2 to about three times the working precision.  P1 and P2 have so few bits that n P1 and n
P2 are exact; x - n P1 is exact as well, because both are close multiples of the same power of two.  Only the
other two differences round, each to the last bit of r, so r is right to one unit in the last place even
near a multiple of pi.  On |r| <= pi / 4, with z = r * r,

    sin r = r + r z (s0 + s1 z + ...),        cos r = 1 + z (-1/2 + z (c0 + c1 z + ...)),

and n modulo 4 swaps and negates the two.  n is found by adding a number so large that the sum has no bits
below 1.  An optimizer that may reassociate would remove that sum, so nothing in this file carries a
fast-math flag.  `multiply_add` is exact here with and without fused instructions (without them only to
|n| < 2**14), so there is one text for all processors.

W. J. Cody, W. Waite, "Software Manual for the Elementary Functions", Prentice-Hall 1980.  The coefficients
interpolate the exact series at Chebyshev nodes, in rational arithmetic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from pepper_kin.kernels.writer import ConstantTable, Lanes, Writer


@dataclass(frozen=True)
class _Precision:
    """Constants of one number format."""

    half_pi: tuple[float, ...]  # in parts
    magic: float  # adding it leaves an integer in the low bits of the significand
    sine: tuple[float, ...]
    cosine: tuple[float, ...]


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float.fromhex(number) if "0x" in number else float(number) for number in text.split())


_DOUBLE = _Precision(
    half_pi=_numbers("0x1.921fb5444p+0 0x1.68c234c4c4p-39 0x1.3145c06e0e689p-78"),
    magic=1.5 * 2.0**52,
    sine=_numbers(
        "-0.16666666666666666 0.008333333333330901 -0.00019841269836686008 "
        "2.7557316064986773e-06 -2.505112403138208e-08 1.59175674789068e-10"
    ),
    cosine=_numbers(
        "0.041666666666666664 -0.0013888888888887367 2.480158729872029e-05 "
        "-2.7557317248229367e-07 2.0876141380294955e-09 -1.1382280957702634e-11"
    ),
)
_SINGLE = _Precision(
    half_pi=_numbers("0x1.921fb6p+0 -0x1.777a5cp-25 -0x1.ee59dap-50"),
    magic=1.5 * 2.0**23,
    sine=_numbers("-0.1666666716337204 0.008333331905305386 -0.00019840076856780797 2.72487022812129e-06"),
    cosine=_numbers("0.0416666641831398 -0.0013888297835364938 2.4546930944779888e-05"),
)


def range_limit(dtype: str, has_fma: bool) -> float:
    """Return the maximum |x| [rad] of the fast path: beyond, n P1 is inexact or n not the nearest integer."""
    if dtype == "float32":
        return 2.0**16
    return 2.0**28 if has_fma else 2.0**14


def sine_cosine_functions(constants: ConstantTable, has_fma: bool) -> str:
    """IR of `{vector, vector} @sine_cosine(vector, constants)`: sine and cosine of every lane.

    Vectors with a lane beyond `range_limit` (or NaN) go lane by lane to the C library.  `@sine_cosine` is
    inlined into its caller, which is fast in a loop; `@sine_cosine_called` is the function as a call, which
    keeps straight-line code with many angles short.
    """
    return _near_function(constants, has_fma) + _called_function(constants) + _far_function(constants)


def _near_function(constants: ConstantTable, has_fma: bool) -> str:
    """IR of `@sine_cosine`: the fast path, or `@sine_cosine_far` if a lane is out of its range."""
    lanes, v = constants.lanes, constants.lanes.vector
    w = Writer(lanes, constants)
    pair = f"{{{v}, {v}}}"
    magnitude = w.value(f"call {v} @llvm.fabs.{lanes.suffix}({v} %x)")
    beyond = w.value(f"fcmp ugt {v} {magnitude}, {w.constant(range_limit(lanes.dtype, has_fma))}")
    bits = w.value(f"bitcast {lanes.mask} {beyond} to i{lanes.count}")
    any_beyond = w.value(f"icmp ne i{lanes.count} {bits}, 0")
    any_beyond = w.value(f"call i1 @llvm.expect.i1(i1 {any_beyond}, i1 false)")
    w.line(f"br i1 {any_beyond}, label %far, label %near")
    w.label("near")
    if lanes.dtype == "float64" or has_fma:
        precision = _DOUBLE if lanes.dtype == "float64" else _SINGLE
        quarter_turns, remainder = _reduce(w, "%x", precision)
    else:
        quarter_turns, remainder = _reduce_in_double(w)
    sine, cosine = _sine_cosine_of_remainder(w, remainder, quarter_turns)
    first = w.value(f"insertvalue {pair} poison, {v} {sine}, 0")
    both = w.value(f"insertvalue {pair} {first}, {v} {cosine}, 1")
    w.line(f"ret {pair} {both}")
    w.label("far")
    result = w.value(f"call {pair} @sine_cosine_far({v} %x)")
    w.line(f"ret {pair} {result}")
    return w.function(
        f"internal {pair} @sine_cosine({v} %x, ptr noalias readonly %constants) alwaysinline nounwind"
    )


def _reduce(w: Writer, x: str, precision: _Precision) -> tuple[str, str]:
    """Return the number of quarter turns (the integer in the low bits) and the remainder in [-pi/4, pi/4]."""
    lanes, v = w.lanes, w.lanes.vector
    magic = w.constant(precision.magic)
    shifted = w.multiply_add(x, w.constant(2 / math.pi), magic)
    # Negated after the subtraction: minus n is -0 for n = 0, which leaves x = -0 as it is.
    turns = w.value(f"fneg {v} {w.binary('fsub', shifted, magic)}")
    remainder = x
    for part in precision.half_pi:
        remainder = w.multiply_add(turns, w.constant(part), remainder)
    return w.value(f"bitcast {v} {shifted} to {lanes.integer}"), remainder


def _reduce_in_double(w: Writer) -> tuple[str, str]:
    """Return quarter turns and remainder of floats via doubles, without fused instructions for exact n P1."""
    wide = Writer(Lanes("float64", w.lanes.count), None, w.lines, _count=w._count)
    x = wide.value(f"fpext {w.lanes.vector} %x to {wide.lanes.vector}")
    integers, remainder = _reduce(wide, x, _DOUBLE)
    w._count = wide._count
    narrow = w.value(f"fptrunc {wide.lanes.vector} {remainder} to {w.lanes.vector}")
    return w.value(f"trunc {wide.lanes.integer} {integers} to {w.lanes.integer}"), narrow


def _sine_cosine_of_remainder(w: Writer, r: str, quarter_turns: str) -> tuple[str, str]:
    """Return sine and cosine of x from the remainder r and the number of quarter turns."""
    lanes, v, i = w.lanes, w.lanes.vector, w.lanes.integer
    precision = _DOUBLE if lanes.dtype == "float64" else _SINGLE
    z = w.binary("fmul", r, r)
    difference = w.binary("fmul", z, w.polynomial(z, precision.sine))
    sine = _with_sign_of(w, w.multiply_add(r, difference, r), r)
    tail = w.multiply_add(z, w.polynomial(z, precision.cosine), w.constant(-0.5))
    cosine = w.multiply_add(z, tail, w.constant(1.0))

    sign_bit = 8 * lanes.scalar_bytes - 1
    odd = w.binary("shl", quarter_turns, lanes.splat_integer(sign_bit), i)
    half = w.binary("shl", quarter_turns, lanes.splat_integer(sign_bit - 1), i)
    swap = w.value(f"icmp slt {i} {odd}, zeroinitializer")
    results = []
    signs = (half, w.binary("xor", odd, half, i))
    for when_even, when_odd, sign in ((sine, cosine, signs[0]), (cosine, sine, signs[1])):
        chosen = w.value(f"select {lanes.mask} {swap}, {v} {when_odd}, {v} {when_even}")
        flip = w.binary("and", sign, lanes.splat_integer(-(2**sign_bit)), i)
        flipped = w.binary("xor", w.value(f"bitcast {v} {chosen} to {i}"), flip, i)
        results.append(w.value(f"bitcast {i} {flipped} to {v}"))
    return results[0], results[1]


def _with_sign_of(w: Writer, sine: str, r: str) -> str:
    """Return the sine with the sign of r: -0 + 0 is 0, other sines have the sign already."""
    v, i = w.lanes.vector, w.lanes.integer
    sign_bit = w.lanes.splat_integer(-(2 ** (8 * w.lanes.scalar_bytes - 1)))
    sign = w.binary("and", w.value(f"bitcast {v} {r} to {i}"), sign_bit, i)
    signed = w.binary("or", w.value(f"bitcast {v} {sine} to {i}"), sign, i)
    return w.value(f"bitcast {i} {signed} to {v}")


def _called_function(constants: ConstantTable) -> str:
    w, v = Writer(constants.lanes), constants.lanes.vector
    parameters = f"({v} %x, ptr %constants)"
    w.line(f"ret {{{v}, {v}}} {w.value(f'call {{{v}, {v}}} @sine_cosine{parameters}')}")
    return w.function(f"internal {{{v}, {v}}} @sine_cosine_called{parameters} noinline nounwind")


def _far_function(constants: ConstantTable) -> str:
    """IR of `@sine_cosine_far`, which calls the C library for each lane."""
    lanes, v = constants.lanes, constants.lanes.vector
    w = Writer(lanes, constants)
    pair, ending = f"{{{v}, {v}}}", "" if lanes.dtype == "float64" else "f"
    result = "poison"
    for position, name in enumerate(("sin", "cos")):
        vector = "poison"
        for k in range(lanes.count):
            x = w.value(f"extractelement {v} %x, i32 {k}")
            y = w.value(f"call {lanes.scalar} @{name}{ending}({lanes.scalar} {x})")
            vector = w.value(f"insertelement {v} {vector}, {lanes.scalar} {y}, i32 {k}")
        result = w.value(f"insertvalue {pair} {result}, {v} {vector}, {position}")
    w.line(f"ret {pair} {result}")
    return w.function(f"internal {pair} @sine_cosine_far({v} %x) noinline cold nounwind")
