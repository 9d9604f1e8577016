"""Calls of machine code from Python.

A compiled function is a Python object of C functions (`METH_FASTCALL`).  All share one machine code function,
`call_from_python`, which reads the arguments as described by a table, `plan`, refuses wrong ones, releases
the interpreter's lock, calls, and makes the result object.  A call costs a tenth of a microsecond and some
nanoseconds for each array: an array's data are read at the offsets of NumPy's stable C interface
(`PyArrayObject_fields`).
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from pepper_kin.kernels.compiled_function import compiled
from pepper_kin.kernels.intrinsics import _emit_call, floats_at, intrinsic, words_at
from pepper_kin.kernels.signatures import Argument, Array, ScalarType

if TYPE_CHECKING:
    from pepper_kin.kernels.compiled_function import CompiledFunction

BLOCK_WORDS = 768
"""Maximum number of words for the arguments of a call: one per number, one plus one per axis per array."""

# Entries of the plan: address of the entry point, number of arguments, number of steps, kind of result,
# message for a wrong number, table of the C interface, size of an object's header [bytes], number and types
# of the results; then the steps.
ENTRY, COUNT, STEPS, RESULT, WRONG_COUNT, API, HEADER, RESULTS, FIRST_STEP = range(9)
STEP_WORDS = 6
# Entries of a step: kind of the value to read, source tuple, index of the item in the tuple, required type,
# number of axes or fields, message for a wrong type.
KIND, SOURCE, ITEM, WHAT, AXES, MESSAGE = range(STEP_WORDS)
INTEGER, UNSIGNED, NUMBER, TRUTH, ARRAY, RECORD = range(6)
NOTHING, AN_INTEGER, A_NUMBER, A_TRUTH, A_TUPLE = range(5)

_NAMES = (
    "PyFloat_AsDouble",
    "PyLong_AsLongLong",
    "PyLong_AsUnsignedLongLongMask",
    "PyObject_IsTrue",
    "PyErr_Occurred",
    "PyErr_SetObject",
    "PyEval_SaveThread",
    "PyEval_RestoreThread",
    "PyFloat_FromDouble",
    "PyLong_FromLongLong",
    "PyBool_FromLong",
    "PyTuple_New",
    "PyTuple_SetItem",
    "Py_IncRef",
)
(
    AS_DOUBLE, AS_INT, AS_UNSIGNED, IS_TRUE, OCCURRED, SET_ERROR, SAVE, RESTORE, FROM_DOUBLE, FROM_INT,
    FROM_BOOL, NEW_TUPLE, SET_ITEM, HOLD, TYPE_ERROR, RUNTIME_ERROR, NONE, ARRAY_TYPE, TUPLE_ITEMS, FAILED,
) = range(20)  # fmt: skip

# Offsets in `PyArrayObject_fields` after the object's header [bytes]: data, number of axes, lengths, dtype,
# flags.
DATA, AXIS_COUNT, LENGTHS, DTYPE, FLAGS = 0, 8, 16, 40, 48
CONTIGUOUS_AND_ALIGNED = 0x0001 | 0x0100
# Mask of the second word of `PyArray_Descr`: kind, letter, byte order and number of the type, without flags.
DTYPE_MASK = -1 ^ 0xFF000000


def _no_python(*_: Any) -> Any:
    """Refuse an interpreted call."""
    raise RuntimeError("only machine code calls this")


_to_double = intrinsic(_emit_call("float64", "int64"))(lambda address, a: _no_python())
_to_word = intrinsic(_emit_call("int64", "int64"))(lambda address, a: _no_python())
_to_flag = intrinsic(_emit_call("int32", "int64"))(lambda address, a: _no_python())
_from_nothing = intrinsic(_emit_call("int64"))(lambda address: _no_python())
_from_double = intrinsic(_emit_call("int64", "float64"))(lambda address, a: _no_python())
_do_one = intrinsic(_emit_call(None, "int64"))(lambda address, a: _no_python())
_do_two = intrinsic(_emit_call(None, "int64", "int64"))(lambda address, a, b: _no_python())
_set_item = intrinsic(_emit_call("int32", "int64", "int64", "int64"))(lambda address, a, b, c: _no_python())


def _emit_stack(typing_context: Any) -> Any:
    """Return signature and writer of the address of a block of 2 `BLOCK_WORDS` words on the stack."""
    from llvmlite import ir
    from numba import types

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        # Numba's `alloca_once` would clear the 12 kB in every call.
        with builder.goto_entry_block():
            block = builder.alloca(ir.ArrayType(ir.IntType(64), 2 * BLOCK_WORDS))
        return builder.ptrtoint(block, ir.IntType(64))

    return types.intp(), generate


_stack = intrinsic(_emit_stack)(_no_python)


@compiled
def _word(address: int) -> int:
    return words_at(address, 1)[0]


@compiled
def _refuse(api: Any, kind: int, message: int) -> int:
    """Set an exception, unless one is set; return 0, the result of a failed call."""
    if _from_nothing(api[OCCURRED]) == 0:
        _do_two(api[SET_ERROR], api[kind], message)
    return 0


@compiled
def _read_array(step: Any, api: Any, item: int, header: int, block: Any, place: int) -> int:
    """Write address and lengths of an array to the block; return the next index, or -1 for a wrong type."""
    if _word(item + header - 8) != api[ARRAY_TYPE]:
        return -1
    base = item + header
    axes = _word(base + AXIS_COUNT) & 0xFFFFFFFF
    flags = _word(base + FLAGS) & CONTIGUOUS_AND_ALIGNED
    if axes != step[AXES] or flags != CONTIGUOUS_AND_ALIGNED:
        return -1
    dtype, wanted = _word(base + DTYPE), step[WHAT]
    # Arrays that were pickled have separate, equal dtypes.
    if dtype != wanted and (_word(dtype + header + 8) ^ _word(wanted + header + 8)) & DTYPE_MASK != 0:
        return -1
    block[place] = _word(base + DATA)
    lengths = words_at(_word(base + LENGTHS), axes)
    for axis in range(axes):
        block[place + 1 + axis] = lengths[axis]
    return place + 1 + axes


@compiled
def _result(plan: Any, api: Any, address: int) -> int:
    """Return a new object with the results at an address."""
    kind = plan[RESULT]
    if kind == AN_INTEGER:
        return _to_word(api[FROM_INT], _word(address))
    if kind == A_NUMBER:
        return _from_double(api[FROM_DOUBLE], floats_at(address, 1)[0])
    if kind == A_TRUTH:
        return _to_word(api[FROM_BOOL], _word(address))
    if kind == A_TUPLE:
        count = plan[RESULTS] & 0xFF
        made = _to_word(api[NEW_TUPLE], count)
        for k in range(count):
            if (plan[RESULTS] >> (8 + k)) & 1:
                part = _from_double(api[FROM_DOUBLE], floats_at(address + 8 * k, 1)[0])
            else:
                part = _to_word(api[FROM_INT], _word(address + 8 * k))
            _set_item(api[SET_ITEM], made, k, part)
        return made
    _do_one(api[HOLD], api[NONE])
    return api[NONE]


@compiled("int64(int64, int64, int64)", by_address=True)
def call_from_python(itself: int, arguments: int, count: int) -> int:
    """Call machine code with the arguments of a Python call, in the form of CPython's METH_FASTCALL."""
    header = 16
    plan = words_at(_word(itself + 16), 1 << 30)
    if plan[HEADER] != 16:  # the plan's own array was read at the wrong offset
        header = plan[HEADER]
    api = words_at(plan[API], 32)
    if count != plan[COUNT]:
        return _refuse(api, TYPE_ERROR, plan[WRONG_COUNT])
    stack = _stack()
    block, sources = words_at(stack, BLOCK_WORDS), words_at(stack + 8 * BLOCK_WORDS, BLOCK_WORDS)
    sources[0], known, place = arguments, 1, 0
    for number in range(plan[STEPS]):
        begin = FIRST_STEP + STEP_WORDS * number
        step = plan[begin : begin + STEP_WORDS]
        item, kind = _word(sources[step[SOURCE]] + 8 * step[ITEM]), step[KIND]
        if kind == ARRAY:
            place = _read_array(step, api, item, header, block, place)
            if place < 0:
                return _refuse(api, TYPE_ERROR, step[MESSAGE])
        elif kind == RECORD:
            if _word(item + header - 8) != step[WHAT]:
                return _refuse(api, TYPE_ERROR, step[MESSAGE])
            sources[known] = item + api[TUPLE_ITEMS]
            known += 1
        elif kind == NUMBER:
            value = _to_double(api[AS_DOUBLE], item)
            if value == -1.0 and _from_nothing(api[OCCURRED]) != 0:
                return 0
            floats_at(stack + 8 * place, 1)[0] = value
            place += 1
        else:
            if kind == TRUTH:
                block[place] = _to_flag(api[IS_TRUE], item)
            elif kind == UNSIGNED:
                block[place] = _to_word(api[AS_UNSIGNED], item)
            else:
                block[place] = _to_word(api[AS_INT], item)
            if block[place] == -1 and _from_nothing(api[OCCURRED]) != 0:
                return 0
            place += 1
    state = _from_nothing(api[SAVE])
    status = _to_word(plan[ENTRY], stack)
    _do_one(api[RESTORE], state)
    if status != 0:
        return _refuse(api, RUNTIME_ERROR, api[FAILED])
    return _result(plan, api, stack)


