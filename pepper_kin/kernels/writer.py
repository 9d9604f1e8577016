"""Writing LLVM IR as text.

llvmlite's own IR builder makes several Python objects per instruction; for straight-line code of thousands of
instructions, writing the text is ten times faster and as easy to read.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from pepper_kin.kernels.target import SCALAR_BYTES


@dataclass(frozen=True)
class Lanes:
    """A vector of numbers in IR: `count` numbers of `dtype`, one per state.

    Attributes:
        dtype: "float64" or "float32".
        count: Number of lanes, a power of two.
    """

    dtype: str
    count: int

    @property
    def scalar(self) -> str:
        """IR type of one number."""
        return "double" if self.dtype == "float64" else "float"

    @property
    def vector(self) -> str:
        """IR type of the vector."""
        return f"<{self.count} x {self.scalar}>"

    @property
    def integer(self) -> str:
        """IR type of a vector of integers of the same size."""
        return f"<{self.count} x i{8 * self.scalar_bytes}>"

    @property
    def mask(self) -> str:
        """IR type of a vector of truth values."""
        return f"<{self.count} x i1>"

    @property
    def suffix(self) -> str:
        """Name of the vector type in the names of LLVM's intrinsic functions."""
        return f"v{self.count}f{8 * self.scalar_bytes}"

    @property
    def scalar_bytes(self) -> int:
        """Size of one number [bytes]."""
        return SCALAR_BYTES[self.dtype]

    @property
    def vector_bytes(self) -> int:
        """Size of the vector [bytes]."""
        return self.count * self.scalar_bytes

    def literal(self, value: float) -> str:
        """One number as IR writes it: the bits of a double, or of the double equal to the rounded float."""
        if self.dtype == "float32" and math.isfinite(value):
            value = _round_to_float(value)
        return f"0x{struct.unpack('<Q', struct.pack('<d', value))[0]:016X}"

    def splat(self, value: float) -> str:
        """The vector that has `value` in every lane."""
        return self._repeat(self.scalar, self.literal(value))

    def splat_integer(self, value: int) -> str:
        """The vector of integers that has `value` in every lane."""
        return self._repeat(f"i{8 * self.scalar_bytes}", str(value))

    def _repeat(self, element_type: str, literal: str) -> str:
        return "<" + ", ".join([f"{element_type} {literal}"] * self.count) + ">"


@dataclass
class ConstantTable:
    """Vector constants of a module, in one array; functions get its address as `%constants`.

    LLVM's own constant pool may end up anywhere in a 64-bit address space when code is loaded at run time, so
    each use would first need the pool's 64-bit address in a register (a fifth of all instructions, measured).
    Relative to an argument, the constant is an operand of the instruction that uses it.
    """

    lanes: Lanes
    _indices: dict[str, int] = field(default_factory=dict)

    def index(self, value: float) -> int:
        """Position of a constant, added if it is new."""
        return self._indices.setdefault(self.lanes.splat(value), len(self._indices))

    def definition(self) -> str:
        """IR of the table, an exported variable, so that LLVM does not fold its values."""
        vectors = ", ".join(f"{self.lanes.vector} {vector}" for vector in self._indices)
        return f"@constants = global [{len(self._indices)} x {self.lanes.vector}] [{vectors}], align 64\n"


@dataclass
class Writer:
    """Writer of the body of one IR function.

    Attributes:
        lanes: The vector type.
        constants: The table of constants, whose address is `%constants` in the function; None to write
            constants where they are used.
        lines: Lines written so far.
    """

    lanes: Lanes
    constants: ConstantTable | None = None
    lines: list[str] = field(default_factory=list)
    _count: int = 0

    def constant(self, value: float) -> str:
        """The vector that has `value` in every lane, from the table if there is one; zero needs none."""
        if self.constants is None or self.lanes.literal(value) == self.lanes.literal(0.0):
            return self.lanes.splat(value)
        return self.load(self.element_address("%constants", self.constants.index(value)))

    def value(self, expression: str) -> str:
        """Write `%t = expression` and return the new name `%t`."""
        name = f"%t{self._count}"
        self._count += 1
        self.lines.append(f"  {name} = {expression}")
        return name

    def line(self, text: str) -> None:
        """Write an instruction that has no value."""
        self.lines.append(f"  {text}")

    def label(self, name: str) -> None:
        """Start a basic block."""
        self.lines.append(f"{name}:")

    def binary(self, operator: str, left: str, right: str, kind: str | None = None) -> str:
        """Write `operator kind left, right`; `kind` is the vector type unless given."""
        return self.value(f"{operator} {kind or self.lanes.vector} {left}, {right}")

    def multiply_add(self, factor: str, other: str, addend: str) -> str:
        """Write `factor * other + addend`, with one rounding where the processor can."""
        v = self.lanes.vector
        name = f"@llvm.fmuladd.{self.lanes.suffix}"
        return self.value(f"call {v} {name}({v} {factor}, {v} {other}, {v} {addend})")

    def polynomial(self, x: str, coefficients: tuple[float, ...]) -> str:
        """Write Horner's rule; the coefficient of the lowest power comes first."""
        result = self.constant(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            result = self.multiply_add(result, x, self.constant(coefficient))
        return result

    def element_address(self, base: str, index: str | int, element: str | None = None) -> str:
        """Write the address of element `index` of an array at `base`; elements are vectors by default."""
        return self.value(f"getelementptr inbounds {element or self.lanes.vector}, ptr {base}, i64 {index}")

    def load(self, address: str) -> str:
        """Write the load of a vector that has only the alignment of one number."""
        return self.value(f"load {self.lanes.vector}, ptr {address}, align {self.lanes.scalar_bytes}")

    def store(self, value: str, address: str) -> None:
        """Write the store of a vector to an address that has only the alignment of one number."""
        self.line(f"store {self.lanes.vector} {value}, ptr {address}, align {self.lanes.scalar_bytes}")

    def loop(self, name: str, count: int | str, step: int, body: Callable[[str], None]) -> None:
        """Write `for (i64 i = 0; i < count; i += step) body(i)`.

        Args:
            name: Prefix of the labels; unique in the function.
            count: End of the index: a number, or the name of an i64.
            step: Increment of the index per iteration.
            body: Function that writes the body; gets the name of the index.  The body may contain loops.
        """
        if count == 0:
            return
        index, following = f"%{name}_index", f"%{name}_next"
        entry = f"{name}_entry"
        self.line(f"br label %{entry}")
        self.label(entry)
        if isinstance(count, str):
            empty = self.value(f"icmp sle i64 {count}, 0")
            self.line(f"br i1 {empty}, label %{name}_end, label %{name}_body")
        else:
            self.line(f"br label %{name}_body")
        self.label(f"{name}_body")
        self.line(f"{index} = phi i64 [0, %{entry}], [{following}, %{name}_latch]")
        body(index)
        self.line(f"br label %{name}_latch")
        self.label(f"{name}_latch")
        self.line(f"{following} = add nuw nsw i64 {index}, {step}")
        again = self.value(f"icmp slt i64 {following}, {count}")
        self.line(f"br i1 {again}, label %{name}_body, label %{name}_end")
        self.label(f"{name}_end")

    def function(self, header: str) -> str:
        """Return the text of the whole function: `header`, then the lines."""
        return "\n".join((f"define {header} {{", *self.lines, "}", ""))


def _round_to_float(value: float) -> float:
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)
