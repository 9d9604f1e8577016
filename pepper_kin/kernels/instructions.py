"""Reading a CasADi `SX` function as a list of scalar operations.

An `SXFunction` holds a flat list of scalar instructions on a small set of reused registers.  `read_program`
converts the list to single assignment form: operation `k` defines value `k`, its operands are earlier values,
and equal operations are merged.  Constants and inputs are values as well.

Elements of inputs and outputs are numbered in NumPy's order of the dense arrays (row-major, all inputs one
after the other), not in CasADi's column-major order of the non-zeros.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from pepper_kin.exceptions import InvalidValueError, PepperKinError

if TYPE_CHECKING:
    import casadi

OPERAND_COUNT: dict[str, int] = {
    **dict.fromkeys(("add", "sub", "mul", "div", "pow", "constpow", "lt", "le", "eq", "ne", "and", "or"), 2),
    **dict.fromkeys(("fmod", "copysign", "if_else_zero", "fmin", "fmax", "atan2", "hypot", "remainder"), 2),
    **dict.fromkeys(
        ("neg", "exp", "log", "sqrt", "sq", "twice", "sin", "cos", "tan", "asin", "acos", "atan"), 1
    ),
    **dict.fromkeys(("not", "floor", "ceil", "fabs", "sign", "erf", "inv", "sinh", "cosh", "tanh"), 1),
    **dict.fromkeys(("asinh", "acosh", "atanh", "log1p", "expm1"), 1),
}
"""Number of operands of each operation that can be compiled, named as in CasADi (`OP_ADD` is "add")."""

SUPPORTED_OPERATIONS: tuple[str, ...] = tuple(sorted(OPERAND_COUNT))
"""Names of the operations that can be compiled."""

_COMMUTATIVE = frozenset(("add", "mul", "eq", "ne", "and", "or"))
_ALIASES = frozenset(("assign", "lift"))  # lift(x, guess) is x; the guess is for multiple shooting only


class UnsupportedInstructionError(PepperKinError):
    """Error for a function with an instruction that cannot be compiled.

    Attributes:
        operation: Name of the instruction.
        function: Name of the function.
        available: Names of the operations that can be compiled.
    """

    def __init__(self, operation: str, function: str) -> None:
        self.operation, self.function, self.available = operation, function, SUPPORTED_OPERATIONS
        super().__init__(
            f"function {function!r} uses the instruction {operation!r}, which cannot be compiled; "
            f"available: {', '.join(self.available)}"
        )


class Operation(NamedTuple):
    """One scalar operation; its index in the list is the index of the value that it defines.

    Attributes:
        name: "const", "input", or a key of `OPERAND_COUNT`.
        operands: Indices of the values that it reads.
        immediate: The constant of "const", the element number of "input", else 0.
    """

    name: str
    operands: tuple[int, ...] = ()
    immediate: float = 0.0

    @property
    def is_leaf(self) -> bool:
        """Whether the operation reads no value (a constant or an input), so that it is cheap to repeat."""
        return not self.operands


@dataclass(frozen=True)
class Signature:
    """Names and dense shapes of the inputs and outputs of a function.

    Attributes:
        name: Name of the function.
        input_names: Names of the inputs.
        input_shapes: (rows, columns) of each input.
        output_names: Names of the outputs.
        output_shapes: (rows, columns) of each output.
    """

    name: str
    input_names: tuple[str, ...]
    input_shapes: tuple[tuple[int, int], ...]
    output_names: tuple[str, ...]
    output_shapes: tuple[tuple[int, int], ...]

    @property
    def input_sizes(self) -> tuple[int, ...]:
        """Number of elements of each input."""
        return tuple(rows * columns for rows, columns in self.input_shapes)

    @property
    def output_sizes(self) -> tuple[int, ...]:
        """Number of elements of each output."""
        return tuple(rows * columns for rows, columns in self.output_shapes)


@dataclass(frozen=True)
class Program:
    """A function in single assignment form.

    Attributes:
        signature: Names and shapes.
        operations: The operations, each after its operands.
        outputs: Index of the value of every element of all outputs, row-major and one output after the other,
            or None for a structural zero.
    """

    signature: Signature
    operations: tuple[Operation, ...]
    outputs: tuple[int | None, ...]

    @property
    def flop_count(self) -> int:
        """Number of arithmetic operations of one evaluation; elementary functions count as one each."""
        free = ("const", "input", "neg", "fabs", "copysign")
        return sum(operation.name not in free for operation in self.operations)


def read_program(function: casadi.Function) -> Program:
    """Read a CasADi function.

    Args:
        function: An `SXFunction` (for an MX function, pass `function.expand()`).

    Returns:
        The function as a list of operations.

    Raises:
        InvalidValueError: It is not an `SXFunction`, or has free variables.
        UnsupportedInstructionError: It holds an instruction that cannot be compiled.
    """
    check_function(function)
    signature = read_signature(function)
    input_elements = [_dense_positions(function.sparsity_in(i)) for i in range(function.n_in())]
    output_elements = [_dense_positions(function.sparsity_out(i)) for i in range(function.n_out())]
    input_offsets, output_offsets = _offsets(signature.input_sizes), _offsets(signature.output_sizes)
    outputs: list[int | None] = [None] * sum(signature.output_sizes)
    builder = _Builder(function.name())
    names = _operation_names()
    registers: dict[int, int] = {}
    for k in range(function.n_instructions()):
        name = names.get(function.instruction_id(k), str(function.instruction_id(k)))
        reads, writes = function.instruction_input(k), function.instruction_output(k)
        if name == "input":
            element = input_offsets[reads[0]] + input_elements[reads[0]][reads[1]]
            registers[writes[0]] = builder.leaf("input", element)
        elif name == "const":
            registers[writes[0]] = builder.leaf("const", function.instruction_constant(k))
        elif name == "output":
            outputs[output_offsets[writes[0]] + output_elements[writes[0]][writes[1]]] = registers[reads[0]]
        elif name in _ALIASES:
            registers[writes[0]] = registers[reads[0]]
        else:
            registers[writes[0]] = builder.operation(name, [registers[register] for register in reads])
    return Program(signature, tuple(builder.operations), tuple(outputs))


def check_function(function: object) -> None:
    """Refuse anything but an `SXFunction` without free variables.

    Raises:
        InvalidValueError: Otherwise.
    """
    class_name = getattr(function, "class_name", lambda: type(function).__name__)()
    if class_name != "SXFunction":
        advice = "; call .expand() on an MX function first" if class_name.endswith("Function") else ""
        raise InvalidValueError("function", class_name, f"a casadi.Function of SX expressions{advice}")
    if function.has_free():  # type: ignore[attr-defined]
        free = ", ".join(str(symbol) for symbol in function.get_free())  # type: ignore[attr-defined]
        raise InvalidValueError("function", f"free variables {free}", "every symbol to be among the inputs")


def read_signature(function: casadi.Function) -> Signature:
    """Names and dense shapes of the inputs and outputs of a CasADi function."""
    return Signature(
        name=function.name(),
        input_names=tuple(function.name_in()),
        input_shapes=tuple(_shape(function.size_in(i)) for i in range(function.n_in())),
        output_names=tuple(function.name_out()),
        output_shapes=tuple(_shape(function.size_out(i)) for i in range(function.n_out())),
    )


def _shape(size: tuple[int, int]) -> tuple[int, int]:
    rows, columns = size
    return rows, columns


class _Builder:
    """Builder of the list of operations, without duplicates."""

    def __init__(self, function_name: str) -> None:
        self.operations: list[Operation] = []
        self._function_name = function_name
        self._numbers: dict[object, int] = {}

    def leaf(self, name: str, immediate: float) -> int:
        """Return the index of an input or constant, added once."""
        # 0.0 == -0.0 and nan != nan: the text of the number is a key that distinguishes them.
        return self._add(Operation(name, (), immediate), (name, repr(immediate)))

    def operation(self, name: str, operands: list[int]) -> int:
        """Return the index of an operation on earlier values, added once."""
        if name not in OPERAND_COUNT:
            raise UnsupportedInstructionError(name, self._function_name)
        operation = Operation(name, tuple(operands[: OPERAND_COUNT[name]]))
        same = tuple(sorted(operation.operands)) if name in _COMMUTATIVE else operation.operands
        return self._add(operation, (name, same))

    def _add(self, operation: Operation, key: object) -> int:
        number = self._numbers.setdefault(key, len(self.operations))
        if number == len(self.operations):
            self.operations.append(operation)
        return number


@cache
def _operation_names() -> dict[int, str]:
    """CasADi's operation codes, by number ("add" for `OP_ADD`)."""
    import casadi

    return {getattr(casadi, name): name[3:].lower() for name in dir(casadi) if name.startswith("OP_")}


def _dense_positions(sparsity: casadi.Sparsity) -> list[int]:
    """Row-major position in the dense array of every non-zero, in CasADi's order."""
    columns = sparsity.size2()
    return [row * columns + column for row, column in zip(*sparsity.get_triplet(), strict=True)]


def _offsets(sizes: tuple[int, ...]) -> list[int]:
    """Number of elements before each array when they are laid one after the other."""
    return [sum(sizes[:k]) for k in range(len(sizes))]
