"""Portable code of compiled functions: LLVM IR, made by Numba's front end.

All functions with a signature become C entry points of one module that needs nothing but the C library:
memory that arrays made inside need is taken by `malloc` (`_RUNTIME`, in place of Numba's run time), and an
exception becomes a status.  The functions are simplified once, all together, not one after the other as
Numba does; nothing of that depends on the processor.  `compiler.compile_portable` makes machine code of it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils, codegen
from numba.core.compiler_lock import global_compiler_lock

from pepper_kin.kernels.compiled_function import BOUNDS_CHECKED
from pepper_kin.kernels.compiler import keep_entries, target_machine
from pepper_kin.kernels.signatures import Argument, Array, Record, Scalar
from pepper_kin.kernels.target import portable_target

if TYPE_CHECKING:
    from pepper_kin.kernels.compiled_function import CompiledFunction

_RUNTIME = """
declare i8* @malloc(i64)
declare i8* @aligned_alloc(i64, i64)
declare void @free(i8*)

define linkonce_odr i8* @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %more = add i64 %size, 191
  %rounded = and i64 %more, -64
  %info = call i8* @aligned_alloc(i64 64, i64 %rounded)
  %none = icmp eq i8* %info, null
  br i1 %none, label %out, label %fill
fill:
  %words = bitcast i8* %info to i64*
  store i64 1, i64* %words
  %data = getelementptr i8, i8* %info, i64 64
  %places = bitcast i8* %info to i8**
  %dtor = getelementptr i8*, i8** %places, i64 1
  store i8* null, i8** %dtor
  %third = getelementptr i8*, i8** %places, i64 3
  store i8* %data, i8** %third
  %fourth = getelementptr i64, i64* %words, i64 4
  store i64 %size, i64* %fourth
  ret i8* %info
out:
  ret i8* null
}
define linkonce_odr i8* @NRT_MemInfo_alloc_safe_aligned(i64 %size, i32 %align) {
  %info = call i8* @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align)
  ret i8* %info
}
define linkonce_odr i8* @NRT_MemInfo_alloc(i64 %size) {
  %info = call i8* @NRT_MemInfo_alloc_aligned(i64 %size, i32 64)
  ret i8* %info
}
define linkonce_odr i8* @NRT_Allocate(i64 %size) {
  %memory = call i8* @malloc(i64 %size)
  ret i8* %memory
}
define linkonce_odr void @NRT_Free(i8* %memory) {
  call void @free(i8* %memory)
  ret void
}
define linkonce_odr void @NRT_MemInfo_call_dtor(i8* %info) {
  call void @free(i8* %info)
  ret void
}
define linkonce_odr i64 @pk_contiguous(i64 %n, i64* %dims, i64* %strides, i64 %item, i1 %write) {
entry:
  br label %test
test:
  %i = phi i64 [ %n, %entry ], [ %k, %next ]
  %stride = phi i64 [ %item, %entry ], [ %longer, %next ]
  %more = icmp sgt i64 %i, 0
  br i1 %more, label %body, label %good
body:
  %k = sub i64 %i, 1
  %place = getelementptr i64, i64* %strides, i64 %k
  br i1 %write, label %store, label %compare
store:
  store i64 %stride, i64* %place
  br label %next
compare:
  %is = load i64, i64* %place
  %same = icmp eq i64 %is, %stride
  br i1 %same, label %next, label %bad
next:
  %length = getelementptr i64, i64* %dims, i64 %k
  %size = load i64, i64* %length
  %longer = mul i64 %stride, %size
  br label %test
good:
  ret i64 1
bad:
  ret i64 0
}
define linkonce_odr i32 @numba_attempt_nocopy_reshape(i64 %n, i64* %dims, i64* %strides, i64 %newn, i64*
%newdims,
                                                      i64* %newstrides, i64 %item, i32 %order) {
  %fine = call i64 @pk_contiguous(i64 %n, i64* %dims, i64* %strides, i64 %item, i1 0)
  %isfine = icmp eq i64 %fine, 1
  br i1 %isfine, label %write, label %out
write:
  %done = call i64 @pk_contiguous(i64 %newn, i64* %newdims, i64* %newstrides, i64 %item, i1 1)
  ret i32 1
out:
  ret i32 0
}
"""


class _LinkedLibrary(codegen.JITCodeLibrary):
    """Functions that are linked and not optimized: that is done once, for the whole unit."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None: ...

    def _finalize_final_module(self) -> None:
        self._finalized = True


def numba_type(argument: Argument) -> Any:
    """Return Numba's type of an argument."""
    if isinstance(argument, Scalar):
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
    return njit(**options)(function.python)


