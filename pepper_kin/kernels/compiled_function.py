"""Decorator `compiled`, which turns Python functions of this library into machine code.

    @compiled
    def _square(x: float) -> float:
        return x * x

    @compiled("float64(float64[::1])")
    def sum_of_squares(x: Floats1) -> float:
        total = 0.0
        for i in range(x.size):
            total += _square(x[i])
        return total

A function with a signature can be called from Python; one without is called by compiled functions only.
Importing a module with compiled functions imports no compiler: on the first call, the machine code of all
functions of the module with signatures is read from the file of the wheel or from the cache folder, or else
made by Numba (`numba_builder`) and LLVM, and kept.  With NUMBA_DISABLE_JIT=1 the source runs interpreted.
With NUMBA_BOUNDSCHECK=1 every index is checked: a wrong one raises RuntimeError, or ends the process if
machine code called the function by its address.
"""

from __future__ import annotations

import ctypes
import hashlib
import marshal
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache, cached_property
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from pepper_kin.kernels.compiler import LOADING, LoadedCode, compile_portable
from pepper_kin.kernels.portable import needed
from pepper_kin.kernels.signatures import FunctionSignature, parse_signature, record_of
from pepper_kin.kernels.sources import file_digest, function_digest
from pepper_kin.kernels.store import find, is_collecting, obtain
from pepper_kin.kernels.target import Target

INTERPRETER = "NUMBA_DISABLE_JIT"
"""Environment variable of Numba: 1 runs compiled functions as Python functions."""

INTERPRETED = os.environ.get(INTERPRETER, "0") not in ("", "0")
"""Whether compiled functions run as Python: for debugging, and for a first result without machine code."""

BOUNDS_CHECKED = os.environ.get("NUMBA_BOUNDSCHECK", "0") not in ("", "0")
"""Whether machine code checks every index: different, slower code under different keys, made by Numba."""

_PACKAGES = ("pepper_kin",)


class CompiledFunction:
    """A function that runs as machine code.

    Attributes:
        python: The Python function.
        signature: Types of its result and arguments; None for a function that only compiled functions call.
        by_address: Whether `address` is the address of a C function with the same scalar arguments.
        lean: Whether the function makes and returns no arrays, so that references need not be counted.
        inline: Whether the function is always inlined into its callers.
        vector: Whether sums may be reordered, since no operand is infinite or NaN.
        symbol: Name of the function in the object file.
        unit: Unit whose object file has the function.
    """

    def __init__(
        self,
        function: FunctionType,
        text: str | None,
        *,
        by_address: bool,
        lean: bool,
        inline: bool,
        vector: bool,
    ) -> None:
        self.python = function
        self.text = text
        self.by_address, self.lean, self.inline, self.vector = by_address, lean, inline, vector
        self.symbol = f"{function.__module__}.{function.__qualname__}".replace(".", "_")
        self.__doc__, self.__name__, self.__module__ = (
            function.__doc__,
            function.__name__,
            function.__module__,
        )
        self.__qualname__, self.__wrapped__ = function.__qualname__, function
        self.unit = unit_of(function.__module__)
        self._signature: FunctionSignature | None = None
        self._direct: Any = None
        self._dispatcher: Any = None
        self._call: Callable[..., Any] = function if INTERPRETED or text is None else self._first_call

    def __call__(self, *arguments: Any) -> Any:
        """Run the function."""
        return self._call(*arguments)

    @property
    def signature(self) -> FunctionSignature | None:
        """Types of result and arguments."""
        if self._signature is None and self.text is not None:
            self._signature = parse_signature(self.text, self.python.__globals__)
        return self._signature

    @cached_property
    def native(self) -> Callable[..., Any]:
        """Callable of the machine code, the fastest way to call it from Python."""
        if self._call == self._first_call:
            self.load()
        return self._call

    @property
    def address(self) -> int:
        """Address of a C function that takes the scalars of the signature; valid as long as the process."""
        if self._direct is None:
            if INTERPRETED:
                self._direct = _callback(self)
            else:
                self._direct = self.unit.load().address(self.symbol + "_direct")
        if isinstance(self._direct, int):
            return self._direct
        return int(ctypes.cast(self._direct, ctypes.c_void_p).value or 0)

    @property
    def _numba_type_(self) -> Any:
        """Numba's type of this object, where a compiled function calls it."""
        from numba import types

        return types.Dispatcher(self.dispatcher)

    @property
    def dispatcher(self) -> Any:
        """Numba's dispatcher of the function, made on first use."""
        if self._dispatcher is None:
            from pepper_kin.kernels.numba_builder import make_dispatcher

            self._dispatcher = make_dispatcher(self)
        return self._dispatcher

    def load(self) -> None:
        """Load or make the machine code."""
        from pepper_kin.kernels.calling import builtin_function

        code = self.unit.load()
        assert self.signature is not None
        self._call = builtin_function(self, code.address(self.symbol))

    def _first_call(self, *arguments: Any) -> Any:
        self.load()
        return self._call(*arguments)

    def __reduce__(self) -> str:
        return self.__qualname__

    def __repr__(self) -> str:
        """Name and signature."""
        return f"<compiled {self.__module__}.{self.__qualname__} {self.text or ''}>"


