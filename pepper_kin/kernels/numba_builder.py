"""Portable code of compiled functions: LLVM IR, made by Numba's front end.

Each function becomes one part for each list of argument types with which it is called, and each function
with a signature a C entry point as well.  The parts need only the C library: memory of arrays made inside
comes from `malloc` (`runtime.ll` in place of Numba's run time), and an exception becomes a status.
Parts are cached by the hash of the function's own inputs: after an edit Numba compiles only the edited
function, and callers for which the type of its result has changed.  `compiler.compile_portable` links parts
and compiles them to machine code.

This file depends on Numba's private classes: the compiler's libraries, its interface of caches, and the
description of a compiled function for its callers.
"""

from __future__ import annotations

import contextlib
import gc
import hashlib
import importlib
import pickle
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import reduce
from typing import TYPE_CHECKING, Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import _dynfunc, njit, types  # type: ignore[attr-defined]
from numba.core import cgutils, codegen, compiler, funcdesc, targetconfig, typing
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from pepper_kin.kernels.compiled_function import BOUNDS_CHECKED, builder_digest, ingredients, runtime_path
from pepper_kin.kernels.compiler import target_machine
from pepper_kin.kernels.portable import PortablePart, needed
from pepper_kin.kernels.signatures import Argument, Array, RecordType, ScalarType
from pepper_kin.kernels.store import read_part, write_part
from pepper_kin.kernels.target import made_by, portable_target

if TYPE_CHECKING:
    from pepper_kin.kernels.compiled_function import CompiledFunction


class _Library(codegen.JITCodeLibrary):
    """Functions of the front end without optimization; they are linked and optimized as part of a unit."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        """Skip linking, which makes copies."""
        self._finalized = True


def numba_type(argument: Argument) -> Any:
    """Return Numba's type of an argument."""
    if isinstance(argument, ScalarType):
        return getattr(types, argument.name)
    if isinstance(argument, Array):
        names = {"bool": "boolean"}
        scalar = getattr(types, names.get(argument.dtype.name, argument.dtype.name))
        return types.Array(scalar, argument.ndim, "C")
    return types.NamedTuple([numba_type(kind) for _, kind in argument.fields], argument.kind)


def make_dispatcher(function: CompiledFunction) -> Any:
    """Return Numba's dispatcher of a function, for functions that call it."""
    options: dict[str, Any] = {
        "nogil": True,
        "error_model": "numpy",
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "forceinline": function.inline,
    }
    # Counting references to every array and slice takes a third of the time of a step of inverse kinematics.
    options["_nrt"] = not function.lean
    if function.vector:
        options["fastmath"] = {"nsz", "contract", "arcp", "nnan", "ninf"}
    dispatcher = njit(**options)(function.python)
    dispatcher._cache = _Cache(function)
    template_for = dispatcher.get_call_template

    def any_value(arguments: Sequence[Any], named: Mapping[str, Any]) -> Any:
        """Compile for argument types; without this, Numba compiles a constant argument for its value."""
        plain = {name: types.unliteral(kind) for name, kind in named.items()}
        return template_for(tuple(map(types.unliteral, arguments)), plain)

    dispatcher.get_call_template = any_value
    return dispatcher


@global_compiler_lock
def portable_parts(functions: Sequence[CompiledFunction]) -> dict[str, PortablePart]:
    """Return the parts of functions with signatures, and of all functions that they call, by symbol."""
    with _front_end() as context, _no_collection():
        for function in functions:
            signature = function.signature
            assert signature is not None
            arguments = tuple(numba_type(argument) for argument in signature.arguments)
            dispatcher = function.dispatcher
            dispatcher.compile(arguments)
            result = dispatcher.overloads[arguments]
            module = _entry_module(function, context, result.fndesc, result.signature.return_type)
            text = cgutils.normalize_ir_text(str(module))
            names = {function.symbol, function.symbol + "_direct"}
            bitcode = _stored(llvm.parse_assembly(text), names, {})
            needs = _symbols[result.library], _add_runtime()
            _parts[function.symbol] = PortablePart("", needs, bitcode, b"")
    symbols = needed([function.symbol for function in functions], _parts.__getitem__)
    return {symbol: _parts[symbol] for symbol in symbols}


