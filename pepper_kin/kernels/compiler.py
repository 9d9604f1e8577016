"""From IR to machine code in memory, through an object file that can be kept."""

from __future__ import annotations

import threading
from functools import cache

import llvmlite.binding as llvm

from pepper_kin.kernels.target import Target

# LLVM's own thread safety covers compiling, not creating engines and targets side by side.
_LOCK = threading.RLock()


class LoadedCode:
    """Machine code that is ready to run; it lives as long as this object.

    Args:
        object_code: An object file, as made by `compile_ir`.
        target: The processor it was made for.
    """

    def __init__(self, object_code: bytes, target: Target) -> None:
        with _LOCK:
            empty = llvm.parse_assembly("")
            self._engine = llvm.create_mcjit_compiler(empty, target_machine(target))
            self._engine.add_object_file(llvm.ObjectFileRef.from_data(object_code))
            self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Address of a function of the object file."""
        return int(self._engine.get_function_address(name))


def compile_ir(ir: str, target: Target) -> bytes:
    """Translate a module to an object file for a processor."""
    with _LOCK:
        return bytes(target_machine(target).emit_object(_parsed(ir)))


def assembly(ir: str, target: Target) -> str:
    """The same code as `compile_ir` makes, as assembly text to read."""
    with _LOCK:
        return str(target_machine(target).emit_assembly(_parsed(ir)))


def _parsed(ir: str) -> llvm.ModuleRef:
    """The module as written.

    No optimisation passes run on it: the writer has folded constants and shared values already, and LLVM's
    standard pipeline doubled the time of compiling without making any kernel faster (measured).
    """
    module = llvm.parse_assembly(ir)
    module.verify()
    return module


def target_machine(target: Target, opt: int = 1) -> llvm.TargetMachine:
    """Return LLVM's code generator for a processor, with this level of optimization."""
    _initialize()
    return llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, features=target.features, opt=opt, reloc="pic", codemodel="jitdefault", jit=True
    )


@cache
def _initialize() -> None:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