def compiled(
    function: Any = None,
    /,
    *,
    by_address: bool = False,
    lean: bool = False,
    inline: bool = False,
    vector: bool = False,
) -> Any:
    """Decorate a function that runs as machine code.

    Args:
        function: The function, or its signature as text (see `signatures`).
        by_address: Whether it is also offered as a C function; all arguments must be scalars (arrays as
            addresses).
        lean: Whether it makes no arrays, returns none and assigns no slices: references to arrays are then
            not counted.
        inline: Whether it is always inlined into its callers.
        vector: Whether products and sums may be contracted, since no operand is infinite or NaN.
    """

    def decorate(python: FunctionType) -> CompiledFunction:
        text = function if isinstance(function, str) else None
        made = CompiledFunction(python, text, by_address=by_address, lean=lean, inline=inline, vector=vector)
        if text is not None:
            if made.unit.is_loaded or made.symbol in made.unit.symbols:
                # Code that has been loaded does not have a function that is defined later.
                made.unit = _units[python.__module__] = Unit(python.__module__)
            made.unit.functions.append(made)
        return made

    if function is None or isinstance(function, str):
        return decorate
    return decorate(function)


class Unit:
    """Functions of a module with signatures, whose machine code is one object file.

    Functions that are defined after the first call, as in a notebook, belong to another unit.
    """

    def __init__(self, module: str) -> None:
        self.module = module
        self.functions: list[CompiledFunction] = []
        self._code: LoadedCode | None = None

    def key(self) -> str:
        """Hash of all inputs of the machine code: sources, constants, signatures, the builder."""
        lines = {f"entry {f.symbol} {f.signature} {f.by_address}" for f in self.functions}
        for own in self.reached().values():
            lines |= own
        return hashlib.sha256(
            "\n".join([builder_digest(), _back_end_digest(), *sorted(lines)]).encode()
        ).hexdigest()

    def reached(self) -> dict[str, set[str]]:
        """Return the ingredients of the functions with signatures, and of their callees, by symbol."""
        reached: dict[str, set[str]] = {}
        waiting = list(self.functions)
        while waiting:
            function = waiting.pop()
            if function.symbol not in reached:
                reached[function.symbol], called = ingredients(function)
                waiting += called
        return reached

    def load(self) -> LoadedCode:
        """Return the machine code, loaded or made."""
        with LOADING:
            if self._code is None:
                key = self.key()
                part = None if is_collecting() else find(self.module, key)
                if part is None:
                    from pepper_kin.kernels.warm_up import wait_for

                    wait_for(self)
                    part = obtain(self.module, key, self.build)
                self._code = LoadedCode(part.content, part.target)
            return self._code

    def build(self, target: Target) -> bytes:
        """Return new object code."""
        from pepper_kin.kernels.numba_builder import portable_parts

        made = portable_parts(self.functions)
        parts = [made[symbol].bitcode for symbol in needed(self.symbols, made.__getitem__)]
        return compile_portable(parts, target, self.symbols)

    @property
    def is_loaded(self) -> bool:
        """Whether the machine code is loaded."""
        return self._code is not None

    @property
    def symbols(self) -> list[str]:
        """Names of the entry points in the object file."""
        return [function.symbol for function in self.functions]


_units: dict[str, Unit] = {}


def unit_of(module: str) -> Unit:
    """Return the unit of a module, the last one if there are several."""
    if module not in _units:
        _units[module] = Unit(module)
    return _units[module]


def units() -> list[Unit]:
    """Return the units of all modules imported so far, by name."""
    return [_units[name] for name in sorted(_units) if _units[name].functions]