@contextlib.contextmanager
def _front_end() -> Iterator[Any]:
    """Make Numba use `_Library`, without loading or running code, within a `with` block."""
    context = cpu_target.target_context
    generator = context.codegen()
    functions: Any = types.BaseFunction
    usual, search = generator._library_class, functions.get_call_type
    generator._library_class = _Library
    generator.set_env = lambda name, environment: None

    def known(operation: Any, typing_context: Any, arguments: Sequence[Any], named: Mapping[str, Any]) -> Any:
        """Return a cached resolution, since Numba tries all definitions of an operator each time."""
        key = operation, tuple(arguments), tuple(named.items()), targetconfig.ConfigStack.top_or_none()
        if key not in _signatures:
            signature = search(operation, typing_context, arguments, named)
            _signatures[key] = signature, operation._impl_keys[signature.args]
        signature, operation._impl_keys[signature.args] = _signatures[key]
        return signature

    functions.get_call_type = known
    try:
        yield context
    finally:
        functions.get_call_type = search
        generator._library_class = usual
        del generator.set_env


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Disable garbage collection within a `with` block: it takes a tenth of Numba's time."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


_parts: dict[str, PortablePart] = {}
"""All parts made or read in this process, by symbol."""

_symbols: dict[Any, str] = {}
"""Symbol of the function of each Numba library."""

_signatures: dict[Any, Any] = {}
"""Resolved calls of Numba's own functions: types of arguments and result, and the definition."""

_functions: dict[Any, tuple[CompiledFunction, tuple[Any, ...]]] = {}
"""Compiled function of this package, and its argument types, by Numba library."""


class _Cache:
    """Cache of the parts of one function, with Numba's interface."""

    def __init__(self, function: CompiledFunction) -> None:
        self._function = function

    def load_overload(self, types_of_arguments: Any, context: Any) -> Any:
        """Return the result of an earlier compilation, or None."""
        arguments = tuple(types_of_arguments)
        symbol = self._symbol(arguments)
        part = self._found(symbol)
        if part is None:
            return None
        try:
            returned, called = pickle.loads(part.types)
        except (ImportError, AttributeError):  # a record among the types has moved to another module
            return None
        libraries = []
        for module, name, kinds, kind in called:
            callee = reduce(getattr, name.split("."), importlib.import_module(module))
            callee.dispatcher.compile(kinds)
            compiled = callee.dispatcher.overloads[kinds]
            if compiled.signature.return_type != kind:
                return None
            libraries.append(compiled.library)
        if not all(_find_shared(name) for name in part.needs if name.startswith(_SHARED)):
            return None
        _parts[symbol] = part
        library = _Library(context.codegen(), symbol)
        library._linking_libraries = libraries
        library._finalized = True
        self._note(library, symbol, arguments)
        described = self._described(symbol, arguments, returned)
        environment = _dynfunc.Environment(globals=self._function.python.__globals__)
        entry = _dynfunc.make_function(
            described.lookup_module(), described.qualname, "", 0, environment, (library,)
        )
        return compiler.compile_result(
            typing_context=context.typing_context,
            target_context=context,
            signature=typing.templates.signature(returned, *arguments),
            library=library,
            fndesc=described,
            environment=environment,
            entry_point=entry,
            type_annotation="",
            objectmode=False,
            lifted=(),
        )

    def save_overload(self, types_of_arguments: Any, result: Any) -> None:
        """Make a part of a compilation, and keep it."""
        arguments, library = tuple(types_of_arguments), result.library
        symbol = self._symbol(arguments)
        self._note(library, symbol, arguments)
        # The same name in each process, for parts that refer to it; callers have not been written yet.
        library._final_module.get_function(result.fndesc.mangled_name).name = symbol
        result.fndesc.mangled_name = symbol
        called, needs, renamed = [], [], {}
        for child in dict.fromkeys(library._linking_libraries):
            if child in _functions:
                callee, kinds = _functions[child]
                kind = callee.dispatcher.overloads[kinds].signature.return_type
                called.append((callee.__module__, callee.__qualname__, kinds, kind))
            else:
                renamed.update(_share(child))
            needs.append(_symbols[child])
        bitcode = _stored(library._final_module.clone(), {symbol}, renamed)
        known = pickle.dumps((result.signature.return_type, called), protocol=4)
        part = PortablePart(self._key(symbol), tuple(needs), bitcode, known)
        _parts[symbol] = part
        if self._can_be_kept:
            _keep(symbol, part)

    def _symbol(self, arguments: tuple[Any, ...]) -> str:
        name = f"{self._function.symbol}.{_digest(repr(arguments))}"
        return name if self._can_be_kept else f"{name}.{id(self._function)}"

    @property
    def _can_be_kept(self) -> bool:
        """Whether other processes can find the function by its name."""
        return "<locals>" not in self._function.__qualname__

    def _key(self, symbol: str) -> str:
        lines, _ = ingredients(self._function)
        return _digest("\n".join([builder_digest(), symbol, *sorted(lines)]))

    def _found(self, symbol: str) -> PortablePart | None:
        key = self._key(symbol)
        return _kept(symbol, key) if self._can_be_kept else None

    def _note(self, library: Any, symbol: str, arguments: tuple[Any, ...]) -> None:
        _symbols[library], _functions[library] = symbol, (self._function, arguments)

    def _described(self, symbol: str, arguments: tuple[Any, ...], returned: Any) -> Any:
        """Return Numba's description of the function for its callers."""
        python = self._function.python
        code = python.__code__
        return funcdesc.PythonFunctionDescriptor(
            native=True,
            modname=python.__module__,
            qualname=python.__qualname__,
            unique_name=symbol,
            doc="",
            typemap=None,
            restype=returned,
            calltypes=None,
            args=code.co_varnames[: code.co_argcount],
            kws=(),
            mangler=lambda *_, **__: symbol,
            argtypes=arguments,
            inline=self._function.inline,
        )