class _Method(ctypes.Structure):
    """`PyMethodDef`."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_FASTCALL = 0x0080
_kept: list[Any] = []  # objects to which machine code refers, kept until the process ends


@cache
def _api() -> np.ndarray:
    """Addresses of the interpreter's functions and objects."""
    table = np.zeros(32, np.int64)
    for place, name in enumerate(_NAMES):
        table[place] = ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0
    failed = "machine code ran out of memory, or met what it cannot compute"
    _kept.append(failed)
    table[TYPE_ERROR], table[RUNTIME_ERROR], table[NONE] = id(TypeError), id(RuntimeError), id(None)
    table[ARRAY_TYPE], table[TUPLE_ITEMS], table[FAILED] = id(np.ndarray), tuple.__basicsize__, id(failed)
    return table


def builtin_function(function: CompiledFunction, entry: int) -> Callable[..., Any]:
    """Return a function that Python calls like a C function.

    Args:
        function: The compiled function.
        entry: Address of its entry point.
    """
    signature = function.signature
    assert signature is not None
    names = function.python.__code__.co_varnames
    steps = list(_steps(function.__qualname__, names, signature.arguments))
    results = [scalar.name for scalar in signature.result]
    kinds = {"int64": AN_INTEGER, "uint64": AN_INTEGER, "float64": A_NUMBER, "boolean": A_TRUTH}
    kind = A_TUPLE if signature.is_tuple else kinds[results[0]] if results else NOTHING
    packed = len(results) | sum((name == "float64") << (8 + k) for k, name in enumerate(results))
    wrong = f"{function.__qualname__}() takes {len(signature.arguments)} arguments"
    header = object.__basicsize__
    head = [entry, len(signature.arguments), len(steps), kind, id(wrong), _api().ctypes.data, header, packed]
    plan = np.array([*head, *(word for step in steps for word in step[:-1])], np.int64)
    name = function.__qualname__.encode()
    method = _Method(name, call_from_python.address, _FASTCALL, None)
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype, make.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p]
    _kept.append((method, name, plan, wrong, [step[-1] for step in steps]))
    made: Callable[..., Any] = make(ctypes.addressof(method), plan, None)
    return made