@global_compiler_lock
def portable_ir(functions: Sequence[CompiledFunction]) -> bytes:
    """Return the bitcode of functions with signatures; what several of them call is in it once."""
    from numba.core.registry import cpu_target

    context = cpu_target.target_context
    generator = context.codegen()
    usual = generator._library_class
    generator._library_class = _LinkedLibrary
    generator.set_env = lambda name, environment: None  # nothing is run here
    try:
        library = generator.create_library("unit")
        for function in functions:
            _add_entry(function, context, library)
        module = _linked(library)
    finally:
        generator._library_class = usual
        del generator.set_env
    return _simplified(module, [f.symbol for f in functions])


def _add_entry(function: CompiledFunction, context: Any, library: Any) -> None:
    """Compile a function and add its entry point to a library."""
    signature = function.signature
    assert signature is not None
    arguments = tuple(numba_type(argument) for argument in signature.arguments)
    dispatcher = function.dispatcher
    dispatcher.compile(arguments)
    result = dispatcher.overloads[arguments]
    library.add_linking_library(result.library)
    library.add_ir_module(_entry_module(function, context, result.fndesc, result.signature.return_type))


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
    reader = _BlockReader(context, builder, entry.args[0])
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
    """Add a function that takes its scalars as a C function does, under the symbol with `_direct`."""
    signature = function.signature
    assert signature is not None
    scalars = [argument for argument in signature.arguments if isinstance(argument, Scalar)]
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
    if BOUNDS_CHECKED:  # C callers check for no errors: the process ends here, not somewhere else later
        abort = cgutils.get_or_insert_function(module, ir.FunctionType(ir.VoidType(), []), "abort")
        with builder.if_then(status.is_error, likely=False):
            builder.call(abort, [])
    if not result:
        builder.ret_void()
    else:
        builder.ret(builder.zext(out, word) if result[0].name == "boolean" else out)


class _BlockReader:
    """Arguments from, and results into, a block of 64-bit words."""

    def __init__(self, context: Any, builder: Any, block: Any) -> None:
        self._context, self._builder, self._block, self._place = context, builder, block, 0

    def _word(self) -> Any:
        place = self._builder.gep(self._block, [ir.IntType(64)(self._place)])
        self._place += 1
        return place

    def read(self, argument: Argument, kind: Any) -> Any:
        """Return the next argument as Numba's value."""
        builder, context = self._builder, self._context
        if isinstance(argument, Record):
            parts = [
                self.read(field, part) for (_, field), part in zip(argument.fields, kind.types, strict=True)
            ]
            return context.make_tuple(builder, kind, parts)
        if isinstance(argument, Scalar):
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

    def write(self, index: int, scalar: Scalar, value: Any) -> None:
        """Store a result in the first words of the block."""
        builder = self._builder
        place = builder.gep(self._block, [ir.IntType(64)(index)])
        if scalar.name == "float64":
            builder.store(value, builder.bitcast(place, ir.DoubleType().as_pointer()))
        else:
            builder.store(builder.zext(value, ir.IntType(64)) if scalar.name == "boolean" else value, place)


def _linked(library: Any) -> Any:
    """Return one module with all that a library and those it links hold."""
    module = library._final_module
    for child in dict.fromkeys(library._linking_libraries):
        module.link_in(child._get_module_for_linking(), preserve=True)
    module.link_in(llvm.parse_assembly(_RUNTIME))
    for function in list(module.functions):
        if function.is_declaration and function.name in _EXCEPTIONS:
            head = re.search(rf"declare (?:noundef )?(\w+) (@{function.name}\([^)]*\))", str(function))
            assert head is not None, str(function)
            body = "{\n  call void @abort()\n  unreachable\n}"
            body = f"declare void @abort()\ndefine {head[1]} {head[2]} {body}"
            module.link_in(llvm.parse_assembly(body))
    return module


# What unpacks the arguments of exceptions that Numba foresees (slices of different lengths).  Nothing here
# does: an exception becomes a status.
_EXCEPTIONS = frozenset(["PyErr_SetString", "PyUnicode_FromKindAndData", "PyObject_Hash", "PyTuple_Pack"])


def _simplified(module: Any, symbols: Sequence[str]) -> bytes:
    """Return the bitcode of a module without what only Numba needs: references, calls of small functions.

    Loops are not vectorized: that is done for a certain processor.
    """
    keep_entries(module, symbols)
    module.verify()
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = tuning.slp_vectorization = False
    builder = llvm.create_pass_builder(target_machine(portable_target()), tuning)
    manager = builder.getModulePassManager()
    manager.add_refprune_pass()
    manager.add_global_dead_code_eliminate_pass()
    manager.add_strip_symbols_pass()  # names are a third of the file, and differ from run to run
    manager.add_strip_dead_prototype_pass()
    manager.run(module, builder)
    return bytes(module.as_bitcode())