_SHARED = "numba."
"""Prefix of the symbols of Numba's own functions; the rest is a hash of the code."""


def _share(library: Any) -> dict[str, str]:
    """Make parts of a Numba function and of its callees; return the new name by the old."""
    if library not in _symbols:
        renamed: dict[str, str] = {}
        needs = []
        for child in dict.fromkeys(library._linking_libraries):
            if child not in _functions:
                renamed.update(_share(child))
            needs.append(_symbols[child])
        module = library._final_module.clone()
        defined = [
            f.name
            for f in module.functions
            if not f.is_declaration and not f.name.startswith(("cfunc.", "__excinfo"))
        ]
        if len(defined) == 1:
            module.get_function(defined[0]).name = _SHARED
            bitcode = _stored(module, {_SHARED}, renamed)
            symbol = f"{_SHARED}{hashlib.sha256(bitcode + repr(needs).encode()).hexdigest()[:16]}"
            module = llvm.parse_bitcode(bitcode)
            module.get_function(_SHARED).name = symbol
            bitcode = bytes(module.as_bitcode())
            _new_names[library] = {defined[0]: symbol}
        else:  # the functions that count references
            symbol, bitcode = f"{_SHARED}{library.name}", _stored(module, set(defined), renamed)
            _new_names[library] = {}
        _symbols[library] = symbol
        _parts[symbol] = PortablePart("", tuple(needs), bitcode, b"")
        _keep(symbol, _parts[symbol])
    return _new_names[library]


_new_names: dict[Any, dict[str, str]] = {}


def _find_shared(symbol: str) -> bool:
    """Read the part of a Numba function and the parts it needs; return whether all were found."""
    if symbol not in _parts:
        found = _kept(symbol, "")
        if found is None or not all(map(_find_shared, found.needs)):
            return False
        _parts[symbol] = found
    return True


def _add_runtime() -> str:
    """Add the part that replaces Numba's run time; return its symbol."""
    symbol = _SHARED + "runtime"
    if symbol not in _parts:
        module = llvm.parse_assembly(runtime_path().read_text(encoding="ascii"))
        names = {function.name for function in module.functions if not function.is_declaration}
        _parts[symbol] = PortablePart("", (), _stored(module, names, {}), b"")
    return symbol


