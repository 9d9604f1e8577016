"""IR of the operations on vectors: a few instructions if the processor has them, else the C library.

Arithmetic carries the flag `contract` only: a product and a sum may become one fused instruction (which
rounds once, so it is more exact), but nothing is reassociated, and NaN, infinities and signed zeros keep
their meaning, so comparisons stay right.
"""

from __future__ import annotations

from pepper_kin.kernels.writer import Lanes, Writer

_ARITHMETIC = {
    "add": "fadd contract {v} {0}, {1}",
    "sub": "fsub contract {v} {0}, {1}",
    "mul": "fmul contract {v} {0}, {1}",
    "div": "fdiv contract {v} {0}, {1}",
    "sq": "fmul contract {v} {0}, {0}",
    "twice": "fadd contract {v} {0}, {0}",
    "inv": "fdiv contract {v} {one}, {0}",
    "neg": "fneg {v} {0}",
}
_INTRINSICS = {
    "sqrt": "sqrt",
    "fabs": "fabs",
    "floor": "floor",
    "ceil": "ceil",
    "fmin": "minnum",
    "fmax": "maxnum",
    "copysign": "copysign",
}
# "unordered or not equal": NaN counts as true, as in C.
_COMPARISONS = {"lt": "olt", "le": "ole", "eq": "oeq", "ne": "une"}
LIBRARY_FUNCTIONS: dict[str, str] = {
    **{
        name: name
        for name in ("exp", "log", "pow", "asin", "acos", "atan", "fmod", "erf", "sinh", "cosh", "tanh")
    },
    **{name: name for name in ("asinh", "acosh", "atanh", "atan2", "log1p", "expm1", "hypot", "remainder")},
    "constpow": "pow",
}
"""Operations that are evaluated lane by lane by the C library, and the names of its functions."""


def emit_operation(w: Writer, name: str, operands: list[str]) -> str:
    """Write one operation other than a leaf, "sin", "cos" and "tan".

    Args:
        w: Writer of the function.
        name: Name of the operation.
        operands: Names of its operands in IR.

    Returns:
        Name of the result in IR.
    """
    v = w.lanes.vector
    if name in _ARITHMETIC:
        return w.value(_ARITHMETIC[name].format(*operands, v=v, one=w.lanes.splat(1.0)))
    if name in _INTRINSICS:
        arguments = ", ".join(f"{v} {operand}" for operand in operands)
        return w.value(f"call {v} @llvm.{_INTRINSICS[name]}.{w.lanes.suffix}({arguments})")
    if name in _COMPARISONS:
        return _truth(w, w.value(f"fcmp {_COMPARISONS[name]} {v} {operands[0]}, {operands[1]}"))
    if name in LIBRARY_FUNCTIONS:
        arguments = ", ".join(f"{v} {operand}" for operand in operands)
        return w.value(f"call {v} @lanes_{LIBRARY_FUNCTIONS[name]}({arguments})")
    if name == "not":
        return _truth(w, w.value(f"fcmp oeq {v} {operands[0]}, zeroinitializer"))
    if name in ("and", "or"):
        left, right = (_is_true(w, operand) for operand in operands)
        return _truth(w, w.binary(name, left, right, w.lanes.mask))
    if name == "if_else_zero":
        condition = _is_true(w, operands[0])
        return w.value(f"select {w.lanes.mask} {condition}, {v} {operands[1]}, {v} zeroinitializer")
    return _sign(w, operands[0])


def library_function(lanes: Lanes, name: str, operand_count: int) -> str:
    """IR of `vector @lanes_<name>(vector, ...)`: a function of the C library in every lane."""
    w, v, s = Writer(lanes), lanes.vector, lanes.scalar
    ending = "" if lanes.dtype == "float64" else "f"
    result = "poison"
    for k in range(lanes.count):
        scalars = [w.value(f"extractelement {v} %x{i}, i32 {k}") for i in range(operand_count)]
        arguments = ", ".join(f"{s} {scalar}" for scalar in scalars)
        y = w.value(f"call {s} @{name}{ending}({arguments})")
        result = w.value(f"insertelement {v} {result}, {s} {y}, i32 {k}")
    w.line(f"ret {v} {result}")
    parameters = ", ".join(f"{v} %x{i}" for i in range(operand_count))
    return w.function(f"internal {v} @lanes_{name}({parameters}) noinline nounwind")


def library_declaration(lanes: Lanes, name: str, operand_count: int) -> str:
    """IR that declares a C library function: `double name(double, ...)`, or with `float`."""
    ending = "" if lanes.dtype == "float64" else "f"
    return f"declare {lanes.scalar} @{name}{ending}({', '.join([lanes.scalar] * operand_count)}) nounwind\n"


def intrinsic_declarations(lanes: Lanes) -> str:
    """IR that declares the LLVM intrinsics that are used here."""
    v = lanes.vector
    counts = {
        "sqrt": 1,
        "fabs": 1,
        "floor": 1,
        "ceil": 1,
        "minnum": 2,
        "maxnum": 2,
        "copysign": 2,
        "fmuladd": 3,
    }
    lines = [f"declare {v} @llvm.{n}.{lanes.suffix}({', '.join([v] * k)})" for n, k in counts.items()]
    return "\n".join((*lines, "declare i1 @llvm.expect.i1(i1, i1)", ""))


def _truth(w: Writer, condition: str) -> str:
    """1 where the condition holds, else 0, as CasADi's comparisons give."""
    v = w.lanes.vector
    return w.value(f"select {w.lanes.mask} {condition}, {v} {w.constant(1.0)}, {v} zeroinitializer")


def _is_true(w: Writer, operand: str) -> str:
    return w.value(f"fcmp une {w.lanes.vector} {operand}, zeroinitializer")


def _sign(w: Writer, x: str) -> str:
    """-1, +1, or x if it is neither negative nor positive (zeros, NaN)."""
    lanes, v = w.lanes, w.lanes.vector
    positive = w.value(f"fcmp ogt {v} {x}, zeroinitializer")
    negative = w.value(f"fcmp olt {v} {x}, zeroinitializer")
    upper = w.value(f"select {lanes.mask} {positive}, {v} {w.constant(1.0)}, {v} {x}")
    return w.value(f"select {lanes.mask} {negative}, {v} {w.constant(-1.0)}, {v} {upper}")
