"""Compilation of IR to object files, and loading of object files as machine code."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from functools import cache

import llvmlite.binding as llvm

from pepper_kin.kernels.target import Target

LOADING = threading.RLock()
"""Lock held while machine code is made or loaded: LLVM is thread-safe in compiling, but not in creating
engines and targets concurrently.  A process forks while the lock is free, so that children can compile."""

if hasattr(os, "register_at_fork"):
    os.register_at_fork(
        before=LOADING.acquire, after_in_parent=LOADING.release, after_in_child=LOADING.release
    )


class LoadedCode:
    """Machine code that is ready to run; it lives as long as this object.

    Args:
        object_code: An object file of `compile_ir`.
        target: The processor for which it was made.
    """

    def __init__(self, object_code: bytes, target: Target) -> None:
        with LOADING:
            empty = llvm.parse_assembly("")
            self._engine = llvm.create_mcjit_compiler(empty, target_machine(target))
            self._engine.add_object_file(llvm.ObjectFileRef.from_data(object_code))
            self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Address of a function of the object file."""
        return int(self._engine.get_function_address(name))


def compile_ir(ir: str, target: Target) -> bytes:
    """Translate a module to an object file for a processor."""
    with LOADING:
        return bytes(target_machine(target).emit_object(_parsed(ir)))


def compile_portable(parts: Sequence[bytes], target: Target, symbols: Sequence[str]) -> bytes:
    """Translate entry points of portable code, and what they call, to an object file for a processor.

    Args:
        parts: Bitcode of all functions, from `numba_builder.portable_parts`.
        target: The processor.
        symbols: Names of the entry points; their C functions, whose names end in `_direct`, are included.

    Raises:
        RuntimeError: The functions need more than the C library.
    """
    with LOADING:
        machine = target_machine(target, opt=3)
        module = llvm.parse_bitcode(parts[0])
        for part in parts[1:]:
            module.link_in(llvm.parse_bitcode(part))
        module.triple, module.data_layout = target.triple, str(machine.target_data)
        keep_entries(module, symbols)
        for vectorize in (False, True):  # the first run inlines, the second vectorizes loops
            tuning = llvm.create_pipeline_tuning_options(speed_level=3)
            tuning.loop_vectorization = tuning.slp_vectorization = tuning.loop_unrolling = vectorize
            builder = llvm.create_pass_builder(machine, tuning)
            remover = llvm.create_new_module_pass_manager()
            remover.add_global_dead_code_eliminate_pass()
            remover.run(module, builder)
            manager = builder.getModulePassManager()
            manager.add_refprune_pass()
            manager.run(module, builder)
        module.verify()
        foreign = [f.name for f in module.functions if f.is_declaration and not _is_known(f.name)]
        if foreign:
            raise RuntimeError(f"compiled functions need Numba's run time: {', '.join(foreign)}")
        return bytes(machine.emit_object(module))


def keep_entries(module: llvm.ModuleRef, symbols: Sequence[str]) -> None:
    """Export only the entry points of a module: other functions are inlined into callers, or removed."""
    names = {name for symbol in symbols for name in (symbol, symbol + "_direct")}
    for function in module.functions:
        if not function.is_declaration:
            function.linkage = "external" if function.name in names else "internal"
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"  # unused names are half of a small object file


def assembly(ir: str, target: Target) -> str:
    """Return the code of `compile_ir` as assembly text to read."""
    with LOADING:
        return str(target_machine(target).emit_assembly(_parsed(ir)))


def _parsed(ir: str) -> llvm.ModuleRef:
    """Return the module of an IR text, unoptimized.

    No optimization passes run on it: the writer has folded constants and shared values already, and LLVM's
    standard pipeline doubled the time of compiling without making any kernel faster (measured).
    """
    module = llvm.parse_assembly(ir)
    module.verify()
    return module


def target_machine(target: Target, opt: int = 1) -> llvm.TargetMachine:
    """Return LLVM's code generator for a processor, with this level of optimization."""
    _initialize(target.triple == llvm.get_process_triple())
    return llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, features=target.features, opt=opt, reloc="pic", codemodel="jitdefault", jit=True
    )


def _is_known(name: str) -> bool:
    """Return whether a function belongs to LLVM or the C library."""
    return name.startswith("llvm.") or name in _C_LIBRARY


_C_LIBRARY = frozenset(
    [
        "abort", "malloc", "free", "aligned_alloc", "memcpy", "memset", "memmove", "memcmp", "sin",
        "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "expm1", "exp2",
        "log", "log1p", "log2", "pow", "sqrt", "cbrt", "fabs", "floor", "ceil",
        "round", "trunc", "rint", "fmod", "hypot", "sinh", "cosh", "tanh", "fmin",
        "fmax", "copysign", "ldexp", "frexp", "sinf", "cosf", "tanf", "sqrtf", "fabsf",
        "floorf", "ceilf", "powf", "expf", "logf", "fminf", "fmaxf",
    ]
)  # fmt: skip


@cache
def _initialize(native: bool) -> None:
    """Initialize LLVM for this platform, or for all platforms."""
    if native:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
    else:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