def _keep(symbol: str, part: PortablePart) -> None:
    """Keep a part in the cache folder."""
    write_part(_digest(f"portable {symbol} {part.key} {made_by()}"), pickle.dumps(tuple(part), protocol=4))


def _kept(symbol: str, key: str) -> PortablePart | None:
    """Return a part from the cache folder, or None."""
    content = read_part(_digest(f"portable {symbol} {key} {made_by()}"))
    return None if content is None else PortablePart(*pickle.loads(content))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _stored(module: Any, symbols: set[str], renamed: Mapping[str, str]) -> bytes:
    """Return the bitcode of a module that exports some symbols and calls functions by their new names."""
    for function in list(module.functions):
        if function.is_declaration and function.name in _EXCEPTIONS:
            head = re.search(rf"declare (?:noundef )?(\w+) (@{function.name}\([^)]*\))", str(function))
            assert head is not None, str(function)
            body = "{\n  call void @abort()\n  unreachable\n}"
            module.link_in(llvm.parse_assembly(f"declare void @abort()\ndefine {head[1]} {head[2]} {body}"))
    module = _without_origin(module)
    for function in module.functions:
        if function.name in renamed:
            function.name = renamed[function.name]
        elif not function.is_declaration:
            function.linkage = "external" if function.name in symbols else "internal"
    for count, variable in enumerate(module.global_variables):
        if not variable.is_declaration:
            variable.linkage, variable.name = "internal", f"value{count}"  # names hold addresses
    module.name, target = "part", portable_target()
    module.triple = target.triple
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.add_sroa_pass()
    passes.add_simplify_cfg_pass()
    passes.add_instruction_combine_pass()
    passes.add_simplify_cfg_pass()
    passes.add_strip_symbols_pass()  # names are a third of the file, and differ from run to run
    passes.add_strip_dead_prototype_pass()
    builder = llvm.create_pass_builder(
        target_machine(target), llvm.create_pipeline_tuning_options(speed_level=1)
    )
    passes.run(module, builder)
    module.verify()
    return bytes(module.as_bitcode())


def _without_origin(module: Any) -> Any:
    """Return a module without addresses and exception data, which hold paths and counters of the process.

    Nothing reads the exception data, since an exception becomes a status; but the order of parts, and so the
    bytes of linked code, depends on hashes of the modules.
    """
    text = re.sub(r"inttoptr \(i64 \d+ to ptr\)", "null", str(module))
    text = re.sub(rf"constant {re.escape(_EXCEPTION)} .*", f"constant {_EXCEPTION} zeroinitializer", text)
    text = re.sub(r'constant \[\d+ x i8\] c"missing Env.*', "constant [1 x i8] zeroinitializer", text)
    return llvm.parse_assembly(text)


def _entry_module(function: CompiledFunction, context: Any, fndesc: Any, returned: Any) -> Any:
    """Return a module with `int64 entry(int64* block)`; see `CompiledFunction`."""
    signature = function.signature
    assert signature is not None
    word = ir.IntType(64)
    module = context.create_module(f"entry.{function.symbol}")
    kind = context.call_conv.get_function_type(fndesc.restype, fndesc.argtypes)
    callee = ir.Function(module, kind, fndesc.llvm_func_name)
    entry = ir.Function(module, ir.FunctionType(word, [word.as_pointer()]), function.symbol)
    builder = ir.IRBuilder(entry.append_basic_block("entry"))
    reader = BlockReader(context, builder, entry.args[0])
    values = [
        reader.read(argument, kind)
        for argument, kind in zip(signature.arguments, fndesc.argtypes, strict=True)
    ]
    status, out = context.call_conv.call_function(builder, callee, fndesc.restype, fndesc.argtypes, values)
    with builder.if_then(status.is_error, likely=False):
        builder.ret(builder.select(status.is_python_exc, word(1), word(2)))
    results = signature.result
    for index, scalar in enumerate(results):
        value = builder.extract_value(out, index) if signature.is_tuple else out
        reader.write(index, scalar, value)
    builder.ret(word(0))
    if function.by_address:
        _add_direct(function, context, module, callee, fndesc)
    return module