def ingredients(function: CompiledFunction) -> tuple[set[str], list[CompiledFunction]]:
    """Return the inputs of a function's code, as lines of text, and the compiled functions it calls.

    The lines do not contain the sources of the called functions.
    """
    python = function.python
    lines = {
        f"source {python.__module__}.{python.__qualname__} {_source_digest(python)} {python.__defaults__}",
        f"options {function.symbol} {function.lean} {function.inline} {function.vector}",
    }
    called = []
    for place, value in _named_values(python):
        if isinstance(value, CompiledFunction):
            called.append(value)
            lines.add(f"calls {place} {value.symbol}")
        elif isinstance(value, FunctionType) and value.__module__.startswith(_PACKAGES):
            lines.add(f"source {value.__module__}.{value.__qualname__} {_source_digest(value)}")
        else:
            described = _described(value)
            if described is not None:
                lines.add(f"value {place} {described}")
    return lines, called


def _named_values(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the globals in a function's code, and of attributes of our modules."""
    names: set[str] = set()
    codes: list[CodeType] = [function.__code__]
    while codes:
        code = codes.pop()
        names.update(code.co_names)
        codes.extend(constant for constant in code.co_consts if isinstance(constant, CodeType))
    for name in sorted(names):
        if name not in function.__globals__:
            continue
        value = function.__globals__[name]
        if isinstance(value, ModuleType) and value.__name__.startswith(_PACKAGES):
            yield name, None
            for attribute in sorted(names):
                if hasattr(value, attribute):
                    yield f"{value.__name__}.{attribute}", getattr(value, attribute)
        else:
            yield f"{function.__module__}.{name}", value
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield f"{function.__module__}.{function.__qualname__}.{name}", cell.cell_contents


def _described(value: object) -> str | None:
    """Return a text that changes with a constant's value; None for a value without effect on machine code."""
    if value is None or isinstance(value, (bool, int, float, str, tuple, np.number)):
        return repr(value)
    if isinstance(value, np.ndarray):
        return hashlib.sha256(repr((value.shape, value.dtype.str)).encode() + value.tobytes()).hexdigest()
    if isinstance(value, type) and hasattr(value, "_fields"):
        return repr(record_of(value)) if _is_record(value) else repr(value._fields)
    described = getattr(value, "described", None)
    return described if isinstance(described, str) else None


def _is_record(kind: type) -> bool:
    """Return whether a class is a NamedTuple that compiled functions can take."""
    try:
        record_of(kind)
    except TypeError:
        return False
    return True


def _source_digest(function: FunctionType) -> str:
    """Return a hash of a function's source, or of its code without a source file, as in a notebook."""
    path = getattr(sys.modules.get(function.__module__), "__file__", None)
    if path and Path(path).is_file():
        return function_digest(str(path), function.__qualname__)
    return hashlib.sha256(marshal.dumps(function.__code__)).hexdigest()


def runtime_path() -> Path:
    """Return the path of the IR file that replaces Numba's run time."""
    return Path(__file__).with_name("data") / "runtime.ll"


@cache
def builder_digest() -> str:
    """Return a hash of the source files here that determine portable code."""
    names = ["numba_builder", "compiled_function", "signatures", "intrinsics", "lanes", "records"]
    names += ["tables", "calling"]
    runtime = hashlib.sha256(runtime_path().read_bytes().replace(b"\r\n", b"\n")).hexdigest()
    return f"{_digest_of(names)} {runtime}" + " bounds checked" * BOUNDS_CHECKED


def _back_end_digest() -> str:
    """Return a hash of the source files here that determine machine code, given portable code."""
    return _digest_of(("compiler", "target"))


def _digest_of(names: Sequence[str]) -> str:
    here = Path(__file__).parent
    return " ".join(file_digest(str(here / f"{name}.py")) for name in names)


def _callback(function: CompiledFunction) -> Any:
    """Return a C function that calls the Python function, for interpreted runs."""
    assert function.signature is not None
    kinds = {"float64": ctypes.c_double}
    scalars = [kinds.get(a.name, ctypes.c_int64) for a in function.signature.arguments]  # type: ignore[union-attr]
    result = function.signature.result
    returned = kinds.get(result[0].name, ctypes.c_int64) if result else None
    return ctypes.CFUNCTYPE(returned, *scalars)(function.python)