def _steps(name: str, names: tuple[str, ...], arguments: tuple[Argument, ...]) -> Iterator[tuple[Any, ...]]:
    """Yield the steps that read arguments, each with the objects to which it refers by address."""
    scalars = {"int64": INTEGER, "uint64": UNSIGNED, "float64": NUMBER, "boolean": TRUTH}
    known = [1]

    def read(argument: Argument, source: int, item: int, path: str) -> Iterator[tuple[Any, ...]]:
        if isinstance(argument, ScalarType):
            message = f"{name}(): {path} must be a {argument.name}"
            yield scalars[argument.name], source, item, 0, 0, id(message), message
        elif isinstance(argument, Array):
            message = (
                f"{name}(): {path} must be a C-contiguous {argument.dtype} array with {argument.ndim} axes"
            )
            keep = (message, argument.dtype)
            yield ARRAY, source, item, id(argument.dtype), argument.ndim, id(message), keep
        else:
            message = f"{name}(): {path} must be a {argument.kind.__name__}"
            yield RECORD, source, item, id(argument.kind), len(argument.fields), id(message), message
            place = known[0]
            known[0] += 1
            for index, (field, kind) in enumerate(argument.fields):
                yield from read(kind, place, index, f"{path}.{field}")

    for index, argument in enumerate(arguments):
        yield from read(argument, 0, index, names[index])