def _add_direct(function: CompiledFunction, context: Any, module: Any, callee: Any, fndesc: Any) -> None:
    """Add a C function of scalar arguments under the symbol with `_direct`."""
    signature = function.signature
    assert signature is not None
    scalars = [argument for argument in signature.arguments if isinstance(argument, ScalarType)]
    word = ir.IntType(64)
    kinds = {"float64": ir.DoubleType()}
    kinds_of_scalars = [kinds.get(a.name, word) for a in scalars]
    result = signature.result
    returned = kinds.get(result[0].name, word) if result else ir.VoidType()
    direct = ir.Function(module, ir.FunctionType(returned, kinds_of_scalars), function.symbol + "_direct")
    builder = ir.IRBuilder(direct.append_basic_block("entry"))
    values = [
        builder.trunc(value, ir.IntType(1)) if argument.name == "boolean" else value
        for value, argument in zip(direct.args, scalars, strict=True)
    ]
    status, out = context.call_conv.call_function(builder, callee, fndesc.restype, fndesc.argtypes, values)
    if BOUNDS_CHECKED:  # C callers check no errors: the process ends here, not somewhere else later
        abort = cgutils.get_or_insert_function(module, ir.FunctionType(ir.VoidType(), []), "abort")
        with builder.if_then(status.is_error, likely=False):
            builder.call(abort, [])
    if not result:
        builder.ret_void()
    else:
        builder.ret(builder.zext(out, word) if result[0].name == "boolean" else out)


class BlockReader:
    """Reader of arguments from, and writer of results to, a block of 64-bit words."""

    def __init__(self, context: Any, builder: Any, block: Any) -> None:
        self._context, self._builder, self._block, self._place = context, builder, block, 0

    def _word(self) -> Any:
        place = self._builder.gep(self._block, [ir.IntType(64)(self._place)])
        self._place += 1
        return place

    def read(self, argument: Argument, kind: Any) -> Any:
        """Return the next argument as a Numba value."""
        builder, context = self._builder, self._context
        if isinstance(argument, RecordType):
            parts = [
                self.read(field, part) for (_, field), part in zip(argument.fields, kind.types, strict=True)
            ]
            return context.make_tuple(builder, kind, parts)
        if isinstance(argument, ScalarType):
            if argument.name == "float64":
                return builder.load(builder.bitcast(self._word(), ir.DoubleType().as_pointer()))
            value = builder.load(self._word())
            return builder.trunc(value, ir.IntType(1)) if argument.name == "boolean" else value
        address = builder.load(self._word())
        shape = [builder.load(self._word()) for _ in range(argument.ndim)]
        item = argument.dtype.itemsize
        strides: list[Any] = []
        stride = ir.IntType(64)(item)
        for size in reversed(shape):
            strides.insert(0, stride)
            stride = builder.mul(stride, size)
        array = context.make_array(kind)(context, builder)
        data = builder.inttoptr(address, context.get_data_type(kind.dtype).as_pointer())
        pack = cgutils.pack_array
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        array.parent = cgutils.get_null_value(array.parent.type)
        count = ir.IntType(64)(1)
        for size in shape:
            count = builder.mul(count, size)
        array.nitems = count
        array.itemsize = ir.IntType(64)(item)
        array.data = data
        array.shape = pack(builder, shape)
        array.strides = pack(builder, strides)
        return array._getvalue()

    def write(self, index: int, scalar: ScalarType, value: Any) -> None:
        """Store a result in the first words of the block."""
        builder = self._builder
        place = builder.gep(self._block, [ir.IntType(64)(index)])
        if scalar.name == "float64":
            builder.store(value, builder.bitcast(place, ir.DoubleType().as_pointer()))
        else:
            builder.store(builder.zext(value, ir.IntType(64)) if scalar.name == "boolean" else value, place)


_EXCEPTION = "{ ptr, i32, ptr, ptr, i32 }"
"""LLVM type of an exception: pickled data, size, hash, and function that unpacks its arguments."""

# Python functions that unpack the arguments of Numba's exceptions (slices of different lengths).  They are
# not needed here: an exception becomes a status.
_EXCEPTIONS = frozenset(["PyErr_SetString", "PyUnicode_FromKindAndData", "PyObject_Hash", "PyTuple_Pack"])
